"""Time to integrate the same view into maps of 1, 4 and 16 times the area, all of them seen before.

Decay is worked out on read, so an instant costs what its views see. Reading the whole map does cost the map.
"""

import statistics
import time
from dataclasses import dataclass, field

import numpy as np
from scene import hills_with_buildings, machine, vga_view

from crowdfence import Camera, CrowdMap, Paper, Rates, Terrain, View, project

SIDES_M = (500.0, 1000.0, 2000.0)
VOXEL_SIZE_M = 0.5
MAX_RANGE_M = 200.0  # stays inside the smallest map
REPEATS = 41
SECOND_NS = 1_000_000_000


@dataclass(slots=True)
class Area:
    """One map and what was measured on it."""

    side_m: float
    ground_m: np.ndarray
    crowd_map: CrowdMap
    seen_before: int
    seen_by_view: int = 0
    integrate_s: list[float] = field(default_factory=list)
    fuse_s: list[float] = field(default_factory=list)
    read_s: list[float] = field(default_factory=list)


def main() -> None:
    height_m = hills_with_buildings(SIDES_M[-1], VOXEL_SIZE_M)
    areas = [_area(height_m, side_m) for side_m in SIDES_M]
    # Taking turns, so that what else the machine does hits all of them.
    for repeat in range(REPEATS):
        for area in areas:
            _integrate(area, (2 * repeat + 1) * SECOND_NS)
    for _ in range(REPEATS):
        for area in areas:
            _read(area)

    print(f"640 x 480 view, voxels of {VOXEL_SIZE_M} m; {machine()}\n")
    print(
        "| map | voxels | seen before | seen by the view | integrate | of which pool and blend | read all |"
    )
    print("|---|---|---|---|---|---|---|")
    smallest = areas[0]
    for area in areas:
        voxels = area.crowd_map.terrain.voxel_count
        print(
            f"| {area.side_m:g} m | {voxels / 1e6:.1f} M | {area.seen_before / 1e6:.1f} M "
            f"| {area.seen_by_view} | {_against(area.integrate_s, smallest.integrate_s)} "
            f"| {_against(area.fuse_s, smallest.fuse_s)} | {_against(area.read_s, smallest.read_s)} |"
        )


def _against(times_s: list[float], smallest_s: list[float]) -> str:
    median_s = statistics.median(times_s)
    return f"{median_s * 1e3:.1f} ms ({median_s / statistics.median(smallest_s):.2f} x)"


def _area(height_m: np.ndarray, side_m: float) -> Area:
    """Middle of the landscape; the view looks from the middle, so all maps share the ground around it."""
    cells, all_cells = round(side_m / VOXEL_SIZE_M), height_m.shape[0]
    around = slice((all_cells - cells) // 2, (all_cells + cells) // 2)
    ground_m = np.ascontiguousarray(height_m[around, around])
    terrain = Terrain.from_height_map(ground_m, VOXEL_SIZE_M)
    crowd_map = _crowd_map_seen_everywhere(terrain, ground_m, side_m)
    return Area(side_m, ground_m, crowd_map, len(crowd_map.seen_ids()))


def _crowd_map_seen_everywhere(terrain: Terrain, ground_m: np.ndarray, side_m: float) -> CrowdMap:
    """After one look from so high that the whole map is in the image."""
    crowd_map = CrowdMap(terrain, Paper(Rates(0.9, 0.05), 0.2, fleet_size=2), max_range_m=MAX_RANGE_M)
    height_m = 10.0 * side_m
    camera = Camera.pinhole(512, 512, 5000.0, 5000.0, 256.0, 256.0)
    world_from_camera = np.diag([1.0, -1.0, -1.0, 1.0])
    world_from_camera[:3, 3] = (side_m / 2, side_m / 2, float(ground_m.mean()) + height_m)
    view = View("high", 0, camera, world_from_camera, np.full((512, 512), 0.25, np.float32))
    observation = project(view, terrain, max_range_m=2 * height_m, coverage="full")
    crowd_map.integrate_observations([observation], 0)
    return crowd_map


def _integrate(area: Area, stamp_ns: int) -> None:
    """The view, and a second later the same once more without projecting it."""
    view = vga_view(area.ground_m, VOXEL_SIZE_M, stamp_ns)
    start = time.perf_counter()
    update = area.crowd_map.integrate([view], stamp_ns)
    area.integrate_s.append(time.perf_counter() - start)
    start = time.perf_counter()
    area.crowd_map.integrate_observations(update.observations, stamp_ns + SECOND_NS)
    area.fuse_s.append(time.perf_counter() - start)
    area.seen_by_view = len(update.voxel_ids)


def _read(area: Area) -> None:
    stamp_ns = area.crowd_map.span_ns[1] + SECOND_NS
    start = time.perf_counter()
    area.crowd_map.probability(stamp_ns)
    area.read_s.append(time.perf_counter() - start)


if __name__ == "__main__":
    main()
