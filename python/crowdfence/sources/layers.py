"""Heatmaps of more than one class: a recording holds one layer per class.

The layer `crowd` is what every recording has: the heatmaps of people. Others lie beside it, each under its
name, with labels where the recording holds truth, and are fused on their own: `Recording.of_layer` gives the
recording as if its heatmaps were those of a layer.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

CROWD = "crowd"
"""The layer of the heatmaps that are not named otherwise."""
LANDING_SITE = "landing-site"
"""Ground on which a drone can land: level, open and free of people."""

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")


@dataclass(frozen=True, slots=True)
class LayerPixels:
    """Where the pixels of one layer of one frame come from: functions called when pixels are wanted, None =
    not recorded.

    heatmap  [h, w] uint8 (value / 255) or float in [0, 1], at any stride of the image
    labels   [H, W] integers, 0 = the pixel does not show the class: truth
    """

    heatmap: Callable[[], NDArray[Any]] | None = None
    labels: Callable[[], NDArray[Any]] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LayerGround:
    """Where in the world the class is, on a square grid: truth. What people take away is not in it yet."""

    cells: NDArray[np.bool_]
    """[X, Y], first axis east, second north."""
    cell_m: float
    west_m: float
    """Local coordinate of the western edge of the cells [0, :]."""
    south_m: float
    people_m: float
    """Ground that lies closer to somebody than this is not of the class while they are there."""

    def __post_init__(self) -> None:
        if self.cells.ndim != 2 or self.cells.dtype != np.bool_ or not self.cells.size:
            raise ValueError(f"cells must be bool [X, Y], got {self.cells.dtype} {list(self.cells.shape)}")
        if not (np.isfinite(self.cell_m) and self.cell_m > 0.0):
            raise ValueError(f"cell_m must be positive and finite, got {self.cell_m}")
        if not (np.isfinite(self.people_m) and self.people_m >= 0.0):
            raise ValueError(f"people_m must be a finite distance of at least 0, got {self.people_m}")

    def without(self, people_enu: ArrayLike) -> NDArray[np.bool_]:
        """The cells [X, Y] while people stand at [P, 2 or 3], local metres: without those whose middle is
        nearer than `people_m` to one of them."""
        feet = np.asarray(people_enu, np.float64)[:, :2]
        place = (feet - (self.west_m, self.south_m)) / self.cell_m
        reach = self.people_m / self.cell_m
        around = np.arange(-int(np.ceil(reach)) - 1, int(np.ceil(reach)) + 2)
        near = np.floor(place).astype(np.int64)[:, :, None] + around  # [P, 2, K]
        apart = near + 0.5 - place[:, :, None]
        who, i, j = np.nonzero(apart[:, 0, :, None] ** 2 + apart[:, 1, None, :] ** 2 < reach**2)
        east, north = near[who, 0, i], near[who, 1, j]
        inside = (east >= 0) & (east < self.cells.shape[0]) & (north >= 0) & (north < self.cells.shape[1])
        left = self.cells.copy()
        left[east[inside], north[inside]] = False
        return left

    def values_at(self, values: NDArray[Any], xy: NDArray[np.float64]) -> NDArray[Any]:
        """`values` of the cells [X, Y] at points [N, 2], local metres; 0 or False outside of the grid."""
        number = self.numbers_at(xy)
        return np.where(number >= 0, values.ravel()[number], values.dtype.type(0))

    def numbers_at(self, xy: NDArray[np.float64]) -> NDArray[np.int64]:
        """Number of the cell, in the order of `cells.ravel()`, that each point [N, 2] lies in; -1 outside."""
        place = np.floor((xy - (self.west_m, self.south_m)) / self.cell_m)
        # A NaN is on no side of anything, and so outside.
        inside: NDArray[np.bool_] = np.all((place >= 0.0) & (place < self.cells.shape), axis=1)
        east, north = np.where(inside[:, None], place, 0.0).astype(np.int64).T
        return np.where(inside, east * self.cells.shape[1] + north, -1)


def checked_layer(name: str) -> str:
    """The name. ValueError where it is none: lower case, digits, single hyphens between."""
    if not _NAME.fullmatch(name):
        raise ValueError(
            f"{name!r} is no name of a layer: lower-case letters and digits, words joined by a hyphen, such "
            f"as {LANDING_SITE}"
        )
    return name


def layer_names(folder: Path, warnings: list[str]) -> list[str]:
    """The folders inside `folder`/layers, one per layer; one without a proper name is reported."""
    names = []
    for inside in sorted(path for path in (folder / "layers").glob("*") if path.is_dir()):
        try:
            names.append(checked_layer(inside.name))
        except ValueError as error:
            warnings.append(f"layers/{inside.name} is not read: {error}")
    return names
