"""Our `Camera` <-> sensor_msgs/CameraInfo.

ROS and OpenCV put the centre of the first pixel at (0, 0), we put it at (0.5, 0.5): cx, cy differ by a half.
"""

from typing import Any

from crowdfence._core import Camera

_HALF_PIXEL = 0.5
_IDENTITY = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]


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

    ValueError for a distortion model other than plumb_bob and equidistant, for an image that is a binned or
    cut part of the sensor (its intrinsics would need correcting), and for intrinsics that the core refuses.
    """
    if info.binning_x > 1 or info.binning_y > 1 or info.roi.width or info.roi.height:
        raise ValueError("binned or cut images (binning_x, binning_y, roi in camera_info) are not supported")
    fx, fy = info.k[0], info.k[4]
    cx, cy = info.k[2] + _HALF_PIXEL, info.k[5] + _HALF_PIXEL
    distortion = list(info.d)
    if info.distortion_model == "equidistant":
        return Camera.fisheye(info.width, info.height, fx, fy, cx, cy, distortion or [0.0] * 4)
    if info.distortion_model not in ("plumb_bob", ""):
        raise ValueError(
            f"distortion model {info.distortion_model!r} is not supported (plumb_bob, equidistant)"
        )
    return Camera.pinhole(info.width, info.height, fx, fy, cx, cy, distortion if any(distortion) else None)
