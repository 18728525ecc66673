"""Which pixels of a frame a detector should mark: the label that it is judged and calibrated by."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.errors import FrameError
from crowdfence.sources.recording import Frame, Recording
from crowdfence.truth.crowd_masks import MaskOf, crowd_mask, has_crowd_mask
from crowdfence.truth.ground_labels import GroundCells, ground_cells

Target = Literal["silhouettes", "ground"]

TARGET_HEIGHT_M: dict[str, float] = {"silhouettes": 0.6, "ground": 0.0}
"""Height above ground at which a target is best projected, as measured by `training/compare_targets.py`:
silhouettes a little below the middle of the body, since the feet stand on the ground that is meant."""


def label_functions(
    target: Target, recording: Recording, terrain: Terrain | None
) -> tuple[MaskOf, MaskOf | None]:
    """`mask_of` and `ignore_of` of the frames of a recording; both raise FrameError where the truth is
    missing.

    `silhouettes`: recorded crowd regions, or silhouettes merged and filled; every pixel counts. `ground`: the
    ground that crowds stand on, as seen from the drone; what things hide does not count. ValueError for
    another target, and for `ground` without a terrain or without recorded people.
    """
    if target == "silhouettes":
        return _silhouettes, None
    if target != "ground":
        raise ValueError(f"target is {target!r}; it must be one of {', '.join(get_args(Target))}")
    if not len(recording.people.stamps_ns):
        raise ValueError(
            f"{recording.name} is not labelled: it does not record where people stand, which the target "
            "'ground' needs"
        )
    if terrain is None:
        raise ValueError(f"{recording.name} comes without a map, which the target 'ground' needs")
    ground = _GroundLabels(recording, terrain)
    return ground.crowd, ground.unknown


def _silhouettes(frame: Frame) -> NDArray[np.bool_]:
    if not has_crowd_mask(frame):
        raise FrameError(frame.drone, frame.stamp_ns, "has no truth: neither crowd regions nor silhouettes")
    return crowd_mask(frame)


class _GroundLabels:
    """Labels of the ground, kept for the frame that was asked for last."""

    def __init__(self, recording: Recording, terrain: Terrain) -> None:
        self._recording, self._terrain = recording, terrain
        self._last: tuple[Frame, GroundCells] | None = None

    def crowd(self, frame: Frame) -> NDArray[np.bool_]:
        return self._of(frame).crowd

    def unknown(self, frame: Frame) -> NDArray[np.bool_]:
        return ~self._of(frame).known

    def _of(self, frame: Frame) -> GroundCells:
        if self._last is None or self._last[0] is not frame:
            self._last = frame, ground_cells(frame, self._recording, self._terrain)
        return self._last[1]
