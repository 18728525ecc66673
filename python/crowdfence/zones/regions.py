"""Which columns belong together. Works on runs of columns and not on a raster, so that it costs what is crowd
and not what lies between.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TOGETHER_WITHIN_M = 2.0
"""As near as the people of a crowd stand to each other."""
_ROUNDED = 1.0 + 1e-12
"""A root of whole numbers that is one itself is not to be missed."""


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Unbroken runs of columns from south to north, arrays [R]; sorted by i, then from south to north."""

    i: NDArray[np.int64]
    south: NDArray[np.int64]
    """First j."""
    north: NDArray[np.int64]
    """One past the last j."""

    @staticmethod
    def of(columns: NDArray[np.int64]) -> Runs:
        """`columns`: distinct (i, j) [C, 2], sorted by i then j."""
        i, j = columns.T
        begins = np.ones(len(columns), dtype=np.bool_)
        begins[1:] = (np.diff(i) != 0) | (np.diff(j) != 1)
        ends = np.append(begins[1:], True)[: len(columns)]
        return Runs(i[begins], j[begins], j[ends] + 1)

    def __len__(self) -> int:
        return len(self.i)

    def __getitem__(self, kept: NDArray[np.bool_]) -> Runs:
        return Runs(self.i[kept], self.south[kept], self.north[kept])

    @property
    def length(self) -> NDArray[np.int64]:
        return self.north - self.south

    def key(self, i: NDArray[np.int64], j: NDArray[np.int64]) -> NDArray[np.int64]:
        """Numbers that sort places (i, j) as the runs are sorted; j from the first to one past the last."""
        low, high = self.south.min(), self.north.max()
        return np.asarray(i * (high - low + 1) + (j - low))

    def without(self, columns: NDArray[np.int64]) -> Runs:
        """The runs of what is left when some of their own `columns` go: distinct (i, j) [C, 2], sorted."""
        if not len(columns):
            return self
        gone, low, width = Runs.of(columns), self.south.min(), self.north.max() - self.south.min() + 1
        begins = np.sort(np.append(self.key(self.i, self.south), self.key(gone.i, gone.north)), kind="stable")
        ends = np.sort(np.append(self.key(self.i, self.north), self.key(gone.i, gone.south)), kind="stable")
        # In this order the n-th begin and the n-th end are one run's, of no length where nothing is left.
        left = begins != ends
        i, south = np.divmod(begins[left], width)
        return Runs(i, south + low, ends[left] - i * width + low)

    def holding(self, i: NDArray[np.int64], j: NDArray[np.int64]) -> NDArray[np.int64]:
        """Position of the run that holds each column (i, j) [N], -1 = none; j as for `key`."""
        run = np.searchsorted(self.key(self.i, self.south), self.key(i, j), "right") - 1
        return np.where((run >= 0) & (self.i[run] == i) & (j < self.north[run]), run, -1)


def reach_columns(voxel_size_m: float) -> float:
    """How far from each other, in columns from middle to middle, crowd is one crowd."""
    return TOGETHER_WITHIN_M / voxel_size_m


def largest_first(runs: Runs, reach: float = 0.0) -> NDArray[np.int64]:
    """Number of the region of each run [R], from 0, the largest region first; of equal ones that with the
    westernmost column, then the southernmost of these.

    Columns that touch at an edge or a corner belong to the same region, and those that lie within `reach`
    columns of each other, from middle to middle.
    """
    region = _parts(runs, _within(reach))
    _, first = np.unique(region, return_index=True)
    columns = np.zeros(len(first), dtype=np.int64)
    np.add.at(columns, region, runs.length)
    number = np.empty(len(first), dtype=np.int64)
    number[np.lexsort((first, -columns))] = np.arange(len(first))
    return number[region]


def connected(runs: Runs) -> NDArray[np.int64]:
    """Number of the part of each run [R], from 0: parts are connected by edges."""
    return _parts(runs, {1: 0})


def _within(reach: float) -> dict[int, int]:
    """How many j two columns that touch or lie within reach are apart at most, by how many i they are."""
    most_dj = {1: 1}
    for di in range(int(reach * _ROUNDED) + 1):
        within = int(math.sqrt(max(reach**2 - di**2, 0.0)) * _ROUNDED)
        most_dj[di] = max(within, most_dj.get(di, 0))
    return most_dj


def _parts(runs: Runs, near: Mapping[int, int]) -> NDArray[np.int64]:
    """Number of the part of each run [R], from 0; columns belong together that are some i apart, and in j no
    more than `near` says of so many."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(runs)
    if count == 0:
        return np.empty(0, dtype=np.int64)
    low, high = runs.south.min(), runs.north.max()
    begins, ends = runs.key(runs.i, runs.south), runs.key(runs.i, runs.north)
    firsts, seconds, opened = [], [], np.zeros(count, dtype=np.int64)
    for di, most_dj in near.items():
        # Of each run, those from `begin` to before `end` are near it, di farther in i.
        from_south = runs.key(runs.i + di, np.maximum(runs.south - most_dj + 1, low))
        to_north = runs.key(runs.i + di, np.minimum(runs.north + most_dj - 1, high))
        begin, end = np.searchsorted(ends, from_south, "left"), np.searchsorted(begins, to_north, "right")
        (some,) = np.nonzero(end > begin)
        firsts.append(some)
        seconds.append(begin[some])
        # They all belong to the same part: each is linked to the next, once for all.
        opened += np.bincount(begin[some], minlength=count) - np.bincount(end[some] - 1, minlength=count)
    (chained,) = np.nonzero(np.cumsum(opened) > 0)
    first, second = np.concatenate([*firsts, chained]), np.concatenate([*seconds, chained + 1])
    links = coo_array((np.ones(len(first), dtype=np.bool_), (first, second)), shape=(count, count))
    return connected_components(links, directed=False)[1].astype(np.int64)
