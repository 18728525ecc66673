"""Whether a probability means what it says: average precision, Brier score, calibration error."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

RELIABILITY_BINS = 15
_SCORE_BINS = 2000


class ProbabilityQuality:
    """Sums over voxels and moments; the figures are properties, NaN before there was a voxel."""

    def __init__(self) -> None:
        self.reliability = np.zeros((RELIABILITY_BINS, 3))
        """[15, 3] voxels, sum of their probability and crowd voxels, in equal bins of the probability."""
        self._squared = 0.0
        self._scores = np.zeros((2, _SCORE_BINS))

    def add(self, probability: ArrayLike, crowd: NDArray[np.bool_], score: ArrayLike | None = None) -> None:
        """Voxels seen so far: probability [S], whether they are crowd [S], and by what they are ranked [S],
        in [0, 1]; None = by their probability."""
        claimed = np.asarray(probability, np.float64)
        self._squared += float(((claimed - crowd) ** 2).sum())
        bins = np.minimum((claimed * RELIABILITY_BINS).astype(np.int64), RELIABILITY_BINS - 1)
        for column, weights in enumerate((None, claimed, crowd)):
            self.reliability[:, column] += np.bincount(bins, weights, minlength=RELIABILITY_BINS)
        ranks = _rank(claimed if score is None else np.asarray(score, np.float64))
        for row, some in enumerate((ranks[~crowd], ranks[crowd])):
            self._scores[row] += np.bincount(some, minlength=_SCORE_BINS)

    @property
    def voxels(self) -> float:
        return float(self.reliability[:, 0].sum())

    @property
    def brier(self) -> float:
        """Mean squared difference to the truth."""
        return self._squared / self.voxels if self.voxels else float("nan")

    @property
    def calibration_error(self) -> float:
        """Expected calibration error: mean distance of probability and share of crowd in a bin."""
        _, probability, crowd = self.reliability.T
        return float(np.abs(probability - crowd).sum() / self.voxels) if self.voxels else float("nan")

    @property
    def average_precision(self) -> float:
        """Precision, averaged over the crowd voxels, each at its own rank."""
        empty, crowd = self._scores[:, ::-1]
        found = crowd.cumsum()
        if not found[-1]:
            return float("nan")
        called = found + empty.cumsum()
        return float((crowd * found / np.maximum(called, 1.0)).sum() / found[-1])


def _rank(score: NDArray[np.float64]) -> NDArray[np.int64]:
    """Bins of equal width in log odds: a crowd is rare, so the ranks that matter are close to 0 or 1."""
    inside = np.clip(score, 1e-6, 1.0 - 1e-6)
    share = (np.log(inside / (1.0 - inside)) / np.log(1e6 - 1.0) + 1.0) / 2.0
    return np.asarray(np.clip((share * _SCORE_BINS).astype(np.int64), 0, _SCORE_BINS - 1))
