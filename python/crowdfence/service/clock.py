"""What time it is for the service."""

from __future__ import annotations

import time
from collections.abc import Callable

from crowdfence.service.settings import ClockKind

JUMP_NS = 1_000_000_000
_SECOND_NS = 1_000_000_000
_COUNTS_SLEEP: int | None = getattr(time, "CLOCK_BOOTTIME", None)
"""Of Linux; elsewhere a machine that slept is told by `Clock.jumped_ns`."""


def steady_ns() -> int:
    """Of a clock that nobody can set, and that goes on while the machine sleeps: what was seen empty before a
    laptop was closed is that much older once it is opened again."""
    return time.monotonic_ns() if _COUNTS_SLEEP is None else time.clock_gettime_ns(_COUNTS_SLEEP)


def steady_s() -> float:
    return steady_ns() / _SECOND_NS


class Clock:
    """The machine's clock when the service started, and the seconds since then by one that cannot jump; or,
    for simulations and replays, the newest stamp."""

    def __init__(
        self,
        kind: ClockKind,
        *,
        system: Callable[[], int] = time.time_ns,
        steady: Callable[[], int] = steady_ns,
    ) -> None:
        self.kind = kind
        self._system, self._steady = system, steady
        self._offset_ns = system() - steady()
        self._newest_ns = 0

    def now_ns(self) -> int:
        """0 before the first view where the clock is that of the views."""
        return self._newest_ns if self.kind == "views" else self._steady() + self._offset_ns

    def saw(self, stamp_ns: int) -> None:
        """A view, or an instant, of this stamp."""
        self._newest_ns = max(self._newest_ns, stamp_ns)

    def jumped_ns(self) -> int:
        """By how much the machine's clock was set since the service started; 0 below a second."""
        jump_ns = self._system() - self._steady() - self._offset_ns
        return jump_ns if self.kind == "system" and abs(jump_ns) >= JUMP_NS else 0
