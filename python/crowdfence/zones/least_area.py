"""Which regions are large enough to be zones.

A crowd that is seen through trees, or whose people stand loosely, comes apart into regions, none of which may
be as large as a crowd's ground: small ones are measured together with what lies near by.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from crowdfence.zones.sorted_keys import are_among, distinct
from crowdfence.zones.tracker import column_keys, column_places

TOGETHER_WITHIN_M = 2.0
"""As near as the people of a crowd stand to each other."""
_ROUNDED = 1.0 - 1e-9
"""49 m2 are 100 columns of 0.7 m, and not 101."""


def least_columns(min_area_m2: float, voxel_size_m: float) -> int:
    """How many columns a region must have that is no smaller than an area."""
    return math.ceil(min_area_m2 / voxel_size_m**2 * _ROUNDED)


def columns_with_nearby(
    keys: NDArray[np.int64], region: NDArray[np.int64], least: int, voxel_size_m: float
) -> NDArray[np.int64]:
    """Of each region 0, 1, .. with fewer than `least` columns, the columns that it holds together with the
    regions within 2 m of it, and with those within 2 m of these, from one small one to the next; of the
    others their own [regions].

    keys    column keys [C]
    region  the region of each [C]; every number from 0 on has one column at least

    From middle to middle of two columns.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    size = np.bincount(region)
    is_small = (size < least)[region]
    if not is_small.any():
        return size
    reach = TOGETHER_WITHIN_M / voxel_size_m
    places = column_places(keys)
    near = _near(places, is_small, reach)
    small, others = cKDTree(places[is_small]), cKDTree(places[near])
    pairs = small.sparse_distance_matrix(others, reach, output_type="ndarray")
    first, second = region[is_small][pairs["i"]], region[near][pairs["j"]]
    links = coo_array((np.ones(len(first), np.bool_), (first, second)), shape=(len(size), len(size)))
    together = connected_components(links, directed=False)[1]
    return np.where(size < least, np.bincount(together, size)[together].astype(np.int64), size)


def of_those_kept(region: NDArray[np.int64], kept: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The regions (any shape) numbered anew, in the same order, without those that are not kept [regions],
    which become -1."""
    return np.where(kept, np.cumsum(kept) - 1, -1)[region]


def _near(places: NDArray[np.int64], is_small: NDArray[np.bool_], reach: float) -> NDArray[np.bool_]:
    """Which columns may lie within reach of one of a small region, so that a crowd of hectares costs no tree:
    those in its square of the ground, `reach` wide, or in one of the eight around it."""
    squares = places // max(1, int(np.ceil(reach)))
    around = [[di, dj] for di in (-1, 0, 1) for dj in (-1, 0, 1)]
    reached = distinct(np.concatenate([column_keys(squares[is_small] + step) for step in around]))
    return are_among(column_keys(squares), reached)
