"""Rows of telemetry that lie further from their neighbours than any drone flies.

A receiver that is wrong for a moment, or a row that was damaged, puts a drone somewhere else: what pictures
around it show would be put between there and here. After a leap that stays, nobody knows which of both
places is right.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_LEAST_M = 20.0
"""Nearer to the row before, a filter may have found a better fix."""
_FASTEST_M_PER_S = 100.0
_LONGEST = 3
"""Rows that are elsewhere for a moment."""
_RARE = 0.05
"""Share of all rows that may be; of more of them the others need not be the right ones."""


def leaps(
    stamps_ns: NDArray[np.int64], positions: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], list[str]]:
    """Which rows of a track, stamps [N] rising and positions [N, 3], are elsewhere for a moment [N], and what
    to tell of them and of leaps that stay."""
    elsewhere = np.zeros(len(stamps_ns), np.bool_)
    steps = np.flatnonzero(_too_far(stamps_ns, positions)).tolist()
    stay: list[int] = []
    number = 0
    while number < len(steps) <= 2 * _RARE * len(stamps_ns):  # there and back
        out, back = steps[number], steps[min(number + 1, len(steps) - 1)]
        ends = [out, back + 1]
        if 0 < back - out <= _LONGEST and not _too_far(stamps_ns[ends], positions[ends]).any():
            elsewhere[out + 1 : back + 1] = True
            number += 2
        else:
            stay.append(out)
            number += 1
    if number == 0 or elsewhere.sum() > _RARE * len(stamps_ns):
        stay, elsewhere = steps, np.zeros(len(stamps_ns), np.bool_)
    said = []
    if elsewhere.any():
        said.append(
            f"{elsewhere.sum()} of {len(stamps_ns)} pose rows are left out, the first at stamp "
            f"{stamps_ns[elsewhere][0]}: {_told(positions, int(np.argmax(elsewhere)) - 1)} and back at once, "
            "further than a drone flies"
        )
    if stay:
        said.append(
            f"poses leap {len(stay)} times further than a drone flies, first at stamp "
            f"{stamps_ns[stay[0] + 1]}: {_told(positions, stay[0])}. What was seen on one side is in the "
            "wrong place; are two drones, or two flights, under one name?"
        )
    return elsewhere, said


def _too_far(stamps_ns: NDArray[np.int64], positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Of the steps [N - 1] from row to row."""
    with np.errstate(over="ignore"):  # damaged rows may hold anything that is finite
        metres = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    return np.asarray(metres > np.maximum(_LEAST_M, _FASTEST_M_PER_S * np.diff(stamps_ns) / 1e9))


def _told(positions: NDArray[np.float64], step: int) -> str:
    with np.errstate(over="ignore"):
        return f"{np.linalg.norm(positions[step + 1] - positions[step]):.0f} m away"
