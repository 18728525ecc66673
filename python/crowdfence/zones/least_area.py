"""Which regions are large enough to be zones."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_ROUNDED = 1.0 - 1e-9
"""49 m2 are 100 columns of 0.7 m, and not 101."""


def least_columns(min_area_m2: float, voxel_size_m: float) -> int:
    """How many columns a region must have that is no smaller than an area."""
    return math.ceil(min_area_m2 / voxel_size_m**2 * _ROUNDED)


def of_those_kept(region: NDArray[np.int64], kept: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The regions (any shape) numbered anew, in the same order, without those that are not kept [regions],
    which become -1."""
    return np.where(kept, np.cumsum(kept) - 1, -1)[region]
