"""Parts of a camera's pictures that never show ground: legs, propellers and gimbal of its own drone, or
writing that was laid over them.

Nobody stands there, as far as a detector can tell, and the ground behind would be called empty. The cells of
a heatmap that reach into such a part are masked: they were not looked at and say neither crowd nor empty.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_LIGHT = 128
"""Pixels darker than this are hidden: a mask that was saved as JPEG has more than two values."""
_MOST_HIDDEN = 0.6
"""Whoever paints in black what is to be seen hides nearly all."""
_MOST_STRETCHED = 0.02
"""How far the proportions of mask and picture may differ, as a share: sizes are rounded."""


@dataclass(frozen=True, eq=False)
class CameraMask:
    """One mask, for all pictures of a camera."""

    hidden: NDArray[np.bool_]
    """[h, w], of any size of the picture's proportions."""
    _cells: dict[tuple[int, int], NDArray[np.bool_]] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        """ValueError for another shape, for one that hides nothing, and one that hides nearly all."""
        if self.hidden.ndim != 2 or self.hidden.dtype != np.bool_:
            raise ValueError(
                f"a camera mask of shape {self.hidden.shape} and type {self.hidden.dtype} must be bool [h, w]"
            )
        if not 0.0 < self.share <= _MOST_HIDDEN:
            raise ValueError(
                f"a camera mask that hides {self.share:.1%} of the picture must hide some of it, and at most "
                f"{_MOST_HIDDEN:.0%}: black hides, white shows"
            )

    @classmethod
    def open(cls, path: str | PathLike[str]) -> CameraMask:
        """From a picture: black where the camera sees no ground, white elsewhere. OSError, ValueError for a
        file that is none."""
        from crowdfence.sources.pictures.decoding import read_rgb

        try:
            return cls(np.asarray((read_rgb(Path(path)) < _LIGHT).all(axis=-1)))
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error

    @cached_property
    def share(self) -> float:
        """Of the picture that is hidden."""
        return float(self.hidden.mean()) if self.hidden.size else 0.0

    def require_fit(self, width: int, height: int) -> None:
        """ValueError for pictures of other proportions than the mask."""
        rows, columns = self.hidden.shape
        if abs(columns * height / (rows * width) - 1.0) > _MOST_STRETCHED:
            raise ValueError(
                f"the camera mask is {columns} x {rows}, and pictures of {width} x {height} have other "
                "proportions: make it of one of these pictures"
            )

    def over(self, heatmap: ArrayLike, width: int, height: int) -> Any:
        """The heatmap [r, c] of a picture of `width` x `height` with the cells masked that reach into what is
        hidden, beside those that are masked already. What is no heatmap stays as it is. ValueError as for
        `require_fit`."""
        self.require_fit(width, height)
        if np.ndim(heatmap) != 2 or np.size(heatmap) == 0:
            return heatmap
        hidden = self.cells(*np.shape(heatmap))
        return np.ma.masked_array(heatmap, np.ma.getmaskarray(np.ma.asarray(heatmap)) | hidden)

    def cells(self, rows: int, columns: int) -> NDArray[np.bool_]:
        """Which cells of a heatmap [rows, columns] reach into what is hidden."""
        known = self._cells.get((rows, columns))
        if known is None:
            known = _any_along(_any_along(self.hidden, rows).T, columns).T
            self._cells[rows, columns] = known
        return known


def _any_along(hidden: NDArray[np.bool_], count: int) -> NDArray[np.bool_]:
    """[n, m] -> [count, m]: whether any row is hidden that one of `count` even parts touches."""
    n = len(hidden)
    so_far = np.concatenate([np.zeros((1, hidden.shape[1]), np.int64), np.cumsum(hidden, axis=0)])
    part = np.arange(count)
    begin, end = part * n // count, -(-(part + 1) * n // count)
    return np.asarray(so_far[end] > so_far[begin])
