"""Boxes given by two corners that were read as a place and a size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SPREAD = 0.25
"""Of a side of the picture."""


def are_two_corners(
    place: NDArray[np.float64], size: NDArray[np.float64], picture: tuple[float, float]
) -> bool:
    """Whether places [N, 2] (x, y) and sizes [N, 2] (width, height) on a picture (width, height) are corners:
    all boxes are as large as they are away from the upper left corner. Those of one person near that corner,
    or of one who fills the picture, may be; those of several at different places are not."""
    spread = _SPREAD * np.array(picture)
    return bool(len(place) and (size >= place).all() and (np.ptp(place, axis=0) > spread).any())
