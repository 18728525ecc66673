"""Whether photographs of several flights, with take-offs at different heights, lie in one folder.

Heights above the take-off begin anew with every battery. The absolute ones, less exact, go on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

_LANDED_NS = 60_000_000_000
"""A pause in which a battery can be changed."""
_APART_M = 5.0
"""Absolute heights of one place an hour apart differ by some metres: the weather changes, satellites move."""


def take_off_doubt(
    stamps_ns: Sequence[int], above_take_off_m: ArrayLike, absolute_m: ArrayLike
) -> str | None:
    """What to tell of photographs in order of time, of which the absolute heights say that they took off at
    different ones, as the end of a sentence that begins with whose they are; None where they do not."""
    of_take_off = np.asarray(absolute_m, np.float64) - np.asarray(above_take_off_m, np.float64)
    landed = np.flatnonzero(np.diff(np.asarray(stamps_ns, np.int64)) > _LANDED_NS) + 1
    heights_m = [float(np.median(flight)) for flight in np.split(of_take_off, landed)]
    apart_m = max(heights_m) - min(heights_m)
    if apart_m <= _APART_M:
        return None
    return (
        "by their absolute heights its photographs are of flights whose take-offs lie "
        f"{apart_m:.0f} m apart in height, and their heights are taken as above one: give each flight in a "
        "folder of its own with its --take-off, or say --heights, of those that are recorded"
    )
