"""What counts in the end: how many of the people of crowds in a picture stand in a cell that is called."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import FrameError
from crowdfence.evaluation.cells.scores import AFFORDABLE_FALSE_POSITIVE_RATE, THRESHOLD
from crowdfence.evaluation.cells.value_histogram import BINS, bin_of_values
from crowdfence.sources.recording import Frame
from crowdfence.truth.at_exposure import true_camera_pose


class PeopleFound:
    """People of crowds whose feet lie in the picture and of whom a pixel shows, and cells of ground without
    crowd, both where metres per pixel lie within a model's tested range. Sums over frames."""

    def __init__(self) -> None:
        self._people, self._empty = np.zeros(BINS), np.zeros(BINS)

    def add(
        self,
        frame: Frame,
        heatmap: NDArray[np.floating[Any]],
        crowd: NDArray[np.bool_],
        gsd_m: NDArray[np.float64],
        tested_m: tuple[float, float] | None,
        stride: int | None = None,
    ) -> None:
        """One frame. heatmap, crowd and gsd_m [h, w]; cells whose truth is not known have no gsd_m (NaN).
        `stride`: pixels along the cells, the last of which may reach beyond the picture; None: they divide it
        evenly.

        FrameError where the frame records its people but they cannot be read; a frame that records none adds
        its cells alone.
        """
        low, high = tested_m or (0.0, np.inf)
        values = heatmap.astype(np.float64)
        empty = ~crowd & (gsd_m >= low) & (gsd_m <= high)
        self._empty += np.bincount(bin_of_values(values[empty]), minlength=BINS)
        if frame.truth.people is None:
            return
        at, distance_m = _feet_of_crowds(frame)
        gsd = distance_m / np.sqrt(frame.camera.fx * frame.camera.fy)
        tested = (gsd >= low) & (gsd <= high)
        size = np.array([frame.camera.width, frame.camera.height])
        cells_per_px = np.array(values.shape[::-1]) / size if stride is None else 1.0 / stride
        column, row = np.floor(at[tested] * cells_per_px).astype(np.intp).T
        self._people += np.bincount(bin_of_values(values[row, column]), minlength=BINS)

    @property
    def people(self) -> int:
        return int(self._people.sum())

    @property
    def empty_cells(self) -> int:
        return int(self._empty.sum())

    def share_found(self, threshold: float = THRESHOLD) -> float:
        """Share of the people who stand in a cell with a value above `threshold`; NaN without people, and for
        a threshold that is NaN."""
        return _share_above(self._people, threshold)

    def share_called(self, threshold: float = THRESHOLD) -> float:
        """Share of the empty cells with such a value; NaN without empty cells."""
        return _share_above(self._empty, threshold)

    def affordable_threshold(self) -> float:
        """The lowest that calls at most 1 % of the empty cells crowd, in steps of 1 / 960; NaN without empty
        cells, where even one that calls everything would cost nothing."""
        if not self.empty_cells:
            return float("nan")
        above = np.cumsum(self._empty[::-1])[::-1]
        affordable = np.flatnonzero(above <= AFFORDABLE_FALSE_POSITIVE_RATE * self._empty.sum())
        return float(affordable[0]) / BINS if affordable.size else 1.0

    def to_json(self) -> dict[str, Any]:
        """Ready for JSON; unknown is null."""
        threshold = self.affordable_threshold()
        shares = {
            "share_found": self.share_found(),
            "share_called": self.share_called(),
            "threshold_at_one_percent": threshold,
            "share_found_at_one_percent": self.share_found(threshold),
        }
        plain = {name: None if value != value else value for name, value in shares.items()}
        return {"people_of_crowds": self.people, "empty_cells": self.empty_cells, **plain}


def _share_above(histogram: NDArray[np.float64], threshold: float) -> float:
    total = histogram.sum()
    if not total or threshold != threshold:
        return float("nan")
    return float(histogram[round(threshold * BINS) :].sum() / total)


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
