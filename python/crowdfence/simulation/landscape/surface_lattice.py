"""Values on a square lattice, linear on the triangles between them: what is drawn is what is measured."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.simulation.landscape.triangle_mesh import TriangleMesh


@dataclass(frozen=True, slots=True)
class SurfaceLattice:
    """Lattice of `rows` x `columns` points; each cell is cut along its south-west to north-east diagonal."""

    west_m: float
    south_m: float
    step_m: float
    columns: int
    rows: int

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        """(west, south, east, north)."""
        return (
            self.west_m,
            self.south_m,
            self.west_m + (self.columns - 1) * self.step_m,
            self.south_m + (self.rows - 1) * self.step_m,
        )

    def coordinates(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """x and y of every lattice point, each [rows, columns]."""
        x, y = np.meshgrid(
            self.west_m + np.arange(self.columns) * self.step_m,
            self.south_m + np.arange(self.rows) * self.step_m,
        )
        return x, y

    def interpolate(self, values: NDArray[np.floating], x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """`values` [rows, columns] at points x, y (any equal shape), linear on the triangles.

        Points outside take the value of the nearest edge."""
        u = np.clip((np.asarray(x, np.float64) - self.west_m) / self.step_m, 0.0, self.columns - 1.0)
        v = np.clip((np.asarray(y, np.float64) - self.south_m) / self.step_m, 0.0, self.rows - 1.0)
        i = np.minimum(u.astype(np.int64), self.columns - 2)
        j = np.minimum(v.astype(np.int64), self.rows - 2)
        u, v = u - i, v - j
        south_west, north_east = values[j, i], values[j + 1, i + 1]
        east_first = u >= v
        corner = np.where(east_first, values[j, i + 1], values[j + 1, i])
        first, second = np.where(east_first, u, v), np.where(east_first, v, u)
        return np.asarray(
            south_west + first * (corner - south_west) + second * (north_east - corner), dtype=np.float64
        )

    def cells(self, stride: int = 1) -> NDArray[np.int32]:
        """Triangles [M, 3] over the lattice points in row order, using every `stride`-th point."""
        return self.cells_between(0, self.rows - 1, 0, self.columns - 1, stride)

    def cells_between(
        self, row0: int, row1: int, column0: int, column1: int, stride: int
    ) -> NDArray[np.int32]:
        """The same for the rectangle of lattice points row0..row1 x column0..column1."""
        row, column = np.meshgrid(
            np.arange(row0, row1, stride), np.arange(column0, column1, stride), indexing="ij"
        )
        south_west = row * self.columns + column
        south_east, north_west = south_west + stride, south_west + stride * self.columns
        north_east = north_west + stride
        corners = np.stack([south_west, south_east, north_east, south_west, north_east, north_west], axis=-1)
        return corners.reshape(-1, 3).astype(np.int32)

    def mesh(self, height_m: NDArray[np.floating]) -> TriangleMesh:
        """The surface `height_m` [rows, columns] as triangles."""
        x, y = self.coordinates()
        vertices = np.stack([x, y, np.asarray(height_m, np.float64)], axis=-1).reshape(-1, 3)
        return TriangleMesh(vertices, self.cells())


def square_lattice(size_m: float, step_m: float) -> SurfaceLattice:
    """Lattice over a square of about `size_m` centred on the origin, a whole number of 64-cell tiles wide.

    Whole tiles let the renderer cut it into equal parts."""
    tiles = max(1, round(size_m / (64 * step_m)))
    cells = 64 * tiles
    half_m = cells * step_m / 2
    return SurfaceLattice(-half_m, -half_m, step_m, cells + 1, cells + 1)
