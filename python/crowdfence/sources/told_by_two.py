"""Whether two tell one track by turns, each something else.

A driver tells how a gimbal stands, and a description of the robot, whose joints nobody set, that it stands
ahead; or two filters tell where one body is. Between such rows nobody knows the pose, and smoothing them puts
it in the middle. A row that is elsewhere once is another matter (`pose_leaps`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.rotation import normalise

_LEAST_M, _LEAST_DEG = 2.0, 5.0
_LONGEST_STEP_NS = 250_000_000
"""In longer ones a drone may be there and back, or a gimbal that swings from picture to picture."""
_BACK = 0.1
"""Of the way there, what may be left after the way back."""
_FEWEST, _SHARE = 4, 0.15
"""Rows that are there and back; errors that are each by themselves, however large, are so in some percent."""


def told_by_two(
    stamps_ns: NDArray[np.int64], positions: NDArray[np.float64], quaternions: NDArray[np.float64]
) -> str | None:
    """How far apart they are, where rows of a track, stamps [N] rising, positions [N, 3] and unit quaternions
    [N, 4], are elsewhere and back again and again; None where not."""
    if len(stamps_ns) < _FEWEST + 2:
        return None
    with np.errstate(over="ignore", invalid="ignore"):  # damaged rows may hold anything that is finite
        turns = normalise(quaternions)
        for metres, unit, least in ((True, "m", _LEAST_M), (False, "degrees", _LEAST_DEG)):
            step, back = (_metres(positions, rows) if metres else _degrees(turns, rows) for rows in (1, 2))
            there = np.minimum(step[:-1], step[1:])
            soon = np.maximum(np.diff(stamps_ns)[:-1], np.diff(stamps_ns)[1:]) <= _LONGEST_STEP_NS
            swings = soon & (there > least) & (back < _BACK * there)
            if swings.sum() >= max(_FEWEST, _SHARE * len(stamps_ns)):
                return f"{np.median(there[swings]):.0f} {unit}"
    return None


def _metres(positions: NDArray[np.float64], rows: int) -> NDArray[np.float64]:
    """From every row to the one so many rows later."""
    return np.asarray(np.linalg.norm(positions[rows:] - positions[:-rows], axis=1))


def _degrees(turns: NDArray[np.float64], rows: int) -> NDArray[np.float64]:
    alike = np.abs(np.sum(turns[rows:] * turns[:-rows], axis=1))
    return np.asarray(np.degrees(2.0 * np.arccos(np.clip(alike, 0.0, 1.0))))
