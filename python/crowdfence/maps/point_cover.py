"""How much ground any number of points covers, in chunks: one apart from all others covers next to none.

Memory is bounded: cells are counted, and made twice as wide where they become too many.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_FIRST_CELL_M = 1.0
"""Holds some points where they are as far apart as the finest voxels that files choose."""
_MOST_CELLS = 1_000_000
_POINTS_PER_CELL = 10
"""On average; where points lie at random, one cell of 20,000 between them is empty then."""
_FULL = 0.5
"""Of a box: rivers, lakes and slanting edges are in it; less is a strip, or a stray point made the box."""
_BITS = 31


class PointCover:
    """Points (x, y) in any units, of which one is `metres` [2] long; `near` [2] is one of them."""

    def __init__(self, metres: NDArray[np.float64], near: NDArray[np.float64]) -> None:
        self._cells_per_unit = metres / _FIRST_CELL_M
        self._near = near
        self._cell_m = _FIRST_CELL_M
        self._keys = np.empty(0, np.int64)
        self.points = 0
        self.low, self.high = np.full(2, np.inf), np.full(2, -np.inf)

    def add(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
        """Points [N]."""
        if len(x) == 0:
            return
        plan = np.stack([x, y])
        self.low, self.high = np.minimum(self.low, plan.min(axis=1)), np.maximum(self.high, plan.max(axis=1))
        self.points += len(x)
        cells = (plan - self._near[:, np.newaxis]) * self._cells_per_unit[:, np.newaxis]
        far = 2.0 ** (_BITS - 1)  # a damaged file; those are refused where they are read
        i, j = np.floor(np.clip(cells * (_FIRST_CELL_M / self._cell_m), -far, far - 1.0)).astype(np.int64)
        self._keys = np.union1d(self._keys, (i << _BITS + 1) + j)
        while len(self._keys) > _MOST_CELLS:
            self._widen()

    def area_m2(self, box_m2: float) -> float:
        """`box_m2`, the area of the box around the points, where they cover about all of it; else of the
        cells that hold some."""
        while len(self._keys) > 1 and self.points < _POINTS_PER_CELL * len(self._keys):
            self._widen()
        covered_m2 = len(self._keys) * self._cell_m**2
        return box_m2 if covered_m2 >= _FULL * box_m2 else covered_m2

    def _widen(self) -> None:
        """The same cells, four in one."""
        j = ((self._keys + (1 << _BITS)) & ((1 << _BITS + 1) - 1)) - (1 << _BITS)
        i = (self._keys - j) >> _BITS + 1
        self._keys = np.unique(((i >> 1) << _BITS + 1) + (j >> 1))
        self._cell_m *= 2.0
