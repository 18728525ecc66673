"""Cells of a model's stride -> cells that divide the picture evenly, which is how everybody reads a heatmap.

A model answers for cells of `stride` pixels from the upper left corner on, the last of which may reach beyond
the picture. Laid evenly over the picture, as the core does, the same cells would be off by up to a stride at
the far edges. So such cells are cut into smaller ones that the picture holds a whole number of. No value is
interpolated: a mean of two calibrated answers is calibrated no more, and small crowds would fade.
"""

from __future__ import annotations

from math import gcd

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.inference.map_output import Map


def evenly(values: Map, stride: int, picture: tuple[int, int]) -> Map:
    """The same heatmap [h, w] of a picture of (height, width) pixels on even cells: of `stride` pixels, or
    where the sides are no multiples of that, of the largest divisor of it that they are multiples of. Pixels
    behind the last cell take its value."""
    side = _side(stride, picture)
    if side == stride:
        return values
    rows, columns = (
        np.minimum(np.arange(pixels // side) * side // stride, cells - 1)
        for pixels, cells in zip(picture, values.shape, strict=True)
    )
    return np.asanyarray(values[np.ix_(rows, columns)])  # with the mask of one that has some


def cells_of_stride(
    heatmap: NDArray[np.floating], stride: int, picture: tuple[int, int]
) -> NDArray[np.floating]:
    """The cells that `evenly` was given, each once: what is counted by cells counts pictures of all sizes
    alike."""
    step = stride // _side(stride, picture)
    return heatmap[::step, ::step]


def _side(stride: int, picture: tuple[int, int]) -> int:
    """Pixels along an even cell."""
    return gcd(stride, *picture)
