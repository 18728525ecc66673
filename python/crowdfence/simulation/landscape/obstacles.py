"""Where nobody can stand: footprints of buildings, cars, trunks and rocks."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(slots=True)
class Obstacles:
    """Circles and turned rectangles on the ground plane."""

    circles: list[NDArray[np.float64]] = field(default_factory=list)
    """Rows (x, y, radius)."""
    rectangles: list[NDArray[np.float64]] = field(default_factory=list)
    """Rows (x, y, heading, half length, half width)."""

    def add_circles(self, x: NDArray[np.float64], y: NDArray[np.float64], radius: ArrayLike) -> None:
        self.circles.append(
            np.stack([x, y, np.broadcast_to(np.asarray(radius, np.float64), x.shape)], axis=-1)
        )

    def add_rectangle(
        self, x: float, y: float, heading_rad: float, half_length_m: float, half_width_m: float
    ) -> None:
        self.rectangles.append(np.array([[x, y, heading_rad, half_length_m, half_width_m]]))

    def blocked(self, x: ArrayLike, y: ArrayLike, radius_m: float) -> NDArray[np.bool_]:
        """Whether a disc of `radius_m` around each point touches an obstacle."""
        px, py = np.atleast_1d(np.asarray(x, np.float64)), np.atleast_1d(np.asarray(y, np.float64))
        return self._in_circle(px, py, radius_m) | self._in_rectangle(px, py, radius_m)

    def _in_circle(
        self, x: NDArray[np.float64], y: NDArray[np.float64], radius_m: float
    ) -> NDArray[np.bool_]:
        from scipy.spatial import cKDTree

        if not self.circles:
            return np.zeros(x.shape, bool)
        circles = np.concatenate(self.circles)
        points = np.stack([x, y], axis=-1)
        blocked = np.zeros(x.shape, bool)
        # One tree per size class: a few wide circles would otherwise hide behind many narrow ones.
        for low, high in ((0.0, 0.6), (0.6, 1.5), (1.5, 4.0), (4.0, np.inf)):
            members = circles[(circles[:, 2] >= low) & (circles[:, 2] < high)]
            members = members[_near(members, members[:, 2].max(initial=0.0) + radius_m, x, y)]
            if len(members):
                neighbours = min(8, len(members))
                distance, index = cKDTree(members[:, :2]).query(points, k=neighbours)
                distance = distance.reshape(*x.shape, neighbours)
                index = index.reshape(*x.shape, neighbours)
                blocked |= (distance < members[index, 2] + radius_m).any(axis=-1)
        return blocked

    def _in_rectangle(
        self, x: NDArray[np.float64], y: NDArray[np.float64], radius_m: float
    ) -> NDArray[np.bool_]:
        blocked = np.zeros(x.shape, bool)
        rectangles = np.concatenate([np.zeros((0, 5)), *self.rectangles])
        reach_m = np.hypot(rectangles[:, 3], rectangles[:, 4]) + radius_m
        for centre_x, centre_y, heading, half_length, half_width in rectangles[
            _near(rectangles, reach_m, x, y)
        ]:
            dx, dy = x - centre_x, y - centre_y
            along = np.abs(np.cos(heading) * dx + np.sin(heading) * dy) - half_length
            across = np.abs(-np.sin(heading) * dx + np.cos(heading) * dy) - half_width
            outside = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
            blocked |= np.where((along < 0) & (across < 0), True, outside < radius_m)
        return blocked


def _near(
    obstacles: NDArray[np.float64], reach_m: ArrayLike, x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which obstacles (x, y, ...) may reach a point: a crowd is metres wide, its landscape kilometres."""
    if x.size == 0:
        return np.zeros(len(obstacles), bool)
    beside_x = np.maximum(x.min() - obstacles[:, 0], obstacles[:, 0] - x.max())
    beside_y = np.maximum(y.min() - obstacles[:, 1], obstacles[:, 1] - y.max())
    return np.asarray(np.maximum(beside_x, beside_y) <= reach_m)
