"""One frame as pixels: the picture as taken, and the picture with what is known about it on top."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import FrameError
from crowdfence.sources.recording import Frame

CLASS_COLOURS = {
    "sky": (150, 190, 230),
    "ground": (139, 152, 112),
    "road": (74, 78, 92),
    "crowd": (232, 48, 70),
    "cyclist": (255, 196, 0),
}
REGION_COLOUR = (255, 120, 20)
HEATMAP_COLOUR = (232, 48, 70)
_LABEL_SHARE, _REGION_SHARE, _HEATMAP_SHARE = 0.72, 0.45, 0.85
_BLANK = 214

Rgb = NDArray[np.uint8]


def photograph(frame: Frame) -> Rgb | None:
    """The picture [H, W, 3], None when there is none that can be read."""
    if frame.pixels.image is None:
        return None
    try:
        return frame.image()
    except FrameError:
        return None


def labelled(frame: Frame) -> tuple[Rgb, str] | None:
    """The frame's labels over its picture [H, W, 3] and what they are; None when it has none.

    The best that is there: classes with the outline of crowd regions, crowd regions or silhouettes alone, or
    the heatmap.
    """
    ground = _grey(photograph(frame), frame)
    for what, paint in (
        ("true classes, crowd regions outlined", _classes),
        ("true crowd regions", _regions),
        ("heatmap", _heatmap),
    ):
        try:
            painted = paint(frame, ground)
        except FrameError:
            continue
        if painted is not None:
            return painted.round().clip(0, 255).astype(np.uint8), what
    return None


def _grey(photo: Rgb | None, frame: Frame) -> NDArray[np.float64]:
    if photo is None:
        return np.full((frame.camera.height, frame.camera.width, 3), float(_BLANK))
    return np.repeat(photo.astype(np.float64).mean(axis=-1, keepdims=True), 3, axis=-1)


def _classes(frame: Frame, ground: NDArray[np.float64]) -> NDArray[np.float64] | None:
    from crowdfence.sources.mission.layout import CLASSES

    if frame.pixels.segmentation is None:
        return None
    palette = np.full((256, 3), float(_BLANK))
    for number, name in CLASSES.items():
        palette[number] = CLASS_COLOURS[name]
    classes = frame.segmentation()
    painted = (1 - _LABEL_SHARE) * ground + _LABEL_SHARE * palette[classes]
    if frame.pixels.regions is not None:
        painted[_outline(frame.regions() > 0)] = REGION_COLOUR
    return painted


def _regions(frame: Frame, ground: NDArray[np.float64]) -> NDArray[np.float64] | None:
    if frame.pixels.regions is None and frame.pixels.silhouettes is None:
        return None
    crowd = frame.regions() > 0 if frame.pixels.regions is not None else frame.silhouettes()
    painted = ground.copy()
    painted[crowd] = (1 - _REGION_SHARE) * ground[crowd] + _REGION_SHARE * np.array(REGION_COLOUR)
    painted[_outline(crowd)] = REGION_COLOUR
    return painted


def _heatmap(frame: Frame, ground: NDArray[np.float64]) -> NDArray[np.float64] | None:
    if frame.pixels.heatmap is None:
        return None
    heatmap = np.asarray(frame.heatmap(), np.float64)
    heatmap = heatmap / 255.0 if frame.heatmap().dtype == np.uint8 else heatmap
    height, width = ground.shape[:2]
    row = np.minimum(np.arange(height) * heatmap.shape[0] // height, heatmap.shape[0] - 1)
    column = np.minimum(np.arange(width) * heatmap.shape[1] // width, heatmap.shape[1] - 1)
    share = _HEATMAP_SHARE * np.nan_to_num(heatmap)[row[:, None], column, None]
    return (1 - share) * ground + share * np.array(HEATMAP_COLOUR)


def _outline(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels just outside of the mask."""
    from scipy.ndimage import binary_dilation

    return np.asarray(binary_dilation(mask) & ~mask)
