"""Small pieces of ground with walls, pits, holes and roofs, cameras at random places over them, and lines of
sight over their heights written plainly: nothing is shared with the core."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence import Camera, Terrain

Array = NDArray[np.float64]

ROUGHNESS = (0.0, 0.02, 0.05, 0.15)
"""Standard deviation of the steps between columns, in voxels."""
ABOVE_GROUND_M = (1.6, 3.0, 8.0, 20.0, 40.0)
TILTS_DEG = (3.0, 10.0, 25.0, 45.0, 70.0, 89.0)
SIZES = ((64, 48), (96, 72), (160, 90))


THICK = 3
"""Voxels of a roof from its underside up: the surface lies anywhere in the lowest and uppermost."""


class Roof(NamedTuple):
    """Over a rectangle of columns, with air below."""

    columns: tuple[slice, slice]
    floor: int
    """Its lowest voxel above 0."""


@dataclass(frozen=True, slots=True)
class RandomGround:
    """Heights [N, N] above 0, NaN = hole, of columns of one voxel side each."""

    heights_m: Array
    voxel_size_m: float
    roofs: tuple[Roof, ...] = ()

    @staticmethod
    def of(rng: np.random.Generator) -> "RandomGround":
        side, size_m = int(rng.integers(20, 36)), float(rng.choice([0.5, 1.0, 2.0]))
        steps = rng.normal(0.0, rng.choice(ROUGHNESS) * size_m, (2, side, side))
        heights_m = 0.5 * (np.cumsum(steps[0], 0) + np.cumsum(steps[1], 1))
        for _ in range(rng.integers(0, 6)):
            heights_m[_rectangle(rng, side)] += rng.uniform(-4.0, 8.0) * size_m
        if rng.random() < 0.4:
            heights_m[_rectangle(rng, side)] = np.nan
        return RandomGround(heights_m, size_m)

    def with_roofs(self, rng: np.random.Generator) -> "RandomGround":
        """The same with up to four of them, each clear of the ground below by two to six voxels."""
        roofs = []
        for _ in range(rng.integers(1, 5)):
            columns = _rectangle(rng, len(self.heights_m), least=3, most=9)
            below = self.heights_m[columns]
            if not np.isnan(below).all():
                highest = int(np.nanmax(below) // self.voxel_size_m)
                roofs.append(Roof(columns, highest + int(rng.integers(3, 8))))
        return replace(self, roofs=tuple(roofs))

    def terrain(self) -> Terrain:
        terrain = Terrain.from_height_map(self.heights_m, self.voxel_size_m)
        for (i, j), floor in self.roofs:
            voxels = np.mgrid[i, j, floor : floor + THICK].reshape(3, -1).T
            terrain = terrain.joined(Terrain.from_indices(voxels, self.voxel_size_m, terrain.origin))
        return terrain

    def height_m(self, x: Array, y: Array) -> Array:
        """Of the columns at places of any shape; -inf over holes and beside the ground."""
        return self._of_columns(np.where(np.isnan(self.heights_m), -np.inf, self.heights_m), x, y)

    def lowest_around_m(self, x: Array, y: Array) -> Array:
        """The least of a column and its eight neighbours."""
        heights_m = np.where(np.isnan(self.heights_m), -np.inf, self.heights_m)
        around = np.lib.stride_tricks.sliding_window_view(
            np.pad(heights_m, 1, constant_values=-np.inf), (3, 3)
        )
        return self._of_columns(around.min(axis=(2, 3)), x, y)

    def _of_columns(self, values: Array, x: Array, y: Array) -> Array:
        i, j = (np.floor(along / self.voxel_size_m).astype(np.int64) for along in (x, y))
        side = len(values)
        inside = (i >= 0) & (i < side) & (j >= 0) & (j < side)
        return np.where(inside, values[np.clip(i, 0, side - 1), np.clip(j, 0, side - 1)], -np.inf)

    def surely_hides(self, x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        """Whether places lie in the ground or in a roof, by a margin: the ground counts at the lowest height
        of a column and its neighbours, a third of a voxel deeper, of a roof the middle layer but its border.
        """
        size_m = self.voxel_size_m
        hidden = z < self.lowest_around_m(x, y) - 0.35 * size_m
        i, j, k = (np.floor(along / size_m).astype(np.int64) for along in (x, y, z))
        for (across, along), floor in self.roofs:
            inside = (across.start < i) & (i < across.stop - 1) & (along.start < j) & (j < along.stop - 1)
            hidden |= inside & (k == floor + THICK // 2)
        return hidden

    def first_column(self, eye: Array, direction: Array, max_range_m: float) -> tuple[int, int] | None:
        """Where a unit ray first gets below the heights, marched in steps of a twentieth of a voxel."""
        along_m = np.arange(0.0, max_range_m, self.voxel_size_m / 20)
        x, y, z = (eye + along_m[:, None] * direction).T
        below = np.flatnonzero(z <= self.height_m(x, y))
        if len(below) == 0:
            return None
        return tuple(int(v // self.voxel_size_m) for v in (x[below[0]], y[below[0]]))

    def pose(self, rng: np.random.Generator) -> Array:
        """`world_from_camera` of a camera above some column, looking anywhere below the horizon."""
        x, y = rng.uniform(0.05, 0.95, 2) * len(self.heights_m) * self.voxel_size_m
        ground_m = max(float(self.height_m(x, y)), -100.0)
        above_m = max(1.2, rng.choice(ABOVE_GROUND_M) * rng.uniform(0.8, 1.2))
        yaw, tilt = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.choice(TILTS_DEG) + rng.uniform(-1.0, 1.0))
        forward = np.array([np.cos(yaw) * np.cos(tilt), np.sin(yaw) * np.cos(tilt), -np.sin(tilt)])
        right = np.cross(forward, [0.0, 0.0, 1.0]) / np.cos(tilt)
        roll = rng.normal(0.0, 0.1)
        turned = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward]) @ turned
        pose[:3, 3] = (x, y, ground_m + above_m)
        return pose


def _rectangle(rng: np.random.Generator, side: int, least: int = 1, most: int = 5) -> tuple[slice, slice]:
    (i, j), (across, along) = rng.integers(0, side - 4, 2), rng.integers(least, most + 1, 2)
    return slice(int(i), int(min(i + across, side))), slice(int(j), int(min(j + along, side)))


def camera(rng: np.random.Generator) -> Camera:
    width, height = SIZES[rng.integers(len(SIZES))]
    focal = rng.uniform(0.5, 1.2) * width
    return Camera.pinhole(width, height, focal, focal, width / 2, height / 2)


def pixels_of(camera: Camera, pose: Array, points: Array) -> Array:
    """Pixels [K, 2] of points [K, 3]; far outside of any picture for those behind the camera."""
    x, y, z = ((points - pose[:3, 3]) @ pose[:3, :3]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = np.column_stack([x / z * camera.fx + camera.cx, y / z * camera.fy + camera.cy])
    return np.where((z > 1e-6)[:, None], pixels, -1e9)


def ray_of(camera: Camera, pose: Array, pixel: tuple[float, float]) -> Array:
    """Unit direction in the world."""
    direction = [(pixel[0] - camera.cx) / camera.fx, (pixel[1] - camera.cy) / camera.fy, 1.0]
    return pose[:3, :3] @ direction / np.linalg.norm(direction)
