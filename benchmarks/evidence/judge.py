"""One configuration on one mission: who stands in its zones and how much ground they close, at many
thresholds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from seen import Mission

import crowdfence as cf
from crowdfence.config import MethodConfig
from crowdfence.evaluation.safety import BUFFERS_M, Safety
from crowdfence.evaluation.threshold_sweep import SweepResult, ThresholdSweep
from crowdfence.voxel_state import VoxelState
from crowdfence.zones.zone_ground import ZoneGround

NO_COLUMNS = np.empty((0, 2), np.int64)
FINE = np.geomspace(1e-4, 0.99, 60)
"""Thresholds of the IoU."""


@dataclass
class Judged:
    """What was counted; one `Safety` per threshold."""

    thresholds: NDArray[np.float64]
    safety: list[Safety]
    sweep: SweepResult
    reliability: NDArray[np.float64]
    """[15, 3] voxels, sum of their probability, crowd voxels, in equal bins of the probability; over all
    instants."""
    empty_people: int
    """Of crowds, on ground that is called empty at the method's own threshold, over all moments."""
    states: NDArray[np.int64]
    """Seen voxels by `VoxelState` at the end, at the method's own threshold."""

    @property
    def ece(self) -> float:
        """Expected calibration error."""
        voxels, probability, crowd = self.reliability.T
        return float(np.abs(probability - crowd).sum() / voxels.sum())

    def curve(self, buffer_m: float = 5.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Share of people in range who stand in a zone, and closed ground per crowds' own, by threshold."""
        at = BUFFERS_M.index(buffer_m)
        return (
            np.array([safety.share_in_zone_in_range[at] for safety in self.safety]),
            np.array([safety.blocked_per_own[at] for safety in self.safety]),
        )


def judged(
    mission: Mission, method: MethodConfig, thresholds: NDArray[np.float64], *, every: int = 1
) -> Judged:
    """Zones are what is held closed by the rules of a run, but with the `thresholds`, looked at in every
    `every`-th of the moments that say who stands where."""
    config = cf.RunConfig(method).with_detector(mission.contract)
    crowd_map = config.crowd_map(mission.terrain, mission.drones)
    own = crowd_map.default_threshold()
    safety = [Safety() for _ in thresholds]
    grounds = [
        ZoneGround(crowd_map, config.zones.rules(threshold, crowd_map.coverage)) for threshold in thresholds
    ]
    sweep = ThresholdSweep(FINE)
    watched = [moment.stamp_ns for moment in mission.moments if moment.in_view is not None][::every]
    empty_people = 0
    reliability = np.zeros((15, 3))
    for moment in mission.moments:
        crowd_map.integrate_observations(moment.observations, moment.stamp_ns)
        ids, probability = crowd_map.seen_probability(moment.stamp_ns)
        crowd = np.isin(ids, moment.crowd_ids, assume_unique=True)
        sweep.update(probability, crowd)
        bins = np.minimum((probability * len(reliability)).astype(int), len(reliability) - 1)
        for column, weights in enumerate((None, probability, crowd)):
            reliability[:, column] += np.bincount(bins, weights, minlength=len(reliability))
        for ground in grounds:
            ground.step(moment.stamp_ns)
        if moment.in_view is None or moment.stamp_ns not in watched:
            continue
        for one, ground in zip(safety, grounds, strict=True):
            one.add_zone(moment.in_view, ground.columns, mission.terrain.voxel_size_m)
        whole = Safety()
        whole.add(moment.in_view, crowd_map, moment.stamp_ns, own, NO_COLUMNS)
        empty_people += whole.people_on_empty
    states = crowd_map.state(mission.moments[-1].stamp_ns, threshold=own)
    counts = np.bincount(states, minlength=len(VoxelState))
    return Judged(thresholds, safety, sweep.result(), reliability, empty_people, counts)
