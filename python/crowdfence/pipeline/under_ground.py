"""Cameras below the map: heights of poses and map that do not count from the same level."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.sources.recording import Frame

ADVICE = "heights of poses and map must count from the same level (for maps: height_offset_m)"


def under_ground(terrain: Terrain, positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which positions [N, 3] lie below the map: it is straight above them and nowhere straight below."""
    if len(positions) == 0:
        return np.zeros(0, dtype=np.bool_)
    low_m, high_m = terrain.bounds[:, 2]
    reach_m = float(np.abs(positions[:, 2, None] - [low_m, high_m]).max()) + terrain.voxel_size_m
    met = [
        np.isfinite(terrain.raycast(positions, np.tile([0.0, 0.0, up], (len(positions), 1)), reach_m)[1])
        for up in (-1.0, 1.0)
    ]
    return ~met[0] & met[1]


def under_ground_line(terrain: Terrain, frames: Sequence[Frame]) -> str | None:
    """One line where cameras are under the ground; None where none is."""
    positions = np.array([frame.world_from_camera[:3, 3] for frame in frames]).reshape(-1, 3)
    count = int(np.count_nonzero(under_ground(terrain, positions)))
    if count == 0:
        return None
    return f"the camera is below the map's ground in {count} of {len(frames)} frames: {ADVICE}"
