"""The layer `landing-site` on recorded missions, and what it and the slope of the map are worth as a spatial
prior of crowds: `python measure.py MISSION.mcap...`.

Two maps take in the same instants: crowds by the shipped detector, landing ground by the simulator's
stand-in. The first table scores the second map like any other. The second table is about the first: who
stands in a zone and what is closed, when columns are taken out of the zones that are steeper than a limit, or
that the landing map calls free. A prior that speaks at read-out alone makes nothing of ground that nobody has
looked at: it is in no zone either way, and not empty.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from landing import with_landing
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1] / "evidence"))
from judge import FINE
from seen import seen

import crowdfence as cf
from crowdfence.evaluation.layer_measures import LayerMeasures
from crowdfence.evaluation.safety import BUFFERS_M, Safety
from crowdfence.evaluation.threshold_sweep import ThresholdSweep
from crowdfence.landing_area import column_surface_m, slope_deg
from crowdfence.sources.layers import LANDING_SITE
from crowdfence.truth.at_exposure import people_at
from crowdfence.truth.over_time import LayerOfTheWorld
from crowdfence.zones.closed_ground import ClosedGround

SLOPES_DEG = (60.0, 45.0, 30.0, 20.0)
LANDING = (0.9, 0.8, 0.6)
AT = BUFFERS_M.index(5.0)


class Steepness:
    """Slope of the map's upper surface over 5 x 5 columns."""

    def __init__(self, terrain: cf.Terrain) -> None:
        self._slope = slope_deg(column_surface_m(terrain), terrain.voxel_size_m, window_cells=5)
        corner = (terrain.bounds[0] - np.asarray(terrain.origin)) / terrain.voxel_size_m
        self._first = np.rint(corner).astype(np.int64)[:2]

    def at(self, columns: NDArray[np.int64]) -> NDArray[np.float32]:
        """Of columns [C, 2], 0 where it cannot be told: nothing is taken out for that."""
        return np.nan_to_num(self._slope[tuple((columns - self._first).T)], nan=0.0)


def free_of(landing: cf.CrowdMap, stamp_ns: int, threshold: float) -> set[tuple[int, int]]:
    """Columns that the landing map calls free."""
    return set(map(tuple, landing.crowd_columns(stamp_ns, threshold=threshold).indices.tolist()))


def measure(path: Path) -> None:
    mission, recording = seen(path), with_landing(path).of_layer(LANDING_SITE)
    terrain = mission.terrain
    crowds = cf.RunConfig().with_detector(mission.contract).crowd_map(terrain, mission.drones)
    landing = cf.RunConfig().with_layer(LANDING_SITE).with_detector(None).crowd_map(terrain, mission.drones)
    truth, steep = LayerOfTheWorld(recording, terrain), Steepness(terrain)
    threshold = crowds.default_threshold()
    ground = ClosedGround(crowds, threshold, threshold)
    names = [
        "as it is",
        *(f"up to {one:g} deg" for one in SLOPES_DEG),
        *(f"landing < {one}" for one in LANDING),
    ]
    safety = {name: Safety() for name in names}
    measures, sweep = LayerMeasures(), ThresholdSweep([*FINE, landing.default_threshold()])
    # Moments that say who stands where come once a second: the landing map is fed no more often.
    for moment, instant in zip(mission.moments, recording.instants(), strict=True):
        assert moment.stamp_ns == instant.stamp_ns
        crowds.integrate_observations(moment.observations, moment.stamp_ns)
        if moment.in_view is not None:
            landing.integrate(instant.views().views, instant.stamp_ns)
        ground.step(moment.stamp_ns)
        if moment.in_view is None:
            continue
        fits, people = truth.at(instant), people_at(instant.frames[-1], recording).position
        measures.add(landing, moment.stamp_ns, landing.default_threshold(), fits, people)
        ids, probability = landing.seen_probability(moment.stamp_ns)
        sweep.update(probability, fits[ids])
        columns = ground.columns
        kept = [np.ones(len(columns), bool), *(steep.at(columns) <= one for one in SLOPES_DEG)]
        for one in LANDING:
            free = free_of(landing, moment.stamp_ns, one)
            kept.append(np.array([tuple(column) not in free for column in columns.tolist()], bool))
        for counted, some in zip(safety.values(), kept, strict=True):
            counted.add_zone(moment.in_view, columns[some], terrain.voxel_size_m)
    result, told = sweep.result(), measures.to_json()
    best, best_iou = result.best()
    figures = [result.at(landing.default_threshold()).mean, best, best_iou.mean]
    figures += [told[name] for name in list(told)[:6]]
    print(f"| {path.stem} | " + " | ".join(f"{one:.3f}" for one in figures) + " |")
    for name, one in safety.items():
        shares = one.share_in_zone_in_range[AT], one.share_in_zone[AT], one.blocked_per_own[AT]
        print(
            f"| {path.stem} | {name} | " + " | ".join(f"{share:.4f}" for share in shares) + " |", flush=True
        )


def main() -> None:
    print("landing: mIoU, best threshold, mIoU there, AP, Brier, ECE, of it true, found, people on it")
    print("crowds: people in range in a zone, in view, closed per own, 5 m around")
    for path in sys.argv[1:]:
        measure(Path(path))


if __name__ == "__main__":
    main()
