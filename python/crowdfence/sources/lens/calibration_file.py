"""Calibration files -> `Camera`: OpenCV, ROS camera_info and kalibr camchain, all YAML.

A camchain of several cameras is named with its camera: camchain.yaml:cam1.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from crowdfence._core import Camera
from crowdfence.errors import one_line
from crowdfence.sources.lens.opencv_camera import focal_and_centre, opencv_camera

_READ = (
    "OpenCV's (camera_matrix, image_width), ROS's camera_info and kalibr's camchain are read, as YAML, and "
    "the numbers of other programs go into one like that (docs/recordings.md, Intrinsics)"
)
_LARGEST_BYTES = 1 << 20
_OF_BOTH = 4
"""So many coefficients may be of either model."""


def read_calibration(path: Path) -> Camera:
    """ValueError names what is missing, or a distortion model that is none of plumb_bob (radtan) and
    equidistant."""
    path, camera = _named_camera(path)
    content = _load(path)
    try:
        return _camera(content, camera)
    except KeyError as error:
        raise ValueError(f"{path} is no calibration: no {error.args[0]}; {_READ}") from error
    except (TypeError, IndexError, AttributeError, ValueError, OverflowError) as error:
        raise ValueError(f"{path} cannot be used as a calibration: {one_line(error)}") from error


def _named_camera(path: Path) -> tuple[Path, str | None]:
    stem, colon, camera = path.name.rpartition(":")
    return (path.with_name(stem), camera) if colon and not path.exists() else (path, None)


def _load(path: Path) -> dict[str, Any]:
    import yaml

    if path.stat().st_size > _LARGEST_BYTES:
        raise ValueError(f"{path} has {path.stat().st_size} bytes, too many for a calibration")
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    # OpenCV writes a directive and tags that YAML parsers do not know.
    text = re.sub(r"^%YAML.*\n", "", text).replace("!!opencv-matrix", "")
    try:
        content = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise ValueError(f"{path} is not YAML: {one_line(error)}; {_READ}") from error
    if not isinstance(content, dict):
        raise ValueError(f"{path} is no calibration: a table of names is expected; {_READ}")
    return content


def _camera(content: dict[str, Any], camera: str | None) -> Camera:
    cameras = [name for name in content if re.fullmatch(r"cam\d+", str(name))]
    if cameras:
        if camera is not None and camera not in cameras:
            raise ValueError(f"no camera {camera!r}; it has {', '.join(cameras)}")
        return _of_kalibr(content[camera or cameras[0]])
    matrix = _matrix(content["camera_matrix"] if "camera_matrix" in content else content["Camera_Matrix"])
    width = int(content.get("image_width") or content["image_Width"])
    height = int(content.get("image_height") or content["image_Height"])
    # OpenCV's own program: its four numbers would fit plumb_bob too.
    model = str(content.get("distortion_model", "fisheye" if content.get("fisheye_model") else ""))
    names = ("distortion_coefficients", "Distortion_Coefficients", "dist_coeffs")
    coefficients = next((_matrix(content[name]) for name in names if name in content), None)
    if coefficients is None:
        # Under another name they would be left out, and every ray be another than was measured.
        if misnamed := [
            name for name in content if re.match(r"dist(?!ortion_model$)|d$|k1$", str(name), re.I)
        ]:
            raise ValueError(f"{misnamed[0]!r} is not known: if it is the distortion, call it {names[0]}")
        coefficients = []
    if len(matrix) != 9:
        raise ValueError(f"camera_matrix has {len(matrix)} values, expected 9")
    focal_px, centre_px = focal_and_centre(matrix, "camera_matrix")
    told = "distortion_model" in content or "fisheye_model" in content
    if not told and len(coefficients) == _OF_BOTH and any(coefficients):
        raise ValueError(
            "4 distortion coefficients are those of cv2.fisheye, or k1, k2, p1, p2 of another lens: add a "
            "line distortion_model: equidistant for the former, plumb_bob for the latter"
        )
    return opencv_camera((width, height), focal_px, centre_px, model, coefficients)


def _of_kalibr(entry: dict[str, Any]) -> Camera:
    if entry["camera_model"] != "pinhole":
        raise ValueError(f"camera_model {entry['camera_model']!r} is not supported (pinhole)")
    fx, fy, cx, cy = (float(value) for value in entry["intrinsics"])
    width, height = (int(value) for value in entry["resolution"])
    model = str(entry.get("distortion_model", ""))
    model = "" if model == "none" else model
    return opencv_camera((width, height), (fx, fy), (cx, cy), model, entry["distortion_coeffs"])


def _matrix(entry: Any) -> list[float]:
    """A matrix as OpenCV and ROS write it, or as nested lists."""
    values = entry["data"] if isinstance(entry, dict) else entry
    flat = [value for row in values for value in (row if isinstance(row, list) else [row])]
    return [float(value) for value in flat]
