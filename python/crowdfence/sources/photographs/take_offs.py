"""Whether photographs of several flights, with take-offs at different heights, lie in one folder.

Heights above the take-off begin anew with every battery, and of two drones without serial numbers each has
its own. The absolute ones, less exact, are of all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

_LANDED_NS = 60_000_000_000
"""A pause in which a battery can be changed."""
_APART_M = 5.0
"""Absolute heights of one place an hour apart differ by some metres: the weather changes, satellites move."""
_TURNS = 2
"""Leaps up and as many down."""


def take_off_doubt(
    stamps_ns: Sequence[int], above_take_off_m: ArrayLike, absolute_m: ArrayLike
) -> str | None:
    """What to tell of photographs in order of time, of which the absolute heights say that they took off at
    different ones, as the end of a sentence that begins with whose they are; None where they do not."""
    of_take_off = np.asarray(absolute_m, np.float64) - np.asarray(above_take_off_m, np.float64)
    by_turns = _by_turns(of_take_off)
    landed = np.flatnonzero(np.diff(np.asarray(stamps_ns, np.int64)) > _LANDED_NS) + 1
    heights_m = [float(np.median(flight)) for flight in np.split(of_take_off, landed)]
    apart_m = by_turns if by_turns is not None else max(heights_m) - min(heights_m)
    if apart_m <= _APART_M:
        return None
    return (
        f"by their absolute heights its photographs are of {'flights' if by_turns is None else 'drones'} "
        f"whose take-offs lie {apart_m:.0f} m apart in height, and their heights are taken as above one: "
        "give each flight in a folder of its own with its --take-off, or say --heights, of those that are "
        "recorded"
    )


def _by_turns(of_take_off: NDArray[np.float64]) -> float | None:
    """How far apart the take-offs of two drones of one name lie whose photographs follow on each other; None
    where they are of one drone, whose heights leap at most once, such as when a receiver finds itself."""
    steps = np.diff(of_take_off)
    leaps = min(np.count_nonzero(steps > _APART_M), np.count_nonzero(steps < -_APART_M))
    return float(np.ptp(np.percentile(of_take_off, (10, 90)))) if leaps >= _TURNS else None
