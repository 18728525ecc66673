"""A map of 16 km2 at 0.5 m: time and memory to build, bytes a voxel, rays a second, time to project a view.

Takes about 2 GB of memory. `--side-m 1000` is a sixteenth of the area.
"""

import argparse
import resource
import statistics
import time
from collections.abc import Callable

import numpy as np
from scene import hills_with_buildings, machine, vga_view

from crowdfence import Terrain, project

MAX_BYTES_PER_VOXEL = 6.0
RAYS = 1_000_000


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--side-m", type=float, default=4000.0)
    parser.add_argument("--voxel-size-m", type=float, default=0.5)
    options = parser.parse_args()
    voxel_size_m = options.voxel_size_m

    height_m = hills_with_buildings(options.side_m, voxel_size_m)
    start = time.perf_counter()
    terrain = Terrain.from_height_map(height_m, voxel_size_m)
    build_s = time.perf_counter() - start
    peak_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9  # Linux counts in KiB

    bytes_per_voxel = terrain.bytes / terrain.voxel_count
    origins, directions = _rays_from_above(terrain)
    raycast_s = _median_s(lambda: terrain.raycast(origins, directions, 500.0), repeats=3)
    view = vga_view(height_m, voxel_size_m, 0)
    rays_s = _median_s(lambda: project(view, terrain, max_range_m=300.0, coverage="rays"), repeats=11)
    full_s = _median_s(lambda: project(view, terrain, max_range_m=300.0), repeats=11)
    seen = len(project(view, terrain, max_range_m=300.0, coverage="rays").voxel_ids)
    seen_full = len(project(view, terrain, max_range_m=300.0).voxel_ids)

    print(f"{options.side_m / 1e3:g} x {options.side_m / 1e3:g} km at {voxel_size_m} m; {machine()}\n")
    print("| | |\n|---|---|")
    print(f"| voxels | {terrain.voxel_count / 1e6:.1f} M |")
    print(f"| build from the height map | {build_s:.1f} s, {peak_gb:.1f} GB at the peak |")
    print(f"| voxels and surface | {terrain.bytes / 1e6:.0f} MB, {bytes_per_voxel:.2f} bytes a voxel |")
    print(f"| raycast from 80 m above | {RAYS / raycast_s / 1e6:.2f} M rays/s |")
    print(f"| project 640 x 480, rays | {rays_s * 1e3:.0f} ms, {seen} voxels |")
    print(f"| project 640 x 480, full | {full_s * 1e3:.0f} ms, {seen_full} voxels |")
    if bytes_per_voxel > MAX_BYTES_PER_VOXEL:
        raise SystemExit(f"a voxel takes more than {MAX_BYTES_PER_VOXEL} bytes")


def _rays_from_above(terrain: Terrain) -> tuple[np.ndarray, np.ndarray]:
    """Starts 80 m above voxels drawn at random, 20 to 90 degrees down, in any direction."""
    rng = np.random.default_rng(3)
    origins = terrain.voxel_centers(rng.integers(0, terrain.voxel_count, RAYS))
    origins[:, 2] += 80.0
    down, azimuth = np.radians(rng.uniform(20.0, 90.0, RAYS)), rng.uniform(0.0, 2 * np.pi, RAYS)
    level = np.cos(down)
    return origins, np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), -np.sin(down)])


def _median_s(call: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


if __name__ == "__main__":
    main()
