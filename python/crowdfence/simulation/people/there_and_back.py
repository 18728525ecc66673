"""Movement to and fro between two ends, without corners in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True)
class ThereAndBack:
    """A place between 0 and `span_m` as a function of the way travelled: a triangle wave with round corners.

    `roundness` in (0, 1): 1 would turn at once; the turn takes about acos(`roundness`) / pi of a crossing.
    `start_m` is the place at way 0, going up. The place never changes faster than the way.
    """

    span_m: float
    start_m: float
    roundness: float

    def place_m(self, way_m: ArrayLike) -> NDArray[np.float64]:
        """Place in (0, `span_m`) after a way of `way_m`."""
        wave = np.arcsin(self.roundness * np.sin(self._angle(way_m))) / np.arcsin(self.roundness)
        return np.asarray(0.5 * self.span_m * (1.0 + wave))

    def direction(self, way_m: ArrayLike) -> NDArray[np.float64]:
        """1 on the way up, -1 on the way down, smooth between: place_m's derivative by the way."""
        angle = self._angle(way_m)
        steepness = np.sqrt(1.0 - (self.roundness * np.sin(angle)) ** 2)
        return np.asarray(np.cos(angle) / steepness)

    def _angle(self, way_m: ArrayLike) -> NDArray[np.float64]:
        start = (2.0 * self.start_m / self.span_m - 1.0) * np.arcsin(self.roundness)
        first = np.arcsin(np.clip(np.sin(start) / self.roundness, -1.0, 1.0))
        per_metre = 2.0 * np.arcsin(self.roundness) / (self.roundness * self.span_m)
        return np.asarray(first + per_metre * np.asarray(way_m, np.float64))
