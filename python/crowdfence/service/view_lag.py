"""How long after their stamps a drone's views come, and whether a clock that is off explains it.

A network holds back some views and not others: of many the quickest tells what is constant, which is the
clock of the drone, or what all its views wait for.
"""

from __future__ import annotations

from collections import deque
from statistics import median

_SECOND_NS = 1_000_000_000
_SECONDS = 20
"""With a view, that are remembered; a camera that gives many a second fills them no faster."""
_LEAST_SECONDS = 10
_BEHIND_S = 1.5
"""What no network adds to every view."""
_NOT_BEHIND_S = 1.0
AHEAD_S = 0.5
"""No view, and no pose, comes before its stamp: clocks that are kept by GNSS or NTP differ by less."""
_NOT_AHEAD_S = 0.3
_CONSTANT_S = 0.5
"""Of half of the seconds above the quickest; a backlog that is sent or a link that chokes differs by more."""


class ViewLag:
    """Of one drone. One thread adds; others may read."""

    def __init__(self) -> None:
        self._quickest: deque[tuple[int, float]] = deque(maxlen=_SECONDS)
        """Each second of the service's clock in which a view came, and the smallest lag in it, s."""

    def came(self, stamp_ns: int, now_ns: int) -> None:
        """A view of that stamp, by the clock of the service."""
        second, lag_s = now_ns // _SECOND_NS, (now_ns - stamp_ns) / _SECOND_NS
        if self._quickest and self._quickest[-1][0] == second:
            self._quickest[-1] = second, min(lag_s, self._quickest[-1][1])
        else:
            self._quickest.append((second, lag_s))

    @property
    def least_s(self) -> float | None:
        """The quickest of late; below 0 where the drone is ahead. None before the first view."""
        return min((lag_s for _, lag_s in tuple(self._quickest)), default=None)

    @property
    def is_off(self) -> bool | None:
        """Whether all its views come later than networks explain, or before their stamps; None where too few
        came to say, or it is neither clearly so nor clearly not."""
        lags_s = [lag_s for _, lag_s in tuple(self._quickest)]
        if len(lags_s) < _LEAST_SECONDS:
            return None
        least_s = min(lags_s)
        if -_NOT_AHEAD_S <= least_s <= _NOT_BEHIND_S:
            return False
        if -AHEAD_S <= least_s <= _BEHIND_S or median(lags_s) - least_s > _CONSTANT_S:
            return None
        return True
