"""Equation 4 at many thresholds at once: no other choice decides more in the paper's method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.evaluation.iou import MeanIou


@dataclass(frozen=True, slots=True)
class SweepResult:
    """Mean IoU as a function of the threshold."""

    thresholds: NDArray[np.float64]
    """[K], increasing."""
    per_frame: NDArray[np.float64]
    """[T, K]; NaN where neither map nor truth has a crowd voxel."""

    def at(self, threshold: float) -> MeanIou:
        """Equation 4 at one of the thresholds. ValueError for any other."""
        matches = np.flatnonzero(self.thresholds == threshold)
        if matches.size == 0:
            raise ValueError(f"threshold {threshold} is none of the {len(self.thresholds)} that were swept")
        return self._score(int(matches[0]))

    def best(self) -> tuple[float, MeanIou]:
        """The threshold with the largest mean IoU on this very recording: an upper bound, not a forecast. NaN
        where none has any above 0, as where no crowd was in view: of all that find nothing none is best, the
        lowest, which calls all ground crowd, least of all."""
        means = [self._score(column).mean for column in range(len(self.thresholds))]
        if np.isnan(means).all():
            return float("nan"), self._score(0)
        column = int(np.nanargmax(means))
        best = float(self.thresholds[column]) if means[column] > 0.0 else float("nan")
        return best, self._score(column)

    def _score(self, column: int) -> MeanIou:
        iou = self.per_frame[:, column]
        counted = iou[~np.isnan(iou)]
        if counted.size == 0:
            return MeanIou(np.nan, np.nan, iou)
        return MeanIou(float(counted.mean()), float(counted.std()), iou)


class ThresholdSweep:
    """Counts frame after frame; each costs what was seen, whatever the number of thresholds."""

    def __init__(self, thresholds: ArrayLike, *, above: bool = False) -> None:
        """`above`: a voxel is called crowd above a threshold, which may be 0, as `or` calls it by its mean
        heatmap value; else from the threshold on, as maps are by their probability. ValueError for thresholds
        outside (0, 1]."""
        self._thresholds = np.unique(np.asarray(thresholds, dtype=np.float64))
        low, high = (self._thresholds[[0, -1]]) if self._thresholds.size else (np.nan, np.nan)
        if not ((low >= 0.0 if above else low > 0.0) and high <= 1.0):
            raise ValueError(f"thresholds must be one or more numbers in {'[' if above else '('}0, 1]")
        self._side: Literal["left", "right"] = "left" if above else "right"
        self._per_frame: list[NDArray[np.float64]] = []

    def update(self, probability: ArrayLike, truth: ArrayLike) -> None:
        """Count one frame: probability [S] and truth bool [S] of the voxels seen so far."""
        probabilities, crowd = np.asarray(probability), np.asarray(truth)
        if crowd.dtype != np.bool_ or crowd.shape != probabilities.shape:
            raise ValueError(
                f"truth must be bool {list(probabilities.shape)}, got {crowd.dtype} {list(crowd.shape)}"
            )
        # A voxel is called crowd at every threshold up to its probability: at the first `reached` of them.
        reached = np.searchsorted(self._thresholds, probabilities, side=self._side)
        called = self._at_least(reached)
        both = self._at_least(reached[crowd])
        union = called + np.count_nonzero(crowd) - both
        with np.errstate(invalid="ignore"):
            self._per_frame.append(both / np.where(union > 0, union, np.nan))

    def _at_least(self, reached: NDArray[np.int64]) -> NDArray[np.int64]:
        """How many voxels reach each threshold [K]."""
        counts = np.bincount(reached, minlength=len(self._thresholds) + 1)
        return counts[::-1].cumsum()[::-1][1:]

    def result(self) -> SweepResult:
        """ValueError before the first frame."""
        if not self._per_frame:
            raise ValueError("mean IoU of no frames: give at least one frame")
        return SweepResult(self._thresholds, np.array(self._per_frame))
