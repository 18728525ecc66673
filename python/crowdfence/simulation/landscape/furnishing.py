"""Puts things on the ground of a landscape: keeps props and the obstacles that they are together."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.simulation.landscape.ground import Ground
from crowdfence.simulation.landscape.obstacles import Obstacles
from crowdfence.simulation.landscape.props import PropKind, Props
from crowdfence.simulation.landscape.road import Road

# Radius in metres at scale 1 of the disc that nobody can stand in; a crown is no obstacle, its trunk is.
_BLOCKING_RADIUS_M: dict[PropKind, float] = {
    "conifer": 0.45,
    "broadleaf": 0.35,
    "birch": 0.25,
    "bush": 0.9,
    "rock": 0.95,
    "tent": 1.7,
    "flag": 0.15,
    "post": 0.12,
    "lamp": 0.2,
    "parasol": 0.2,
    "statue": 0.7,
    "scarecrow": 0.3,
    "cow": 1.1,
    "bale": 0.9,
}
_BLOCKING_HALF_SIZE_M: dict[PropKind, tuple[float, float]] = {
    "car": (2.2, 0.95),
    "van": (2.7, 1.05),
    "barrier": (1.15, 0.3),
    "marquee": (3.2, 3.2),
    "boat": (2.4, 0.9),
    "stage": (5.2, 7.2),
    "towel": (0.95, 0.4),
}

CAR_COLOURS = np.array(
    [
        [190, 192, 195],
        [38, 40, 44],
        [225, 226, 228],
        [96, 102, 110],
        [140, 24, 28],
        [32, 62, 120],
        [60, 84, 66],
        [196, 160, 60],
        [90, 66, 50],
        [30, 110, 140],
    ],
    np.uint8,
)
CLOTH_COLOURS = np.array(
    [
        [205, 60, 48],
        [40, 90, 170],
        [230, 225, 214],
        [238, 190, 60],
        [58, 130, 84],
        [120, 62, 130],
        [236, 120, 48],
        [60, 160, 170],
    ],
    np.uint8,
)


@dataclass(slots=True)
class Furnishing:
    """Collects the things of one landscape."""

    surface: Ground
    rng: np.random.Generator
    props: list[Props] = field(default_factory=list)
    obstacles: Obstacles = field(default_factory=Obstacles)

    def free(self, x: NDArray[np.float64], y: NDArray[np.float64], radius_m: float) -> NDArray[np.bool_]:
        """Points where nothing stands yet within `radius_m`."""
        return ~self.obstacles.blocked(x, y, radius_m)

    def place(
        self,
        kind: PropKind,
        x: NDArray[np.float64],
        y: NDArray[np.float64],
        *,
        heading_rad: ArrayLike | None = None,
        scale: ArrayLike = 1.0,
        colour: ArrayLike = (128, 128, 128),
        sink_m: float = 0.0,
    ) -> None:
        """Stand things of one kind at points x, y [N]; turned at random unless told how."""
        if not len(x):
            return
        heading = self.rng.uniform(-np.pi, np.pi, len(x)) if heading_rad is None else heading_rad
        headings = np.array(np.broadcast_to(np.asarray(heading, np.float64), x.shape))
        scales = np.array(np.broadcast_to(np.asarray(scale, np.float64), x.shape))
        colours = np.array(np.broadcast_to(np.asarray(colour, np.uint8), (len(x), 3)))
        position = np.stack([x, y, self.surface.height_at(x, y) - sink_m], axis=-1)
        self.props.append(Props(kind, position, headings, scales, colours))
        if kind in _BLOCKING_RADIUS_M:
            self.obstacles.add_circles(x, y, _BLOCKING_RADIUS_M[kind] * scales)
        if kind in _BLOCKING_HALF_SIZE_M:
            half_length, half_width = _BLOCKING_HALF_SIZE_M[kind]
            for at_x, at_y, turn, factor in zip(x, y, headings, scales, strict=True):
                self.obstacles.add_rectangle(at_x, at_y, turn, half_length * factor, half_width * factor)

    def choose(self, palette: NDArray[np.uint8], count: int) -> NDArray[np.uint8]:
        """`count` random rows of a palette, each a little lighter or darker."""
        rows = palette[self.rng.integers(0, len(palette), count)].astype(np.float64)
        return np.asarray(np.clip(rows * self.rng.uniform(0.85, 1.12, (count, 1)), 0, 255), dtype=np.uint8)

    def beside(
        self, road: Road, count: int, lateral_m: tuple[float, float]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """x, y and the road's heading for `count` random points `lateral_m` to either side of it."""
        s = self.rng.uniform(20.0, max(road.length_m - 20.0, 21.0), count)
        side = self.rng.choice([-1.0, 1.0], count)
        point = road.position(s, side * self.rng.uniform(*lateral_m, count))
        return point[:, 0], point[:, 1], road.heading_rad(s)
