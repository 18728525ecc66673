"""How low and how high the ground lies in a part of the map."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.zones.outline import outlines
from crowdfence.zones.regions import Runs
from crowdfence.zones.tracker import column_keys, column_places

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon


class GroundHeights:
    """Lowest and highest voxel of every column of a terrain. Made once, see `Terrain.columns`."""

    def __init__(self, terrain: Terrain) -> None:
        columns = terrain.columns()
        self._keys = column_keys(columns[:, :2])
        self._lowest, self._highest = columns[:, 2], columns[:, 3]
        self._terrain = terrain

    def below(self, outline: Polygon | MultiPolygon) -> tuple[float, float] | None:
        """The same where the map has ground below all of an outline; None where it lacks any."""
        import shapely

        (west, south, _), (east, north, _) = self._terrain.bounds
        if not shapely.box(west, south, east, north).covers(outline):
            return None
        runs = Runs.of(column_places(self._keys[self._inside(outline)]))
        ground = outlines(runs, np.zeros(len(runs), dtype=np.int64), self._terrain)
        return self.within(outline) if ground and ground[0].covers(outline) else None

    def within(self, outline: Polygon | MultiPolygon) -> tuple[float, float] | None:
        """Local heights of the underside of the lowest and the top of the highest voxel in the bounds of an
        outline; None where the map has no ground there."""
        inside = self._inside(outline)
        if not len(inside):
            return None
        size_m, origin = self._terrain.voxel_size_m, self._terrain.origin
        lowest, highest = self._lowest[inside].min(), self._highest[inside].max() + 1
        return origin[2] + float(lowest) * size_m, origin[2] + float(highest) * size_m

    def _inside(self, outline: Polygon | MultiPolygon) -> NDArray[np.int64]:
        """Positions of the columns in the bounds of an outline."""
        size_m, origin = self._terrain.voxel_size_m, self._terrain.origin
        west, south, east, north = outline.bounds
        first = np.floor((np.array([west, south]) - origin[:2]) / size_m).astype(np.int64)
        last = np.floor((np.array([east, north]) - origin[:2]) / size_m).astype(np.int64)
        rows = np.arange(first[0], last[0] + 1)
        west_end, east_end = (
            column_keys(np.stack([rows, np.full(len(rows), j)], axis=1)) for j in (first[1], last[1])
        )
        begin = np.searchsorted(self._keys, west_end, "left")
        count = np.searchsorted(self._keys, east_end, "right") - begin
        before = np.cumsum(count) - count
        return np.repeat(begin - before, count) + np.arange(count.sum())
