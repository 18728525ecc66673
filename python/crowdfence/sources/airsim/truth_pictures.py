"""Truth pictures of an AirSim recording: which colour picture they belong to, and how depth is read."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera
from crowdfence.sources.airsim.table import ImageName
from crowdfence.sources.pictures.decoding import read_depth_cm, read_pfm

DEPTH_PLANAR, DEPTH_PERSPECTIVE, DEPTH_VIS, SEGMENTATION = 1, 2, 3, 5
"""AirSim's ImageType numbers. DepthVis is 8-bit and clipped at 100 m: a picture, not truth."""

TRUTH_TYPES = {
    DEPTH_PLANAR: "planar depth",
    DEPTH_PERSPECTIVE: "depth along the ray",
    SEGMENTATION: "segmentation",
}


def pair_truth(
    anchor: ImageName, number: int, anchors: int, of_camera: list[ImageName]
) -> tuple[dict[int, ImageName], int]:
    """The truth pictures of one line that belong to its `number`-th colour picture, and how many to none.

    Equal nanoseconds decide. AirSim itself reads the clock anew for every file; its pictures then pair by
    order, provided that the line lists as many of them (issues 2110 and 3177: it does not always).
    """
    truth: dict[int, ImageName] = {}
    unpaired = 0
    for image_type in TRUTH_TYPES:
        images = [image for image in of_camera if image.image_type == image_type]
        same = [image for image in images if image.stamp_ns == anchor.stamp_ns]
        if same:
            truth[image_type] = same[0]
        elif len(images) == anchors:
            truth[image_type] = images[number]
        elif number == 0:
            unpaired += len(images)
    return truth, unpaired


def depth_source(truth: dict[int, Path], camera: Camera) -> Callable[[], NDArray[np.float32]] | None:
    """How to read the depth of a frame from its truth pictures by type: planar depth as it is, depth along
    the ray times the ray's cosine to the z axis. None without either."""
    size = (camera.width, camera.height)
    if DEPTH_PLANAR in truth:
        planar = truth[DEPTH_PLANAR]
        return lambda: _read_depth(planar, size)
    if DEPTH_PERSPECTIVE in truth:
        along_ray = truth[DEPTH_PERSPECTIVE]
        return lambda: _read_depth(along_ray, size) * _cosines(camera)
    return None


def _read_depth(path: Path, size: tuple[int, int]) -> NDArray[np.float32]:
    return read_pfm(path, size) if path.suffix == ".pfm" else read_depth_cm(path, size)


def _cosines(camera: Camera) -> NDArray[np.float32]:
    """Cosine between every pixel's ray and the z axis [H, W]."""
    x = (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx
    y = (np.arange(camera.height) + 0.5 - camera.cy) / camera.fy
    cosines: NDArray[Any] = 1.0 / np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2)
    return cosines.astype(np.float32)
