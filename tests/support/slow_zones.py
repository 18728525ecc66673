"""Zones by looking at every voxel of the terrain, one column after the other: what `find_zones` must give."""

import math
from collections import defaultdict

import numpy as np
import shapely
from numpy.typing import NDArray

from crowdfence import CrowdMap, Terrain
from crowdfence.zones import Zone

Column = tuple[int, int]


def slow_zones(crowd_map: CrowdMap, stamp_ns: int, threshold: float) -> list[Zone]:
    terrain = crowd_map.terrain
    indices = terrain.voxel_indices(np.arange(terrain.voxel_count))
    probability, last_seen_ns = crowd_map.probability(stamp_ns), crowd_map.last_seen_ns()
    voxels: dict[Column, list[int]] = defaultdict(list)
    for voxel, (i, j, _) in enumerate(indices.tolist()):
        voxels[i, j].append(voxel)
    seen = {column: [v for v in ids if last_seen_ns[v] >= 0] for column, ids in voxels.items()}
    largest = {column: max(probability[ids]) for column, ids in seen.items() if ids}
    regions = _regions({column for column, p in largest.items() if p >= threshold}, terrain.voxel_size_m)
    zones = []
    for number, region in enumerate(sorted(regions, key=lambda region: (-len(region), region)), start=1):
        levels = [indices[v, 2] for column in region for v in voxels[column]]
        crowd_in = [[v for v in seen[column] if probability[v] >= threshold] for column in region]
        newest = [max(last_seen_ns[ids]) for ids in crowd_in]
        crowd = [v for ids in crowd_in for v in ids]
        zones.append(
            Zone(
                id=f"Z{np.base_repr(number, 36)}",
                polygon=_union(region, terrain),
                cell_count=len(region),
                area_m2=len(region) * terrain.voxel_size_m**2,
                probability_max=max(largest[column] for column in region),
                probability_mean=float(np.mean([largest[column] for column in region])),
                lower_m=terrain.origin[2] + min(levels) * terrain.voxel_size_m,
                upper_m=terrain.origin[2] + (max(levels) + 1) * terrain.voxel_size_m,
                last_seen_ns=max(newest),
                oldest_look_ns=min(newest),
                seen_by=tuple(drone for drone in sorted(crowd_map.drones) if _saw(crowd_map, drone, crowd)),
            )
        )
    return zones


def _saw(crowd_map: CrowdMap, drone: str, ids: list[int]) -> bool:
    return any(drone in crowd_map.seen_by([voxel]) for voxel in ids)


def _regions(crowd: set[Column], size_m: float) -> list[list[Column]]:
    """Columns that touch, or lie within 2 m of each other from middle to middle."""
    regions = []
    while crowd:
        region = [crowd.pop()]
        for i, j in region:
            apart = {(ci, cj): (abs(ci - i), abs(cj - j)) for ci, cj in crowd}
            near = {
                one
                for one, (di, dj) in apart.items()
                if max(di, dj) == 1 or math.hypot(di, dj) * size_m <= 2.0
            }
            crowd -= near
            region += near
        regions.append(sorted(region))
    return regions


def _union(region: list[Column], terrain: Terrain) -> shapely.Polygon | shapely.MultiPolygon:
    """Of a box per unbroken run of columns, in the order that shapely gives to rings and parts."""
    runs: list[list[int]] = []  # i, first j, one past the last j
    for i, j in region:
        if runs and runs[-1][0] == i and runs[-1][2] == j:
            runs[-1][2] = j + 1
        else:
            runs.append([i, j, j + 1])
    column, south, north = np.array(runs).T
    west_m, east_m = (terrain.origin[0] + index * terrain.voxel_size_m for index in (column, column + 1))
    south_m, north_m = (terrain.origin[1] + index * terrain.voxel_size_m for index in (south, north))
    union = shapely.normalize(shapely.union_all(shapely.box(west_m, south_m, east_m, north_m)))
    if isinstance(union, shapely.Polygon):
        return _without_straight_vertices(union)
    return shapely.MultiPolygon([_without_straight_vertices(part) for part in union.geoms])


def _without_straight_vertices(polygon: shapely.Polygon) -> shapely.Polygon:
    shell, *holes = (_corners(np.asarray(ring.coords)) for ring in (polygon.exterior, *polygon.interiors))
    return shapely.Polygon(shell, holes)


def _corners(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    vertices = ring[:-1]
    straight = (np.roll(vertices, 1, axis=0) == vertices) & (vertices == np.roll(vertices, -1, axis=0))
    return vertices[~straight.any(axis=1)]
