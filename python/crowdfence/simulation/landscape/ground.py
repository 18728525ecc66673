"""The ground: heights, what covers it, where the road lies; all linear on the triangles drawn."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.simulation.landscape.surface_lattice import SurfaceLattice
from crowdfence.simulation.landscape.triangle_mesh import TriangleMesh


class Cover(IntEnum):
    """What covers the ground; index of the last axis of `Ground.cover`."""

    GRASS = 0
    DIRT = 1
    ROCK = 2
    SNOW = 3
    SAND = 4
    PAVING = 5
    WATER = 6
    GRAVEL = 7


@dataclass(frozen=True, slots=True)
class Ground:
    """Heights and surface of the ground on one lattice; every array is [rows, columns]."""

    lattice: SurfaceLattice
    height_m: NDArray[np.float32]
    cover: NDArray[np.uint8]
    """[rows, columns, 8] weight of each `Cover`, 255 = all of it."""
    road_margin_m: NDArray[np.float32]
    """Distance to the edge of the nearest road, negative on the road."""
    road_lateral_m: NDArray[np.float32]
    """Signed distance to the centre line of the nearest road, positive on its left."""
    road_arc_m: NDArray[np.float32]
    """Distance along the nearest road."""
    water_depth_m: NDArray[np.float32] | None = None
    """Depth of the water under the drawn surface, 0 on land; None where there is no water at all."""

    def height_at(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Height in metres at points x, y, exactly on the triangles."""
        return self.lattice.interpolate(self.height_m, x, y)

    def on_road(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """Whether points x, y lie on a road surface."""
        return self.lattice.interpolate(self.road_margin_m, x, y) < 0.0

    def mesh(self) -> TriangleMesh:
        """The ground as triangles."""
        return self.lattice.mesh(self.height_m)


def cover_weights(shape: tuple[int, ...], **weights: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Weights by name of cover (lower case), each [rows, columns] >= 0, scaled to 255; the rest is grass."""
    total = np.zeros((*shape, len(Cover)))
    for name, weight in weights.items():
        total[..., Cover[name.upper()]] = np.clip(weight, 0.0, 1.0)
    rest = np.clip(1.0 - total.sum(axis=-1), 0.0, 1.0)
    total[..., Cover.GRASS] += rest
    total /= total.sum(axis=-1, keepdims=True)
    return np.asarray(np.round(total * 255), dtype=np.uint8)
