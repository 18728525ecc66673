"""How low and how high the ground lies in a part of the map."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from crowdfence._core import Terrain
from crowdfence.zones.tracker import column_keys

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

_VOXELS_PER_BLOCK = 1 << 20


class GroundHeights:
    """Lowest and highest voxel of every column of a terrain. Made once, 0.2 s a million voxels."""

    def __init__(self, terrain: Terrain) -> None:
        keys, levels = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
        for start in range(0, terrain.voxel_count, _VOXELS_PER_BLOCK):
            block = np.arange(start, min(start + _VOXELS_PER_BLOCK, terrain.voxel_count), dtype=np.int64)
            indices = terrain.voxel_indices(block)
            keys.append(column_keys(indices[:, :2]))
            levels.append(indices[:, 2])
        key, level = np.concatenate(keys), np.concatenate(levels)
        order = np.lexsort((level, key))
        self._keys, first = np.unique(key[order], return_index=True)
        self._lowest = level[order][first]
        self._highest = level[order][np.append(first[1:], len(order))[: len(first)] - 1]
        self._terrain = terrain

    def within(self, outline: Polygon | MultiPolygon) -> tuple[float, float] | None:
        """Local heights of the underside of the lowest and the top of the highest voxel in the bounds of an
        outline; None where the map has no ground there."""
        size_m, origin = self._terrain.voxel_size_m, self._terrain.origin
        west, south, east, north = outline.bounds
        first = np.floor((np.array([west, south]) - origin[:2]) / size_m).astype(np.int64)
        last = np.floor((np.array([east, north]) - origin[:2]) / size_m).astype(np.int64)
        corners = column_keys(np.stack([first, last]))
        begin = int(np.searchsorted(self._keys, corners[0], "left"))
        end = int(np.searchsorted(self._keys, corners[1], "right"))
        j = ((self._keys[begin:end] + (1 << 31)) & 0xFFFFFFFF) - (1 << 31)
        inside = np.flatnonzero((j >= first[1]) & (j <= last[1])) + begin
        if not len(inside):
            return None
        lowest, highest = self._lowest[inside].min(), self._highest[inside].max() + 1
        return origin[2] + float(lowest) * size_m, origin[2] + float(highest) * size_m
