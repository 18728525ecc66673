"""Several methods on one mission, fed the same looks: mean IoU at every threshold, and what few misses cost.
What does not depend on the method is worked out once for all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from judge import FINE
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from seen import Mission, Moment

import crowdfence as cf
from crowdfence.config import MethodConfig
from crowdfence.evaluation.closing_cost import BUFFER_M
from crowdfence.evaluation.threshold_sweep import SweepResult, ThresholdSweep

Reading = Callable[[NDArray[np.int64], NDArray[np.float64]], NDArray[np.float64]]
"""What becomes of the probabilities [S] of the voxels seen so far, ids [S], before they are judged."""


class Contender(NamedTuple):
    name: str
    method: MethodConfig
    reading: Reading | None = None


class Curve(NamedTuple):
    """Of one method on one mission, over all thresholds."""

    sweep: SweepResult
    people: NDArray[np.float64]
    """[P] The threshold up to which each person in range stands within 5 m of a zone, over all moments; -inf
    where none is low enough."""
    far: NDArray[np.float64]
    """[C] The same for ground farther than 5 m from any crowd: the threshold up to which it is closed."""
    own: int
    """Columns of the crowds' own ground, over the same moments."""

    def threshold(self, missed: float) -> float:
        """The highest that misses no larger a share of the people."""
        return float(np.sort(self.people)[min(int(missed * len(self.people)), len(self.people) - 1)])

    def over_blocked(self, missed: float) -> float:
        """Ground closed for nothing, times the crowds' own, where that share is missed; NaN where none
        misses so few."""
        threshold = self.threshold(missed)
        return float(np.count_nonzero(self.far >= threshold) / self.own) if threshold > 0.0 else np.nan


def curves(mission: Mission, contenders: Sequence[Contender], *, every: int = 1) -> list[Curve]:
    """Zones are those of the moment, without what is held closed. The IoU counts every `every`-th instant."""
    maps = [_crowd_map(mission, one.method) for one in contenders]
    sweeps = [ThresholdSweep(FINE) for _ in contenders]
    people: list[list[NDArray[np.float64]]] = [[] for _ in contenders]
    far: list[list[NDArray[np.float64]]] = [[] for _ in contenders]
    own = 0
    for number, moment in enumerate(mission.moments):
        for crowd_map in maps:
            crowd_map.integrate_observations(moment.observations, moment.stamp_ns)
        counts_iou = number % every == 0
        ground = None if moment.in_view is None else _Ground(mission, moment, maps[0])
        if not counts_iou and ground is None:
            continue
        own += 0 if ground is None else ground.own
        for at, (crowd_map, contender) in enumerate(zip(maps, contenders, strict=True)):
            ids, probability = crowd_map.seen_probability(moment.stamp_ns)
            if contender.reading is not None:
                probability = contender.reading(ids, probability)
            if counts_iou:
                sweeps[at].update(probability, np.isin(ids, moment.crowd_ids, assume_unique=True))
            if ground is not None:
                column = ground.highest(probability)
                people[at].append(ground.of_people(column))
                far[at].append(column[ground.is_far])
    return [
        Curve(sweep.result(), np.concatenate(of_people), np.concatenate(of_far), own)
        for sweep, of_people, of_far in zip(sweeps, people, far, strict=True)
    ]


class _Ground:
    """The columns seen so far at one moment, and who stands near which."""

    def __init__(self, mission: Mission, moment: Moment, crowd_map: cf.CrowdMap) -> None:
        assert moment.in_view is not None
        ids, _ = crowd_map.seen_probability(moment.stamp_ns)
        indices = mission.terrain.voxel_indices(ids)[:, :2].astype(np.int64)
        keys = indices[:, 0] * (1 << 32) + indices[:, 1]
        self._order = np.argsort(keys, kind="stable")
        sorted_keys = keys[self._order]
        self._first = np.flatnonzero(np.diff(sorted_keys, prepend=sorted_keys[0] - 1))
        columns = indices[self._order[self._first]]
        size_m = mission.terrain.voxel_size_m
        tree = cKDTree(columns)
        crowds = moment.in_view
        self.own = len(crowds.ground)
        reach = np.nextafter(BUFFER_M / size_m, np.inf)
        away, _ = cKDTree(crowds.ground).query(columns, distance_upper_bound=reach)
        self.is_far = np.isinf(away)
        # To the column's edge, within a part of a column.
        self._near = tree.query_ball_point(crowds.people[crowds.in_range], BUFFER_M / size_m + 0.5)

    def highest(self, probability: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of each column."""
        return np.maximum.reduceat(probability[self._order], self._first)

    def of_people(self, column: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([column[near].max() if near else -np.inf for near in self._near])


def _crowd_map(mission: Mission, method: MethodConfig) -> cf.CrowdMap:
    config = cf.RunConfig(method).with_detector(mission.contract)
    return config.crowd_map(mission.terrain, mission.drones)
