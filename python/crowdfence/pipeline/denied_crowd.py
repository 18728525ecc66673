"""Drones that see nobody wherever others clearly show a crowd: blind, most likely.

A covered lens, or a detector that fails at dusk, shows an empty field with full weight. What another drone
clearly shows at the time is closed all the same (`CrowdMap.shown_ids`); ground that the blind one alone has
in view opens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Observation
from crowdfence.zones.sorted_keys import are_among

LEAST_LOOKS = 5
"""In a row. On 14 rendered missions drones that see had at most three."""
LEAST_S = 3.0
"""From the first of them to the last: the false alarm of another drone stands for 2 s."""
_APART_S = 10.0
"""Longer between two of them, and they are of two occasions: false alarms that flash up now and then make no
row, however long the flight."""
_LEAST_VOXELS = 20
"""That somebody shows within a look, or it says nothing."""
_SHARP_M = 0.3
"""Metres per pixel up to which nobody should be missed there."""
_NOBODY = 0.05
"""A smaller value shows nobody."""
_NEARLY_ALL = 0.95
_SHOWS_NS = 2_000_000_000
"""So long it stands what a drone showed itself (`crowd_map/shown.rs`)."""


@dataclass(frozen=True, slots=True)
class _Denials:
    """Looks of a drone in a row that saw nobody where others showed crowd."""

    looks: int
    first_ns: int
    last_ns: int

    @property
    def are_many(self) -> bool:
        return self.looks >= LEAST_LOOKS and self.last_ns - self.first_ns >= LEAST_S * 1e9

    def ended(self, stamp_ns: int) -> bool:
        """Whether the next look of that kind begins a row anew. One that was told goes on, or a blind drone
        would see again for a moment each time that it comes back."""
        return not self.are_many and stamp_ns - self.last_ns > _APART_S * 1e9


class DeniedCrowd:
    """Looks at observations as they pass; may be shared between threads."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._now: dict[str, _Denials | None] = {}
        """Of every drone that looked at what others showed."""
        self._most: dict[str, _Denials] = {}
        """The longest rows of each drone that are long enough to be told."""
        self._showed_ns: dict[str, int] = {}

    def look(self, observations: Sequence[Observation], shown_ids: NDArray[np.int64]) -> None:
        """What was taken in together, and the voxels that some look clearly shows as crowd after it."""
        with self._lock:
            for observation in observations:
                self._look(observation, shown_ids)

    def _look(self, observation: Observation, shown_ids: NDArray[np.int64]) -> None:
        drone, stamp_ns, mean = observation.drone, observation.stamp_ns, observation.mean
        if (mean > 0.5).any():
            self._showed_ns[drone] = max(stamp_ns, self._showed_ns.get(drone, stamp_ns))
            self._now[drone] = None
            return
        shows_itself = stamp_ns - self._showed_ns.get(drone, -_SHOWS_NS - 1) <= _SHOWS_NS
        if shows_itself or len(shown_ids) < _LEAST_VOXELS:
            return
        near = observation.range_m <= _SHARP_M * observation.focal_px
        looked = near & (observation.tilt_deg > 0.0) & are_among(observation.voxel_ids, shown_ids)
        there = mean[looked]
        if len(there) < _LEAST_VOXELS:
            return
        if np.mean(there < _NOBODY) < _NEARLY_ALL:
            self._now[drone] = None
            return
        before = self._now.get(drone)
        if before is None or before.ended(stamp_ns):
            before = _Denials(0, stamp_ns, stamp_ns)
        row = _Denials(before.looks + 1, min(stamp_ns, before.first_ns), max(stamp_ns, before.last_ns))
        self._now[drone] = row
        if row.are_many and (drone not in self._most or row.looks > self._most[drone].looks):
            self._most[drone] = row

    def now(self) -> dict[str, str | None]:
        """Of drones that looked at what others show: one sentence where they see nobody there now."""
        with self._lock:
            rows = sorted(self._now.items())
        return {drone: _sentence(drone, row) if row and row.are_many else None for drone, row in rows}

    @property
    def warnings(self) -> list[str]:
        """One sentence for each drone that saw nobody there at any time."""
        with self._lock:
            return [_sentence(drone, row) for drone, row in sorted(self._most.items())]


def _sentence(drone: str, row: _Denials) -> str:
    seconds = (row.last_ns - row.first_ns) / 1e9
    return (
        f"{drone} saw nobody in {row.looks} looks in a row, over {seconds:.0f} s, where other drones clearly "
        "showed a crowd: is its camera covered, or its detector failing? What it alone has in view opens: "
        "leave it out; or the others are wrong"
    )
