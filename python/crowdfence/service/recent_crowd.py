"""Where the crowd went that each drone showed of late: a long good flight must not cover up what is lost."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Lock

from crowdfence._core import CrowdMass, Observation

WINDOW_S = 10.0
_WINDOW_NS = round(WINDOW_S * 1_000_000_000)


class RecentCrowd:
    """The crowd masses of each drone's looks of the last `WINDOW_S` seconds before its newest one. Safe to
    read while others add."""

    def __init__(self) -> None:
        self._looks: dict[str, list[tuple[int, CrowdMass]]] = {}
        """By drone: stamp (ns) and mass, as they came."""
        self._lock = Lock()

    def add(self, observations: Sequence[Observation]) -> None:
        """What was taken in together; late ones count too, until the next one in time comes."""
        with self._lock:
            for one in observations:
                kept = [
                    look for look in self._looks.get(one.drone, ()) if one.stamp_ns - look[0] < _WINDOW_NS
                ]
                self._looks[one.drone] = [*kept, (one.stamp_ns, one.crowd_mass)]

    def masses(self) -> dict[str, CrowdMass]:
        """By drone, of those that gave anything."""
        with self._lock:
            looks = {drone: tuple(kept) for drone, kept in self._looks.items()}
        return {drone: sum((mass for _, mass in kept), CrowdMass()) for drone, kept in looks.items()}
