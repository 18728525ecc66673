"""The known map of a scene as files: the very triangles that are rendered, ground and buildings.

Trees, cars, tents and other things that stand around are on no map.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.atomic_file import atomic_path
from crowdfence.exports.octomap import write_terrain_octomap
from crowdfence.exports.raster_placement import azimuthal_equidistant_wkt
from crowdfence.georeference import Georeference
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.landscape.triangle_mesh import TriangleMesh, merged
from crowdfence.simulation.scene import Scene

_STEPS = 3


@dataclass(frozen=True, slots=True)
class TerrainFiles:
    """Where the map of a scene was written."""

    octomap: Path
    """Voxels that the triangles touch, local ENU metres."""
    dem: Path
    """GeoTIFF: highest surface in metres above the ellipsoid."""
    mesh: Path
    """PLY: the triangles, local ENU metres."""

    def __iter__(self) -> Iterator[Path]:
        return iter((self.octomap, self.dem, self.mesh))


def terrain_files(folder: Path, stem: str, dem_stem: str | None = None) -> TerrainFiles:
    """`<stem>.bt`, `<dem_stem or stem>.tif` and `<stem>.ply` in `folder`."""
    return TerrainFiles(folder / f"{stem}.bt", folder / f"{dem_stem or stem}.tif", folder / f"{stem}.ply")


def write_terrain_files(scene: Scene, folder: Path, stem: str, dem_stem: str | None = None) -> TerrainFiles:
    """Write the files that `terrain_files` names.

    OSError when one cannot be written; ValueError when the voxels do not fit into an OctoMap.
    """
    landscape, scenario = scene.landscape, scene.scenario
    files = terrain_files(folder, stem, dem_stem)
    mesh = known_map(landscape)
    write_terrain_octomap(files.octomap, known_terrain(scene))
    write_dem(files.dem, landscape, scenario.georeference)
    write_ply(files.mesh, mesh)
    return files


def known_map(landscape: Landscape) -> TriangleMesh:
    """Ground and buildings."""
    return merged([landscape.ground, *landscape.solids])


def known_terrain(scene: Scene) -> Terrain:
    """The known map as voxels of the scenario's size."""
    mesh = known_map(scene.landscape)
    terrain = Terrain.from_triangles(mesh.vertices, mesh.triangles, scene.scenario.voxel_size_m)
    terrain.georeference = scene.scenario.georeference
    return terrain


def top_height_m(landscape: Landscape, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Height of the highest triangle, of ground or buildings, at the points x, y [N]."""
    top = np.asarray(landscape.height_m(x, y), np.float64).copy()
    for mesh in landscape.solids:
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        near = np.flatnonzero((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]))
        for corners in mesh.vertices[mesh.triangles] if len(near) else ():
            height = _height_on_triangle(corners, x[near], y[near])
            top[near] = np.fmax(top[near], height)
    return top


def _height_on_triangle(
    corners: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Height of a triangle [3, 3] at points, NaN outside of it (and everywhere for an upright one)."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
    doubled_area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if doubled_area == 0.0:
        return np.full(x.shape, np.nan)
    to_b = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / doubled_area
    to_c = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / doubled_area
    inside = (to_b >= 0.0) & (to_c >= 0.0) & (to_b + to_c <= 1.0)
    return np.where(inside, az + to_b * (bz - az) + to_c * (cz - az), np.nan)


def write_dem(path: Path, landscape: Landscape, anchor: Georeference) -> None:
    """Height model as GeoTIFF: highest surface at the middle of every cell, metres above the ellipsoid.

    The projection is azimuthal equidistant around the anchor; cells are as large as those of the ground's
    triangles. Every value is computed at the place where its cell's middle lies in the local frame.
    """
    import rasterio
    from affine import Affine

    west, south, east, north = landscape.extent_m
    cell_m = landscape.surface.lattice.step_m
    wkt = azimuthal_equidistant_wkt(anchor)
    # Ground above the ellipsoid is wider than its projection: one cell less on every side is surely inside.
    columns = int((east - west) / cell_m) - 2
    rows = int((north - south) / cell_m) - 2
    map_x, map_y = np.meshgrid(
        west + (np.arange(columns) + 1.5) * cell_m, north - (np.arange(rows) + 1.5) * cell_m
    )
    heights = _ellipsoidal_heights(landscape, anchor, wkt, map_x.ravel(), map_y.ravel())
    with (
        atomic_path(path) as temporary,
        rasterio.open(
            temporary,
            "w",
            driver="GTiff",
            width=columns,
            height=rows,
            count=1,
            dtype="float32",
            nodata=float("nan"),
            crs=wkt,
            transform=Affine(cell_m, 0.0, west + cell_m, 0.0, -cell_m, north - cell_m),
            tiled=True,
            blockxsize=256,
            blockysize=256,
            compress="deflate",
            predictor=3,
        ) as raster,
    ):
        raster.write(heights.reshape(rows, columns).astype(np.float32), 1)
        raster.set_band_description(1, "highest surface of ground and buildings, m above the WGS84 ellipsoid")


def _ellipsoidal_heights(
    landscape: Landscape,
    anchor: Georeference,
    wkt: str,
    map_x: NDArray[np.float64],
    map_y: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Heights [N] where the surface lies at the map coordinates [N]."""
    x, y = map_x.copy(), map_y.copy()
    for _ in range(_STEPS):
        # The two frames differ by parts in ten thousand: the error shrinks by as much in every step.
        placed = anchor.projected_from_local(wkt, np.column_stack([x, y, landscape.height_m(x, y)]))
        x, y = x + map_x - placed[:, 0], y + map_y - placed[:, 1]
    local = np.column_stack([x, y, top_height_m(landscape, x, y)])
    return anchor.projected_from_local(wkt, local)[:, 2]


def write_ply(path: Path, mesh: TriangleMesh) -> None:
    """Binary PLY with the vertices as doubles."""
    header = "\n".join(
        [
            "ply",
            "format binary_little_endian 1.0",
            "comment local east-north-up metres",
            f"element vertex {len(mesh.vertices)}",
            *(f"property double {axis}" for axis in "xyz"),
            f"element face {len(mesh.triangles)}",
            "property list uchar int vertex_indices",
            "end_header\n",
        ]
    )
    faces = np.zeros(len(mesh.triangles), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"], faces["corners"] = 3, mesh.triangles
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(header.encode("ascii"))
        file.write(np.ascontiguousarray(mesh.vertices, "<f8").tobytes())
        file.write(faces.tobytes())
