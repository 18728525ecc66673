"""Which looks of a drone take in far ground.

Ground beyond what a detector knows is shown to it enlarged. It takes half of the time of detecting on a
typical oblique view, and more than half of the cells of the map that a view touches, while a single look at
it says least. A machine that does not keep up with its pictures may look at it a few times a second, whatever
their rate, and in between not at all: those cells of the heatmap are masked, which says neither crowd nor
empty. A method that takes what a drone does not see for empty needs whole looks.
"""

from __future__ import annotations

from collections.abc import Mapping

_TURN = 0.618034
"""Of an interval, from the turn of one drone to that of the next: the golden section spreads any number."""


class FarLooks:
    """Asked once for every look of every drone, in the order in which they come."""

    def __init__(self, every_s: float) -> None:
        """`every_s`: seconds from one far look of a drone to its next; 0: every look is one."""
        self._every_ns = round(every_s * 1e9)
        self._last_ns: dict[str, int] = {}

    def takes(self, drone: str, stamp_ns: int) -> bool:
        """Whether a look takes in far ground. The first one of a drone does, and so does one with a stamp
        before its last: clocks are set."""
        last_ns = self._last_ns.get(drone)
        if last_ns is None:
            # The drones of a fleet take turns, so that their far looks do not fall on the same instants.
            turn_ns = round(self._every_ns * (_TURN * len(self._last_ns) % 1.0))
            self._last_ns[drone] = stamp_ns - turn_ns
            return True
        if 0 <= stamp_ns - last_ns < self._every_ns:
            return False
        self._last_ns[drone] = stamp_ns
        return True

    def to_json(self) -> dict[str, int]:
        """All that later answers depend on."""
        return dict(sorted(self._last_ns.items()))

    def restore(self, state: Mapping[str, int]) -> None:
        """What `to_json` gave."""
        self._last_ns = dict(state)
