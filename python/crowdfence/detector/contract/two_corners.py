"""Boxes given by two corners that were read as a place and a size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SPREAD = 0.25
"""Of a side of the picture."""
_SEVERAL = 5
"""Boxes, of people who stand nearer together than that."""
_ALIKE = 0.25
"""Of how far apart they are: people differ in size by no more."""


def are_two_corners(
    place: NDArray[np.float64], size: NDArray[np.float64], picture: tuple[float, float]
) -> bool:
    """Whether places [N, 2] (x, y) and sizes [N, 2] (width, height) on a picture (width, height) are corners:
    all boxes are as large as they are away from the upper left corner. Those of one person near that corner,
    or of one who fills the picture, may be; those of several at different places are not."""
    if not len(place) or (size < place).any():
        return False
    apart = np.ptp(place, axis=0)
    far_apart = bool((apart > _SPREAD * np.array(picture)).any())
    return far_apart or _are_a_group(size - place, apart)


def _are_a_group(people: NDArray[np.float64], apart: NDArray[np.float64]) -> bool:
    """Whether boxes whose second corners are `people` [N, 2] from their first ones show several who are about
    equally large, over ground [2] that is larger than any of them. Widths and heights that grow just as
    places go right and down have no other reason: one person found many times is about as large every time,
    or grows twice as fast as its middle moves."""
    alike = np.ptp(people, axis=0) <= _ALIKE * apart
    return len(people) >= _SEVERAL and bool((alike & (apart > people.max(axis=0))).all())
