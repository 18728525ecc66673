"""How far the ground of a map reaches: beyond it nobody can look, so nobody knows that it is empty."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.zones.map_holes import hole_columns
from crowdfence.zones.outline import outlines
from crowdfence.zones.regions import Runs
from crowdfence.zones.tracker import column_keys, column_places

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

_VOXELS_PER_BLOCK = 1 << 20
_MOST_CORNERS = 1000
"""The rim of a point cloud can have a hundred times as many; a history file and a planner carry them all."""


def known_ground(terrain: Terrain) -> Polygon | MultiPolygon:
    """What the rim of a map encloses, in local metres. Made once per terrain, 0.2 s a million voxels.

    Its holes are in it: they are unseen ground like any other, which `close_unseen` closes. A ragged rim is
    drawn with fewer corners, inward.
    """
    import shapely

    keys = []
    for start in range(0, terrain.voxel_count, _VOXELS_PER_BLOCK):
        block = np.arange(start, min(start + _VOXELS_PER_BLOCK, terrain.voxel_count), dtype=np.int64)
        keys.append(_distinct(column_keys(terrain.voxel_indices(block)[:, :2])))
    columns = _distinct(np.concatenate(keys))
    holes = column_keys(hole_columns(column_places(columns)))
    runs = Runs.of(column_places(_distinct(np.concatenate([columns, holes]))))
    (exact,) = outlines(runs, np.zeros(len(runs), dtype=np.int64), terrain)
    ground, tolerance_m = exact, terrain.voxel_size_m
    while shapely.get_num_coordinates(ground) > _MOST_CORNERS:
        # Taken in by more than simplifying may move a corner, so that no ground is added.
        ground = shapely.buffer(exact, -tolerance_m, join_style="mitre").simplify(0.9 * tolerance_m)
        tolerance_m *= 2.0
    return ground


def _distinct(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sorted. `np.unique` counts by hashes, which takes ten times as long for as many keys as a map has."""
    ordered = np.sort(keys)
    return ordered[np.append(True, ordered[1:] != ordered[:-1])]
