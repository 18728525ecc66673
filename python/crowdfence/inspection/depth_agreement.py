"""Do the recorded poses fit the terrain? Recorded depth against the depth of the terrain along the same rays.

A pose that lags its image, a camera with the wrong field of view or a shifted map show here before they show
as a wrong zone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.detector.ground_sampling import rays_or_nan
from crowdfence.errors import FrameError
from crowdfence.sources.recording import Frame

_COLUMNS, _ROWS = 32, 24


@dataclass(frozen=True, slots=True)
class DepthAgreement:
    """Recorded minus terrain depth, along the camera's z axis, over a coarse grid of pixels."""

    frames: int
    rays: int
    """Rays with both depths."""
    median_m: float
    """Negative: the recorded surface is nearer, as grass and people above the terrain make it."""
    median_absolute_m: float


def depth_agreement(frames: Sequence[Frame], terrain: Terrain, max_range_m: float) -> DepthAgreement | None:
    """Over the frames that hold readable depth; None when there is nothing to compare."""
    differences = []
    for frame in frames:
        if frame.pixels.depth_m is None:
            continue
        try:
            differences.append(_differences_m(frame, terrain, max_range_m))
        except (FrameError, ValueError):
            continue  # damaged depth; counted as no frame
    if not differences:
        return None
    all_m = np.concatenate(differences)
    if all_m.size == 0:
        return None
    return DepthAgreement(
        frames=len(differences),
        rays=int(all_m.size),
        median_m=float(np.median(all_m)),
        median_absolute_m=float(np.median(np.abs(all_m))),
    )


def _differences_m(frame: Frame, terrain: Terrain, max_range_m: float) -> NDArray[np.float64]:
    recorded_m = frame.depth_m()
    rows = np.linspace(0, frame.camera.height - 1, min(_ROWS, frame.camera.height)).astype(int)
    columns = np.linspace(0, frame.camera.width - 1, min(_COLUMNS, frame.camera.width)).astype(int)
    row, column = (grid.ravel() for grid in np.meshgrid(rows, columns, indexing="ij"))
    rays = rays_or_nan(frame.camera, np.stack([column + 0.5, row + 0.5], axis=-1))
    seeing = np.isfinite(rays).all(axis=1)  # not beyond where the model of the lens ends
    rays, row, column = rays[seeing], row[seeing], column[seeing]
    pose = frame.world_from_camera
    origins = np.tile(pose[:3, 3], (len(rays), 1))
    _, distances_m = terrain.raycast(origins, rays @ pose[:3, :3].T, max_range_m)
    difference = recorded_m[row, column] - distances_m * rays[:, 2]
    return np.asarray(difference[np.isfinite(difference)], dtype=np.float64)
