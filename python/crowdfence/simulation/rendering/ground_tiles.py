"""The ground as the GPU reads it: one vertex per lattice point, drawn in tiles of 64 x 64 cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.ground import Ground
from crowdfence.simulation.rendering.terrain_light import openness, sun_reaches

TILE_CELLS = 64

VERTEX = np.dtype(
    [
        ("position", np.float32, 3),
        ("normal", np.float32, 3),
        ("cover", np.uint8, 8),
        ("road", np.float32, 3),
        ("light", np.uint8, 4),
    ]
)
LAYOUT = "3f 3f 4f1 4f1 3f 2f1 2x1"
NAMES = ("in_position", "in_normal", "in_cover_a", "in_cover_b", "in_road", "in_light")


@dataclass(frozen=True, slots=True)
class GroundTiles:
    """Vertices of the lattice and the tiles that they are drawn in."""

    vertices: NDArray[np.void]
    """[rows * columns] `VERTEX`."""
    pattern: NDArray[np.uint32]
    """Indices of one tile's triangles relative to its south-west vertex."""
    first_vertex: NDArray[np.int64]
    """[T] south-west vertex of each tile."""
    centre: NDArray[np.float64]
    """[T, 3]."""
    radius_m: NDArray[np.float64]
    """[T] of a sphere around each tile."""


def normals(height_m: NDArray[np.floating], step_m: float) -> NDArray[np.float32]:
    """Unit normals [rows, columns, 3] of a height lattice."""
    north, east = np.gradient(np.asarray(height_m, np.float64), step_m)
    up = np.stack([-east, -north, np.ones_like(east)], axis=-1)
    return np.asarray(up / np.linalg.norm(up, axis=-1, keepdims=True), dtype=np.float32)


def ground_vertices(ground: Ground, sun_direction: tuple[float, float, float]) -> NDArray[np.void]:
    """All lattice points with what the shader needs to know of them."""
    x, y = ground.lattice.coordinates()
    vertices = np.zeros(x.shape, VERTEX)
    vertices["position"] = np.stack([x, y, ground.height_m], axis=-1)
    vertices["normal"] = normals(ground.height_m, ground.lattice.step_m)
    vertices["cover"] = ground.cover
    vertices["road"] = np.stack([ground.road_margin_m, ground.road_lateral_m, ground.road_arc_m], axis=-1)
    sun = sun_reaches(ground.height_m, ground.lattice.step_m, sun_direction)
    sky = openness(ground.height_m, ground.lattice.step_m)
    if ground.water_depth_m is not None:
        # Over water the second number is how shallow it is.
        sky = np.where(ground.water_depth_m > 0, np.exp(-ground.water_depth_m / 2.2), sky)
    vertices["light"][..., 0] = np.round(255 * sun)
    vertices["light"][..., 1] = np.round(255 * sky)
    return vertices.reshape(-1)


def ground_tiles(ground: Ground, sun_direction: tuple[float, float, float]) -> GroundTiles:
    """Cut the ground into tiles. The lattice is a whole number of tiles wide (`square_lattice`)."""
    lattice = ground.lattice
    if (lattice.rows - 1) % TILE_CELLS or (lattice.columns - 1) % TILE_CELLS:
        raise ValueError(
            f"ground of {lattice.columns - 1} x {lattice.rows - 1} cells is not a multiple of 64"
        )
    rows, columns = np.meshgrid(
        np.arange(0, lattice.rows - 1, TILE_CELLS),
        np.arange(0, lattice.columns - 1, TILE_CELLS),
        indexing="ij",
    )
    row, column = rows.ravel(), columns.ravel()
    half_m = TILE_CELLS * lattice.step_m / 2
    heights = [
        ground.height_m[j : j + TILE_CELLS + 1, i : i + TILE_CELLS + 1]
        for j, i in zip(row, column, strict=True)
    ]
    low, high = (np.array([pick(h) for h in heights], np.float64) for pick in (np.min, np.max))
    centre = np.stack(
        [
            lattice.west_m + column * lattice.step_m + half_m,
            lattice.south_m + row * lattice.step_m + half_m,
            (low + high) / 2,
        ],
        axis=-1,
    )
    radius = np.sqrt(2 * half_m**2 + ((high - low) / 2) ** 2)
    pattern = lattice.cells_between(0, TILE_CELLS, 0, TILE_CELLS, 1).astype(np.uint32).ravel()
    first = (row * lattice.columns + column).astype(np.int64)
    return GroundTiles(ground_vertices(ground, sun_direction), pattern, first, centre, radius)
