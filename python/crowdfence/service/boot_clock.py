"""When an autopilot says something: its milliseconds since it started -> stamps of the service's clock."""

from __future__ import annotations

from collections import deque
from typing import Literal

from crowdfence.sources.stamp_unit import THIS_CENTURY_S

BootSource = Literal["timesync", "system_time", "arrival"]

_KEPT = 16
_LONGEST_WAY_NS = 500_000_000
"""An answer to TIMESYNC that took longer says little about the time."""
_RESTARTED_MS = 5000
"""A message so much older than the newest is of an autopilot that started anew."""


class BootClock:
    """The best that was told so far: TIMESYNC, answered by the autopilot; SYSTEM_TIME, which it knows from
    satellites; else when messages arrive, late by their way."""

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self._asked: deque[tuple[int, int]] = deque(maxlen=_KEPT)
        """Length of the way and offset, nanoseconds."""
        self._told_ns: int | None = None
        self._arrived: deque[int] = deque(maxlen=200)
        self._newest_ms = 0

    def answered(self, sent_ns: int, boot_ns: int, now_ns: int) -> None:
        """TIMESYNC: it was `boot_ns` there between two moments of our clock."""
        way_ns = now_ns - sent_ns
        if 0 <= way_ns <= _LONGEST_WAY_NS:
            self._asked.append((way_ns, sent_ns + way_ns // 2 - boot_ns))

    def told(self, unix_ns: int, boot_ms: int) -> bool:
        """SYSTEM_TIME; False where it is no time of day: until satellites tell it, autopilots say 0, or count
        from 1970."""
        if unix_ns // 1_000_000_000 not in THIS_CENTURY_S:
            return False
        self._told_ns = unix_ns - boot_ms * 1_000_000
        return True

    def arrived(self, boot_ms: int, now_ns: int) -> bool:
        """Any message with a time; True if it is the first since the autopilot started anew, so that all
        before is of another time."""
        anew = boot_ms < self._newest_ms - _RESTARTED_MS
        if anew:
            self._forget()
        self._newest_ms = max(self._newest_ms, boot_ms)
        self._arrived.append(now_ns - boot_ms * 1_000_000)
        return anew

    @property
    def source(self) -> BootSource:
        if self._asked:
            return "timesync"
        return "arrival" if self._told_ns is None else "system_time"

    @property
    def offset_ns(self) -> int | None:
        """Stamp of the autopilot's start; None before the first message."""
        if self._asked:
            return min(self._asked)[1]
        if self._told_ns is not None:
            return self._told_ns
        return self.by_arrival_ns

    @property
    def by_arrival_ns(self) -> int | None:
        """The same by when messages arrive alone, to compare clocks."""
        return min(self._arrived, default=None)
