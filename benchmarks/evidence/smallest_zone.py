"""Where zones begin and how large they are at least: `python smallest_zone.py MISSION.mcap...`; README.md.

First the regions that are held closed, of any size, by whether anybody stands within 2 m of them; then people
in view who stand in a zone, closed ground, how many zones there are at a time and were ever named, by
where zones begin and by their least area.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label, minimum
from seen import Mission, seen

import crowdfence as cf
from crowdfence.config import EvidenceConfig, ZoneConfig
from crowdfence.evaluation.safety import BUFFERS_M, Safety
from crowdfence.sources.recording import Recording
from crowdfence.truth.at_exposure import people_at, timed_frame
from crowdfence.zones.zone_ground import ZoneGround

BUFFER_M = 5.0
NEAR_M = 2.0
SIZES_M2 = np.array([0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, np.inf])
OF_ANY_SIZE = (1.2, 0.0)
CONTENDERS = (OF_ANY_SIZE, (1.2, 2.0), (1.2, 4.0), (1.1, 2.0), (1.1, 3.0), (1.1, 4.0), (1.0, 4.0))
"""Log odds above the prior, and least area, m2."""
KINDS = ("of a crowd", "of others", "of nobody")


@dataclass
class Regions:
    """Counted over all moments."""

    count: NDArray[np.int64] = field(default_factory=lambda: np.zeros((len(SIZES_M2) - 1, 3), np.int64))
    """By size and kind."""
    nobody_m2: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(SIZES_M2) - 1))
    """What those of nobody close away from crowds, with the buffer."""
    own_m2: float = 0.0

    def add(
        self,
        terrain: cf.Terrain,
        people: NDArray[np.floating[Any]],
        own: NDArray[np.int64],
        closed: NDArray[np.int64],
    ) -> None:
        """One moment: where everybody stands [P, 2], columns of the crowds' own ground in view and those that
        are closed."""
        size_m, origin = terrain.voxel_size_m, np.asarray(terrain.origin)[:2]
        feet = np.floor((people - origin) / size_m).astype(np.int64)
        margin = int(30.0 / size_m)
        corners = np.concatenate([closed, own])
        first, last = corners.min(axis=0) - margin, corners.max(axis=0) + margin
        feet = feet[((feet >= first) & (feet <= last)).all(axis=1)]

        def apart_m(columns: NDArray[np.int64]) -> NDArray[np.float64]:
            free = np.ones(last - first + 1, bool)
            free[tuple((columns - first).T)] = False
            return np.asarray(distance_transform_edt(free) * size_m) if len(columns) else free * np.inf

        to_closed, to_own, to_people = apart_m(closed), apart_m(own), apart_m(feet)
        self.own_m2 += float(np.count_nonzero(to_own <= BUFFER_M)) * size_m**2
        # Regions whose gap a person does not fit into are one.
        near, regions = label(to_closed <= 1.0)
        numbers = np.arange(1, regions + 1)
        of_closed = np.where(to_closed == 0.0, near, 0)
        area_m2 = np.bincount(of_closed[of_closed > 0], minlength=regions + 1)[1:] * size_m**2
        kind = np.where(minimum(to_people, of_closed, numbers) <= NEAR_M, 1, 2)
        kind[minimum(to_own, of_closed, numbers) <= NEAR_M] = 0
        _, nearest = distance_transform_edt(to_closed > 0.0, return_indices=True)
        around = near[tuple(nearest)][(to_closed <= BUFFER_M) & (to_own > BUFFER_M)]
        around_m2 = np.bincount(around, minlength=regions + 1)[1:] * size_m**2
        bins = np.searchsorted(SIZES_M2, area_m2, "right") - 1
        np.add.at(self.count, (bins, kind), 1)
        np.add.at(self.nobody_m2, bins[kind == 2], around_m2[kind == 2])


def measure(mission: Mission, recording: Recording) -> tuple[Regions, list[tuple[float, ...]]]:
    """The regions of any size; of each contender people in a zone, closed ground per crowds' own and in m2,
    zones at a time and zones named."""
    config = cf.RunConfig().with_detector(mission.contract)
    crowd_map = config.crowd_map(mission.terrain, mission.drones)
    grounds = []
    for log_odds, least_m2 in CONTENDERS:
        method = EvidenceConfig(zone_log_odds=log_odds).with_detector(mission.contract)
        threshold = method.fusion_method(mission.terrain, mission.drones).default_threshold
        rules = ZoneConfig(min_area_m2=least_m2).rules(threshold)
        grounds.append(ZoneGround(crowd_map, rules))
    regions, safety = Regions(), [Safety() for _ in grounds]
    zones: list[list[int]] = [[] for _ in grounds]
    named = [0 for _ in grounds]
    for moment, instant in zip(mission.moments, recording.instants(), strict=True):
        crowd_map.integrate_observations(moment.observations, moment.stamp_ns)
        for number, (ground, one, alive) in enumerate(zip(grounds, safety, zones, strict=True)):
            events = ground.step(moment.stamp_ns).events
            named[number] += sum(event.kind in ("created", "split") for event in events)
            if moment.in_view is not None:
                one.add_zone(moment.in_view, ground.columns, mission.terrain.voxel_size_m)
                alive.append(len(ground.tracker.alive))
        of_any_size = grounds[CONTENDERS.index(OF_ANY_SIZE)].columns
        if moment.in_view is not None and len(of_any_size):
            people = people_at(timed_frame(instant) or instant.frames[-1], recording).position[:, :2]
            regions.add(mission.terrain, people, moment.in_view.ground, of_any_size)
    at = BUFFERS_M.index(BUFFER_M)
    told = [
        (
            one.share_in_zone[at],
            one.blocked_per_own[at],
            one.closed_m2[at],
            float(np.mean(alive)),
            float(count),
        )
        for one, alive, count in zip(safety, zones, named, strict=True)
    ]
    return regions, told


def main() -> None:
    paths = [Path(one) for one in sys.argv[1:]]
    found = [measure(seen(path), cf.open_recording(path)) for path in paths]
    print("| m2 |", " | ".join(f"from {one:g}" for one in SIZES_M2[:-1]), "|")
    print("|---|" + "---|" * (len(SIZES_M2) - 1))
    for number, kind in enumerate(KINDS):
        counted = sum(regions.count[:, number] for regions, _ in found)
        print(f"| {kind} |", " | ".join(map(str, counted)), "|")
    with np.errstate(divide="ignore", invalid="ignore"):
        per_own = np.nanmean([regions.nobody_m2 / regions.own_m2 for regions, _ in found], axis=0)
    print("| of nobody close, times the crowds' own |", " | ".join(f"{one:.2f}" for one in per_own), "|\n")
    print("| begins at | at least | in a zone | closed / own | closed m2 | zones | named |")
    print("|---|---|---|---|---|---|---|")
    for (log_odds, least_m2), told in zip(
        CONTENDERS, zip(*(row for _, row in found), strict=True), strict=True
    ):
        share, per_own, m2, *count = np.nanmean(told, axis=0)
        counted = " | ".join(f"{one:.1f}" for one in count)
        print(f"| {log_odds:g} | {least_m2:g} m2 | {share:.3f} | {per_own:.2f} | {m2:.0f} | {counted} |")


if __name__ == "__main__":
    main()
