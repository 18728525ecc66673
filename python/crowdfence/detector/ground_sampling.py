"""How finely a frame samples the ground: metres per image pixel, distance and tilt over a grid of rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence._core import Camera, Terrain

ROWS, COLUMNS = 12, 16
FLATTEST_DEG = 5.0
"""Flatter rays end on slopes that face the camera, where a pixel is not stretched without limit."""


@dataclass(frozen=True, slots=True, eq=False)
class GroundSampling:
    """Arrays [rows, columns]; the cells divide the image evenly and hold the value at their centre, NaN where
    no ground is seen: sky, beyond the range, beside the map, or no ray because of the lens."""

    gsd_m: NDArray[np.float64]
    """Metres per image pixel, across the ray: distance / focal length in pixels."""
    distance_m: NDArray[np.float64]
    """From the camera to the ground along the ray."""
    tilt_deg: NDArray[np.float64]
    """Angle of the ray below the horizon, 90 = straight down."""

    @property
    def sees_ground(self) -> bool:
        return bool(np.isfinite(self.gsd_m).any())

    def along_ground(self) -> NDArray[np.float64]:
        """Metres per pixel to the right and downwards in the image [rows, columns, 2] on level ground, for a
        camera without roll: a ray that comes in flat stretches a pixel along the ground."""
        stretch = np.sin(np.radians(np.maximum(self.tilt_deg, FLATTEST_DEG)))
        return np.stack([self.gsd_m, self.gsd_m / stretch], axis=-1)


def ground_sampling(
    camera: Camera,
    world_from_camera: ArrayLike,
    terrain: Terrain,
    *,
    max_range_m: float,
    rows: int = ROWS,
    columns: int = COLUMNS,
) -> GroundSampling:
    """Cast rows x columns rays onto the terrain. `world_from_camera` [4, 4]: camera axes -> local metres."""
    pose = np.asarray(world_from_camera, dtype=np.float64)
    x = (np.arange(columns) + 0.5) * camera.width / columns
    y = (np.arange(rows) + 0.5) * camera.height / rows
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    rays = rays_or_nan(camera, pixels) @ pose[:3, :3].T
    usable = np.isfinite(rays).all(axis=1)
    distance_m = np.full(len(rays), np.nan)
    origins = np.tile(pose[:3, 3], (int(usable.sum()), 1))
    _, hits_m = terrain.raycast(origins, rays[usable], max_range_m)
    distance_m[usable] = np.where(np.isfinite(hits_m) & (hits_m > 0.0), hits_m, np.nan)
    tilt_deg = np.where(np.isnan(distance_m), np.nan, np.degrees(np.arcsin(np.clip(-rays[:, 2], -1.0, 1.0))))
    focal_px = float(np.sqrt(camera.fx * camera.fy))
    grid = (rows, columns)
    return GroundSampling(
        (distance_m / focal_px).reshape(grid), distance_m.reshape(grid), tilt_deg.reshape(grid)
    )


def rays_or_nan(camera: Camera, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit rays [N, 3] in camera axes of pixels [N, 2], NaN where the distortion cannot be inverted."""
    try:
        return camera.unproject(pixels)
    except ValueError:
        pass  # one that has no ray refuses all
    rays = np.full((len(pixels), 3), np.nan)
    for number, pixel in enumerate(pixels):
        try:
            rays[number] = camera.unproject(pixel[None])[0]
        except ValueError:
            continue
    return rays
