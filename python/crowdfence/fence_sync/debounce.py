"""Which zones stand in the fence: new ground at once, ground that opens after a while.

A zone that comes and goes would make a vehicle that halts before it stutter, and a fence that is replaced is
not kept for a moment. So what was closed stays closed until it has been open for a while, and fences are sent
at most so often.
"""

from __future__ import annotations

from collections.abc import Sequence

from crowdfence.zones import Zone

Outlines = tuple[tuple[str, bytes], ...]
"""What tells two wanted fences apart: ids and outlines."""


class Debounce:
    """Given zones as they change, says what to send and when. Seconds are the caller's."""

    def __init__(self, opening_s: float, interval_s: float) -> None:
        """`opening_s`: ground opens after it was open for so long; `interval_s`: between two fences."""
        self._opening_s = opening_s
        self._interval_s = interval_s
        self._versions: list[tuple[float, Sequence[Zone]]] = []
        self._sent: Outlines | None = None
        self._sent_s = float("-inf")

    def offer(self, zones: Sequence[Zone], now_s: float) -> None:
        """The zones are these from now on."""
        self._versions.append((now_s, tuple(zones)))
        self._forget(now_s)  # also while nobody asks: a link may be lost for hours

    def due(self, now_s: float) -> tuple[Zone, ...] | None:
        """The zones to send now; None while nothing changed, or the last fence is too new."""
        if not self._versions or now_s - self._sent_s < self._interval_s:
            return None
        wanted = self._wanted(now_s)
        return None if _outlines(wanted) == self._sent else wanted

    def sent(self, zones: Sequence[Zone], now_s: float) -> None:
        """The vehicle holds these."""
        self._sent, self._sent_s = _outlines(zones), now_s

    def failed(self, now_s: float) -> None:
        """The vehicle did not take them: again after the interval."""
        self._sent, self._sent_s = None, now_s

    def _wanted(self, now_s: float) -> tuple[Zone, ...]:
        """The newest zones, and those that were there less than `opening_s` ago."""
        self._forget(now_s)
        newest = {_outline(zone): zone for _, zones in reversed(self._versions) for zone in zones}
        return tuple(newest.values())

    def _forget(self, now_s: float) -> None:
        """What ended `opening_s` ago or before."""
        ends_s = [start_s for start_s, _ in self._versions[1:]]
        alive = [now_s - end_s < self._opening_s for end_s in ends_s]
        self._versions = [
            version for version, keep in zip(self._versions, [*alive, True], strict=True) if keep
        ]


def _outlines(zones: Sequence[Zone]) -> Outlines:
    return tuple(sorted(_outline(zone) for zone in zones))


def _outline(zone: Zone) -> tuple[str, bytes]:
    return zone.id, zone.polygon.wkb
