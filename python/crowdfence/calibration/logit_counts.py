"""Cells by logit and truth in fine bins: what a calibration is fitted on, in bounded memory."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

LIMIT = 16.0
"""Logits are cut here: a float32 probability cannot tell more from 1."""
BINS = 2048

COUNT_EMPTY, COUNT_CROWD, LOGIT_SUM = range(3)
"""Rows of counts [3, BINS]: cells without crowd, cells with crowd, sum of the logits of both. Counts of
different frames add up."""


def cell_logits(heatmap: NDArray[Any]) -> NDArray[np.float64]:
    """log(p / (1 - p)) of a heatmap in [0, 1], between -LIMIT and LIMIT."""
    p = np.asarray(heatmap, np.float64)
    with np.errstate(divide="ignore"):
        logits = np.log(p) - np.log1p(-p)
    return np.clip(logits, -LIMIT, LIMIT)


def logit_counts(
    values: NDArray[np.float64], crowd: NDArray[np.bool_], counted: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """Counts [3, BINS] of cells with probability `values` and truth `crowd`; of those `counted`, if given."""
    chosen = np.ones(values.shape, np.bool_) if counted is None else counted
    logits, truth = cell_logits(values[chosen]), crowd[chosen]
    bin_of = np.minimum(((logits + LIMIT) * (BINS / (2.0 * LIMIT))).astype(np.int64), BINS - 1)
    counts = np.empty((3, BINS))
    counts[COUNT_EMPTY] = np.bincount(bin_of[~truth], minlength=BINS)
    counts[COUNT_CROWD] = np.bincount(bin_of[truth], minlength=BINS)
    counts[LOGIT_SUM] = np.bincount(bin_of, logits, minlength=BINS)
    return counts


def mean_logits(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean logit of the cells of every bin [BINS]; its centre where there is none."""
    cells = counts[COUNT_EMPTY] + counts[COUNT_CROWD]
    centre = (np.arange(BINS) + 0.5) * (2.0 * LIMIT / BINS) - LIMIT
    return np.where(cells > 0.0, counts[LOGIT_SUM] / np.maximum(cells, 1.0), centre)
