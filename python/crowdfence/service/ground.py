"""The terrain from above: which voxels people can stand on in each column, and how high the ground lies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.zones.tracker import column_keys, column_places

MAX_SIDE = 1024
"""Rows and columns of the raster at most: what a browser draws at once."""


@dataclass(frozen=True, slots=True, eq=False)
class GroundRaster:
    """Heights of the highest ground, for drawing."""

    west_m: float
    north_m: float
    cell_size_m: float
    heights_m: NDArray[np.float32]
    """[R, C], north row first, NaN where the map has no ground."""

    def height_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Heights [N] under points [N, 2] (local x, y); NaN outside."""
        column = np.floor((points[:, 0] - self.west_m) / self.cell_size_m).astype(np.int64)
        row = np.floor((self.north_m - points[:, 1]) / self.cell_size_m).astype(np.int64)
        rows, columns = self.heights_m.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        heights = np.full(len(points), np.nan)
        heights[inside] = self.heights_m[row[inside], column[inside]]
        return heights


class Ground:
    """Made once from a terrain, about 1 s for four million voxels; 16 bytes a standing place."""

    def __init__(self, terrain: Terrain) -> None:
        self.terrain = terrain
        self.voxel_ids: NDArray[np.int64] = terrain.standing_places()
        """The standing places: voxels without a voxel on top of them."""
        self.keys: NDArray[np.int64] = column_keys(terrain.voxel_indices(self.voxel_ids)[:, :2])
        """Column of each standing place, sorted; see `column_keys`."""

    def places_of(self, columns: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Standing places of columns (sorted keys [C]): voxel ids [N], and the number of each's column."""
        begin = np.searchsorted(self.keys, columns, "left")
        count = np.searchsorted(self.keys, columns, "right") - begin
        number = np.repeat(np.arange(len(columns)), count)
        within = np.arange(len(number)) - np.repeat(np.cumsum(count) - count, count)
        return self.voxel_ids[begin[number] + within], number

    def raster(self, bounds: tuple[float, float, float, float] | None = None) -> GroundRaster:
        """Highest ground per cell, at most `MAX_SIDE` cells a side; within bounds (west, south, east, north)
        in local metres, or of all the terrain."""
        terrain, size_m = self.terrain, self.terrain.voxel_size_m
        places = column_places(self.keys)
        first, last = places.min(axis=0), places.max(axis=0)
        if bounds is not None:
            corners = np.array(bounds).reshape(2, 2)
            wanted = np.floor((corners - terrain.origin[:2]) / size_m).astype(np.int64)
            first, last = np.maximum(first, wanted[0]), np.minimum(last, wanted[1])
        span = np.maximum(last - first + 1, 1)
        stride = int(np.ceil(span.max() / MAX_SIDE))
        columns, rows = (int(n) for n in -(-span // stride))
        inside = ((places >= first) & (places <= last)).all(axis=1)
        cell = (places[inside] - first) // stride
        heights = terrain.surface_heights(self.voxel_ids[inside]).astype(np.float32)
        raster = np.full((rows, columns), -np.inf, dtype=np.float32)
        np.maximum.at(raster, (rows - 1 - cell[:, 1], cell[:, 0]), heights)
        raster[np.isneginf(raster)] = np.nan
        return GroundRaster(
            west_m=terrain.origin[0] + float(first[0]) * size_m,
            north_m=terrain.origin[1] + float(first[1] + rows * stride) * size_m,
            cell_size_m=size_m * stride,
            heights_m=raster,
        )
