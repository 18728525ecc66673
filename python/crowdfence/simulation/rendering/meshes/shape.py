"""Drawable triangles with normals, colours and limbs, and the solids that figures are made of.

Meshes are in metres, foot at the origin, front along +x, z up.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Colour = tuple[int, int, int]

FIXED = 255
"""Colour slot of a vertex that keeps its own colour whatever the instance's colours are."""


class Limb(IntEnum):
    """Which joint moves a vertex; the vertex shader knows the same numbers."""

    BODY = 0
    LEFT_LEG = 1
    RIGHT_LEG = 2
    LEFT_ARM = 3
    RIGHT_ARM = 4
    LEFT_SHIN = 6
    RIGHT_SHIN = 7
    LEFT_FOREARM = 8
    RIGHT_FOREARM = 9
    CLOTH = 10
    CRANK = 11


@dataclass(frozen=True, slots=True)
class Shape:
    """Triangles ready to draw."""

    position: Array
    """[N, 3] metres."""
    normal: Array
    """[N, 3] unit."""
    colour: NDArray[np.uint8]
    """[N, 4]: sRGB factor (own colour, or times the instance's colour) and slot 0-5 or `FIXED`."""
    limb: NDArray[np.uint8]
    """[N] `Limb`."""
    triangles: NDArray[np.int32]
    """[M, 3]."""

    def moved(self, offset: ArrayLike) -> "Shape":
        return replace(self, position=self.position + np.asarray(offset, np.float64))

    def scaled(self, factor: ArrayLike) -> "Shape":
        factors = np.broadcast_to(np.asarray(factor, np.float64), (3,))
        normal = self.normal / factors
        normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        return replace(self, position=self.position * factors, normal=normal)

    def turned(self, rotation: ArrayLike) -> "Shape":
        matrix = np.asarray(rotation, np.float64)
        return replace(self, position=self.position @ matrix.T, normal=self.normal @ matrix.T)

    def on_limb(self, limb: Limb) -> "Shape":
        return replace(self, limb=np.full(len(self.limb), int(limb), np.uint8))

    def painted(self, rgb: Colour = (255, 255, 255), slot: int = FIXED) -> "Shape":
        colour = np.empty((len(self.position), 4), np.uint8)
        colour[:] = (*rgb, slot)
        return replace(self, colour=colour)

    def shaded(self, factor: Array) -> "Shape":
        """Colours times `factor` [N]: darker undersides, lighter tips."""
        colour = self.colour.copy()
        colour[:, :3] = np.clip(self.colour[:, :3] * factor[:, None], 0, 255)
        return replace(self, colour=colour)


def shape_of(position: ArrayLike, triangles: ArrayLike, *, smooth: bool = True) -> Shape:
    """Shape with normals from its triangles: shared by neighbours when `smooth`, else one per triangle."""
    points = np.asarray(position, np.float64)
    faces = np.asarray(triangles, np.int64).reshape(-1, 3)
    if not smooth:
        points = points[faces].reshape(-1, 3)
        faces = np.arange(len(points)).reshape(-1, 3)
    across = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    normal = np.zeros_like(points)
    for corner in range(3):
        np.add.at(normal, faces[:, corner], across)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    colour = np.full((len(points), 4), 255, np.uint8)
    return Shape(points, normal, colour, np.zeros(len(points), np.uint8), faces.astype(np.int32))


def joined(shapes: Sequence[Shape]) -> Shape:
    """Several shapes as one."""
    starts = np.cumsum([0] + [len(shape.position) for shape in shapes[:-1]])
    return Shape(
        np.concatenate([shape.position for shape in shapes]),
        np.concatenate([shape.normal for shape in shapes]),
        np.concatenate([shape.colour for shape in shapes]),
        np.concatenate([shape.limb for shape in shapes]),
        np.concatenate([shape.triangles + start for shape, start in zip(shapes, starts, strict=True)]).astype(
            np.int32
        ),
    )


def loft(rings: Sequence[Sequence[float]], sides: int, *, smooth: bool = True) -> Shape:
    """Skin over ellipses from bottom to top, with both ends closed; ring = (x, y, z, radius_x, radius_y)."""
    angle = np.arange(sides) * 2.0 * np.pi / sides + np.pi / sides
    ring = np.asarray(rings, np.float64)
    x = ring[:, 0, None] + ring[:, 3, None] * np.cos(angle)
    y = ring[:, 1, None] + ring[:, 4, None] * np.sin(angle)
    z = np.broadcast_to(ring[:, 2, None], x.shape)
    points = np.concatenate([np.stack([x, y, z], axis=-1).reshape(-1, 3), ring[[0, -1], :3]])
    count = len(ring)
    step = np.arange(sides)
    next_step = (step + 1) % sides
    faces = []
    for level in range(count - 1):
        a, b = level * sides + step, level * sides + next_step
        faces += [np.stack([a, b, b + sides], axis=-1), np.stack([a, b + sides, a + sides], axis=-1)]
    bottom, top, last = count * sides, count * sides + 1, (count - 1) * sides
    faces.append(np.stack([np.full(sides, bottom), next_step, step], axis=-1))
    faces.append(np.stack([np.full(sides, top), last + step, last + next_step], axis=-1))
    return shape_of(points, np.concatenate(faces), smooth=smooth)


def tube(
    start: ArrayLike, end: ArrayLike, radius: float, sides: int = 5, *, end_radius: float = -1.0
) -> Shape:
    """Round bar between two points; `end_radius` makes it taper."""
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    length = float(np.linalg.norm(b - a))
    forward = (b - a) / length
    side = np.cross([0.0, 0.0, 1.0] if abs(forward[2]) < 0.99 else [1.0, 0.0, 0.0], forward)
    side /= np.linalg.norm(side)
    tip = radius if end_radius < 0 else end_radius
    bar = loft([(0, 0, 0, radius, radius), (0, 0, length, tip, tip)], sides)
    return bar.turned(np.stack([side, np.cross(forward, side), forward], axis=1)).moved(a)


def box(centre: ArrayLike, size: ArrayLike) -> Shape:
    """Upright box with flat faces."""
    half = np.asarray(size, np.float64) / 2.0
    corner = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)]) * half
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return shape_of(corner + np.asarray(centre, np.float64), faces, smooth=False)


def ball(
    centre: ArrayLike,
    radius: ArrayLike,
    *,
    rings: int = 4,
    sides: int = 8,
    roughness: float = 0.0,
    rng: np.random.Generator | None = None,
    smooth: bool = True,
) -> Shape:
    """Ellipsoid; `roughness` moves its points in and out at random by that share of the radius."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, rings + 2)[1:-1]
    skin = loft([(0, 0, np.sin(a), np.cos(a), np.cos(a)) for a in latitude], sides)
    points = skin.position.copy()
    points[-2:] = [[0, 0, -1], [0, 0, 1]]
    if roughness and rng is not None:
        points *= 1.0 + rng.uniform(-roughness, roughness, (len(points), 1))
    radii = np.broadcast_to(np.asarray(radius, np.float64), (3,))
    return shape_of(points * radii + np.asarray(centre, np.float64), skin.triangles, smooth=smooth)
