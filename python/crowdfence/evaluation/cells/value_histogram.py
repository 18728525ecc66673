"""Heatmap values by truth in fine bins: all that thresholds and reliability need, in bounded memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BINS = 960
"""Bin b holds values in (b / 960, (b + 1) / 960], the first one also 0: "above a threshold" is then exact at
every edge. 0.05 and 0.5 are edges, and the 15 bins of a reliability table are 64 of these each."""

EMPTY, CROWD, VALUE_SUM, SQUARED_ERROR = range(4)
"""Rows of a histogram [4, BINS]: cells without crowd, cells with crowd, sum of the values of both, and sum of
(value - truth)^2. Histograms of different frames add up."""

_EDGES = np.arange(1, BINS) / BINS


def value_histogram(values: NDArray[np.float64], crowd: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Histogram [4, BINS] of cell values in [0, 1] and whether each cell is crowd (arrays of one shape)."""
    value, truth = values.ravel(), crowd.ravel()
    bin_of = bin_of_values(value)
    histogram = np.empty((4, BINS))
    histogram[EMPTY] = np.bincount(bin_of[~truth], minlength=BINS)
    histogram[CROWD] = np.bincount(bin_of[truth], minlength=BINS)
    histogram[VALUE_SUM] = np.bincount(bin_of, value, minlength=BINS)
    histogram[SQUARED_ERROR] = np.bincount(bin_of, (value - truth) ** 2, minlength=BINS)
    return histogram


def bin_of_values(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Bin number of values in [0, 1]."""
    return np.searchsorted(_EDGES, values, side="left")


def called_above(histogram: NDArray[np.float64], row: int) -> NDArray[np.float64]:
    """Cells [..., BINS] of one row with a value above b / BINS (all of them for b = 0), for every b."""
    return np.flip(np.cumsum(np.flip(histogram[..., row, :], -1), -1), -1)
