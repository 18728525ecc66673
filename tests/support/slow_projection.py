"""Back-projection written plainly over a dense array, to test the sparse and parallel one against.

Shares nothing with the core: own lens formulas, own march (all plane crossings of a ray, sorted), own means.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence import Camera, Terrain, View

Array = NDArray[np.float64]
Cells = NDArray[np.int64]

NO_HIT = -1


@dataclass(frozen=True, slots=True)
class DenseTerrain:
    """Occupied cells [X, Y, Z]; cells are named by their row-major number."""

    occupied: NDArray[np.bool_]
    voxel_size_m: float
    origin: tuple[float, float, float]

    def terrain(self) -> Terrain:
        return Terrain.from_occupancy(self.occupied, self.voxel_size_m, self.origin)

    def cells(self, terrain: Terrain) -> Cells:
        """Cell of every voxel id [V]."""
        indices = terrain.voxel_indices(np.arange(terrain.voxel_count))
        return np.ravel_multi_index(tuple(indices.T), self.occupied.shape)

    def centres(self, cells: Cells) -> Array:
        indices = np.stack(np.unravel_index(cells, self.occupied.shape), axis=1)
        return np.asarray(self.origin) + (indices + 0.5) * self.voxel_size_m

    def is_occupied(self, indices: Cells) -> NDArray[np.bool_]:
        """Indices [..., 3] anywhere; free outside the array."""
        shape = np.array(self.occupied.shape)
        inside = ((indices >= 0) & (indices < shape)).all(axis=-1)
        x, y, z = np.moveaxis(np.clip(indices, 0, shape - 1), -1, 0)
        return inside & self.occupied[x, y, z]

    def first_hits(self, origin: Array, directions: Array, max_range_m: float) -> tuple[Cells, Array]:
        """First occupied cell [R] (NO_HIT = none) along each ray [R, 3] and the distance to its entry [R]."""
        start = (origin - np.asarray(self.origin)) / self.voxel_size_m
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        crossings = [np.zeros((len(unit), 1))]
        for axis, cells in enumerate(self.occupied.shape):
            to_plane = np.arange(cells + 1) - start[axis]
            with np.errstate(divide="ignore", invalid="ignore"):
                distance = to_plane / unit[:, axis : axis + 1]
            crossings.append(np.where((distance > 0.0) & np.isfinite(distance), distance, 0.0))
        # Between two crossings that follow each other the ray is in one cell: ask at half way.
        entry = np.sort(np.concatenate(crossings, axis=1), axis=1)
        middle = (entry[:, :-1] + entry[:, 1:]) / 2
        cell = np.floor(start + middle[..., None] * unit[:, None]).astype(np.int64)
        passes = entry[:, 1:] - entry[:, :-1] > 1e-12
        in_range = entry[:, :-1] * self.voxel_size_m <= max_range_m
        hits = self.is_occupied(cell) & passes & in_range
        first = hits.argmax(axis=1)
        rows = np.arange(len(unit))
        number = np.ravel_multi_index(
            tuple(np.moveaxis(cell[rows, first], -1, 0)), self.occupied.shape, "clip"
        )
        return (
            np.where(hits.any(axis=1), number, NO_HIT),
            np.where(hits.any(axis=1), entry[rows, first] * self.voxel_size_m, np.inf),
        )


def pixel_centre_rays(camera: Camera) -> Array:
    """Rays [height * width, 3] in camera axes, row after row."""
    v, u = np.mgrid[: camera.height, : camera.width] + 0.5
    x, y = (u.ravel() - camera.cx) / camera.fx, (v.ravel() - camera.cy) / camera.fy
    if camera.model == "kannala_brandt":
        return _fisheye_rays(x, y, camera.distortion)
    undistorted_x, undistorted_y = x, y
    for _ in range(100):  # fixed point: slow, but there is not much to get wrong
        distorted_x, distorted_y = _brown_conrady(undistorted_x, undistorted_y, camera.distortion)
        undistorted_x = undistorted_x + x - distorted_x
        undistorted_y = undistorted_y + y - distorted_y
    return np.stack([undistorted_x, undistorted_y, np.ones_like(x)], axis=1)


def image_points(camera: Camera, points_camera: Array) -> Array:
    """Pixel coordinates [N, 2] of points in camera axes; NaN behind a camera that is no fisheye."""
    if camera.model == "kannala_brandt":
        off_axis = np.hypot(points_camera[:, 0], points_camera[:, 1])
        angle = np.arctan2(off_axis, points_camera[:, 2])
        k1, k2, k3, k4 = camera.distortion
        distorted = angle * (1 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8)
        x, y = (points_camera[:, :2] * (distorted / off_axis)[:, None]).T
        return np.stack([x * camera.fx + camera.cx, y * camera.fy + camera.cy], axis=1)
    z = np.where(points_camera[:, 2] > 0.0, points_camera[:, 2], np.nan)
    x, y = _brown_conrady(points_camera[:, 0] / z, points_camera[:, 1] / z, camera.distortion)
    return np.stack([x * camera.fx + camera.cx, y * camera.fy + camera.cy], axis=1)


def _brown_conrady(x: Array, y: Array, distortion: list[float]) -> tuple[Array, Array]:
    k1, k2, p1, p2, k3 = distortion or (0.0,) * 5
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


def _fisheye_rays(x: Array, y: Array, distortion: list[float]) -> Array:
    distorted = np.hypot(x, y)
    angle = distorted
    for _ in range(100):
        k1, k2, k3, k4 = distortion
        angle = distorted / (1 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8)
    return np.stack([np.sin(angle) * x / distorted, np.sin(angle) * y / distorted, np.cos(angle)], axis=1)


def heatmap_at(view: View, values: Array, columns: Cells, rows: Cells) -> Array:
    """Values that pixels read: those of the heatmap's cell under the pixel's centre."""
    stride_x, stride_y = view.camera.width / values.shape[1], view.camera.height / values.shape[0]
    row, column = np.floor((rows + 0.5) / stride_y), np.floor((columns + 0.5) / stride_x)
    return values[row.astype(int), column.astype(int)]


def lowered_camera(dense: DenseTerrain, view: View, target_height_m: float) -> Array | None:
    """Where rays start; None when terrain is in the way of lowering the camera."""
    position = view.world_from_camera[:3, 3]
    blocked, _ = dense.first_hits(position, np.array([[0.0, 0.0, -1.0]]), target_height_m)
    return None if blocked[0] != NO_HIT else position - (0.0, 0.0, target_height_m)


def project_rays(
    dense: DenseTerrain, view: View, values: Array, max_range_m: float, target_height_m: float = 0.0
) -> dict[int, tuple[float, int]]:
    """Cell -> mean heatmap value and pixel count of the cells that pixel centres hit."""
    position = lowered_camera(dense, view, target_height_m)
    if position is None:
        return {}
    directions = pixel_centre_rays(view.camera) @ view.world_from_camera[:3, :3].T
    hit, _ = dense.first_hits(position, directions, max_range_m)
    rows, columns = np.divmod(np.arange(len(hit)), view.camera.width)
    read = heatmap_at(view, values, columns, rows)
    return {
        int(cell): (float(read[hit == cell].mean()), int((hit == cell).sum()))
        for cell in np.unique(hit[hit != NO_HIT])
    }


def project_tops(
    dense: DenseTerrain, view: View, values: Array, max_range_m: float
) -> tuple[dict[int, float], set[int]]:
    """Cells with the middle of their top in view -> heatmap value there; and cells whose top is hidden.

    A top has no occupied cell above it, and its middle is in the image and in range; it is in view when it is
    turned to the camera and the line of sight to its middle is free.
    """
    position = view.world_from_camera[:3, 3]
    cells = np.flatnonzero(dense.occupied)
    indices = np.stack(np.unravel_index(cells, dense.occupied.shape), axis=1)
    to_top = dense.centres(cells) + np.array([0.0, 0.0, dense.voxel_size_m / 2]) - position
    bare = ~dense.is_occupied(indices + np.array([0, 0, 1]))
    near = np.linalg.norm(to_top, axis=1) <= max_range_m
    pixel = image_points(view.camera, to_top @ view.world_from_camera[:3, :3])
    inside = ((pixel >= 0.0) & (pixel < (view.camera.width, view.camera.height))).all(axis=1)
    (chosen,) = np.nonzero(bare & near & inside)
    if len(chosen) == 0:
        return {}, set()
    hit, _ = dense.first_hits(position, to_top[chosen], np.inf)
    free = chosen[(hit == cells[chosen]) & (to_top[chosen, 2] < 0.0)]
    column, row = np.floor(pixel[free]).astype(np.int64).T
    read = heatmap_at(view, values, column, row)
    seen = {int(cell): float(value) for cell, value in zip(cells[free], read, strict=True)}
    return seen, set(cells[chosen].tolist()) - set(seen)
