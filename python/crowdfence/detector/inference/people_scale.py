"""Metres per pixel of a picture from the people in it, where nothing else tells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.inference.people_output import People

_NEAREST = 5
"""People whose middle size counts at a place: some sit, some are cut off by others."""
_GRID_PX = 32


def gsd_of_people(people: People, shape: tuple[int, int], height_m: float) -> NDArray[np.float32]:
    """Metres per pixel [r, c] over a picture of `shape` = (height, width), from the boxes of people of that
    height: at each place the median of the nearest. At least one person."""
    from scipy.spatial import cKDTree

    longest_px = np.maximum(np.maximum(people.height, people.width), 1.0)
    rows, columns = (-(-side // _GRID_PX) for side in shape)
    y, x = (
        (np.arange(count) + 0.5) * side / count for count, side in zip((rows, columns), shape, strict=True)
    )
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    near = np.arange(1, min(_NEAREST, len(longest_px)) + 1)
    _, who = cKDTree(np.stack([people.x, people.y], axis=1)).query(places, k=near)
    return np.asarray(height_m / np.median(longest_px[who], axis=1), np.float32).reshape(rows, columns)
