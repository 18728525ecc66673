"""How a drone was flown: height, speed, and where its camera pointed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.pipeline.under_ground import under_ground
from crowdfence.sources.recording import Frame


@dataclass(frozen=True, slots=True)
class Range:
    """Lowest and highest value."""

    low: float
    high: float

    @staticmethod
    def of(values: NDArray[np.float64]) -> Range | None:
        """None when there is no value."""
        return Range(float(values.min()), float(values.max())) if values.size else None


@dataclass(frozen=True, slots=True)
class FlightReport:
    """Poses of one drone's camera at its frames."""

    tilt_below_horizon_deg: Range | None
    """Optical axis: 0 looks at the horizon, 90 straight down; negative looks up."""
    speed_m_per_s: Range | None
    """Mean speed between consecutive frames, climbing included."""
    height_above_terrain_m: Range | None
    """From the camera straight down to the terrain, over the frames that have some below; None without
    terrain as well."""
    frames_beside_terrain: int | None
    """Frames with no terrain straight below the camera, nor above it: beside the map or over a hole of it.
    None without terrain."""
    frames_under_terrain: int | None
    """Frames whose camera lies under the map. None without terrain."""

    @staticmethod
    def of(frames: Sequence[Frame], terrain: Terrain | None) -> FlightReport:
        """`frames` of one drone by stamp."""
        poses = np.array([frame.world_from_camera for frame in frames]).reshape(-1, 4, 4)
        positions, axes = poses[:, :3, 3], poses[:, :3, 2]
        tilt_deg = np.degrees(np.arcsin(np.clip(-axes[:, 2], -1.0, 1.0)))
        stamps_ns = np.array([frame.stamp_ns for frame in frames], dtype=np.int64)
        seconds = np.diff(stamps_ns).astype(np.float64) / 1e9
        speeds = np.linalg.norm(np.diff(positions, axis=0), axis=1) / seconds
        heights_m = None if terrain is None else heights_above(terrain, positions)
        under = None if terrain is None else int(np.count_nonzero(under_ground(terrain, positions)))
        return FlightReport(
            tilt_below_horizon_deg=Range.of(tilt_deg),
            speed_m_per_s=Range.of(speeds),
            height_above_terrain_m=None if heights_m is None else Range.of(heights_m[np.isfinite(heights_m)]),
            frames_beside_terrain=None
            if heights_m is None or under is None
            else int(np.count_nonzero(np.isinf(heights_m))) - under,
            frames_under_terrain=under,
        )


def heights_above(terrain: Terrain, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance [N] straight down from positions [N, 3] to the terrain, inf where there is none."""
    if len(positions) == 0:
        return np.empty(0)
    depth_m = float(positions[:, 2].max() - terrain.bounds[0, 2])
    down = np.tile([0.0, 0.0, -1.0], (len(positions), 1))
    _, distances_m = terrain.raycast(positions, down, max(depth_m, 0.0) + terrain.voxel_size_m)
    return distances_m
