"""A built landscape: the ground, the road, buildings, things, and where people may stand."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.simulation.landscape.building import Building
from crowdfence.simulation.landscape.ground import Ground
from crowdfence.simulation.landscape.obstacles import Obstacles
from crowdfence.simulation.landscape.props import Props
from crowdfence.simulation.landscape.road import Road
from crowdfence.simulation.landscape.triangle_mesh import TriangleMesh

WADING_DEPTH_M = 0.35
"""Nobody goes deeper into the water."""


@dataclass(frozen=True, slots=True)
class Landscape:
    """Everything that does not move. Local ENU metres."""

    surface: Ground
    road: Road | None
    buildings: tuple[Building, ...]
    """With the ground, the known map."""
    props: tuple[Props, ...]
    """Things that no map knows."""
    places: Mapping[str, NDArray[np.float64]]
    """Named points and lines [N, 3] on the ground where people gather or pass."""
    obstacles: Obstacles

    @property
    def ground(self) -> TriangleMesh:
        """The ground as the very triangles that are drawn."""
        return self.surface.mesh()

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        """(west, south, east, north) of the ground."""
        return self.surface.lattice.extent_m

    @property
    def solids(self) -> tuple[TriangleMesh, ...]:
        """The meshes of the buildings, overhanging roofs included."""
        return tuple(building.mesh for building in self.buildings)

    def height_m(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Height of the ground at points x, y, exactly on the triangles; the edge's height outside."""
        return self.surface.height_at(x, y)

    def on_road(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """Whether points x, y lie on a road surface."""
        return self.surface.on_road(x, y)

    def blocked(self, x: ArrayLike, y: ArrayLike, radius_m: float) -> NDArray[np.bool_]:
        """Where a person of `radius_m` cannot stand: in an obstacle, in deep water, off the map."""
        px, py = np.atleast_1d(np.asarray(x, np.float64)), np.atleast_1d(np.asarray(y, np.float64))
        west, south, east, north = self.extent_m
        outside = (px < west + 1) | (px > east - 1) | (py < south + 1) | (py > north - 1)
        blocked = outside | self.obstacles.blocked(px, py, radius_m)
        if self.surface.water_depth_m is not None:
            blocked |= self.surface.lattice.interpolate(self.surface.water_depth_m, px, py) > WADING_DEPTH_M
        return blocked
