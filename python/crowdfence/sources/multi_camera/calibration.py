"""Calibrations as OpenCV writes them (XML) -> cameras and where they stand."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as xml

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera
from crowdfence.errors import one_line
from crowdfence.sources.multi_camera.layout import CALIBRATIONS, Layout


class FixedCamera(NamedTuple):
    name: str
    """C1, C2, ..., the folder of its pictures."""
    camera: Camera
    world_from_camera: NDArray[np.float64]
    """[4, 4], metres."""


def read_cameras(folder: Path, layout: Layout, size: tuple[int, int]) -> list[FixedCamera]:
    """Every camera of a data set whose pictures have the size (width, height).

    ValueError for a calibration that cannot be read or stands below the ground.
    """
    intrinsics = sorted((folder / CALIBRATIONS / layout.intrinsics).glob("*.xml"))
    extrinsics = sorted((folder / CALIBRATIONS / "extrinsic").glob("*.xml"))
    if not intrinsics or len(intrinsics) != len(extrinsics):
        raise ValueError(
            f"{folder / CALIBRATIONS} holds {len(intrinsics)} camera matrices and {len(extrinsics)} poses; "
            "each camera needs one of both"
        )
    pairs = enumerate(zip(intrinsics, extrinsics, strict=True), start=1)
    return [
        FixedCamera(f"C{number}", _camera(matrix, size), _pose(pose, layout.unit_m))
        for number, (matrix, pose) in pairs
    ]


def _camera(path: Path, size: tuple[int, int]) -> Camera:
    matrix = _numbers(path, "camera_matrix", 9).reshape(3, 3)
    try:
        # OpenCV counts from the middle of the first pixel.
        return Camera.pinhole(*size, matrix[0, 0], matrix[1, 1], matrix[0, 2] + 0.5, matrix[1, 2] + 0.5)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _pose(path: Path, unit_m: float) -> NDArray[np.float64]:
    from scipy.spatial.transform import Rotation

    camera_from_world = Rotation.from_rotvec(_numbers(path, "rvec", 3)).as_matrix()
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = camera_from_world.T
    world_from_camera[:3, 3] = -camera_from_world.T @ (_numbers(path, "tvec", 3) * unit_m)
    if not world_from_camera[2, 3] > 0.0:
        raise ValueError(
            f"{path}: the camera stands {-world_from_camera[2, 3]:g} m below the ground; z must be up"
        )
    return world_from_camera


def _numbers(path: Path, name: str, count: int) -> NDArray[np.float64]:
    """The numbers of an element, plain or in OpenCV's matrix form."""
    data = path.read_bytes()
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ValueError(f"{path} declares entities, which no calibration needs")
    try:
        root = xml.fromstring(data)
        element = root.find(name)
        if element is None:
            raise ValueError(f"it has no {name}")
        matrix = element.find("data")
        text = (element if matrix is None else matrix).text or ""
        values = np.array([float(number) for number in text.split()])
    except (xml.ParseError, ValueError, LookupError) as error:  # the last of an unknown encoding
        raise ValueError(f"{path} cannot be read: {one_line(error)}") from error
    if values.shape != (count,) or not np.isfinite(values).all():
        raise ValueError(f"{path}: {name} must hold {count} finite numbers, got {len(values)}")
    return values
