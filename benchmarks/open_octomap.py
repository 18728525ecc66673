"""An OctoMap of 4 km2 at 0.5 m, opened and written: beside the OctoMap library, which reads and writes the
same file and finds no surface in its voxels.

CPU time of all threads and wall time, fastest of three; the machine should do nothing else.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyoctomap
from scene import hills_with_buildings, machine

from crowdfence import Terrain
from crowdfence.exports.octomap import write_terrain_octomap
from crowdfence.maps import open_terrain

PASSES = 3


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--side-m", type=float, default=2000.0)
    parser.add_argument("--voxel-size-m", type=float, default=0.5)
    options = parser.parse_args()

    heights_m = hills_with_buildings(options.side_m, options.voxel_size_m)
    terrain = Terrain.from_height_map(heights_m, options.voxel_size_m)
    print(f"{terrain.voxel_count / 1e6:.1f} M voxels of {options.voxel_size_m:g} m; {machine()}\n")
    print("| | crowdfence: CPU | wall | OctoMap library: CPU | crowdfence / library |")
    print("|---|---|---|---|---|")
    with TemporaryDirectory() as folder:
        path, theirs = Path(folder, "map.bt"), Path(folder, "theirs.bt")
        ours = _fastest(lambda: write_terrain_octomap(path, terrain))
        tree = pyoctomap.OcTree(options.voxel_size_m)
        tree.readBinary(str(path))
        _row("write", ours, _fastest(lambda: tree.writeBinary(str(theirs))))
        library = _fastest(lambda: pyoctomap.OcTree(options.voxel_size_m).readBinary(str(path)))
        _row("open, with where the surface lies", _fastest(lambda: open_terrain(path)), library)


def _fastest(call: Callable[[], object]) -> tuple[float, float]:
    """CPU and wall seconds."""
    times = []
    for _ in range(PASSES):
        cpu_s, wall_s = time.process_time(), time.perf_counter()
        call()
        times.append((time.process_time() - cpu_s, time.perf_counter() - wall_s))
    cpu_s, wall_s = np.min(times, axis=0)
    return float(cpu_s), float(wall_s)


def _row(name: str, ours: tuple[float, float], library: tuple[float, float]) -> None:
    print(
        f"| {name} | {ours[0]:.2f} s | {ours[1]:.2f} s | {library[0]:.2f} s | {ours[0] / library[0]:.1f} x |"
    )


if __name__ == "__main__":
    main()
