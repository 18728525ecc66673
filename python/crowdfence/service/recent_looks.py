"""What each drone's looks showed of late: a long good flight must not cover up crowd that is lost now, nor a
camera that sees no ground any more."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Lock
from typing import NamedTuple

from crowdfence._core import CrowdMass, Observation

WINDOW_S = 10.0
_WINDOW_NS = round(WINDOW_S * 1_000_000_000)
_SPANNED_NS = 0.9 * _WINDOW_NS
"""By looks in a row before they are said to be those of the whole window."""


class _Look(NamedTuple):
    stamp_ns: int
    crowd: CrowdMass
    met_ground: bool


class RecentLooks:
    """Of each drone those of the last `WINDOW_S` seconds before its newest one. Safe to read while others
    add."""

    def __init__(self) -> None:
        self._looks: dict[str, list[_Look]] = {}
        """By drone, as they came."""
        self._lock = Lock()

    def add(self, observations: Sequence[Observation]) -> None:
        """What was taken in together; late ones count too, until the next one in time comes."""
        with self._lock:
            for one in observations:
                kept = [
                    look
                    for look in self._looks.get(one.drone, ())
                    if one.stamp_ns - look.stamp_ns < _WINDOW_NS
                ]
                look = _Look(one.stamp_ns, one.crowd_mass, len(one.voxel_ids) > 0)
                self._looks[one.drone] = [*kept, look]

    def masses(self) -> dict[str, CrowdMass]:
        """Where the crowd went, by drone, of those that gave anything."""
        return {drone: sum((look.crowd for look in looks), CrowdMass()) for drone, looks in self._each()}

    def meets_ground(self) -> dict[str, bool]:
        """Whether any of its looks met ground of the map, by drone: of those that gave looks for most of the
        window, or whose newest one met some."""
        return {
            drone: any(look.met_ground for look in looks)
            for drone, looks in self._each()
            if looks[-1].met_ground or looks[-1].stamp_ns - looks[0].stamp_ns >= _SPANNED_NS
        }

    def _each(self) -> list[tuple[str, list[_Look]]]:
        with self._lock:
            return list(self._looks.items())  # a list of looks is replaced, never changed
