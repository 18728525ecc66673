"""A smooth line over the ground that crowds, cyclists and drones follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

SPACING_M = 0.5


@dataclass(frozen=True, slots=True)
class GuideLine:
    """Plane curve by arc length; beyond its ends it goes on straight."""

    curve: CubicSpline
    length_m: float

    @staticmethod
    def through(points: ArrayLike, rounding_m: float = 0.0) -> GuideLine:
        """Curve along the polyline `points` [N, 2], N >= 2; corners are rounded over about `rounding_m`."""
        corners = np.asarray(points, np.float64)
        along = _arc_m(corners)
        count = max(4, round(along[-1] / SPACING_M) + 1)
        arc = np.linspace(0.0, along[-1], count)
        dense = np.stack([np.interp(arc, along, corners[:, axis]) for axis in (0, 1)], axis=-1)
        if rounding_m > 0.0:
            dense = _rounded(dense, rounding_m / (arc[1] - arc[0]))
        along = _arc_m(dense)
        return GuideLine(CubicSpline(along, dense), float(along[-1]))

    @staticmethod
    def straight(x_m: float, y_m: float, heading_rad: float, half_length_m: float = 50.0) -> GuideLine:
        """Straight line whose middle is (`x_m`, `y_m`); heading counter-clockwise from east."""
        reach = half_length_m * np.array([np.cos(heading_rad), np.sin(heading_rad)])
        middle = np.array([x_m, y_m])
        return GuideLine.through(np.stack([middle - reach, middle + reach]))

    def heading_rad(self, s_m: ArrayLike) -> NDArray[np.float64]:
        """Direction of travel, counter-clockwise from east, in the shape of `s_m`."""
        tangent = self._tangent(np.clip(np.asarray(s_m, np.float64), 0.0, self.length_m))
        return np.asarray(np.arctan2(tangent[..., 1], tangent[..., 0]))

    def position(self, s_m: ArrayLike, left_m: ArrayLike = 0.0) -> NDArray[np.float64]:
        """Points [..., 2] at arc length `s_m`, `left_m` to the left of the line."""
        s, left = np.broadcast_arrays(np.asarray(s_m, np.float64), np.asarray(left_m, np.float64))
        inside = np.clip(s, 0.0, self.length_m)
        tangent = self._tangent(inside)
        normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
        beyond = (s - inside)[..., None] * tangent
        return np.asarray(self.curve(inside) + beyond + left[..., None] * normal)

    def narrowest(self, from_m: float, to_m: float, right_m: float, left_m: float) -> float:
        """Least stretch of the strip from `right_m` (negative) to `left_m` beside the line: 1 on a straight
        line, less on the inside of a bend, 0 or below where the strip folds over itself."""
        s = np.clip(np.arange(from_m, to_m + 1.0), 0.0, self.length_m)
        velocity, turn = self.curve(s, 1), self.curve(s, 2)
        curvature = (velocity[:, 0] * turn[:, 1] - velocity[:, 1] * turn[:, 0]) / np.maximum(
            np.linalg.norm(velocity, axis=-1) ** 3, 1e-9
        )
        return float(np.minimum(1.0 - curvature * left_m, 1.0 - curvature * right_m).min())

    def _tangent(self, inside: NDArray[np.float64]) -> NDArray[np.float64]:
        velocity = self.curve(inside, 1)
        return np.asarray(velocity / np.linalg.norm(velocity, axis=-1, keepdims=True))


def _arc_m(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=-1))])


def _rounded(points: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Gaussian smoothing that keeps both ends: the line is continued straight while it is smoothed."""
    reach = int(np.ceil(4 * sigma))
    before = points[0] - np.arange(reach, 0, -1)[:, None] * (points[1] - points[0])
    after = points[-1] + np.arange(1, reach + 1)[:, None] * (points[-1] - points[-2])
    whole = gaussian_filter1d(np.concatenate([before, points, after]), sigma, axis=0, mode="nearest")
    return np.asarray(whole[reach : len(whole) - reach])
