"""What counts in the end: how many of the people of crowds in a picture stand in a cell that is called."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import FrameError
from crowdfence.evaluation.cells.scores import THRESHOLD
from crowdfence.sources.recording import Frame
from crowdfence.truth.at_exposure import true_camera_pose


@dataclass(slots=True)
class PeopleFound:
    """People of crowds whose feet lie in the picture and of whom a pixel shows, and cells of ground without
    crowd, both where metres per pixel lie within a model's tested range. Sums over frames."""

    people: int = 0
    found: int = 0
    """Their feet stand in a cell with a value above 0.5."""
    empty_cells: int = 0
    called_cells: int = 0
    """Empty cells with a value above 0.5."""

    def add(
        self,
        frame: Frame,
        heatmap: NDArray[np.floating[Any]],
        crowd: NDArray[np.bool_],
        gsd_m: NDArray[np.float64],
        tested_m: tuple[float, float] | None,
    ) -> None:
        """One frame. heatmap, crowd and gsd_m [h, w]; cells whose truth is not known have no gsd_m (NaN).

        FrameError where the frame records its people but they cannot be read; a frame that records none adds
        its cells alone.
        """
        low, high = tested_m or (0.0, np.inf)
        called = heatmap > THRESHOLD
        empty = ~crowd & (gsd_m >= low) & (gsd_m <= high)
        self.empty_cells += int(empty.sum())
        self.called_cells += int((empty & called).sum())
        if frame.truth.people is None:
            return
        at, distance_m = _feet_of_crowds(frame)
        gsd = distance_m / np.sqrt(frame.camera.fx * frame.camera.fy)
        tested = (gsd >= low) & (gsd <= high)
        size = np.array([frame.camera.width, frame.camera.height])
        column, row = np.floor(at[tested] * (np.array(called.shape[::-1]) / size)).astype(np.intp).T
        self.people += int(tested.sum())
        self.found += int(called[row, column].sum())

    @property
    def share_found(self) -> float:
        return self.found / self.people if self.people else np.nan

    @property
    def share_called(self) -> float:
        return self.called_cells / self.empty_cells if self.empty_cells else np.nan

    def to_json(self) -> dict[str, Any]:
        """Ready for JSON; unknown is null."""
        return {
            "people_of_crowds": self.people,
            "share_found": self.share_found if self.people else None,
            "empty_cells": self.empty_cells,
            "share_called": self.share_called if self.empty_cells else None,
        }


def _feet_of_crowds(frame: Frame) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels [N, 2] and distances [N] of the feet that lie in the picture, of people who are not hidden."""
    people = frame.people()
    if people.pixels is None:
        raise FrameError(frame.drone, frame.stamp_ns, "records people, but not how many pixels show them")
    feet = people.position[(people.crowd > 0) & (people.pixels > 0)].astype(np.float64)
    world_from_camera = true_camera_pose(frame)
    ray = (feet - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
    feet_camera = ray[ray[:, 2] > 0.0]
    pixels = frame.camera.project(feet_camera) if len(feet_camera) else np.empty((0, 2))
    size = np.array([frame.camera.width, frame.camera.height])
    inside = ((pixels >= 0.0) & (pixels < size)).all(axis=1)  # also false for NaN
    return pixels[inside], np.linalg.norm(feet_camera[inside], axis=1)
