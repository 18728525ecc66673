"""Walls and roofs in voxel columns larger than the file's pixels: what stands out of a column counts.

The height of a column is that of the surface at its middle. A wall of half a metre falls between the middles
of columns of two metres, and the ground that it hides would be called seen and empty. A column whose highest
pixel stands out of the ground is therefore as high as that pixel: a little too much is hidden, never too
little. People stand beside a wall, and in its column they are counted all the same.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Heights = NDArray[np.float32]

OUTSTANDING_M = 1.0
"""A standing person is seen over what is lower."""
OUTSTANDING_CELLS = 0.5
"""The same in cells: what is lower than half a voxel hides little more than the voxel behind it."""
COARSER = 1.1
"""Cells up to so many pixels wide are as fine as the file; their size was rounded to two digits."""

_ROWS = 1024


def raised(heights: Heights, tops: Heights, cell_size_m: float) -> Heights:
    """`heights` [X, Y] of the middles of cells, and of their highest pixel `tops` where that stands out.

    On a slope the upper edge of a cell lies above its middle; what its neighbours on both sides make of that
    does not count. NaN, a hole, stays one.
    """
    result = heights.copy()
    least_m = max(OUTSTANDING_M, OUTSTANDING_CELLS * cell_size_m)
    for first in range(0, len(heights), _ROWS):
        stop = min(first + _ROWS, len(heights))
        begin = max(first - 1, 0)
        relief_m = _relief_m(heights[begin : stop + 1])[first - begin :][: stop - first]
        with np.errstate(invalid="ignore"):
            stands_out = tops[first:stop] - heights[first:stop] - relief_m > least_m
        result[first:stop][stands_out] = tops[first:stop][stands_out]
    return result


def _relief_m(heights: Heights) -> Heights:
    """How far the highest corner of a cell on a slope lies above its middle: by the gentler side of each
    axis, because beside a house only the other one is the ground's. What falls, or rises, to both sides is
    no slope."""
    relief = np.zeros_like(heights)
    for axis in (0, 1):
        if heights.shape[axis] < 2:
            continue
        step = np.nan_to_num(np.diff(heights, axis=axis))  # level towards a hole
        first, last = np.take(step, [0], axis=axis), np.take(step, [-1], axis=axis)  # goes on at the edge
        before, after = np.concatenate([first, step], axis), np.concatenate([step, last], axis)
        gentler = np.minimum(np.abs(before), np.abs(after))
        relief += np.where(before * after > 0, gentler / 2, 0)
    return relief
