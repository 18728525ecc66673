"""Intervals by resampling missions: cells of one frame and frames of one flight are not independent."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

RESAMPLES = 500
_RESAMPLES_AT_ONCE = 100


class Estimate(NamedTuple):
    """A number with its interval; NaN is unknown."""

    value: float
    low: float = nan
    high: float = nan

    def to_json(self) -> dict[str, float | None]:
        """Ready for JSON: unknown is null."""
        return {name: number if number == number else None for name, number in self._asdict().items()}


def bootstrap_interval(
    totals: NDArray[np.float64],
    statistic: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    *,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Percentile bootstrap (Efron, 1979) over units, such as missions or blocks of frames.

    `totals` [U, ...] holds the counts of each of U units. A resample draws U units with replacement and adds
    their counts; `statistic` turns added counts [R, ...] into R x [...] results, NaN where one is undefined.
    Returns the lower and upper end, in the shape of one result. NaN for fewer than two units, from which
    nothing can be learnt about how units differ, and where no resample defines the result. With a handful of
    units the percentile interval is known to be too narrow. Errors such as the ECE grow under resampling; the
    caller widens the interval to include the value itself.
    """
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence must lie inside (0, 1), got {confidence}")
    if resamples < 1:
        raise ValueError(f"resamples must be at least 1, got {resamples}")
    if len(totals) < 2:
        unknown = np.full_like(np.asarray(statistic(totals.sum(axis=0, keepdims=True))[0], np.float64), nan)
        return unknown, unknown.copy()
    results = np.concatenate([statistic(added) for added in _resampled(totals, resamples, seed)])
    tail = (1.0 - confidence) / 2.0
    defined = ~np.isnan(results)
    # A column without any defined result stays NaN and would only raise a warning.
    filled = np.where(defined.any(axis=0), results, 0.0)
    ends = np.nanquantile(filled, [tail, 1.0 - tail], axis=0)
    low, high = np.where(defined.any(axis=0), ends, nan)
    return low, high


def _resampled(totals: NDArray[np.float64], resamples: int, seed: int) -> Iterator[NDArray[np.float64]]:
    rng = np.random.default_rng(seed)
    units = len(totals)
    for start in range(0, resamples, _RESAMPLES_AT_ONCE):
        count = min(_RESAMPLES_AT_ONCE, resamples - start)
        times_drawn = rng.multinomial(units, np.full(units, 1.0 / units), size=count).astype(np.float64)
        # einsum, not a matrix product: the threads of a BLAS would wait for each other on a busy machine.
        yield np.einsum("ru,u...->r...", times_drawn, totals)
