"""Zones of one instant: what they cost with 10^3 to 10^5 crowd columns, in a map of 10^7 voxels.

The rivals are the map seen from above (`SurfaceGrid`), whose cost is the map's, and shapely's union of a box
per run of columns.
"""

import time
from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import NDArray
from scene import hills_with_buildings, machine

from crowdfence import CrowdMap, Observation, Paper, Rates, SurfaceGrid, Terrain, find_zones
from crowdfence.zones.outline import outlines
from crowdfence.zones.regions import Runs, largest_first, reach_columns

SIDE_M = 1500.0
VOXEL_SIZE_M = 0.5
SEEN_COLUMNS = 1000  # along each side of the square that was seen
REPEATS = 21
GRID_REPEATS = 3


def main() -> None:
    terrain = Terrain.from_height_map(hills_with_buildings(SIDE_M, VOXEL_SIZE_M), VOXEL_SIZE_M)
    print(
        f"{terrain.voxel_count / 1e6:.1f} M voxels, {SEEN_COLUMNS**2 / 1e6:.1f} M seen; "
        f"fastest of {REPEATS}; {machine()}\n"
    )
    print(
        "| crowd columns | regions | rings | core: crowd columns | regions | outlines | find_zones "
        "| shapely.union_all | SurfaceGrid |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for columns in (1_000, 10_000, 100_000):
        for regions in (1, 100):
            _print_row(_crowd_map(terrain, _ragged_discs(columns, regions)))


def _print_row(crowd_map: CrowdMap) -> None:
    terrain = crowd_map.terrain
    columns = crowd_map.crowd_columns(0)
    runs = Runs.of(columns.indices)
    reach = reach_columns(VOXEL_SIZE_M)
    region = largest_first(runs, reach)
    polygons = outlines(runs, region, terrain)
    times_ms = [
        _fastest_ms(lambda: crowd_map.crowd_columns(0)),
        _fastest_ms(lambda: largest_first(Runs.of(columns.indices), reach)),
        _fastest_ms(lambda: outlines(runs, region, terrain)),
        _fastest_ms(lambda: find_zones(crowd_map, 0)),
        _fastest_ms(lambda: _unions(runs, region)),
        _fastest_ms(lambda: SurfaceGrid.from_crowd_map(crowd_map, 0), GRID_REPEATS),
    ]
    rings = sum(shapely.get_num_interior_rings(shapely.get_parts(polygons)) + 1)
    figures = " | ".join(f"{time_ms:.1f} ms" for time_ms in times_ms)
    print(f"| {len(columns)} | {len(polygons)} | {rings} | {figures} |", flush=True)


def _unions(runs: Runs, region: NDArray[np.int64]) -> list[object]:
    boxes = shapely.box(runs.i, runs.south, runs.i + 1, runs.north)
    unions = [shapely.union_all(boxes[region == number]) for number in range(region.max() + 1)]
    return list(shapely.simplify(shapely.normalize(unions), 0.0))


def _ragged_discs(columns: int, regions: int) -> NDArray[np.bool_]:
    """Crowd [X, Y] of the square that was seen: discs with a wavy edge, every fiftieth column left out."""
    rng = np.random.default_rng(5)
    across = round(np.sqrt(regions))
    pitch = SEEN_COLUMNS // across
    radius = np.sqrt(columns / regions / np.pi)
    east, north = np.indices((pitch, pitch)) - pitch / 2 + 0.5
    azimuth = np.arctan2(north, east)
    edge = radius * (1.0 + 0.2 * np.sin(3 * azimuth) + 0.1 * np.sin(11 * azimuth))
    disc = np.hypot(east, north) < edge
    crowd = np.tile(disc, (across, across))
    return np.asarray(crowd & (rng.random(crowd.shape) > 0.02))


def _crowd_map(terrain: Terrain, crowd: NDArray[np.bool_]) -> CrowdMap:
    """One look at the middle of the map, in which one drone of three is sure of everything."""
    crowd_map = CrowdMap(terrain, Paper(Rates(0.9, 0.05), 0.2, alpha=1.0, fleet_size=3))
    low, high = terrain.bounds
    middle = np.floor((low + high)[:2] / 2 / VOXEL_SIZE_M) - SEEN_COLUMNS / 2
    east, north = ((np.indices(crowd.shape).reshape(2, -1).T + middle + 0.5) * VOXEL_SIZE_M).T
    from_above = np.column_stack([east, north, np.full(crowd.size, high[2] + 1.0)])
    down = np.broadcast_to([0.0, 0.0, -1.0], from_above.shape)
    ids, range_m = terrain.raycast(from_above, down, high[2] - low[2] + 2.0)
    order = np.argsort(ids)
    observation = Observation(
        terrain,
        "uav1",
        0,
        voxel_ids=ids[order],
        mean=crowd.ravel()[order].astype(float),
        pixel_count=np.ones(crowd.size, dtype=int),
        range_m=range_m[order],
        tilt_deg=np.full(crowd.size, 90.0),
        occluded_ids=[],
    )
    crowd_map.integrate_observations([observation], 0)
    return crowd_map


def _fastest_ms(call: Callable[[], object], repeats: int = REPEATS) -> float:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times) * 1e3


if __name__ == "__main__":
    main()
