"""How strongly a look speaks for landing ground: `python calibrate.py EVERY MISSION.mcap...`, on every
so manieth frame of training missions.

The printed prior and log ratios are those of `python/crowdfence/config/layer.py`. Every voxel of every look
counts once, against the recorded ground at that moment.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from landing import with_landing

import crowdfence as cf
from crowdfence.config.layer import BORDERS
from crowdfence.sources.layers import LANDING_SITE
from crowdfence.truth.over_time import LayerOfTheWorld


def main() -> None:
    counts = np.zeros((2, len(BORDERS) + 1))
    for path in map(Path, sys.argv[2:]):
        recording = with_landing(path, int(sys.argv[1])).of_layer(LANDING_SITE)
        terrain = cf.open_terrain(recording)
        truth = LayerOfTheWorld(recording, terrain)
        crowd_map = cf.RunConfig(cf.OrConfig()).crowd_map(terrain, len(recording.drones))
        of_mission = np.zeros_like(counts)
        for instant in recording.instants():
            fits = truth.at(instant)
            update = crowd_map.integrate(instant.views().views, instant.stamp_ns)
            for look in update.observations:
                # A value on a border belongs to the bin below, as in the core.
                bins = np.searchsorted(BORDERS, look.mean.astype(np.float32))
                for row, some in enumerate((~fits[look.voxel_ids], fits[look.voxel_ids])):
                    of_mission[row] += np.bincount(bins[some], minlength=len(BORDERS) + 1)
        share = of_mission[1].sum() / of_mission.sum()
        print(f"{path.stem}: {share:.3f} of the looked-at voxels are landing ground", flush=True)
        counts += of_mission / of_mission.sum()
    shares = counts / counts.sum(axis=1, keepdims=True)
    print("prior", round(float(counts[1].sum() / counts.sum()), 3))
    print("log ratio", np.log(shares[1] / shares[0]).round(1).tolist())


if __name__ == "__main__":
    main()
