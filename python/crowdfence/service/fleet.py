"""Where the drones are: the cameras of every drone over time."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera, Terrain, View
from crowdfence.exports.picture.footprint import ground_footprint
from crowdfence.service.ground import GroundRaster
from crowdfence.service.stamps import moment_json

TRAIL = 240
"""Points of a trail at most."""
_REMEMBERED = 20_000
_SECOND_NS = 1_000_000_000

DroneStatus = Literal["ok", "stale", "never"]


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A camera at a stamp."""

    stamp_ns: int
    camera: Camera
    world_from_camera: NDArray[np.float64]
    picture: bool
    heatmap: bool


class Fleet:
    """Sightings of every drone, the newest 20 000 each; safe to read while others write."""

    def __init__(
        self,
        drones: Sequence[str],
        terrain: Terrain,
        raster: GroundRaster,
        *,
        max_range_m: float,
        stale_after_s: float,
    ) -> None:
        self._terrain, self._raster = terrain, raster
        self._max_range_m, self._stale_after_s = max_range_m, stale_after_s
        self._sightings: dict[str, deque[Sighting]] = {drone: deque(maxlen=_REMEMBERED) for drone in drones}
        self._footprints: dict[str, tuple[int, list[list[float]]]] = {}
        self._lock = Lock()

    @property
    def drones(self) -> tuple[str, ...]:
        with self._lock:
            return tuple(self._sightings)

    def saw(self, drone: str, sighting: Sighting) -> None:
        """A drone's camera was there. One that is older than the newest is left out of the trail."""
        with self._lock:
            track = self._sightings.setdefault(drone, deque(maxlen=_REMEMBERED))
            if not track or sighting.stamp_ns > track[-1].stamp_ns:
                track.append(sighting)

    def last(self, drone: str) -> Sighting | None:
        with self._lock:
            track = self._sightings.get(drone)
            return track[-1] if track else None

    def to_json(self, now_ns: int, at_ns: int | None = None, *, trails: bool = True) -> list[dict[str, Any]]:
        """Every drone as of `at_ns`, or now."""
        return [self._drone_json(drone, now_ns, at_ns, trails) for drone in sorted(self.drones)]

    def _drone_json(self, drone: str, now_ns: int, at_ns: int | None, trails: bool) -> dict[str, Any]:
        with self._lock:
            track = list(self._sightings[drone])
        if at_ns is not None:
            track = track[: bisect_right(track, at_ns, key=lambda sighting: sighting.stamp_ns)]
        if not track:
            return {**_NEVER, "drone": drone}
        last = track[-1]
        age_s = max(0.0, ((now_ns if at_ns is None else at_ns) - last.stamp_ns) / _SECOND_NS)
        told = {
            "drone": drone,
            **moment_json("stamp", last.stamp_ns),
            "age_s": age_s,
            "position": last.world_from_camera[:3, 3].tolist(),
            "world_from_camera": last.world_from_camera.tolist(),
            "camera": {"width": last.camera.width, "height": last.camera.height, "fx": last.camera.fx},
            "footprint": self._footprint(drone, last),
            "range_m": self._max_range_m,
            "status": "ok" if age_s <= self._stale_after_s else "stale",
            "picture": last.picture,
            "heatmap": last.heatmap,
        }
        if trails:
            stride = max(1, -(-len(track) // TRAIL))
            told["trail"] = [one.world_from_camera[:3, 3].tolist() for one in track[::-1][::stride]][::-1]
        return told

    def _footprint(self, drone: str, sighting: Sighting) -> list[list[float]]:
        """Closed ring on the terrain; kept for the newest that was asked for."""
        known = self._footprints.get(drone)
        if known is not None and known[0] == sighting.stamp_ns:
            return known[1]
        blank = np.zeros((1, 1), dtype=np.uint8)
        view = View(drone, sighting.stamp_ns, sighting.camera, sighting.world_from_camera, blank)
        outline = ground_footprint(view, self._terrain, self._max_range_m)
        ring: list[list[float]] = []
        if len(outline):
            outline = np.concatenate([outline, outline[:1]])
            heights = self._raster.height_at(outline)
            lowest = float(np.nanmin(heights)) if np.isfinite(heights).any() else 0.0
            ring = np.column_stack([outline, np.nan_to_num(heights, nan=lowest)]).tolist()
        self._footprints[drone] = (sighting.stamp_ns, ring)
        return ring


_NEVER: dict[str, Any] = {
    **moment_json("stamp", None),
    "age_s": None,
    "position": None,
    "world_from_camera": None,
    "camera": None,
    "footprint": [],
    "trail": [],
    "range_m": None,
    "status": "never",
    "picture": False,
    "heatmap": False,
}
