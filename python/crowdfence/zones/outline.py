"""Columns of a terrain -> the polygons that they cover, exactly.

An outline runs along grid lines and turns at corners, so its corners alone make it: on every line they are
joined in pairs, from south to north or from west to east.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.zones.regions import Runs, connected

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

    from crowdfence._core import Terrain


def outlines(runs: Runs, region: NDArray[np.int64], terrain: Terrain) -> list[Polygon | MultiPolygon]:
    """Exact union of the columns of each region, in local metres: valid, with a vertex at every corner and
    nowhere else. Rings begin at their westernmost corner; shells run clockwise, holes counter-clockwise.

    region  [R] number of each run's region, 0 .. Z - 1, each at least once; no two regions share a corner
    """
    import shapely

    if len(runs) == 0:
        return []
    part = connected(runs)
    x, y, west_to_east = _corners(runs, part)
    corner, ring = _rings(west_to_east)
    x, y = x[corner], y[corner]
    rings = shapely.linearrings(_edge_m(x, terrain, 0), _edge_m(y, terrain, 1), indices=ring)
    first = np.searchsorted(ring, np.arange(len(rings)))
    bounded, is_hole = _bounded_part(runs, part, x[first], y[first])
    rings[is_hole] = shapely.reverse(rings[is_hole])
    order = np.lexsort((-y[first], -x[first], -_vertex_count(x, ring)))
    part_region = np.empty(part.max() + 1, dtype=np.int64)
    part_region[part] = region
    return _assembled(rings[order], bounded[order], is_hole[order], part_region)


def _edge_m(index: NDArray[np.int64], terrain: Terrain, axis: int) -> NDArray[np.float64]:
    # One expression for every edge, so that neighbouring columns share bit-identical coordinates.
    return terrain.origin[axis] + index.astype(np.float64) * terrain.voxel_size_m


def _corners(
    runs: Runs, part: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Where outlines turn: x, y [K], sorted, and the order [K] in which west to east comes first.

    (x, y) is the south-west corner of column (x, y). Where two columns touch at this corner and nowhere else,
    an outline turns twice, and the corner is there twice: as the end of the edge from the south, then as the
    beginning of the edge to the north.
    """
    x = np.concatenate([runs.i, runs.i, runs.i + 1, runs.i + 1])
    y = np.concatenate([runs.south, runs.north, runs.south, runs.north])
    # The columns north-east and south-west of a corner count 1, the other two -1: nothing is left on an edge.
    turn = np.repeat([1, -1, -1, 1], len(runs))
    _, at, corner = np.unique(runs.key(x, y), return_index=True, return_inverse=True)
    turn = np.bincount(corner, weights=turn).astype(np.int64)
    x, y, turn = x[at][turn != 0], y[at][turn != 0], turn[turn != 0]
    to_east = _turns_east(runs, part, x, y, turn)
    times = np.abs(turn)
    x, y, to_east = np.repeat(x, times), np.repeat(y, times), np.repeat(to_east, times)
    # The edge from the south comes first on the line from west to east if it goes on to the west.
    second = np.append(False, (np.diff(x) == 0) & (np.diff(y) == 0))
    return x, y, np.lexsort((second ^ to_east, x, y))


def _turns_east(
    runs: Runs, part: NDArray[np.int64], x: NDArray[np.int64], y: NDArray[np.int64], turn: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Whether the edge from the south goes on to the east [K], where two columns touch at a corner only.

    Two parts are two polygons: each outline stays with its column. Within one part that closes around ground
    below the threshold, a polygon and its hole must not become one ring: the outline changes the column.
    """
    to_east = np.zeros(len(x), dtype=np.bool_)
    two = np.flatnonzero(np.abs(turn) == 2)
    x, y, is_north_east = x[two], y[two], turn[two] > 0
    north = runs.holding(x - ~is_north_east, y)
    south = runs.holding(x - is_north_east, y - 1)
    to_east[two] = is_north_east == (part[north] == part[south])
    return to_east


def _rings(west_to_east: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Corners of all rings [V], each ring closed and beginning at its first corner; number of the ring [V].

    Corners 2n and 2n + 1 are joined by an edge from south to north, those at places 2n and 2n + 1 of
    `west_to_east` by one from west to east.
    """
    across = np.empty_like(west_to_east)
    across[west_to_east[0::2]] = west_to_east[1::2]
    across[west_to_east[1::2]] = west_to_east[0::2]
    next_across = across.tolist()
    done = bytearray(len(next_across))
    corners: list[int] = []
    lengths: list[int] = []
    for start in range(0, len(done), 2):
        if done[start]:
            continue
        begin, at = len(corners), start
        while not done[at]:
            along = at ^ 1
            done[at] = done[along] = 1
            corners += (at, along)
            at = next_across[along]
        corners.append(start)
        lengths.append(len(corners) - begin)
    return np.array(corners), np.repeat(np.arange(len(lengths)), lengths)


def _bounded_part(
    runs: Runs, part: NDArray[np.int64], x: NDArray[np.int64], y: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Which part each ring bounds, and whether it is a hole of it.

    (x, y) is the first corner of the ring: what it encloses begins north-east of there.
    """
    inside = runs.holding(x, y)
    is_hole = inside < 0
    return part[np.where(is_hole, runs.holding(x - 1, y), inside)], is_hole


def _vertex_count(x: NDArray[np.int64], ring: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many vertices each ring would have with one between every two columns on an edge from west to east,
    as the union of their runs has them: holes and parts have always come in this order."""
    steps = np.abs(np.diff(x))
    # An edge from south to north counts 1, whatever its length; between two rings there is no edge.
    vertices = np.where(np.diff(ring) == 0, np.maximum(steps, 1), 0)
    return np.bincount(ring[1:], weights=vertices).astype(np.int64)


def _assembled(
    rings: NDArray[Any], part: NDArray[np.int64], is_hole: NDArray[np.bool_], part_region: NDArray[np.int64]
) -> list[Polygon | MultiPolygon]:
    """One polygon per region, of several parts where not all its columns touch. Holes and parts come
    in the order of the rings."""
    import shapely

    shell_first = np.lexsort((is_hole, part))
    polygons = shapely.polygons(rings[shell_first], indices=part[shell_first])
    part = part[~is_hole]
    part = part[np.argsort(part_region[part], kind="stable")]
    region = part_region[part]
    whole = shapely.multipolygons(polygons[part], indices=region)
    alone = np.bincount(region)[region] == 1
    whole[region[alone]] = polygons[part[alone]]
    return list(whole)
