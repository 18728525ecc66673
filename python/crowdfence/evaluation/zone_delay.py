"""How long zones lag behind crowds: until the ground of a crowd in view is closed, and until it is opened
after the crowd left."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crowdfence.evaluation.safety import Cells, CrowdsInView, distance_m
from crowdfence.zones.tracker import column_keys

BUFFER_M = 5.0


class Delay(NamedTuple):
    """Of columns of ground."""

    median_s: float
    """Of those where it ended; NaN where it ended nowhere."""
    never: float
    """Share of all where it had not ended at the end of the recording; NaN where there were none."""
    columns: int


class ZoneDelay:
    """Remembers when ground was crowd, in view, and when it was closed, as finely as it is told."""

    def __init__(self) -> None:
        self._crowd_from: dict[int, int] = {}
        self._marked_at: dict[int, int] = {}
        self._left_at: dict[int, int] = {}
        self._cleared_at: dict[int, int] = {}
        self._before: set[int] = set()

    def add(self, crowds: CrowdsInView, closed: Cells, size_m: float, stamp_ns: int) -> None:
        """One moment: the crowds, and the columns that are closed [C, 2]."""
        in_zone = distance_m(crowds.ground, closed, size_m) <= BUFFER_M
        ground = column_keys(crowds.ground)
        for key in ground.tolist():
            self._crowd_from.setdefault(key, stamp_ns)
        for key in ground[in_zone].tolist():
            self._marked_at.setdefault(key, stamp_ns)
        now, held = set(ground.tolist()), set(column_keys(closed).tolist())
        for key in (self._before - now) & held:
            self._left_at.setdefault(key, stamp_ns)
        for key in now & self._left_at.keys():  # somebody came back
            del self._left_at[key]
            self._cleared_at.pop(key, None)
        for key in self._left_at.keys() - self._cleared_at.keys() - held:
            self._cleared_at[key] = stamp_ns
        self._before = now

    @property
    def to_mark(self) -> Delay:
        """From when a crowd's ground is first in view until a zone with `BUFFER_M` around it holds it."""
        return _delay(self._crowd_from, self._marked_at)

    @property
    def to_clear(self) -> Delay:
        """From when a crowd left ground that is closed until it is open."""
        return _delay(self._left_at, self._cleared_at)


def _delay(begun: dict[int, int], ended: dict[int, int]) -> Delay:
    if not begun:
        return Delay(float("nan"), float("nan"), 0)
    lasted = [(ended[key] - begun[key]) / 1e9 for key in begun if key in ended]
    never = 1.0 - len(lasted) / len(begun)
    return Delay(float(np.median(lasted)) if lasted else float("nan"), never, len(begun))
