"""Whether stamps are nanoseconds, or another unit that was taken for them.

Microseconds of today are nanoseconds of January or February 1970, and every age that follows from them is a
thousand times too small: nothing ever gets old. A clock of a simulation or of a machine since its start may
pass through the same numbers, but no camera takes its frames that close together.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from statistics import median_low

_OTHER_UNITS = {"seconds": 1, "milliseconds": 10**3, "microseconds": 10**6}
"""How many make a second."""
THIS_CENTURY_S = range(1_000_000_000, 4_000_000_000)
"""September 2001 to October 2096, since the epoch."""
_FASTEST_FRAMES_NS = 4_000_000
"""Cameras of drones take up to 240 frames a second."""
_LEAST_FRAMES = 3
"""So many tell how far apart a camera takes them; two may be of one shot through two lenses."""


def unit_warning(drone: str, stamps_ns: Sequence[int]) -> str | None:
    """One line where the stamps of a drone's frames may be in another unit. ValueError where they must be."""
    unit = _looks_like(stamps_ns)
    if unit is None:
        _refuse_other_clocks(drone, stamps_ns)
        return None
    first_ns, factor = min(stamps_ns), 10**9 // _OTHER_UNITS[unit]
    apart_ns = _apart_ns(stamps_ns)
    if apart_ns is not None and apart_ns < _FASTEST_FRAMES_NS:
        raise ValueError(
            f"the stamps of {drone} look like {unit}, not nanoseconds: {first_ns} ns is in 1970, and its "
            f"frames would be {apart_ns / 1e6:g} ms apart, closer than any camera takes them; multiply them "
            f"by {factor}"
        )
    # A machine runs for days without a restart, not for the weeks that microseconds look like; whoever
    # simulates a second or an hour is in the numbers of the other two all the time.
    if unit != "microseconds":
        return None
    return (
        f"the stamps of {drone} begin at {first_ns} ns, {first_ns / 86_400e9:.0f} days into 1970; if they "
        f"are {unit}, multiply them by {factor}: every age is wrong until then"
    )


def unit_hint(stamp_ns: int) -> str:
    """What to add to the words that a stamp is far off; empty where it looks like no other unit."""
    unit = _looks_like([stamp_ns])
    if unit is None:
        return ""
    factor = 10**9 // _OTHER_UNITS[unit]
    return f"; {stamp_ns} looks like {unit} since 1970: stamps are nanoseconds, multiply by {factor}"


def _refuse_other_clocks(drone: str, stamps_ns: Sequence[int]) -> None:
    """ValueError for a clock in another unit that began with the machine or the simulation: its numbers are
    no date, and only how close the frames are tells it."""
    if any(stamp // 10**9 in THIS_CENTURY_S for stamp in stamps_ns):
        return
    frames = len(set(stamps_ns))
    apart_ns = (max(stamps_ns) - min(stamps_ns)) / (frames - 1) if frames >= _LEAST_FRAMES else math.inf
    if apart_ns < _FASTEST_FRAMES_NS:
        raise ValueError(
            f"the stamps of {drone} are no nanoseconds: its frames would be {apart_ns / 1e6:g} ms apart, "
            "closer than any camera takes them; multiply seconds by 1000000000, milliseconds by 1000000, "
            "microseconds by 1000"
        )


def _looks_like(stamps_ns: Sequence[int]) -> str | None:
    """The unit in which all are stamps of this century."""
    for unit, per_second in _OTHER_UNITS.items():
        if stamps_ns and all(stamp // per_second in THIS_CENTURY_S for stamp in stamps_ns):
            return unit
    return None


def _apart_ns(stamps_ns: Sequence[int]) -> int | None:
    """Usual time between two frames; None for fewer than two."""
    ordered = sorted(set(stamps_ns))
    steps = [later - earlier for earlier, later in pairwise(ordered)]
    return median_low(steps) if steps else None
