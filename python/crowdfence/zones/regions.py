"""Which columns belong together. Works on runs of columns and not on a raster, so that it costs what is crowd
and not what lies between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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


def largest_first(runs: Runs) -> NDArray[np.int64]:
    """Number of the region of each run [R], from 0, the largest region first; of equal ones that with the
    westernmost column, then the southernmost of these.

    Columns that touch at an edge or a corner belong to the same region.
    """
    region = connected(runs, corners=True)
    _, first = np.unique(region, return_index=True)
    columns = np.zeros(len(first), dtype=np.int64)
    np.add.at(columns, region, runs.length)
    number = np.empty(len(first), dtype=np.int64)
    number[np.lexsort((first, -columns))] = np.arange(len(first))
    return number[region]


def connected(runs: Runs, *, corners: bool) -> NDArray[np.int64]:
    """Number of the part of each run [R], from 0: parts are connected by edges, or by `corners` too."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if len(runs) == 0:
        return np.empty(0, dtype=np.int64)
    first, second = _touching(runs, corners=corners)
    links = coo_array((np.ones(len(first), dtype=np.bool_), (first, second)), shape=(len(runs), len(runs)))
    return connected_components(links, directed=False)[1].astype(np.int64)


def _touching(runs: Runs, *, corners: bool) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Positions of every two runs that touch, the second one with the next i."""
    south, north = runs.key(runs.i, runs.south), runs.key(runs.i, runs.north)
    next_south, next_north = runs.key(runs.i + 1, runs.south), runs.key(runs.i + 1, runs.north)
    begin = np.searchsorted(north, next_south, "left" if corners else "right")
    end = np.searchsorted(south, next_north, "right" if corners else "left")
    count = end - begin
    before = np.cumsum(count) - count
    first = np.repeat(np.arange(len(runs)), count)
    return first, np.arange(len(first)) - np.repeat(before - begin, count)
