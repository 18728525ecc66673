"""What the fusion methods make of looks, from `docs/methods.md` and `docs/states.md` in float64. `evidence`
and `moving-average` are summed anew from all looks that ever came, whatever their order."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence import Observation, VoxelState

SECOND_NS = 1_000_000_000
NEVER_NS = -1
CLEARLY = 2.0
"""In log odds above the threshold: what one look shows by itself, for so many seconds."""
FINER = 1.5
"""How much finer a look that shows crowd may count than one of the calibration's cameras."""
Numbers = NDArray[np.float64]


def log_odds(p: Numbers | float) -> Numbers:
    return np.asarray(np.log(p) - np.log1p(-np.asarray(p)))


def probability(odds: Numbers | float) -> Numbers:
    return np.asarray(1.0 / (1.0 + np.exp(-np.asarray(odds))))


@dataclass(frozen=True)
class Table:
    """log_ratio [M] by the mean heatmap value alone; each of the borders [M - 1] belongs to the bin below."""

    borders: Numbers
    log_ratio: Numbers

    def of(self, mean: Numbers) -> Numbers:
        return self.log_ratio[np.searchsorted(self.borders, mean, side="left")]


@dataclass
class SlowFusion:
    """One map; `name` is that of the method and `told` are its parameters, `table` its calibration."""

    name: str
    told: dict[str, float]
    table: Table
    voxels: int
    last_ns: NDArray[np.int64] = field(init=False)
    looks: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], Numbers, Numbers]] = field(
        default_factory=list
    )
    """Voxel, stamp, drone, weight and l of the looks of each view, each [N]."""
    drones: list[str] = field(default_factory=list)
    newest_ns: int = NEVER_NS

    def __post_init__(self) -> None:
        self.last_ns = np.full(self.voxels, NEVER_NS, np.int64)
        self.occluded = np.zeros(self.voxels, dtype=bool)
        self.kept = np.zeros(self.voxels)
        """P~ of `paper` and `linear-pool`, L~ of `log-pool`, L of `log-odds`; as of the last look."""

    @property
    def seen(self) -> NDArray[np.bool_]:
        return self.last_ns >= 0

    def take_in(self, observations: list[Observation], stamp_ns: int) -> None:
        """One instant. Views within 1 s of it count as taken then, others at their own stamps."""
        told, before = self.told, self.last_ns.copy()
        rows: list[tuple[NDArray[np.int64], Numbers, Numbers]] = []
        for one in observations:
            if one.drone not in self.drones:
                self.drones.append(one.drone)
            taken_ns = stamp_ns if stamp_ns - one.stamp_ns <= SECOND_NS else one.stamp_ns
            ratio = self.table.of(one.mean)
            tells = (one.tilt_deg > 0.0) | (ratio > 0.0) | (self.name != "evidence")
            theirs_px = told.get("focal_px", 1.0)
            finest_px = np.where(ratio > 0.0, FINER * theirs_px, theirs_px)
            gsd_m = one.range_m.astype(float) / np.minimum(one.focal_px or theirs_px, finest_px)
            sharp_m = told.get("sharp_gsd_m", np.inf)
            weight = np.where(gsd_m <= sharp_m, 1.0, (sharp_m / np.maximum(gsd_m, 1e-9)) ** 2)
            self.occluded[one.occluded_ids] = self.occluded[one.voxel_ids[~tells]] = True
            ids = one.voxel_ids[tells]
            np.maximum.at(self.last_ns, ids, taken_ns)
            rows.append((ids, one.mean[tells], ratio[tells]))
            number = np.full(len(ids), self.drones.index(one.drone))
            self.looks.append((ids, np.full(len(ids), taken_ns), number, weight[tells], ratio[tells]))
        if rows and self.name not in ("evidence", "moving-average"):
            ids, mean, ratio = (np.concatenate([row[part] for row in rows]) for part in range(3))
            self._keep(ids.astype(np.int64), mean, ratio, before)
        self.newest_ns = max(self.newest_ns, stamp_ns)

    def _keep(
        self, ids: NDArray[np.int64], mean: Numbers, ratio: Numbers, before_ns: NDArray[np.int64]
    ) -> None:
        """Equations 1 to 3 and what is made of them."""
        told, seen = self.told, before_ns >= 0
        count = np.bincount(ids, minlength=self.voxels)
        shows = mean > told.get("b_threshold", 0.5)

        def total(values: Numbers) -> Numbers:
            return np.bincount(ids, values, self.voxels)

        if self.name == "or":
            new = np.maximum(self.kept, np.minimum(total(shows), 1.0))
        elif self.name == "log-odds":
            hit = np.log(told["true_positive_rate"] / told["false_positive_rate"])
            miss = np.log((1 - told["true_positive_rate"]) / (1 - told["false_positive_rate"]))
            was = np.where(seen, self.kept, log_odds(told["prior"]))
            new = np.clip(was + total(np.where(shows, hit, miss)), told["clamp_low"], told["clamp_high"])
        else:
            left = np.exp(-told["decay"] * (self.last_ns - before_ns) / 1e9)
            prior = told["prior"]
            if self.name == "log-pool":
                pooled, rest = total(ratio) / np.maximum(count, 1), 0.0
            else:
                crowd, none = prior * told["true_positive_rate"], (1 - prior) * told["false_positive_rate"]
                positive = crowd / (crowd + none)
                crowd, none = prior - crowd, (1 - prior) - none
                negative = crowd / (crowd + none)
                weight, says = np.abs(mean - 0.5), np.where(shows, positive, negative)
                if self.name == "paper":  # who does not see it says m = 0; weights by 0.5 N
                    size, rest = told["fleet_size"], 0.0
                    pooled = (total(weight * says) + 0.5 * (size - count) * negative) / (0.5 * size)
                else:
                    weights, rest = total(weight), prior
                    with np.errstate(invalid="ignore"):
                        pooled = np.where(weights > 0.0, total(weight * says) / weights, prior)
            faded = np.where(seen, rest + left * (self.kept - rest), rest)
            new = told["alpha"] * pooled + (1 - told["alpha"]) * faded
        self.kept = np.where(count > 0, new, self.kept)

    def _all_looks(self) -> list[NDArray[Any]]:
        return [np.concatenate(part) for part in zip(*self.looks, strict=True)]

    def above(self, stamp_ns: int | NDArray[np.int64]) -> tuple[Numbers, Numbers]:
        """`evidence`: log odds above the prior, and what is remembered of looks."""
        told = self.told
        voxel, taken_ns, drone, weight, ratio = self._all_looks()
        age_s = (np.broadcast_to(stamp_ns, self.voxels)[voxel] - taken_ns) / 1e9
        weight = weight * np.exp(-age_s / told["memory_s"])
        of_drone = [np.bincount(voxel, weight * (drone % 3 == number), self.voxels) for number in range(3)]
        total, squares = np.sum(of_drone, axis=0), np.sum(np.square(of_drone), axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.bincount(voxel, weight * ratio, self.voxels) / (total + told["doubt"])
            odds = np.where(squares > 0.0, mean * (total**2 / squares) ** told["agreement"], 0.0)
        return np.clip(odds, -12.0, 12.0), total

    def probability(self, stamp_ns: int | NDArray[np.int64]) -> Numbers:
        """[V] At one stamp, or at one for each voxel: not before its last look."""
        told, prior = self.told, self.told.get("prior", 0.0)
        if not self.looks:
            now = np.full(self.voxels, prior)
        elif self.name == "evidence":
            now = probability(log_odds(prior) + self.above(stamp_ns)[0])
        elif self.name == "moving-average":
            voxel, taken_ns, _, _, ratio = self._all_looks()
            weight = np.exp(-(self.last_ns[voxel] - taken_ns) / 1e9 / told["memory_s"])
            score = np.bincount(voxel, weight * probability(log_odds(prior) + ratio), self.voxels)
            with np.errstate(invalid="ignore"):
                now = score / np.bincount(voxel, weight, self.voxels)
        else:
            left = np.exp(-told.get("decay", 0.0) * (stamp_ns - self.last_ns) / 1e9)
            now = {
                "or": lambda: self.kept,
                "log-odds": lambda: probability(self.kept),
                "paper": lambda: left * self.kept,
                "linear-pool": lambda: prior + left * (self.kept - prior),
                "log-pool": lambda: probability(log_odds(prior) + left * self.kept),
            }[self.name]()
        return np.where(self.seen, now, 0.0 if self.name in ("paper", "or") else prior)

    def shown(self, threshold: float, until_ns: int | NDArray[np.int64]) -> NDArray[np.bool_]:
        """[V] Where one look of the 2 s before a stamp, or one for each voxel, by itself showed crowd."""
        found = np.zeros(self.voxels, dtype=bool)
        if self.looks and self.name == "evidence":
            voxel, taken_ns, _, weight, ratio = self._all_looks()
            alone = log_odds(self.told["prior"]) + weight * ratio / (weight + self.told["doubt"])
            stands = np.broadcast_to(until_ns, self.voxels)[voxel] - taken_ns <= 2 * SECOND_NS
            found[voxel[stands & (alone >= log_odds(threshold) + CLEARLY)]] = True
        return found

    def state(self, stamp_ns: int, threshold: float, stale_after_s: float) -> NDArray[np.uint8]:
        """[V] Time makes what was empty stale, and nothing empty."""
        now, then = self.probability(stamp_ns), self.probability(self.last_ns)
        cleared = self.told["cleared"] if self.name == "evidence" else 1.0
        shown = self.shown(self.told.get("prior", threshold), self.last_ns)
        fresh = (stamp_ns - self.last_ns) / 1e9 <= stale_after_s
        looked_at = np.where(fresh & (now <= cleared) & ~shown, VoxelState.EMPTY, VoxelState.NOT_CLEARED)
        was_empty = (then < threshold) & (then <= cleared) & ~shown
        looked_at = np.where(~fresh & was_empty, VoxelState.STALE, looked_at)
        seen = np.where(now >= threshold, VoxelState.CROWD, looked_at)
        unseen = np.where(self.occluded, VoxelState.OCCLUDED, VoxelState.NEVER_SEEN)
        return np.where(self.seen, seen, unseen).astype(np.uint8)
