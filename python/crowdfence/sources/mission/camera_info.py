"""Our `Camera` <-> sensor_msgs/CameraInfo.

ROS and OpenCV put the centre of the first pixel at (0, 0), we put it at (0.5, 0.5): cx, cy differ by a half.
"""

import re
from typing import Any

import numpy as np

from crowdfence._core import Camera
from crowdfence.sources.rotation_angle import angle_between_deg

_HALF_PIXEL = 0.5
_IDENTITY = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
_RECTIFIED = re.compile(r"(?:^|[/_])(?:rect(?:ified)?|undist(?:ort(?:ed)?)?)(?:[/_]|$)")
_MOST_TURN_DEG = 0.2
"""By which pictures may be rectified away from the frame of their poses: 0.35 m in 100 m."""


def camera_info_fields(camera: Camera, size: tuple[int, int] | None = None) -> dict[str, Any]:
    """The fields of a CameraInfo message apart from its header; `size` (width, height) is that of a raster
    over the whole image, None = the image's own."""
    width, height = size or (camera.width, camera.height)
    across, down = width / camera.width, height / camera.height
    fx, fy = camera.fx * across, camera.fy * down
    cx, cy = camera.cx * across - _HALF_PIXEL, camera.cy * down - _HALF_PIXEL
    fisheye = camera.model == "kannala_brandt"
    return {
        "height": height,
        "width": width,
        "distortion_model": "equidistant" if fisheye else "plumb_bob",
        "d": list(camera.distortion) or [0.0] * 5,
        "k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "r": _IDENTITY,
        "p": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }


def camera_from_info(info: Any) -> Camera:
    """Camera of a decoded CameraInfo message.

    ValueError for a distortion model other than plumb_bob (also told as a rational_polynomial whose
    denominator is 1) and equidistant, for an image that is a binned or cut part of the sensor (its intrinsics
    would need correcting), and for intrinsics that the core refuses.
    """
    _require_whole(info)
    fx, fy = info.k[0], info.k[4]
    cx, cy = info.k[2] + _HALF_PIXEL, info.k[5] + _HALF_PIXEL
    distortion = list(info.d)
    if info.distortion_model == "equidistant":
        return Camera.fisheye(info.width, info.height, fx, fy, cx, cy, distortion or [0.0] * 4)
    if info.distortion_model == "rational_polynomial" and not any(distortion[5:]):
        distortion = distortion[:5]  # without a denominator it is plumb_bob, and OpenCV's drivers write it so
    elif info.distortion_model not in ("plumb_bob", ""):
        raise ValueError(
            f"distortion model {info.distortion_model!r} is not supported (plumb_bob, equidistant)"
        )
    return Camera.pinhole(info.width, info.height, fx, fy, cx, cy, distortion if any(distortion) else None)


def is_rectified(topic: str) -> bool:
    """Whether the pictures of a topic are rectified, by the names that image_proc and others give, such as
    image_rect, image_rect_color, image_undistorted. Their CameraInfo is that of the raw pictures."""
    return _RECTIFIED.search(topic) is not None


def rectified_camera(info: Any) -> Camera:
    """Camera of the pictures that were rectified as a decoded CameraInfo says: a pinhole by its P.

    ValueError where P is empty and the lens distorts, where R turns the pictures away from the frame that
    poses mean, and as for `camera_from_info`.
    """
    _require_whole(info)
    p, r = info.p, np.array(info.r, np.float64)
    if not p[0] > 0.0:
        if any(info.d):
            raise ValueError("the pictures are rectified, and P in camera_info, which says how, is empty")
        return camera_from_info(info)
    turn_deg = angle_between_deg(r.reshape(3, 3), np.eye(3)) if r.any() else 0.0
    if turn_deg > _MOST_TURN_DEG:
        raise ValueError(
            f"the pictures are rectified and turned by {turn_deg:.2f} degrees against the camera (R in "
            f"camera_info), at most {_MOST_TURN_DEG:g} are taken: name the raw pictures"
        )
    return Camera.pinhole(info.width, info.height, p[0], p[5], p[2] + _HALF_PIXEL, p[6] + _HALF_PIXEL)


def _require_whole(info: Any) -> None:
    roi = info.roi
    of_all = (roi.x_offset, roi.y_offset, roi.width, roi.height) == (0, 0, info.width, info.height)
    cut = (roi.width or roi.height) and not of_all
    if info.binning_x > 1 or info.binning_y > 1 or cut:
        raise ValueError("binned or cut images (binning_x, binning_y, roi in camera_info) are not supported")
