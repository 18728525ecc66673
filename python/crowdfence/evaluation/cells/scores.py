"""Scores of a detector from its value histogram: IoU, precision and recall, rates, reliability."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.evaluation.cells.value_histogram import (
    BINS,
    CROWD,
    EMPTY,
    SQUARED_ERROR,
    VALUE_SUM,
    called_above,
)
from crowdfence.evaluation.statistics.unit_bootstrap import RESAMPLES, Estimate, bootstrap_interval

THRESHOLD = 0.5
AFFORDABLE_FALSE_POSITIVE_RATE = 0.01
RELIABILITY_BINS = 15
RELIABILITY_ABOVE = 0.05
"""Cells below this are mostly easy ground, and so many that they hide how the rest is doing."""


@dataclass(frozen=True, slots=True)
class Quality:
    """How well heatmap cells match the labels. Unknown numbers are NaN: without a crowd cell there is no
    IoU, no precision-recall curve and no true-positive rate; without an empty one no area under that curve
    and nothing found at 1 %; with one unit there is no interval."""

    cells: int
    crowd_cells: int
    units: int
    """Missions (or blocks of frames) that the intervals resample."""
    best_threshold: float
    """Threshold with the largest IoU on these very cells: an upper bound, not a forecast."""
    iou: Estimate
    """Intersection over union of the cells above 0.5 and the crowd cells."""
    iou_at_best: Estimate
    pr_auc: Estimate
    """Area under the precision-recall curve (average precision, no interpolation)."""
    true_positive_rate: Estimate
    """At 0.5, as the next two."""
    false_positive_rate: Estimate
    true_positive_rate_at_one_percent: Estimate
    """With the lowest threshold that calls at most 1 % of the empty cells crowd: how much is found when that
    is the price."""
    false_crowd_share: Estimate
    """Cells wrongly called crowd as a share of all cells."""
    true_positive_rate_at_best: Estimate
    false_positive_rate_at_best: Estimate
    calibration_error: Estimate
    """Expected calibration error over 15 equal bins, all cells."""
    calibration_error_above: Estimate
    """The same for cells with a value above 0.05."""
    brier: Estimate
    """Mean squared difference between value and truth."""

    def to_json(self) -> dict[str, Any]:
        """Ready for JSON; unknown is null."""
        return {field.name: _plain(getattr(self, field.name)) for field in fields(self)}


def quality(histograms: NDArray[np.float64], *, resamples: int = RESAMPLES, seed: int = 0) -> Quality:
    """Quality of all units together, with 95 % bootstrap intervals over the units.

    `histograms` [U, 4, BINS]: one value histogram for each of U units. The best threshold is chosen once, on
    all units; the intervals at it do not include the choice.
    """
    total = histograms.sum(axis=0)
    positives, negatives = total[CROWD].sum(), total[EMPTY].sum()
    best_bin = _best_bin(total)
    statistic = partial(_scores, best_bin=best_bin)
    values = statistic(total[None])[0]
    lows, highs = bootstrap_interval(histograms, statistic, resamples=resamples, seed=seed)
    lows, highs = np.minimum(lows, values), np.maximum(highs, values)
    estimates = {
        name: Estimate(*map(float, numbers))
        for name, *numbers in zip(_ESTIMATES, values, lows, highs, strict=True)
    }
    return Quality(
        cells=int(positives + negatives),
        crowd_cells=int(positives),
        units=len(histograms),
        best_threshold=best_bin / BINS if positives else np.nan,
        **estimates,
    )


@dataclass(frozen=True, slots=True, eq=False)
class PrecisionRecall:
    """Precision-recall curve; cells with a value above `threshold` are called crowd (arrays [K])."""

    threshold: NDArray[np.float64]
    """Increasing; the first one, 0, calls every cell crowd."""
    precision: NDArray[np.float64]
    """NaN where no cell is called crowd."""
    recall: NDArray[np.float64]
    """NaN without a crowd cell."""


def precision_recall(total: NDArray[np.float64]) -> PrecisionRecall:
    """The curve of a histogram [4, BINS], at every edge of its bins."""
    called_crowd, called_empty = called_above(total, CROWD), called_above(total, EMPTY)
    return PrecisionRecall(
        np.arange(BINS) / BINS,
        _ratio(called_crowd, called_crowd + called_empty),
        _ratio(called_crowd, total[CROWD].sum()),
    )


def reliability_of(total: NDArray[np.float64], *, above: float = 0.0) -> tuple[NDArray[np.float64], ...]:
    """Reliability table of a histogram [4, BINS] in 15 equal bins: cells, their mean value, and the share of
    them that is crowd (NaN where no cell is). Leaves out cells with a value of `above` and less."""
    count, value_sum, crowd = _reliability_sums(total, above)
    return count, _ratio(value_sum, count), _ratio(crowd, count)


_ESTIMATES = (
    "iou",
    "iou_at_best",
    "pr_auc",
    "true_positive_rate",
    "false_positive_rate",
    "true_positive_rate_at_one_percent",
    "false_crowd_share",
    "true_positive_rate_at_best",
    "false_positive_rate_at_best",
    "calibration_error",
    "calibration_error_above",
    "brier",
)


def _scores(histograms: NDArray[np.float64], *, best_bin: int) -> NDArray[np.float64]:
    """Histograms [R, 4, BINS] -> scores [R, len(_ESTIMATES)] in that order."""
    crowd, empty = histograms[:, CROWD], histograms[:, EMPTY]
    positives, negatives = crowd.sum(-1), empty.sum(-1)
    cells = positives + negatives
    hits, false = called_above(histograms, CROWD), called_above(histograms, EMPTY)
    half = int(THRESHOLD * BINS)
    affordable = false <= AFFORDABLE_FALSE_POSITIVE_RATE * negatives[:, None]
    precision = _ratio(hits, hits + false)
    average_precision = np.nansum(crowd * precision, axis=-1)
    iou = _iou(hits, false, positives)
    # What is found at a price is unknown where no empty cell sets one: it would be all, for nothing.
    weighed = np.where(negatives > 0.0, positives, 0.0)
    return np.stack(
        [
            iou[:, half],
            iou[:, best_bin],
            _ratio(average_precision, weighed),
            _ratio(hits[:, half], positives),
            _ratio(false[:, half], negatives),
            _ratio(np.where(affordable, hits, 0.0).max(-1), weighed),
            _ratio(false[:, half], cells),
            _ratio(hits[:, best_bin], positives),
            _ratio(false[:, best_bin], negatives),
            _calibration_error(histograms, 0.0),
            _calibration_error(histograms, RELIABILITY_ABOVE),
            _ratio(histograms[:, SQUARED_ERROR].sum(-1), cells),
        ],
        axis=-1,
    )


def _iou(
    hits: NDArray[np.float64], false: NDArray[np.float64], positives: NDArray[np.float64]
) -> NDArray[np.float64]:
    """IoU [..., BINS] per threshold; NaN without crowd cells, where it would say nothing but 0."""
    crowd = np.asarray(positives)[..., None]
    return _ratio(hits, np.where(crowd > 0.0, crowd + false, 0.0))


def _best_bin(total: NDArray[np.float64]) -> int:
    iou = _iou(called_above(total, CROWD), called_above(total, EMPTY), total[CROWD].sum())
    return int(THRESHOLD * BINS) if np.isnan(iou).all() else int(np.nanargmax(iou))


def _calibration_error(histograms: NDArray[np.float64], above: float) -> NDArray[np.float64]:
    count, value_sum, crowd = _reliability_sums(histograms, above)
    # = count * |mean value - crowd share|, summed over the bins
    return _ratio(np.abs(value_sum - crowd).sum(-1), count.sum(-1))


def _reliability_sums(histograms: NDArray[np.float64], above: float) -> tuple[NDArray[np.float64], ...]:
    """Cells, sum of values and crowd cells [..., 15] of the cells with a value above `above`, which lies in
    the first bin."""
    first = round(above * BINS)
    starts = np.maximum(np.arange(0, BINS, BINS // RELIABILITY_BINS) - first, 0)
    empty, crowd, value_sum = (
        np.add.reduceat(histograms[..., row, first:], starts, axis=-1) for row in (EMPTY, CROWD, VALUE_SUM)
    )
    return empty + crowd, value_sum, crowd


def _ratio(count: NDArray[np.float64], total: NDArray[np.float64]) -> NDArray[np.float64]:
    """count / total, NaN where total is 0."""
    total = np.asarray(total)
    return np.asarray(count / np.where(total > 0.0, total, np.nan))


def _plain(value: float | Estimate) -> Any:
    if isinstance(value, Estimate):
        return value.to_json()
    return None if value != value else value
