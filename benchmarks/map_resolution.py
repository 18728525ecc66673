"""One flight over one crowd, on maps from coarser to far finer than the footprint of a pixel.

A crowd fills 12 x 12 m of a gentle slope. A drone looks at it five times on its way past, from 150 m away and
70 m above; a pixel covers about 0.4 x 1 m of the ground. The heatmaps are perfect: 1 at a pixel whose ray
meets the crowd's ground, worked out on the plane itself. Nothing of the 144 m2 should depend on the voxels.
`paper` calls a voxel crowd from its fourth look on.
"""

import argparse
import os
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from projections import projections
from scene import machine

from crowdfence import Camera, CrowdMap, Or, Paper, Terrain, View
from crowdfence.config.method import PaperConfig

VOXEL_SIZES_M = (2.0, 1.0, 0.5, 0.25, 0.1)
CROWD_M = 12.0
MAP_M = 64.0
SLOPE = np.array([0.04, 0.03])  # rise per metre east and north
AWAY_M, ABOVE_M = 150.0, 70.0
LOOKS, LOOK_NS = 5, 1_000_000_000
FLOWN_M = np.array([6.3, 1.9])  # east and north from look to look
PRIOR = 0.5

Array = NDArray[np.float64]


def slope(voxel_size_m: float) -> Terrain:
    """A square of `MAP_M` around the origin, whose middle lies at z = 0."""
    along_m = (np.arange(round(MAP_M / voxel_size_m)) + 0.5) * voxel_size_m - MAP_M / 2
    height_m = SLOPE[0] * along_m[:, None] + SLOPE[1] * along_m
    return Terrain.from_height_map(height_m, voxel_size_m, origin=(-MAP_M / 2, -MAP_M / 2, 0.0))


def flight() -> list[View]:
    """Looks from the south, with the crowd in the middle of the first one."""
    camera = Camera.pinhole(640, 480, 381.0, 381.0, 320.0, 240.0)
    down = np.arctan2(ABOVE_M, AWAY_M)
    level, drop = np.cos(down), np.sin(down)
    views = []
    for look in range(LOOKS):
        pose = np.eye(4)
        pose[:3, :3] = np.array([[1.0, 0.0, 0.0], [0.0, -drop, level], [0.0, -level, -drop]])
        pose[:3, 3] = (*(np.array([0.0, -AWAY_M]) + look * FLOWN_M), ABOVE_M)
        views.append(View("drone", look * LOOK_NS, camera, pose, _perfect_heatmap(camera, pose)))
    return views


def _perfect_heatmap(camera: Camera, pose: Array) -> NDArray[np.uint8]:
    v, u = np.indices((camera.height, camera.width)) + 0.5
    rays = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1)) @ pose[:3, :3].T
    origin = pose[:3, 3]
    t = (origin[2] - origin[:2] @ SLOPE) / (rays[:, :2] @ SLOPE - rays[:, 2])
    met = (t > 0.0) & _in_crowd(origin[:2] + t[:, None] * rays[:, :2])
    return (met * np.uint8(255)).reshape(camera.height, camera.width).astype(np.uint8)


def _in_crowd(xy: Array) -> NDArray[np.bool_]:
    return np.asarray((np.abs(xy) < CROWD_M / 2).all(axis=1))


def fly(terrain: Terrain, method: Paper | Or, projection: dict[str, Any], views: list[View]) -> str:
    """A row of the table, from the fused map."""
    crowd_map = CrowdMap(terrain, method, **projection)
    start = time.process_time()
    for view in views:
        crowd_map.integrate([view], view.stamp_ns)
    seconds = time.process_time() - start
    columns = crowd_map.crowd_columns(views[-1].stamp_ns).indices
    size_m = terrain.voxel_size_m
    right = _in_crowd((columns + 0.5) * size_m + np.asarray(terrain.origin)[:2]) if len(columns) else columns
    called_m2, right_m2 = len(columns) * size_m**2, np.count_nonzero(right) * size_m**2
    missed_m2 = CROWD_M**2 - right_m2
    return (
        f"{called_m2:.0f} m2 | {called_m2 - right_m2:.0f} m2 | {missed_m2:.0f} m2 "
        f"| {len(crowd_map.seen_ids())} | {1e3 * seconds / len(views):.0f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--voxel-sizes-m", type=float, nargs="+", default=VOXEL_SIZES_M)
    options = parser.parse_args()

    views = flight()
    print(f"{CROWD_M**2:g} m2 of crowd, {LOOKS} looks; {machine()}, load {os.getloadavg()[0]:.1f}\n")
    print("| projection | method | voxels | called crowd | of it wrong | missed | voxels seen | CPU a look |")
    print("|---|---|---|---|---|---|---|---|")
    terrains = {size_m: slope(size_m) for size_m in options.voxel_sizes_m}
    methods: dict[str, Paper | Or] = {
        "paper": PaperConfig(prior=PRIOR).fusion_method(terrains[options.voxel_sizes_m[0]], 1),
        "or": Or(),
    }
    for name, projection in projections().items():
        for method_name, method in methods.items():
            for size_m, terrain in terrains.items():
                row = fly(terrain, method, projection, views)
                print(f"| {name} | {method_name} | {size_m:g} m | {row} |")


if __name__ == "__main__":
    main()
