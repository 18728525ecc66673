"""How strongly a mean heatmap value speaks for crowd: log10 P(m | crowd) / P(m | no crowd)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.evaluation.statistics.isotonic import pool_adjacent_violators
from crowdfence.evaluation.statistics.unit_bootstrap import RESAMPLES, bootstrap_interval

EMPTY, CROWD = 0, 1
"""Last axis of the counts."""

BORROWED = 1000.0
"""Observations that the wider group counts for in each of its parts: about the crowd voxels that one frame
shows. Neighbouring voxels agree, so this many say little more than one look at one crowd."""

JEFFREYS = 0.5
_Z_95 = 1.959964


@dataclass(frozen=True, slots=True, eq=False)
class LikelihoodRatio:
    """Table of the likelihood ratio; D distance bins, T tilt bins, M bins of the mean value."""

    distance_m: NDArray[np.float64]
    """Edges [D + 1]; what lies outside belongs to the nearest bin, as with the tilt."""
    tilt_deg: NDArray[np.float64]
    """Edges [T + 1], below the horizon."""
    mean: NDArray[np.float64]
    """Edges [M + 1] from 0 to 1; a bin holds values above its lower and up to its upper edge, the first
    also 0."""
    log10_ratio: NDArray[np.float64]
    """[D, T, M]."""
    low: NDArray[np.float64]
    """[D, T, M] lower end of the 95 % interval: the wider of Jeffreys' and the bootstrap over missions."""
    high: NDArray[np.float64]
    crowd: NDArray[np.int64]
    """[D, T, M] observations of crowd voxels."""
    empty: NDArray[np.int64]
    monotone: NDArray[np.bool_]
    """[D, T] the ratio was made to increase with the mean value. False where the data contradict that: then
    it is as counted."""
    all_log10_ratio: NDArray[np.float64]
    """[M] over all distances and tilts, not made monotone."""

    def to_json(self) -> dict[str, Any]:
        """Ready for JSON, numbers to four decimals."""
        table: dict[str, Any] = {
            "distance_m": self.distance_m.tolist(),
            "tilt_deg": self.tilt_deg.tolist(),
            "mean": self.mean.tolist(),
        }
        for name in ("log10_ratio", "low", "high", "all_log10_ratio"):
            table[name] = np.round(getattr(self, name), 4).tolist()
        for name in ("crowd", "empty", "monotone"):
            table[name] = getattr(self, name).tolist()
        return table


def likelihood_ratio(
    counts: ArrayLike,
    distance_edges_m: ArrayLike,
    tilt_edges_deg: ArrayLike,
    mean_edges: ArrayLike,
    *,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> LikelihoodRatio:
    """The table from counts [U, D, T, M, 2] of U missions; last axis: observations of empty, of crowd voxels.

    P(m bin | truth) comes from counts to which Jeffreys' half an observation is added in every bin. Each
    distance also borrows `BORROWED` observations spread like those of all distances, and each (distance,
    tilt) as many spread like those of its distance: a bin with few looks follows its neighbourhood, one with
    many its own counts, and what was never seen is never impossible. The ratio of a (distance, tilt) is made
    to increase with m (pool-adjacent-violators) where every pooled value lies within its bin's interval.
    """
    by_unit = np.asarray(counts, np.float64)
    total = by_unit.sum(axis=0)
    raw, standard_error = _log10_ratio(total)
    low, high = bootstrap_interval(
        by_unit, lambda added: _log10(_evidence(added)), resamples=resamples, seed=seed
    )
    # fmin, fmax: a single mission leaves the bootstrap unknown
    low = np.fmin(raw - _Z_95 * standard_error, low)
    high = np.fmax(raw + _Z_95 * standard_error, high)
    ratio, monotone = _monotone(total, raw, low, high)
    return LikelihoodRatio(
        np.asarray(distance_edges_m, np.float64),
        np.asarray(tilt_edges_deg, np.float64),
        np.asarray(mean_edges, np.float64),
        ratio,
        np.minimum(low, ratio),
        np.maximum(high, ratio),
        total[..., CROWD].astype(np.int64),
        total[..., EMPTY].astype(np.int64),
        monotone,
        _log10(_overall(total))[0, 0],
    )


def _log10_ratio(counts: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Counts [..., D, T, M, 2] -> log10 ratio [..., D, T, M] and its standard error for independent looks.

    The logarithm of a Beta(a, b) share has variance trigamma(a) - trigamma(a + b); the second term is left
    out, which widens the interval slightly.
    """
    from scipy.special import polygamma

    evidence = _evidence(counts)
    variance = polygamma(1, evidence).sum(axis=-1)
    return _log10(evidence), np.asarray(np.sqrt(variance) / np.log(10.0))


def _evidence(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Counts [..., D, T, M, 2] plus what each (distance, tilt) borrows from its distance, that from all."""
    of_distance = counts.sum(axis=-3, keepdims=True) + BORROWED * _share(_overall(counts)) + JEFFREYS
    return np.asarray(counts + BORROWED * _share(of_distance) + JEFFREYS)


def _overall(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(counts.sum(axis=(-4, -3), keepdims=True) + JEFFREYS)


def _share(evidence: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of each m bin among the bins of its truth."""
    return np.asarray(evidence / evidence.sum(axis=-2, keepdims=True))


def _log10(evidence: NDArray[np.float64]) -> NDArray[np.float64]:
    share = _share(evidence)
    return np.asarray(np.log10(share[..., CROWD] / share[..., EMPTY]))


def _monotone(
    total: NDArray[np.float64],
    raw: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    share = _share(_evidence(total))
    ratio, monotone = raw.copy(), np.zeros(raw.shape[:2], np.bool_)
    for cell in np.ndindex(raw.shape[:2]):
        crowd, empty = pool_adjacent_violators(share[cell][:, CROWD], share[cell][:, EMPTY])
        pooled = np.log10(crowd / empty)
        monotone[cell] = ((pooled >= low[cell]) & (pooled <= high[cell])).all()
        if monotone[cell]:
            ratio[cell] = pooled
    return ratio, monotone
