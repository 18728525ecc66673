"""Our `Camera` <-> sensor_msgs/CameraInfo."""

import re
from typing import Any

import numpy as np

from crowdfence._core import Camera
from crowdfence.sources.lens.opencv_camera import HALF_PIXEL, focal_and_centre, opencv_camera
from crowdfence.sources.rotation_angle import angle_between_deg

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
    cx, cy = camera.cx * across - HALF_PIXEL, camera.cy * down - HALF_PIXEL
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

    ValueError as of `focal_and_centre` and `opencv_camera`, for a camera that is not calibrated, and for an
    image that is a binned or cut part of the sensor: its intrinsics would need correcting.
    """
    _require_whole(info)
    if not any(info.k):
        raise ValueError("K in camera_info is all 0, as of a camera that is not calibrated")
    focal_px, centre_px = focal_and_centre(list(info.k), "K in camera_info")
    size = info.width, info.height
    return opencv_camera(size, focal_px, centre_px, info.distortion_model, list(info.d))


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
    return Camera.pinhole(info.width, info.height, p[0], p[5], p[2] + HALF_PIXEL, p[6] + HALF_PIXEL)


def _require_whole(info: Any) -> None:
    roi = info.roi
    of_all = (roi.x_offset, roi.y_offset, roi.width, roi.height) == (0, 0, info.width, info.height)
    cut = (roi.width or roi.height) and not of_all
    if info.binning_x > 1 or info.binning_y > 1 or cut:
        raise ValueError("binned or cut images (binning_x, binning_y, roi in camera_info) are not supported")
