"""A road: a centre line over the ground, addressed by distance along it and distance to its side."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Height = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class CentreLine:
    """Polyline in the plane, dense enough that its chords stand for the curve."""

    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    arc_m: NDArray[np.float64]
    """Distance along the line at each point, starting with 0."""

    @staticmethod
    def through(x_m: NDArray[np.float64], y_m: NDArray[np.float64], spacing_m: float = 1.0) -> "CentreLine":
        """Line through points [N], resampled to one point per `spacing_m`."""
        along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x_m), np.diff(y_m)))])
        arc = np.linspace(0.0, along[-1], max(2, round(along[-1] / spacing_m) + 1))
        return CentreLine(np.interp(arc, along, x_m), np.interp(arc, along, y_m), arc)

    @property
    def length_m(self) -> float:
        return float(self.arc_m[-1])

    def tangents(self) -> NDArray[np.float64]:
        """Unit direction [N, 2] at each point of the line."""
        tangent = np.stack([np.gradient(self.x_m, self.arc_m), np.gradient(self.y_m, self.arc_m)], axis=-1)
        return np.asarray(tangent / np.linalg.norm(tangent, axis=-1, keepdims=True))

    def at(self, s_m: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """x, y and heading at distance `s_m`; beyond its ends the line stops."""
        s = np.clip(np.asarray(s_m, np.float64), 0.0, self.length_m)
        tangent = self.tangents()
        east, north = np.interp(s, self.arc_m, tangent[:, 0]), np.interp(s, self.arc_m, tangent[:, 1])
        return np.interp(s, self.arc_m, self.x_m), np.interp(s, self.arc_m, self.y_m), np.arctan2(north, east)

    def nearest(self, x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distance along the line and signed distance to it (positive on the left) of points x, y."""
        from scipy.spatial import cKDTree

        points = np.stack([np.asarray(x, np.float64), np.asarray(y, np.float64)], axis=-1)
        distance, index = cKDTree(np.stack([self.x_m, self.y_m], axis=-1)).query(points)
        offset = points - np.stack([self.x_m[index], self.y_m[index]], axis=-1)
        tangent = self.tangents()[index]
        along = tangent[..., 0] * offset[..., 0] + tangent[..., 1] * offset[..., 1]
        across = tangent[..., 0] * offset[..., 1] - tangent[..., 1] * offset[..., 0]
        # Near the line the exact offset; far away only the side matters and the chord distance is smoother.
        lateral = np.where(distance < 60.0, across, np.copysign(distance, across))
        return self.arc_m[index] + along, lateral


@dataclass(frozen=True, slots=True)
class Road:
    """A road on the ground."""

    centre: CentreLine
    half_width_m: float
    height_at: Height
    marked: bool = True
    """Has edge lines and a broken middle line."""

    @property
    def length_m(self) -> float:
        return self.centre.length_m

    def position(self, s_m: ArrayLike, lateral_m: ArrayLike = 0.0) -> NDArray[np.float64]:
        """Points [..., 3] on the ground `s_m` along the road, `lateral_m` to the left of its middle."""
        x, y, heading = self.centre.at(s_m)
        lateral = np.asarray(lateral_m, np.float64)
        x, y = x - np.sin(heading) * lateral, y + np.cos(heading) * lateral
        return np.stack([x, y, self.height_at(x, y)], axis=-1)

    def heading_rad(self, s_m: ArrayLike) -> NDArray[np.float64]:
        """Direction of travel, counter-clockwise from east."""
        return self.centre.at(s_m)[2]

    def nearest(self, x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(s_m, lateral_m) of points x, y."""
        return self.centre.nearest(x, y)
