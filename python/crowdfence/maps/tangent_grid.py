"""A height surface given in any reference system -> heights on a regular grid in the local tangent plane.

"Above (east, north)" means along the local z axis, which is the plumb line only at the anchor. The surface
is therefore searched along that axis: a guess of the height gives the place in the source, and the height
there gives a better guess. Each step shrinks the error by the lean of the plumb line (1.6e-4 at 1 km) times
the slope of the surface.

The map from local to source coordinates is smooth, so PROJ is asked on a lattice of nodes at most 100 m apart
and at two heights, and what lies between is interpolated: off by less than 1 mm up to 100 km from the anchor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import raised

Array = NDArray[np.float64]

NODE_SPACING_M = 100.0

_MAX_BLOCK_CELLS = 512
_MAX_STEPS = 6
_CONVERGED_M = 1e-3


@dataclass(frozen=True, slots=True)
class LocalGrid:
    """Cell (i, j) covers west_m + [i, i + 1) x south_m + [j, j + 1) cells of `cell_size_m`."""

    west_m: float
    south_m: float
    cell_size_m: float
    shape: tuple[int, int]

    def east_centres_m(self, first: int, last: int) -> Array:
        return self.west_m + (np.arange(first, last, dtype=np.float64) + 0.5) * self.cell_size_m

    def north_centres_m(self, first: int, last: int) -> Array:
        return self.south_m + (np.arange(first, last, dtype=np.float64) + 0.5) * self.cell_size_m

    def cells_near(self, places: Array, reach_m: Array) -> NDArray[np.bool_]:
        """Cells [X, Y] whose middle is nearer than `reach_m` (east, north) to one of the places [N, 2], to
        the micrometre, as heights are."""
        near = np.zeros(self.shape, np.bool_)
        corner, reach = np.array([self.west_m, self.south_m]), reach_m - 1e-6
        first = np.ceil((places - reach - corner) / self.cell_size_m - 0.5).astype(np.int64)
        last = np.floor((places + reach - corner) / self.cell_size_m - 0.5).astype(np.int64)
        first, last = np.maximum(first, 0), np.minimum(last, np.array(self.shape) - 1)
        for step in np.ndindex(*(last - first).max(axis=0, initial=-1) + 1):
            cells = first + step
            near[tuple(cells[(cells <= last).all(axis=1)].T)] = True
        return near


def resample(
    grid: LocalGrid,
    source_from_local: Callable[[Array], Array],
    sample: Callable[[Array, Array], Array],
    *,
    up_range_m: tuple[float, float],
    base_up_m: float,
    block_cells: int = _MAX_BLOCK_CELLS,
    node_spacing_m: float = NODE_SPACING_M,
    highest: Callable[[Array, Array], Array] | None = None,
) -> NDArray[np.float32]:
    """Heights [X, Y] in metres above `base_up_m` at the centres of the grid's cells, NaN for holes.

    `source_from_local`: local points [N, 3] -> source (x, y, height) [N, 3]. `sample`: source x and y, each
    [n, m] -> source height of the surface, NaN for holes. `up_range_m`: local heights between which the
    surface lies. `block_cells`: side of the blocks that `sample` is called with. `highest`: the like of
    `sample` for the highest point of the surface in the cell around a place; cells that something stands out
    of are as high as that (`_core.raised`).
    """
    heights = np.full(grid.shape, np.nan, np.float32)
    tops = None if highest is None else heights.copy()
    stride = max(1, min(block_cells, int(node_spacing_m / grid.cell_size_m)))
    for rows, columns in _blocks(grid.shape, block_cells):
        east = grid.east_centres_m(rows.start, rows.stop)
        north = grid.north_centres_m(columns.start, columns.stop)
        chart = _BlockChart.of(east, north, stride, up_range_m, source_from_local)
        # To the micrometre: ground exactly on the face between two voxels must not flicker between them.
        up_m = _surface_up_m(chart, sample)
        heights[rows, columns] = np.round(up_m - base_up_m, 6)
        if tops is not None and highest is not None:
            x, y, height = chart.at(np.where(np.isnan(up_m), chart.low_m, up_m))
            top_m = up_m + (highest(x, y) - height) / chart.per_metre[2]
            tops[rows, columns] = np.round(top_m - base_up_m, 6)
    return heights if tops is None else raised(heights, tops, grid.cell_size_m)


def _blocks(shape: tuple[int, int], side: int) -> Iterator[tuple[slice, slice]]:
    for i in range(0, shape[0], side):
        for j in range(0, shape[1], side):
            yield slice(i, min(i + side, shape[0])), slice(j, min(j + side, shape[1]))


@dataclass(frozen=True, slots=True)
class _BlockChart:
    """Source coordinates of a block's cells at local height `low_m`, and what each metre of height adds."""

    low_m: float
    at_low: Array  # [3, n, m]: x, y, height
    per_metre: Array  # [3, n, m]

    @staticmethod
    def of(
        east: Array,
        north: Array,
        stride: int,
        up_range_m: tuple[float, float],
        source_from_local: Callable[[Array], Array],
    ) -> _BlockChart:
        east_nodes, east_weights = _nodes(east, stride)
        north_nodes, north_weights = _nodes(north, stride)
        low_m, high_m = up_range_m[0], max(up_range_m[1], up_range_m[0] + 1.0)
        corners = np.stack(np.meshgrid(east_nodes, north_nodes, [low_m, high_m], indexing="ij"), axis=-1)
        source = source_from_local(corners.reshape(-1, 3)).reshape(corners.shape)
        low, high = source[:, :, 0], source[:, :, 1]
        slope = (high - low) / (high_m - low_m)
        # Not "@": matrix products of several strided planes are 40 times slower.
        at_low, per_metre = (
            np.einsum("ia,abp,jb->pij", east_weights, nodes, north_weights, optimize=True)
            for nodes in (low, slope)
        )
        return _BlockChart(low_m, at_low, per_metre)

    def at(self, up_m: Array) -> Array:
        """Source (x, y, height), [3, n, m], of the cells at local height `up_m` [n, m]."""
        return self.at_low + (up_m - self.low_m) * self.per_metre


def _nodes(centres: Array, stride: int) -> tuple[Array, Array]:
    """Every stride-th centre and the last; weights [centres, nodes] of linear interpolation between them."""
    chosen = np.unique(np.append(np.arange(0, len(centres), stride), len(centres) - 1))
    weights = np.stack(
        [np.interp(np.arange(len(centres)), chosen, unit) for unit in np.eye(len(chosen))], axis=-1
    )
    return centres[chosen], weights


def _surface_up_m(chart: _BlockChart, sample: Callable[[Array, Array], Array]) -> Array:
    """Local height [n, m] at which the cells' vertical lines meet the surface, NaN for holes."""
    up_m = np.full(chart.at_low.shape[1:], chart.low_m)
    for _ in range(_MAX_STEPS):
        x, y, height = chart.at(up_m)
        step_m = (sample(x, y) - height) / chart.per_metre[2]
        holes = np.isnan(step_m)
        if holes.all():
            break
        # At the rim of a hole the first guess may fall into it; a typical height gets it out again.
        up_m = np.where(holes, np.nanmean(up_m + step_m), up_m + step_m)
        if np.nanmax(np.abs(step_m)) < _CONVERGED_M:
            break
    return np.where(holes, np.nan, up_m)
