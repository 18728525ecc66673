"""Where the drones are: the cameras of every drone over time."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain, View
from crowdfence.exports.picture.footprint import ground_footprint
from crowdfence.service.ground import GroundRaster
from crowdfence.service.stamps import moment_json
from crowdfence.service.track import Sighting, Track

TRAIL = 240
"""Points of a trail at most."""
_REMEMBERED = 20_000
_TURNS = 500
"""Attitudes that say how a camera hangs."""
_SECOND_NS = 1_000_000_000
_AMONG = 12
"""Sightings that say whether a drone is in two places."""
_LEAPS = 4
"""Of them: one reset of a position is one leap, one wrong fix is two."""
_LEAP_M, _LEAP_MPS = 30.0, 100.0
"""No small drone goes so far so fast."""


class Fleet:
    """Sightings of every drone, the newest 10 000 each and as many again; safe to read while others write."""

    def __init__(
        self,
        drones: Sequence[str],
        terrain: Terrain,
        raster: GroundRaster,
        *,
        max_range_m: float,
        stale_after_s: float,
        max_ahead_s: float,
    ) -> None:
        """Seconds since a sighting beyond which a drone is stale, and by how much one may be ahead of the
        clock."""
        self._terrain, self._raster = terrain, raster
        self._max_range_m, self._stale_after_s = max_range_m, stale_after_s
        self._max_ahead_s = max_ahead_s
        self._tracks = {drone: Track(_REMEMBERED) for drone in drones}
        self._places: dict[str, tuple[int, NDArray[np.float64]]] = {}
        self._footprints: dict[str, tuple[int, list[list[float]]]] = {}
        self._lock = Lock()
        self.restarted_ns = 0
        """Up to then views may have come before a restart, after which where they were from is not known."""

    @property
    def drones(self) -> tuple[str, ...]:
        with self._lock:
            return tuple(self._tracks)

    def saw(self, drone: str, sighting: Sighting) -> None:
        """A drone's camera was there. One that is older than the newest is left out of the trail."""
        with self._lock:
            self._tracks.setdefault(drone, Track(_REMEMBERED)).add(sighting)

    def was_at(self, drone: str, stamp_ns: int, position: NDArray[np.float64]) -> None:
        """A drone was there, in local metres [3], whether what it saw could be used or not."""
        with self._lock:
            newest_ns, _ = self._places.get(drone, (-1, position))
            if stamp_ns > newest_ns:
                self._places[drone] = stamp_ns, np.array(position, np.float64)

    def places(self) -> dict[str, NDArray[np.float64]]:
        """Where every drone was last, in local metres [3]; of companions, which project themselves, nobody
        knows."""
        with self._lock:
            newest = dict(self._places)
            seen = {drone: track.at() for drone, track in self._tracks.items()}
        for drone, last in seen.items():
            if last is not None and (drone not in newest or newest[drone][0] < last.stamp_ns):
                newest[drone] = last.stamp_ns, last.world_from_camera[:3, 3]
        return {drone: position for drone, (_, position) in newest.items()}

    def last(self, drone: str) -> Sighting | None:
        with self._lock:
            track = self._tracks.get(drone)
            return None if track is None else track.at()

    def turns(self, drone: str) -> NDArray[np.float64]:
        """Rotations [N, 3, 3] from camera to world of a drone's sightings, evenly thinned."""
        with self._lock:
            track = self._tracks.get(drone)
            return np.empty((0, 3, 3)) if track is None else track.turns(_TURNS)

    def leaps_m(self, drone: str) -> float | None:
        """How far apart the places are between which a drone goes to and fro, faster than any drone flies; 0
        where it does not, None where too little was seen of it to say."""
        with self._lock:
            track = self._tracks.get(drone)
            stamps_ns, places = (
                (np.empty(0, np.int64), np.empty((0, 3))) if track is None else track.newest(_AMONG)
            )
        if len(stamps_ns) < _AMONG:
            return None
        way_m = np.linalg.norm(np.diff(places, axis=0), axis=1)
        is_leap = (way_m > _LEAP_M) & (way_m > _LEAP_MPS * np.diff(stamps_ns) / _SECOND_NS)
        return float(np.median(way_m[is_leap])) if np.count_nonzero(is_leap) >= _LEAPS else 0.0

    def to_json(self, now_ns: int, at_ns: int | None = None, *, trails: bool = True) -> list[dict[str, Any]]:
        """Every drone as of `at_ns`, or now."""
        return [self._drone_json(drone, now_ns, at_ns, trails) for drone in sorted(self.drones)]

    def _drone_json(self, drone: str, now_ns: int, at_ns: int | None, trails: bool) -> dict[str, Any]:
        with self._lock:
            track = self._tracks[drone]
            last, trail = track.at(at_ns), track.trail(at_ns, TRAIL) if trails else None
        if last is None:
            # Of then nobody knows any more whether it had given a view.
            is_lost = at_ns is not None and (track.has_forgotten or at_ns <= self.restarted_ns)
            return {**_NEVER, "drone": drone, "status": "unknown" if is_lost else "never"}
        age_s = ((now_ns if at_ns is None else at_ns) - last.stamp_ns) / _SECOND_NS
        is_known = age_s >= -self._max_ahead_s  # else the clock was another one then
        told = {
            "drone": drone,
            **moment_json("stamp", last.stamp_ns),
            "age_s": max(0.0, age_s) if is_known else None,
            "position": last.world_from_camera[:3, 3].tolist(),
            "world_from_camera": last.world_from_camera.tolist(),
            "camera": {"width": last.camera.width, "height": last.camera.height, "fx": last.camera.fx},
            "footprint": self._footprint(drone, last),
            "range_m": self._max_range_m,
            "status": "ok" if is_known and age_s <= self._stale_after_s else "stale",
            "picture": last.picture,
            "heatmap": last.heatmap,
        }
        if trail is not None:
            told["trail"] = trail.tolist()
        return told

    def _footprint(self, drone: str, sighting: Sighting) -> list[list[float]]:
        """Closed ring on the terrain, to the centimetre; kept for the newest that was asked for."""
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
            ring = np.column_stack([outline, np.nan_to_num(heights, nan=lowest)]).round(2).tolist()
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
