"""The lowest height at which a drone may fly, as one coarse raster over ground, roofs and trees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter, maximum_filter1d

from crowdfence.simulation.landscape.landscape import Landscape

CELL_M = 2.0
ABOVE_TREES_M = 3.0

_TREE_HEIGHT_M = {"conifer": 15.0, "broadleaf": 12.0, "birch": 13.0, "lamp": 7.0, "flag": 7.0, "stage": 9.0}
"""Generous heights of the tall props at scale 1."""


@dataclass(frozen=True, slots=True)
class TopSurface:
    """`height_m` [rows, columns], row 0 in the south, cells of `CELL_M`."""

    west_m: float
    south_m: float
    height_m: NDArray[np.float64]

    @staticmethod
    def of(landscape: Landscape, altitude_m: float, clearance_m: float) -> TopSurface:
        """`altitude_m` above ground and roofs and 3 m above trees within `clearance_m` of every cell."""
        west, south, east, north = landscape.extent_m
        x, y = np.arange(west, east + CELL_M, CELL_M), np.arange(south, north + CELL_M, CELL_M)
        columns, rows = np.meshgrid(x, y)
        top = np.asarray(landscape.height_m(columns.ravel(), rows.ravel()), np.float64).reshape(rows.shape)
        surface = TopSurface(west, south, top)
        for mesh in landscape.solids:
            corners = mesh.vertices[mesh.triangles]
            for low, high in zip(corners.min(axis=1), corners.max(axis=1), strict=True):
                surface._raise(low, high)
        top += altitude_m
        for props in landscape.props:
            if props.kind in _TREE_HEIGHT_M:
                column, row = surface._cells(props.position[:, 0], props.position[:, 1])
                tips = props.position[:, 2] + _TREE_HEIGHT_M[props.kind] * props.scale + ABOVE_TREES_M
                np.maximum.at(top, (row, column), tips)
        reach = 1 + 2 * int(np.ceil(clearance_m / CELL_M))
        return TopSurface(west, south, maximum_filter(top, reach, mode="nearest"))

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height [N] at points [N, 2]; the edge's height outside."""
        column, row = self._cells(points[:, 0], points[:, 1])
        return np.asarray(self.height_m[row, column])

    def _raise(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
        """Lifts the cells below a box to its top."""
        columns, rows = self._cells(np.array([low[0], high[0]]), np.array([low[1], high[1]]))
        box = np.s_[rows[0] : rows[1] + 1, columns[0] : columns[1] + 1]
        self.height_m[box] = np.maximum(self.height_m[box], high[2])

    def _cells(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        rows, columns = self.height_m.shape
        column = np.clip(np.rint((x - self.west_m) / CELL_M), 0, columns - 1).astype(np.int64)
        row = np.clip(np.rint((y - self.south_m) / CELL_M), 0, rows - 1).astype(np.int64)
        return column, row


def rounded_above(height_m: NDArray[np.float64], rounding: float, *, closed: bool) -> NDArray[np.float64]:
    """Heights [N] along a way as a smooth line that is nowhere below them.

    `rounding` is the standard deviation of the smoothing in steps of the way; a `closed` way ends where it
    begins.
    """
    mode = "wrap" if closed else "nearest"
    reach = round(3.0 * rounding)
    # Every weight of the smoothing then falls on a height that is at least the one below.
    widened = maximum_filter1d(height_m, 1 + 2 * reach, mode=mode)
    return np.asarray(gaussian_filter1d(widened, rounding, mode=mode, radius=reach))
