"""What a spatial prior gives: `python spatial_prior.py --train MISSION.mcap... --test MISSION.mcap...`.

Walls and steep roofs hold no crowd. How much less crowd stands on a slope is counted on the training
missions, as ln P(slope | crowd) / P(slope | no crowd) of the ground that was seen, and added to the log odds
of `evidence` when they are read. Thinned missions (`tune_pools.py`); the mean IoU is at the best threshold of
each.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from heatmaps import model_sha
from judge import FINE
from numpy.typing import NDArray
from seen import Mission
from tune_pools import thinned

import crowdfence as cf
from crowdfence.config import EvidenceConfig
from crowdfence.evaluation.threshold_sweep import ThresholdSweep
from crowdfence.landing_area import column_surface_m, slope_deg

SLOPES_DEG = np.array([5.0, 10.0, 15.0, 25.0, 40.0])
"""Borders between the classes; one more is what lies below the top of its column: walls, ground under
roofs."""
MOST = 3.0
"""Log odds that a slope may take away or give."""


def classes(terrain: cf.Terrain) -> NDArray[np.int8]:
    """Of every voxel."""
    height_m = column_surface_m(terrain)
    slope = slope_deg(height_m, terrain.voxel_size_m, window_cells=5)
    ids = np.arange(terrain.voxel_count)
    lowest = np.rint((terrain.bounds[0] - np.asarray(terrain.origin)) / terrain.voxel_size_m)
    i, j, _ = (terrain.voxel_indices(ids) - lowest.astype(np.int64)).T
    of_slope = np.digitize(np.nan_to_num(slope[i, j], nan=90.0), SLOPES_DEG)
    above_m = terrain.surface_heights(ids) - terrain.bounds[0, 2]
    is_below = above_m < height_m[i, j] - terrain.voxel_size_m
    return np.where(is_below, len(SLOPES_DEG) + 1, of_slope).astype(np.int8)


def counted(mission: Mission, of: NDArray[np.int8]) -> NDArray[np.float64]:
    """[2, classes] voxels seen by the end, without and with crowd."""
    last = mission.moments[-1]
    looks = [one.voxel_ids for moment in mission.moments for one in moment.observations]
    seen = np.unique(np.concatenate(looks))
    crowd = np.isin(seen, last.crowd_ids, assume_unique=True)
    size = len(SLOPES_DEG) + 2
    return np.array([np.bincount(of[seen[some]], minlength=size) for some in (~crowd, crowd)], np.float64)


def best_iou(mission: Mission, offset: NDArray[np.float64]) -> float:
    """`offset` [V] is added to the log odds."""
    config = cf.RunConfig(EvidenceConfig()).with_detector(mission.contract)
    crowd_map = config.crowd_map(mission.terrain, mission.drones)
    sweep = ThresholdSweep(FINE)
    for moment in mission.moments:
        crowd_map.integrate_observations(moment.observations, moment.stamp_ns)
        ids, probability = crowd_map.seen_probability(moment.stamp_ns)
        log_odds = np.log(probability / (1.0 - probability)) + offset[ids]
        crowd = np.isin(ids, moment.crowd_ids, assume_unique=True)
        sweep.update(1.0 / (1.0 + np.exp(-log_odds)), crowd)
    return sweep.result().best()[1].mean


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--train", type=Path, nargs="+", required=True)
    parser.add_argument("--test", type=Path, nargs="+", required=True)
    arguments = parser.parse_args()
    counts = np.zeros((2, len(SLOPES_DEG) + 2))
    for path in arguments.train:
        mission = thinned(path)
        counts += counted(mission, classes(mission.terrain))
    shares = (counts + 0.5) / (counts + 0.5).sum(axis=1, keepdims=True)
    log_ratio = np.clip(np.log(shares[1] / shares[0]), -MOST, MOST)
    print(f"model {model_sha()}; borders {SLOPES_DEG.tolist()} deg, below the top")
    print("voxels without crowd", counts[0].astype(int).tolist(), "with", counts[1].astype(int).tolist())
    print("log ratio", log_ratio.round(2).tolist())
    print("| mission | as it is | with the prior |\n|---|---|---|")
    for path in arguments.test:
        mission = thinned(path)
        offset = log_ratio[classes(mission.terrain)]
        without, with_prior = best_iou(mission, np.zeros(len(offset))), best_iou(mission, offset)
        print(f"| {path.stem} | {without:.4f} | {with_prior:.4f} |", flush=True)


if __name__ == "__main__":
    sys.exit(main())
