"""How low and how high the ground lies in a part of the map."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.prepared import prepared
from crowdfence.zones.regions import Runs
from crowdfence.zones.tracker import column_keys, column_places

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

ROUNDING_M = 0.002
"""More than the steps from crowd to outline add where they say nothing of it."""


class GroundHeights:
    """Lowest and highest voxel of every column of a terrain. Made once, see `Terrain.columns`."""

    def __init__(self, terrain: Terrain) -> None:
        columns = terrain.columns()
        self._keys = column_keys(columns[:, :2])
        self._lowest, self._highest = columns[:, 2], columns[:, 3]
        self._terrain = terrain

    def below(self, outline: Polygon | MultiPolygon) -> tuple[float, float] | None:
        """The same where the map has ground below all of an outline; None where it lacks any."""
        return self.within(outline) if self.hold(outline) else None

    def hold(self, outline: Polygon | MultiPolygon) -> bool:
        """Whether the map has ground below all of an outline, but for what rounding adds to one."""
        import shapely

        (west, south, _), (east, north, _) = self._terrain.bounds
        if not shapely.box(west, south, east, north).buffer(ROUNDING_M, join_style="mitre").covers(outline):
            return False
        first, last = self._corner_columns(outline, ROUNDING_M)
        begin, count = self._rows_between(first, last)
        width = int(last[1] - first[1]) + 1
        gaps = np.flatnonzero(count < width)
        if not len(gaps):
            return True
        missing = np.ones((len(gaps), width), dtype=np.bool_)
        present = column_places(self._keys[_ranges(begin[gaps], count[gaps])])
        missing[np.repeat(np.arange(len(gaps)), count[gaps]), present[:, 1] - first[1]] = False
        row, column = np.nonzero(missing)
        runs = Runs.of(np.stack([first[0] + gaps[row], first[1] + column], axis=1))
        size_m, origin = self._terrain.voxel_size_m, self._terrain.origin
        low = np.stack([runs.i, runs.south], axis=1) * size_m + origin[:2] + ROUNDING_M
        high = np.stack([runs.i + 1, runs.north], axis=1) * size_m + origin[:2] - ROUNDING_M
        return not shapely.intersects(prepared(outline), shapely.box(*low.T, *high.T)).any()

    def within(self, outline: Polygon | MultiPolygon) -> tuple[float, float] | None:
        """Local heights of the underside of the lowest and the top of the highest voxel in the bounds of an
        outline; None where the map has no ground there."""
        inside = self._between(*self._corner_columns(outline))
        if not len(inside):
            return None
        size_m, origin = self._terrain.voxel_size_m, self._terrain.origin
        lowest, highest = self._lowest[inside].min(), self._highest[inside].max() + 1
        return origin[2] + float(lowest) * size_m, origin[2] + float(highest) * size_m

    def _corner_columns(
        self, outline: Polygon | MultiPolygon, less_m: float = 0.0
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(i, j) of the south-westernmost and the north-easternmost column in the bounds of an outline, taken
        in by `less_m`."""
        size_m, origin = self._terrain.voxel_size_m, self._terrain.origin
        west, south, east, north = outline.bounds
        first = np.floor((np.array([west, south]) + less_m - origin[:2]) / size_m).astype(np.int64)
        last = np.floor((np.array([east, north]) - less_m - origin[:2]) / size_m).astype(np.int64)
        return first, np.maximum(first, last)

    def _between(self, first: NDArray[np.int64], last: NDArray[np.int64]) -> NDArray[np.int64]:
        """Positions of the columns from one corner to the other."""
        return _ranges(*self._rows_between(first, last))

    def _rows_between(
        self, first: NDArray[np.int64], last: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The same row by row: where each begins, and how many columns it has."""
        rows = np.arange(first[0], last[0] + 1)
        west_end, east_end = (
            column_keys(np.stack([rows, np.full(len(rows), j)], axis=1)) for j in (first[1], last[1])
        )
        begin = np.searchsorted(self._keys, west_end, "left")
        return begin, np.searchsorted(self._keys, east_end, "right") - begin


def _ranges(begin: NDArray[np.int64], count: NDArray[np.int64]) -> NDArray[np.int64]:
    """So many numbers from each begin on, one after the other."""
    before = np.cumsum(count) - count
    return np.repeat(begin - before, count) + np.arange(count.sum())
