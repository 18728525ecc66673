"""The ground of a simulated landscape, met by rays exactly: float64, the triangles that are drawn, no voxels.

Nothing of the core takes part in it, so that it can judge the core. Ground and buildings stand in the way of
a ray; trees, cars and people do not, because no map knows them.
"""

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.rendering.ray_surface import box_candidates, ground_hits, triangle_hits

Array = NDArray[np.float64]

_CELLS_PER_BLOCK = 8
_AHEAD = 1e-7  # of a block: past the edge that the last step ended on
_ARRIVED = 1e-6  # of the way to a point: a ray that is stopped there has met the point itself


class ExactGround:
    """First hits with ground and buildings."""

    def __init__(self, landscape: Landscape) -> None:
        self._landscape = landscape
        self._tops = _BlockTops(landscape)

    def height_m(self, xy: Array) -> Array:
        """Height of the ground at points [N, 2]."""
        return self._landscape.height_m(xy[:, 0], xy[:, 1])

    def meet(self, origin: Array, rays: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Ray parameter [N] of the first hit, inf = none, and whether it is ground and no building [N]."""
        nearest = ground_hits(self._landscape.surface, origin, rays, self._tops.skip)
        is_ground = np.isfinite(nearest)
        for mesh in self._landscape.solids:
            near = box_candidates(origin, rays, mesh.vertices.min(axis=0), mesh.vertices.max(axis=0))
            hit = triangle_hits(origin, rays[near], mesh.vertices[mesh.triangles])
            closer = hit < nearest[near]
            nearest[near[closer]], is_ground[near[closer]] = hit[closer], False
        return nearest, is_ground

    def in_sight(self, origin: Array, points: Array) -> NDArray[np.bool_]:
        """Whether nothing stands between `origin` and points [N, 3] of the ground."""
        nearest, _ = self.meet(origin, points - origin)
        return nearest >= 1.0 - _ARRIVED


class _BlockTops:
    """The highest ground of square blocks of the lattice: above it a ray can meet nothing."""

    def __init__(self, landscape: Landscape) -> None:
        lattice = landscape.surface.lattice
        self._corner = np.array([lattice.west_m, lattice.south_m])
        self._side_m = _CELLS_PER_BLOCK * lattice.step_m
        self._top_m = np.array(
            [
                [
                    landscape.surface.height_m[
                        row : row + _CELLS_PER_BLOCK + 1, column : column + _CELLS_PER_BLOCK + 1
                    ].max()
                    for row in range(0, lattice.rows - 1, _CELLS_PER_BLOCK)
                ]
                for column in range(0, lattice.columns - 1, _CELLS_PER_BLOCK)
            ],
            np.float64,
        )

    def skip(self, points: Array, rays: Array) -> Array:
        """Ray parameter [N] up to which rays stay above the highest ground of every block; inf = for ever."""
        above = np.zeros(len(points))
        active = np.arange(len(points))
        while len(active):
            here = points[active] + above[active, None] * rays[active]
            block = (here[:, :2] - self._corner) / self._side_m
            pace = rays[active, :2] / self._side_m
            index = np.floor(block + np.copysign(_AHEAD, pace)).astype(np.int64)
            inside = ((index >= 0) & (index < self._top_m.shape)).all(axis=1)
            above[active[~inside]] = np.inf
            active, here, block, pace, index = (array[inside] for array in (active, here, block, pace, index))
            with np.errstate(divide="ignore", invalid="ignore"):
                to_edge = np.where(pace == 0.0, np.inf, (index + (pace > 0) - block) / pace).min(axis=1)
                to_top = (here[:, 2] - self._top_m[tuple(index.T)]) / -rays[active, 2]
            over = here[:, 2] > self._top_m[tuple(index.T)]
            to_top = np.where(over, np.where(rays[active, 2] < 0.0, to_top, np.inf), 0.0)
            arrives = to_top <= to_edge
            above[active] += np.minimum(to_top, np.maximum(to_edge, 0.0))
            active = active[~arrives]
        return above
