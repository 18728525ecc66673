"""Few points far below all around them: low noise of a lidar that nobody marked (class 7), or a shaft.

Points are counted in wide cells. Cells that touch make a group; a group of few points below a cell of
another, with an empty one between at least, was hardly ground: a valley, a quay or a yard holds many.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.maps.point_cells import Gathered, VoxelKeys, cells, means, summed

_CELL_M = 10.0
_VOXELS = 4.0
"""A cell is at least as many wide, which bounds the cells."""
_FEW = 100
"""Points of a group; a yard of 10 m x 10 m holds more where there is one on a square metre."""
_MOST = 0.01
"""Of all points; where more lie in such groups, the cloud is too sparse to tell."""
_MOST_CELLS = 20_000_000
_NEAR = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]


class LonePoints:
    """Counts points [N, 3], local metres, of ground and others apart; `near` [3] is one of them."""

    def __init__(self, voxel_size_m: float, near: NDArray[np.float64]) -> None:
        self._keys = VoxelKeys(max(_CELL_M, _VOXELS * voxel_size_m), near)
        self._ground, self._other = (
            Gathered(summed, f"cells of {self._keys.voxel_size_m:g} m", _MOST_CELLS) for _ in range(2)
        )

    def add(self, points: NDArray[np.float64], is_ground: NDArray[np.bool_]) -> None:
        for gathered, chosen in ((self._ground, is_ground), (self._other, ~is_ground)):
            gathered.add(cells(self._keys.of(points[chosen]), points[chosen]))

    def below(self, *, only_ground: bool) -> tuple[int, float]:
        """How many lie far below all around them, and how far the farthest of them, in metres by the mean
        heights of their cells."""
        rows = self._ground.rows()
        if not only_ground:
            rows = summed(np.concatenate([rows, self._other.rows()]))
        if len(rows) < 2:
            return 0, 0.0
        height_m = means(rows)[:, 2]
        cell = np.floor(self._keys.centres(rows["key"]) / self._keys.voxel_size_m).astype(np.int64)
        group = _groups(cell)
        few = np.bincount(group, rows["count"])[group] <= _FEW
        if rows["count"][few].sum() > _MOST * rows["count"].sum():
            return 0, 0.0
        depth_m = _depths(cell, height_m, few)
        low = np.isfinite(depth_m)
        return int(rows["count"][low].sum()), float(depth_m[low].max(initial=0.0))


def _groups(cell: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of each cell's group [N]; cells [N, 3] that touch, at corners too, belong together."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    one, other = cKDTree(cell).query_pairs(1.5, p=np.inf, output_type="ndarray").T
    graph = coo_array((np.ones(len(one), np.int8), (one, other)), shape=(len(cell), len(cell)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def _depths(
    cell: NDArray[np.int64], height_m: NDArray[np.float64], few: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Metres [N] from each of the `few` up to the nearest other in or beside its column; NaN for the rest."""
    depth_m = np.full(len(cell), np.nan)
    columns: dict[tuple[int, int], list[int]] = {}
    wanted = {(i + di, j + dj) for i, j, _ in cell[few].tolist() for di, dj in _NEAR}
    for place in np.flatnonzero(~few).tolist() if wanted else ():
        column = int(cell[place, 0]), int(cell[place, 1])
        if column in wanted:
            columns.setdefault(column, []).append(place)
    for place in np.flatnonzero(few).tolist():
        i, j, _ = cell[place].tolist()
        around = [one for di, dj in _NEAR for one in columns.get((i + di, j + dj), ())]
        if around and height_m[around].min() > height_m[place]:
            depth_m[place] = height_m[around].min() - height_m[place]
    return depth_m
