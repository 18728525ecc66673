"""Rates of a detector per voxel observation: one frame, one voxel in view, one mean value, one truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.evaluation.statistics.bin_edges import increasing_edges
from crowdfence.evaluation.statistics.observed_range import ObservedRange
from crowdfence.evaluation.statistics.unit_bootstrap import RESAMPLES, Estimate, bootstrap_interval
from crowdfence.evaluation.voxels.labelled_projection import LabelledObservation
from crowdfence.evaluation.voxels.likelihood_ratio import CROWD, EMPTY, LikelihoodRatio, likelihood_ratio

DISTANCE_EDGES_M = (0.0, 20.0, 35.0, 50.0, 75.0, 100.0, 150.0, 200.0, 300.0)
TILT_EDGES_DEG = (0.0, 10.0, 20.0, 30.0, 45.0, 60.0, 90.0)
MEAN_EDGES = (0.0, 0.005, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0)

_SPREAD_EDGES = {
    "gsd_m": np.geomspace(1e-3, 10.0, 401, dtype=np.float64),
    "distance_m": np.arange(0.0, 2001.0, dtype=np.float64),
    "tilt_deg": np.arange(-90.0, 91.0, dtype=np.float64),
}


class RatePair(NamedTuple):
    """TPR and FPR of some of the observations, each (count + 1/2) / (total + 1) with its 95 % interval: the
    wider of Jeffreys' for independent observations and the bootstrap over missions. An unknown rate is NaN
    and so is its interval."""

    true_positive: Estimate
    """P(m > b_threshold | crowd)."""
    false_positive: Estimate
    """P(m > b_threshold | no crowd)."""

    def to_json(self) -> dict[str, Any]:
        """Ready for JSON; unknown is null."""
        return {name: _rate_json(estimate) for name, estimate in self._asdict().items()}


@dataclass(frozen=True, slots=True)
class ProjectionSettings:
    """How observations were made; a map that uses the rates has to look the same way."""

    voxel_size_m: float
    target_height_m: float
    max_range_m: float
    coverage: Literal["rays", "full"] = "full"
    surface: Literal["planes", "voxels"] = "planes"


@dataclass(frozen=True, slots=True, eq=False)
class VoxelRates:
    """What a detector is worth on the terrain."""

    b_threshold: float
    missions: int
    crowd_observations: int
    empty_observations: int
    rates: RatePair
    """Of all observations: what equation 1 asks for."""
    away_from_edges: RatePair
    """Without voxels within one voxel of where crowd begins or ends."""
    by_distance: tuple[RatePair, ...]
    """One for each distance bin of `likelihood_ratio`."""
    by_tilt: tuple[RatePair, ...]
    likelihood_ratio: LikelihoodRatio
    validity: dict[str, list[float] | None]
    """Ground sample distance, distance and tilt between which 98 % of the crowd observations lie."""

    def to_json(self, settings: ProjectionSettings) -> dict[str, Any]:
        """The "rates" of a detector's contract."""
        return {
            "per": "voxel observation",
            "b_threshold": self.b_threshold,
            "voxel_size_m": settings.voxel_size_m,
            "coverage": settings.coverage,
            "surface": settings.surface,
            "target_height_m": settings.target_height_m,
            "max_range_m": settings.max_range_m,
            "missions": self.missions,
            "crowd_observations": self.crowd_observations,
            "empty_observations": self.empty_observations,
            **self.rates.to_json(),
            "away_from_edges": self.away_from_edges.to_json(),
            "by_distance": [pair.to_json() for pair in self.by_distance],
            "by_tilt": [pair.to_json() for pair in self.by_tilt],
            "likelihood_ratio": self.likelihood_ratio.to_json(),
        }


class VoxelRateCounter:
    """Counts labelled observations; memory grows with missions (about 25 kB each), not with frames."""

    def __init__(
        self,
        *,
        b_threshold: float = 0.5,
        distance_edges_m: ArrayLike = DISTANCE_EDGES_M,
        tilt_edges_deg: ArrayLike = TILT_EDGES_DEG,
        mean_edges: ArrayLike = MEAN_EDGES,
    ) -> None:
        """`mean_edges` run from 0 to 1; distances and tilts beyond their edges count with the nearest."""
        if not 0.0 <= b_threshold < 1.0:
            raise ValueError(f"b_threshold must lie in [0, 1), got {b_threshold}")
        self.b_threshold = b_threshold
        self._distance_m = increasing_edges("distance_edges_m", distance_edges_m)
        self._tilt_deg = increasing_edges("tilt_edges_deg", tilt_edges_deg)
        self._mean = increasing_edges("mean_edges", mean_edges)
        if self._mean[0] != 0.0 or self._mean[-1] != 1.0:
            raise ValueError(f"mean_edges must run from 0 to 1, got {self._mean.tolist()}")
        bins = (len(self._distance_m) - 1, len(self._tilt_deg) - 1)
        self._table_shape = (*bins, len(self._mean) - 1, 2)
        self._called_shape = (*bins, 2, 2, 2)  # near an edge, called crowd, is crowd
        self._units: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
        self._missions: set[str] = set()
        self._spread = {name: ObservedRange(edges) for name, edges in _SPREAD_EDGES.items()}

    def add(self, seen: LabelledObservation, mission: str, unit: str | None = None) -> None:
        """Count one frame. Frames of one `unit` (default: the mission) are resampled together."""
        if not ((seen.mean >= 0.0) & (seen.mean <= 1.0)).all():
            raise ValueError(f"{mission}: mean heatmap values must lie in [0, 1]")
        key = mission if unit is None else unit
        if key not in self._units:
            self._units[key] = (np.zeros(self._table_shape), np.zeros(self._called_shape))
        distance = np.searchsorted(self._distance_m[1:-1], seen.distance_m, side="right")
        tilt = np.searchsorted(self._tilt_deg[1:-1], seen.tilt_deg, side="right")
        mean = np.searchsorted(self._mean[1:-1], seen.mean, side="left")
        crowd = seen.crowd.astype(np.int64)
        called = (seen.mean > self.b_threshold).astype(np.int64)
        table, confusion = self._units[key]
        table += _counted((distance, tilt, mean, crowd), self._table_shape)
        near_edge = seen.near_edge.astype(np.int64)
        confusion += _counted((distance, tilt, near_edge, called, crowd), self._called_shape)
        for name, spread in self._spread.items():
            spread.add(getattr(seen, name)[seen.crowd])
        self._missions.add(mission)

    def result(self, *, resamples: int = RESAMPLES, seed: int = 0) -> VoxelRates:
        """Rates and table of everything counted. ValueError when no voxel with crowd, or none without, was
        observed: then nothing was measured."""
        if not self._units:
            raise ValueError("no observations: add at least one frame")
        tables = np.stack([table for table, _ in self._units.values()])
        confusions = np.stack([confusion for _, confusion in self._units.values()])
        seen = tables.sum(axis=(0, 1, 2, 3))
        if not seen.all():
            missing = "crowd" if seen[CROWD] == 0 else "empty"
            raise ValueError(
                f"no {missing} voxel among {int(seen.sum())} observations: add missions with some"
            )

        def rates(called: NDArray[np.float64]) -> RatePair:
            return _rate_pair(called, resamples, seed)

        return VoxelRates(
            self.b_threshold,
            len(self._missions),
            int(seen[CROWD]),
            int(seen[EMPTY]),
            rates(confusions.sum(axis=(1, 2, 3))),
            rates(confusions[:, :, :, 0].sum(axis=(1, 2))),
            tuple(rates(confusions[:, i].sum(axis=(1, 2))) for i in range(self._table_shape[0])),
            tuple(rates(confusions[:, :, i].sum(axis=(1, 2))) for i in range(self._table_shape[1])),
            likelihood_ratio(
                tables, self._distance_m, self._tilt_deg, self._mean, resamples=resamples, seed=seed
            ),
            {name: _plain_range(spread) for name, spread in self._spread.items()},
        )


def _rate_pair(called: NDArray[np.float64], resamples: int, seed: int) -> RatePair:
    """Counts [U, called, is crowd] of units -> rates with intervals."""
    from scipy.special import betaincinv

    def shares(added: NDArray[np.float64]) -> NDArray[np.float64]:
        positive, total = added[:, 1], added.sum(axis=1)
        return np.asarray(np.where(total > 0.0, (positive + 0.5) / (total + 1.0), np.nan))

    positive, total = called.sum(axis=0)[1], called.sum(axis=(0, 1))
    value = shares(called.sum(axis=0)[None])[0]
    low, high = bootstrap_interval(called, shares, resamples=resamples, seed=seed)
    ends = [betaincinv(positive + 0.5, total - positive + 0.5, tail) for tail in (0.025, 0.975)]
    # fmin, fmax: a single mission leaves the bootstrap unknown
    low, high = (
        np.where(total > 0.0, end, np.nan) for end in (np.fmin(ends[0], low), np.fmax(ends[1], high))
    )
    estimates = [Estimate(float(value[i]), float(low[i]), float(high[i])) for i in (EMPTY, CROWD)]
    return RatePair(true_positive=estimates[CROWD], false_positive=estimates[EMPTY])


def _counted(bins: tuple[NDArray[np.int64], ...], shape: tuple[int, ...]) -> NDArray[np.float64]:
    flat = np.ravel_multi_index(bins, shape)
    return np.bincount(flat, minlength=int(np.prod(shape))).reshape(shape).astype(np.float64)


def _rate_json(estimate: Estimate) -> dict[str, float | None]:
    plain = estimate.to_json()
    return {"rate": plain["value"], "low": plain["low"], "high": plain["high"]}


def _plain_range(spread: ObservedRange) -> list[float] | None:
    middle = spread.middle()
    # A ray above the horizon has a negative tilt; a contract states ranges from 0.
    return None if middle is None else [round(max(end, 0.0), 4) for end in middle]
