"""Metres per pixel of every heatmap cell, from whatever the caller knows about the flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Kind = TypeVar("_Kind", bound=np.generic)

Gsd = ArrayLike
"""Metres on the ground per image pixel: a number, an array [r, c] whose cells divide the image evenly (NaN:
no ground there), or [r, c, 2] with metres per pixel to the right and downwards in the image.

Across the ray a pixel is distance / focal length metres wide. Along the ground downwards in the image it is
longer by 1 / sin(tilt); without the third axis that is left out, which makes people stand closer together
than they do and so errs towards crowd.
"""


@dataclass(frozen=True, slots=True)
class GroundScale:
    """Metres per image pixel at the centre of every heatmap cell, [h, w] each, finite and positive."""

    right_m: NDArray[np.float32]
    down_m: NDArray[np.float32]

    @staticmethod
    def of(gsd_m: Gsd | None, cells: tuple[int, int], kind: str) -> GroundScale:
        """At `cells` = (h, w). Cells without ground get the value of the nearest that has some.

        ValueError when it is missing, of another shape, or not positive.
        """
        if gsd_m is None:
            raise ValueError(f"gsd_m is missing: {kind} become a heatmap only with metres per image pixel")
        given = checked_gsd(gsd_m)
        axes = (given, given) if given.ndim == 2 else (given[..., 0], given[..., 1])
        return GroundScale(*(at_cells(with_nearest(axis), cells) for axis in axes))


def checked_gsd(gsd_m: Gsd) -> NDArray[np.float32]:
    """[r, c] or [r, c, 2]; ValueError for another shape and for numbers that are no metres."""
    given = np.asarray(gsd_m, np.float32)
    if given.ndim == 0:
        given = given.reshape(1, 1)
    if given.ndim not in (2, 3) or (given.ndim == 3 and given.shape[2] != 2) or given.size == 0:
        raise ValueError(f"gsd_m has shape {list(given.shape)}; allowed: a number, [r, c] or [r, c, 2]")
    if not np.isfinite(given).any():
        raise ValueError("gsd_m holds no finite number: no ground in this frame")
    wrong = np.isfinite(given) & (given <= 0.0)
    if wrong.any():
        raise ValueError(f"gsd_m holds {given[wrong][0]}; allowed: metres above 0, NaN where no ground is")
    return given


def across(gsd_m: Gsd) -> NDArray[np.float32]:
    """[r, c] metres per pixel to the right. ValueError as for `checked_gsd`."""
    given = checked_gsd(gsd_m)
    return given if given.ndim == 2 else given[..., 0]


def with_nearest(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """[r, c] with the nearest finite number where there is none."""
    missing = ~np.isfinite(values)
    if not missing.any():
        return values
    if missing.all():
        raise ValueError("gsd_m holds no finite number in one direction")
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(missing, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)])


def at_cells(values: NDArray[_Kind], cells: tuple[int, int]) -> NDArray[_Kind]:
    """[r, c] over an image -> the value at the centre of each of `cells` = (h, w)."""
    rows, columns = (
        ((np.arange(count) + 0.5) * side / count).astype(np.intp)
        for count, side in zip(cells, values.shape, strict=True)
    )
    return values[rows[:, None], columns]
