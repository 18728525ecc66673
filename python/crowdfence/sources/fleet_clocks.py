"""Whether the drones of a fleet may have flown together on clocks of different time zones.

A clock that is whole hours off is that of another zone, or of summer time. Where flights are long, the pause
that it leaves between them is shorter than any bound on pauses.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

_HOUR_NS = 3600 * 10**9
_MOST_HOURS = 14
"""Between UTC and the time of any zone."""


def zone_doubts(frames: Iterable[tuple[str, int]]) -> list[str]:
    """A sentence for each drone that flew after another one had ended, where the two would have been in the
    air together, for more than half of the shorter flight, if one clock were whole hours off. `frames`: drone
    and stamp."""
    flights: dict[str, tuple[int, int]] = {}
    for drone, stamp_ns in frames:
        first_ns, last_ns = flights.get(drone, (stamp_ns, stamp_ns))
        flights[drone] = min(first_ns, stamp_ns), max(last_ns, stamp_ns)
    in_order = sorted(flights.items(), key=lambda flight: flight[1])
    return [doubt for pair in pairwise(in_order) if (doubt := _doubt(*pair)) is not None]


def _doubt(before: tuple[str, tuple[int, int]], after: tuple[str, tuple[int, int]]) -> str | None:
    (earlier, (begin_ns, end_ns)), (later, (next_ns, last_ns)) = before, after
    pause_ns = next_ns - end_ns
    hours = round((next_ns - begin_ns) / _HOUR_NS)
    if pause_ns <= 0 or not 1 <= hours <= _MOST_HOURS:
        return None
    off_ns = hours * _HOUR_NS
    together_ns = min(end_ns, last_ns - off_ns) - max(begin_ns, next_ns - off_ns)
    if not together_ns > min(end_ns - begin_ns, last_ns - next_ns) / 2:
        return None
    return (
        f"{later} begins {pause_ns / 60e9:.0f} min after {earlier} has ended; had they flown together, one "
        f"clock would be {hours} h off, and what {earlier} saw would count as {hours} h older than it is"
    )
