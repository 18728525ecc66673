"""How far the ground of a map reaches: beyond it nobody can look, so nobody knows that it is empty."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from crowdfence._core import Terrain
from crowdfence.zones.map_holes import hole_columns
from crowdfence.zones.outline import outlines
from crowdfence.zones.regions import Runs
from crowdfence.zones.tracker import column_keys, column_places

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

_MOST_CORNERS = 1000
"""The rim of a point cloud can have a hundred times as many; a history file and a planner carry them all."""


def known_ground(terrain: Terrain) -> Polygon | MultiPolygon:
    """What the rim of a map encloses, in local metres. Made once per terrain, see `Terrain.columns`.

    Its holes are in it: they are unseen ground like any other, which `close_unseen` closes. A ragged rim is
    drawn with fewer corners, inward.
    """
    import shapely

    columns = terrain.columns()[:, :2]
    holes = hole_columns(columns)
    if len(holes):
        columns = column_places(np.sort(column_keys(np.concatenate([columns, holes]))))
    runs = Runs.of(columns)
    (exact,) = outlines(runs, np.zeros(len(runs), dtype=np.int64), terrain)
    ground, tolerance_m = exact, terrain.voxel_size_m
    while shapely.get_num_coordinates(ground) > _MOST_CORNERS:
        # Taken in by more than simplifying may move a corner, so that no ground is added.
        ground = shapely.buffer(exact, -tolerance_m, join_style="mitre").simplify(0.9 * tolerance_m)
        tolerance_m *= 2.0
    return ground
