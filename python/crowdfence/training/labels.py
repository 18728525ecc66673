"""What the network is to mark in an image, cell by cell, as training wants it."""

from __future__ import annotations

from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.evaluation.frame_labels import Target
from crowdfence.evaluation.ground_labels import STRIDE, ground_cells
from crowdfence.sources.recording import Frame, Recording

__all__ = ["STRIDE", "TARGETS", "CellLabels", "Target", "cell_labels"]

TARGETS: tuple[Target, ...] = get_args(Target)


class CellLabels(NamedTuple):
    """Labels of one image for one target."""

    crowd: NDArray[np.uint8]
    """[h, w] share of the cell that is crowd, times 255."""
    known: NDArray[np.bool_]
    """[h, w] False where the truth cannot be told from the image: such cells teach nothing."""


def cell_labels(target: Target, frame: Frame, recording: Recording, terrain: Terrain | None) -> CellLabels:
    """Labels [h, w] of a frame at `STRIDE`. FrameError when its truth cannot be read, ValueError when
    `ground` is wanted without a terrain."""
    if target == "silhouettes":
        return _silhouette_cells(frame)
    if target == "ground":
        if terrain is None:
            raise ValueError(f"{recording.name} comes without a map, which the target 'ground' needs")
        cells = ground_cells(frame, recording, terrain)
        return CellLabels(np.rint(cells.share * 255.0).astype(np.uint8), cells.known)
    raise ValueError(f"target is {target!r}; it must be one of {', '.join(TARGETS)}")


def _silhouette_cells(frame: Frame) -> CellLabels:
    regions = frame.regions() > 0
    rows, columns = regions.shape[0] // STRIDE, regions.shape[1] // STRIDE
    blocks = regions[: rows * STRIDE, : columns * STRIDE].reshape(rows, STRIDE, columns, STRIDE)
    return CellLabels(
        np.rint(blocks.mean(axis=(1, 3)) * 255.0).astype(np.uint8), np.ones((rows, columns), np.bool_)
    )
