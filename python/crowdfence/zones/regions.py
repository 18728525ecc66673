"""Which columns belong together. Works on runs of columns and not on a raster, so that it costs what is crowd
and not what lies between.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TOGETHER_WITHIN_M = 2.0
"""As near as the people of a crowd stand to each other."""
_ROUNDED = 1.0 + 1e-12
"""A root of whole numbers that is one itself is not to be missed."""
_EDGES = ((1, 0),)
_CORNERS = ((1, 1),)


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
    region = _parts(runs, tuple(_within(reach)))
    _, first = np.unique(region, return_index=True)
    columns = np.zeros(len(first), dtype=np.int64)
    np.add.at(columns, region, runs.length)
    number = np.empty(len(first), dtype=np.int64)
    number[np.lexsort((first, -columns))] = np.arange(len(first))
    return number[region]


def connected(runs: Runs, *, corners: bool) -> NDArray[np.int64]:
    """Number of the part of each run [R], from 0: parts are connected by edges, or by `corners` too."""
    return _parts(runs, _CORNERS if corners else _EDGES)


def _within(reach: float) -> Iterator[tuple[int, int]]:
    """How many i two columns may lie apart that touch or lie within reach, and how many j at most."""
    yield from _CORNERS
    for di in range(int(reach * _ROUNDED) + 1):
        yield di, int(math.sqrt(max(reach**2 - di**2, 0.0)) * _ROUNDED)


def _parts(runs: Runs, near: tuple[tuple[int, int], ...]) -> NDArray[np.int64]:
    """Number of the part of each run [R], from 0; columns belong together that lie at most as far apart, in i
    and j, as one of the pairs `near` says."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(runs)
    if count == 0:
        return np.empty(0, dtype=np.int64)
    firsts, seconds, opened = [], [], np.zeros(count, dtype=np.int64)
    for di, most_dj in near:
        begin, end = _beside(runs, di, most_dj)
        (some,) = np.nonzero(end > begin)
        firsts.append(some)
        seconds.append(begin[some])
        # All between begin and end belong to the same part: each is linked to the next, once for all.
        opened += np.bincount(begin[some], minlength=count) - np.bincount(end[some] - 1, minlength=count)
    (chained,) = np.nonzero(np.cumsum(opened) > 0)
    first, second = np.concatenate([*firsts, chained]), np.concatenate([*seconds, chained + 1])
    links = coo_array((np.ones(len(first), dtype=np.bool_), (first, second)), shape=(count, count))
    return connected_components(links, directed=False)[1].astype(np.int64)


def _beside(runs: Runs, di: int, most_dj: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of each run, from which to before which position [R] the runs lie that are `di` >= 0 farther in i, some
    columns of them at most `most_dj` from its own in j."""
    low, high = runs.south.min(), runs.north.max()
    from_south = runs.key(runs.i + di, np.maximum(runs.south - most_dj + 1, low))
    to_north = runs.key(runs.i + di, np.minimum(runs.north + most_dj - 1, high))
    begin = np.searchsorted(runs.key(runs.i, runs.north), from_south, "left")
    return begin, np.searchsorted(runs.key(runs.i, runs.south), to_north, "right")
