"""The map that a recording is projected onto, and whether the two belong together."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.sources.recording import Recording


def open_terrain(recording: Recording, path: str | PathLike[str] | None = None, **options: Any) -> Terrain:
    """The map to project onto: `path`, or else the one that came with the recording.

    Georeferenced maps are brought into the recording's local frame; `options` are those of
    `maps.open_terrain`. ValueError when there is no map or an option does not belong to its kind.
    """
    chosen = path or recording.terrain
    if chosen is None:
        raise ValueError(f"{recording.name} comes without a map; give one with --terrain")
    try:
        return Terrain.open(chosen, georeference=recording.georeference, **options)
    except TypeError as error:
        raise ValueError(f"{chosen}: {error}") from error


def check_overlap(recording: Recording, terrain: Terrain, max_range_m: float) -> None:
    """ValueError when no camera of the recording comes within range of the terrain's bounding box."""
    if not recording.frames:
        return
    cameras = np.array([frame.world_from_camera[:3, 3] for frame in recording.frames])
    low, high = terrain.bounds
    distance_m = np.linalg.norm(cameras - np.clip(cameras, low, high), axis=1)
    if distance_m.min() > max_range_m:
        raise ValueError(
            f"terrain and poses do not overlap: the nearest camera is {distance_m.min():.0f} m away from the "
            f"terrain, max_range_m is {max_range_m:g}. The terrain spans {_box(low, high)}, the cameras "
            f"{_box(cameras.min(axis=0), cameras.max(axis=0))} (local metres)"
        )


def _box(low: NDArray[np.float64], high: NDArray[np.float64]) -> str:
    spans = (f"{axis} {a:.0f} to {b:.0f}" for axis, a, b in zip("xyz", low, high, strict=True))
    return ", ".join(spans)
