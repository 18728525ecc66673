"""Reliability of probabilities: does 0.7 mean 70 percent?"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.evaluation.cells.rates import labelled_cells


@dataclass(frozen=True, slots=True)
class Reliability:
    """Reliability table over equal bins of [0, 1] (arrays [bins]) and the scores that follow from it."""

    count: NDArray[np.int64]
    """Cells per bin; bin b holds values in [b, b + 1) / bins, the last one also 1."""
    mean_probability: NDArray[np.float64]
    """Mean value of the cells of a bin; NaN for an empty bin."""
    crowd_share: NDArray[np.float64]
    """Share of the cells of a bin that are crowd; NaN for an empty bin."""
    expected_calibration_error: float
    """Mean of |mean_probability - crowd_share| over the bins, weighted by count."""
    brier_score: float
    """Mean squared difference between value and truth."""


def reliability(
    heatmaps: Iterable[ArrayLike],
    masks: Iterable[ArrayLike],
    *,
    bins: int = 15,
    above: float = 0.0,
) -> Reliability:
    """Reliability of heatmaps against masks (input as in `detector_rates.confusion`).

    Most cells of a frame are empty and easy, and hide what happens to the rest: `above` leaves out cells
    with a smaller value. ValueError for unusable input, or when no cell is left.
    """
    if bins < 1:
        raise ValueError(f"bins must be at least 1, got {bins}")
    if not 0.0 <= above < 1.0:
        raise ValueError(f"above must lie in [0, 1), got {above}")
    count = np.zeros(bins, np.int64)
    value_sum, crowd_sum, squared_error = np.zeros(bins), np.zeros(bins), 0.0
    for values, crowd in labelled_cells(heatmaps, masks):
        kept = values >= above
        value, truth = values[kept], crowd[kept].astype(np.float64)
        bin_of = np.minimum((value * bins).astype(np.int64), bins - 1)
        count += np.bincount(bin_of, minlength=bins)
        value_sum += np.bincount(bin_of, value, minlength=bins)
        crowd_sum += np.bincount(bin_of, truth, minlength=bins)
        squared_error += float(np.sum((value - truth) ** 2))
    total = int(count.sum())
    if total == 0:
        raise ValueError(f"no cell has a value of at least {above}: nothing to judge")
    divisor = np.where(count > 0, count, np.nan)
    gap = np.abs(value_sum - crowd_sum)  # = count * |mean_probability - crowd_share|
    return Reliability(
        count, value_sum / divisor, crowd_sum / divisor, float(gap.sum()) / total, squared_error / total
    )
