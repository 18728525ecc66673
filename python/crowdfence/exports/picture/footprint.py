"""Where a camera's picture meets the ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import ViewError

if TYPE_CHECKING:
    from crowdfence._core import Camera, Terrain, View

_COLUMNS, _ROWS = 64, 96
_SMOOTHED_COLUMNS = 9


def ground_footprint(view: View, terrain: Terrain, max_range_m: float) -> NDArray[np.float64]:
    """Outline [M, 2] (local x, y) of the ground inside the picture, for drawing; M = 0 when it shows none.

    In a grid of image columns the lowest and the highest pixel whose ray meets the terrain within
    `max_range_m` are joined up. Hills that hide ground behind them are inside the outline: what was really
    seen is the map's business, not this line's.
    """
    camera, pose = view.camera, view.world_from_camera
    u = np.linspace(0.5, camera.width - 0.5, _COLUMNS)
    v = np.linspace(camera.height - 0.5, 0.5, _ROWS)  # from the bottom of the picture upwards
    pixels = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    rays = _rays(camera, pixels)
    has_ray = np.asarray(np.isfinite(rays).all(axis=1))
    directions = np.where(has_ray[:, None], rays, 0.0) @ pose[:3, :3].T
    distances_m = np.full(len(pixels), np.inf)
    origins = np.tile(pose[:3, 3], (int(has_ray.sum()), 1))
    _, distances_m[has_ray] = terrain.raycast(origins, directions[has_ray], max_range_m)
    hit = np.isfinite(distances_m)
    offsets = directions[:, :2] * np.where(hit, distances_m, 0.0)[:, None]
    outline = outline_of_hits(offsets.reshape(_COLUMNS, _ROWS, 2), hit.reshape(_COLUMNS, _ROWS))
    return np.asarray(pose[:2, 3] + outline)


def _rays(camera: Camera, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit rays [N, 3] in camera axes, NaN at pixels where the distortion cannot be inverted. Those lie
    together, in the corners, so that few halves have to be asked again."""
    try:
        return camera.unproject(pixels)
    except ViewError:
        if len(pixels) == 1:
            return np.full((1, 3), np.nan)
        middle = len(pixels) // 2
        return np.concatenate([_rays(camera, pixels[:middle]), _rays(camera, pixels[middle:])])


def outline_of_hits(offsets: NDArray[np.float64], hit: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Walk [M, 2] along the near ends of the image columns and back along their far ends.

    offsets [C, R, 2] lead from below the camera to the ground, from the bottom of the picture to its top
    along the second axis; they count where hit [C, R]. A far end that jumps from ridge to ridge between
    neighbouring columns is evened out by a running median.
    """
    from scipy import ndimage

    columns = np.flatnonzero(hit.any(axis=1))
    if columns.size == 0:
        return np.empty((0, 2))
    near = offsets[columns, hit.argmax(axis=1)[columns]]
    far = offsets[columns, hit.shape[1] - 1 - hit[:, ::-1].argmax(axis=1)[columns]]
    distance_m = np.linalg.norm(far, axis=1)
    steady_m = ndimage.median_filter(distance_m, size=_SMOOTHED_COLUMNS, mode="nearest")
    far = far * (steady_m / np.maximum(distance_m, 1e-9))[:, None]
    return np.concatenate([near, far[::-1]])
