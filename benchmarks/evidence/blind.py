"""What a blind drone costs: `python blind.py MISSION.mcap...`; see README.md.

The same missions, with the heatmaps of one drone all zero, or without it; zones as they are, and without
looks that by themselves show crowd (`CrowdMap.shown_ids`).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from seen import Mission, seen
from tuned import TUNED

import crowdfence as cf
from crowdfence.evaluation.safety import BUFFERS_M, Safety
from crowdfence.zones.closed_ground import ClosedGround

EVERY = 2
"""Of the moments that say who stands where, so many are one that is counted."""
Change = Callable[[cf.Observation], cf.Observation | None]


class ByBeliefs(ClosedGround):
    """Closed by what all drones make of it together, and by nothing else."""

    def _crowd(self, stamp_ns: int) -> NDArray[np.int64]:
        return self._crowd_map.crowd_ids_at_last_looks(threshold=self._threshold)


def blind(observation: cf.Observation, terrain: cf.Terrain) -> cf.Observation:
    """The same view of somebody who sees nobody anywhere."""
    return cf.Observation(
        terrain,
        observation.drone,
        observation.stamp_ns,
        voxel_ids=observation.voxel_ids,
        mean=np.zeros(len(observation.voxel_ids)),
        pixel_count=observation.pixel_count,
        range_m=observation.range_m,
        tilt_deg=observation.tilt_deg,
        occluded_ids=observation.occluded_ids,
        focal_px=observation.focal_px,
    )


def changes(mission: Mission) -> dict[str, Change]:
    """What becomes of each view, by what is the matter."""
    drones = {view.drone for moment in mission.moments for view in moment.observations}
    (first, second), terrain = sorted(drones)[:2], mission.terrain
    return {
        "all see": lambda view: view,
        "the first is blind": lambda view: blind(view, terrain) if view.drone == first else view,
        "the second is blind": lambda view: blind(view, terrain) if view.drone == second else view,
        "the first is missing": lambda view: None if view.drone == first else view,
    }


def told(mission: Mission, change: Change) -> NDArray[np.float64]:
    """People in view who stand in a zone and closed ground per crowds' own, by beliefs alone and as it is
    [2, 2]."""
    config = cf.RunConfig(TUNED[0].method).with_detector(mission.contract)
    crowd_map = config.crowd_map(mission.terrain, mission.drones)
    threshold = crowd_map.default_threshold()
    grounds = [kind(crowd_map, threshold, threshold) for kind in (ByBeliefs, ClosedGround)]
    safety = [Safety() for _ in grounds]
    watched = [moment.stamp_ns for moment in mission.moments if moment.in_view is not None][::EVERY]
    for moment in mission.moments:
        views = [view for view in map(change, moment.observations) if view is not None]
        crowd_map.integrate_observations(views, moment.stamp_ns)
        for ground, one in zip(grounds, safety, strict=True):
            ground.step(moment.stamp_ns)
            if moment.in_view is not None and moment.stamp_ns in watched:
                one.add_zone(moment.in_view, ground.columns, mission.terrain.voxel_size_m)
    at = BUFFERS_M.index(5.0)
    return np.array([(one.share_in_zone[at], one.blocked_per_own[at]) for one in safety])


def main() -> None:
    missions = [seen(Path(path)) for path in sys.argv[1:]]
    print("| | by beliefs alone | as it is |\n|---|---|---|")
    for name in changes(missions[0]):
        by_mission = np.array([told(mission, changes(mission)[name]) for mission in missions])
        means = [f"{people:.3f} / {closed:.2f}" for people, closed in by_mission.mean(axis=0)]
        print(f"| {name} | {' | '.join(means)} |", flush=True)


if __name__ == "__main__":
    sys.exit(main())
