"""What it costs to miss few people: ground closed for nothing, over all thresholds at once.

A person is in a zone with `BUFFER_M` around it exactly if the highest score within that distance reaches the
threshold. Ground is closed for nothing if its own score does and no crowd stands within that distance. Both
are distances to the edges of columns, as `safety.distance_m` counts them. So one number per person and per
column gives the whole curve.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.evaluation.safety import Cells, CrowdsInView, distance_m, to_column

BUFFER_M = 5.0
_BINS = 1 << 16
"""Of equal width in log odds, 0.0004: the thresholds of a calibrated probability that matter lie close to 0
or 1."""
_EDGE = 1e-6


class ClosingCost:
    """Sums over the moments that were counted. Zones are here those of the moment, without what is held.
    Memory grows with people and moments; ground is counted in bins of its score."""

    def __init__(self) -> None:
        self._people: list[NDArray[np.float64]] = []
        self._far = np.zeros(_BINS, np.int64)
        self._own_columns = 0

    def add(self, crowds: CrowdsInView, columns: Cells, score: NDArray[np.float64], size_m: float) -> None:
        """One moment: who stands where, and what each column [C, 2] scores [C]; one that is left out is never
        closed."""
        self._people.append(_highest_near(crowds.people, columns, score, size_m))
        far = score[distance_m(columns, crowds.ground, size_m) > BUFFER_M]
        self._far += np.bincount(_bin_of(far), minlength=_BINS)
        self._own_columns += len(crowds.ground)

    def curve(self, missed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Ground closed for nothing [K], as a multiple of the crowds' own, where so many of the people are
        missed [K]; NaN where no threshold misses so few, or there was nobody. Ground in the bin of the
        threshold counts as closed."""
        people = np.sort(np.concatenate([np.empty(0), *self._people]))
        if not len(people) or not self._own_columns:
            return np.full(len(missed), np.nan)
        threshold = people[np.minimum((missed * len(people)).astype(np.int64), len(people) - 1)]
        closed = self._far[::-1].cumsum()[::-1][_bin_of(threshold)]
        return np.where(np.isfinite(threshold), closed / self._own_columns, np.nan)


def _bin_of(score: NDArray[np.float64]) -> NDArray[np.int64]:
    inside = np.clip(score, _EDGE, 1.0 - _EDGE)
    share = np.log(inside / (1.0 - inside)) / np.log((1.0 - _EDGE) / _EDGE)  # -1 to 1
    return np.asarray(np.clip(((share + 1.0) / 2.0 * _BINS).astype(np.int64), 0, _BINS - 1))


def _highest_near(
    places: Cells, columns: Cells, score: NDArray[np.float64], size_m: float
) -> NDArray[np.float64]:
    """Highest score within `BUFFER_M` of each place [N]; -inf where there is none."""
    from scipy.spatial import cKDTree

    if not len(columns) or not len(places):
        return np.full(len(places), -np.inf)
    reach = BUFFER_M / size_m
    # The middle of a column lies no farther behind its edge than half its diagonal.
    near = cKDTree(columns).query_ball_point(places, reach + np.sqrt(0.5))
    each = zip(near, places, strict=True)
    return np.array([_highest(score[one], columns[one] - place, reach) for one, place in each])


def _highest(score: NDArray[np.float64], aside: Cells, reach: float) -> float:
    """Of columns [C] so far aside [C, 2] whose edges lie within reach, in columns; -inf where none does."""
    return float(score[to_column(aside) <= reach].max(initial=-np.inf))
