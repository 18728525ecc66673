"""Any number of points, in chunks -> one point per cell and the set of voxels that hold one.

Memory grows with the cells and voxels found, not with the points.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

# The tree of the core is 2^20 voxels wide; one more bit lets the first index lie anywhere.
MAX_EXTENT = 1 << 20
_BITS = 21
_MASK = (1 << _BITS) - 1

# Rows that may wait before they are merged.
_PENDING_ROWS = 4_000_000

_CELL = np.dtype([("key", np.int64), ("count", np.float64), ("sum", np.float64, 3)])


class VoxelKeys:
    """Grid indices of points near a first one, packed into one integer."""

    def __init__(self, voxel_size_m: float, near: NDArray[np.float64]) -> None:
        self.voxel_size_m = voxel_size_m
        self._base = np.floor(near / voxel_size_m).astype(np.int64) - MAX_EXTENT

    def of(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Keys [N] of points [N, 3]; ValueError for a point 2^20 voxels away from the first one."""
        relative = np.floor(points / self.voxel_size_m) - self._base
        stray = ~((relative >= 0) & (relative <= _MASK)).all(axis=1)
        if stray.any():
            first = points[int(np.argmax(stray))]
            raise ValueError(
                f"a point at ({first[0]:.0f}, {first[1]:.0f}, {first[2]:.0f}) m lies more than {MAX_EXTENT} "
                f"voxels of {self.voxel_size_m:g} m away from the middle of the file; pass a larger "
                "voxel_size_m or remove the point"
            )
        i, j, k = relative.astype(np.int64).T
        return (i << 2 * _BITS) | (j << _BITS) | k

    def columns_of(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Keys [N] of the columns of voxels."""
        return self.of(points) >> _BITS

    def centres(self, keys: NDArray[np.int64]) -> NDArray[np.float64]:
        """Centres [N, 3] of voxels, metres."""
        indices = np.stack([keys >> 2 * _BITS, (keys >> _BITS) & _MASK, keys & _MASK], axis=-1) + self._base
        return np.asarray((indices + 0.5) * self.voxel_size_m, np.float64)


class Gathered:
    """Rows that arrive in chunks and are reduced together now and then; `bound` limits what is left."""

    def __init__(self, reduce: Callable[[NDArray[Any]], NDArray[Any]], what: str, bound: int) -> None:
        self._reduce = reduce
        self._what = what
        self._bound = bound
        self._reduced: list[NDArray[Any]] = []
        self._pending: list[NDArray[Any]] = []
        self._pending_rows = 0

    def add(self, rows: NDArray[Any]) -> None:
        self._pending.append(self._reduce(rows))
        self._pending_rows += len(self._pending[-1])
        if self._pending_rows > _PENDING_ROWS:
            self._merge()

    def rows(self) -> NDArray[Any]:
        """All rows, reduced. ValueError when there are more than `bound`; something must have been added."""
        self._merge()
        return self._reduced[0]

    def _merge(self) -> None:
        self._reduced = [self._reduce(np.concatenate(self._reduced + self._pending))]
        self._pending, self._pending_rows = [], 0
        if len(self._reduced[0]) > self._bound:
            raise ValueError(f"more than {self._bound} {self._what}; pass a larger voxel_size_m")


def cells(keys: NDArray[np.int64], points: NDArray[np.float64]) -> NDArray[Any]:
    """One row per point: key, count 1 and the point as sum."""
    rows = np.empty(len(keys), _CELL)
    rows["key"], rows["count"], rows["sum"] = keys, 1, points
    return rows


def summed(rows: NDArray[Any]) -> NDArray[Any]:
    """One row per key, counts and sums added."""
    keys, place = np.unique(rows["key"], return_inverse=True)
    result = np.empty(len(keys), _CELL)
    result["key"] = keys
    result["count"] = np.bincount(place, rows["count"], len(keys))
    for axis in range(3):
        result["sum"][:, axis] = np.bincount(place, rows["sum"][:, axis], len(keys))
    return result


def lowest(rows: NDArray[Any]) -> NDArray[Any]:
    """The row with the smallest z of every key."""
    order = np.lexsort((rows["sum"][:, 2], rows["key"]))
    rows = rows[order]
    return rows[np.unique(rows["key"], return_index=True)[1]]


def means(rows: NDArray[Any]) -> NDArray[np.float64]:
    """Mean point [N, 3] of every row."""
    return np.asarray(rows["sum"] / rows["count"][:, np.newaxis])
