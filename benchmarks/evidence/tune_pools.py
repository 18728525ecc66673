"""Tunes what `evidence` is compared with on training missions: `python tune_pools.py MISSION.mcap...`.

Every knob of `KNOBS` is turned, one at a time, from the method's best value of the knobs before it: a
coordinate search, with the same effort a knob for all of them, `paper` included. A setting is judged by the
mean IoU at the one threshold that is best over all missions together. Missions are thinned to every eighth
tile of 4 m, which costs an eighth.
"""

from __future__ import annotations

import argparse
import pickle
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from heatmaps import model_sha
from judge import FINE
from numpy.typing import NDArray
from seen import Mission, Moment, part_of, seen

import crowdfence as cf
from crowdfence.config import (
    EvidenceConfig,
    LinearPoolConfig,
    LogOddsConfig,
    LogPoolConfig,
    MethodConfig,
    MovingAverageConfig,
    PaperConfig,
)
from crowdfence.evaluation.knobs import KNOBS
from crowdfence.evaluation.threshold_sweep import ThresholdSweep

TILE_M, KEPT_IN = 4.0, 8
STARTS = (
    EvidenceConfig(),
    PaperConfig(prior=0.015),
    LinearPoolConfig(),
    LogPoolConfig(),
    LogOddsConfig(),
    MovingAverageConfig(),
)
ASIDE = {"unseen", "normalise", "initial"}
"""Switches of `paper` that make another method of it: `linear-pool` stands for that."""


class Worth(NamedTuple):
    """Of a setting over all missions."""

    iou: float
    threshold: float


def thinned(path: Path) -> Mission:
    """The mission with the looks at some tiles alone; kept beside it."""
    kept = path.with_suffix(".thin")
    if kept.exists():
        recording = cf.open_recording(path)
        moments = pickle.loads(kept.read_bytes())
        contract = cf.Detector().contract
        return Mission(path.stem, cf.open_terrain(recording), contract, len(recording.drones), moments)
    mission = seen(path)
    moments = [_thin(mission.terrain, moment) for moment in mission.moments]
    kept.write_bytes(pickle.dumps(moments))
    return mission._replace(moments=moments)


def _thin(terrain: cf.Terrain, moment: Moment) -> Moment:
    observations = [part_of(terrain, one, _is_kept(terrain, one.voxel_ids)) for one in moment.observations]
    crowd_ids = moment.crowd_ids[_is_kept(terrain, moment.crowd_ids)]
    return Moment(moment.stamp_ns, observations, crowd_ids, None)


def _is_kept(terrain: cf.Terrain, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
    tile = terrain.voxel_indices(ids)[:, :2].astype(np.int64) // round(TILE_M / terrain.voxel_size_m)
    return (tile[:, 0] * 73_856_093 ^ tile[:, 1] * 19_349_663) % KEPT_IN == 0


def iou_by_threshold(mission: Mission, method: MethodConfig) -> NDArray[np.float64]:
    """Mean IoU at each of `FINE`."""
    config = cf.RunConfig(method).with_detector(mission.contract)
    crowd_map = config.crowd_map(mission.terrain, mission.drones)
    sweep = ThresholdSweep(FINE)
    for moment in mission.moments:
        crowd_map.integrate_observations(moment.observations, moment.stamp_ns)
        ids, probability = crowd_map.seen_probability(moment.stamp_ns)
        sweep.update(probability, np.isin(ids, moment.crowd_ids, assume_unique=True))
    return np.nanmean(sweep.result().per_frame, axis=0)


def worth(missions: list[Mission], method: MethodConfig) -> Worth:
    together = np.mean([iou_by_threshold(one, method) for one in missions], axis=0)
    return Worth(float(together.max()), float(FINE[together.argmax()]))


def tuned(missions: list[Mission], start: MethodConfig) -> tuple[MethodConfig, Worth]:
    best, reached = start, worth(missions, start)
    for knob, values in KNOBS[type(start)].items():
        if knob in ASIDE:
            continue
        for value in values:
            if value == getattr(best, knob):
                continue
            one = replace(best, **{knob: value})
            found = worth(missions, one)
            print(f"  {start.name} {knob}={value:g}: {found.iou:.4f} at {found.threshold:.4f}", flush=True)
            if found.iou > reached.iou:
                best, reached = one, found
    return best, reached


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    parser.add_argument("--only", help="Name of the one method to tune.")
    arguments = parser.parse_args()
    missions = [thinned(path) for path in arguments.missions]
    print(f"model {model_sha()}, {', '.join(one.name for one in missions)}")
    for start in STARTS:
        if arguments.only in (None, start.name):
            best, reached = tuned(missions, start)
            print(f"{best}\n  mean IoU {reached.iou:.4f} at threshold {reached.threshold:.4f}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
