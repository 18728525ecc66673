"""Two drones that each show crowd only where the other sees nobody: one crowd at two places, most likely, and
at neither of its own. So it is where heights of poses and map do not fit, or a heading is wrong: every drone
puts the crowd on another side, and the look of another one opens its zone."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence.pipeline.close_look import LEAST_VOXELS, CloseLook
from crowdfence.pipeline.looks_in_a_row import LooksInARow

_TOGETHER_NS = 1_000_000_000
"""So far apart two looks are of one moment: whoever runs has gone 3 m by then, less than a crowd is wide."""


class _Shown(NamedTuple):
    look: CloseLook
    shows: NDArray[np.int64]
    """Voxels that it clearly shows as crowd, sorted."""

    def is_denied_by(self, other: CloseLook) -> bool | None:
        """Whether a look of another drone saw nobody there; None where it had too little of it in view."""
        return other.closely(self.shows).is_denied if len(self.shows) >= LEAST_VOXELS else None


_Rows = Mapping[tuple[str, str], LooksInARow]
"""Of each pair, without a look at which both show the same ground."""


class CrowdsApart:
    """Asks looks as they pass; may be shared between threads."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._last: dict[str, _Shown] = {}
        self._rows: dict[tuple[str, str], LooksInARow] = {}
        self._most: dict[tuple[str, str], LooksInARow] = {}
        """The longest row of each pair that is long enough to be told."""
        self._has_ended = False

    def look(self, looks: Sequence[CloseLook], shown_ids: NDArray[np.int64]) -> None:
        """What was taken in together, and the voxels that some look clearly shows as crowd after it."""
        with self._lock:
            for look in looks:
                own = _Shown(look, look.shows(shown_ids))
                for drone, other in self._last.items():
                    if drone != look.drone and abs(look.stamp_ns - other.look.stamp_ns) <= _TOGETHER_NS:
                        first, second = sorted((drone, look.drone))
                        self._compare((first, second), own, other)
                self._last[look.drone] = own

    def _compare(self, pair: tuple[str, str], own: _Shown, other: _Shown) -> None:
        here = own.is_denied_by(other.look)
        there = None if here is None else other.is_denied_by(own.look)
        if there is None:
            return
        stamp_ns = own.look.stamp_ns
        if not (here and there):
            self._rows.pop(pair, None)
            self._has_ended = True
            return
        row = self._rows[pair] = self._rows.get(pair, LooksInARow.begun(stamp_ns)).and_at(stamp_ns)
        longest = self._most.get(pair)
        if row.are_many and (longest is None or row.looks > longest.looks):
            self._most[pair] = row

    @property
    def is_undecided(self) -> bool:
        """Whether no pair has shown yet if it puts crowd at two places or not."""
        with self._lock:
            return not (self._has_ended or self._most)

    def now(self, left_out: Collection[str]) -> str | None:
        """What is to be told of rows that go on, of drones that are not `left_out`; None where none does."""
        with self._lock:
            told = {pair: row for pair, row in self._rows.items() if row.are_many}
            return _sentence({pair: told[pair] for pair in told if not any(one in left_out for one in pair)})

    @property
    def warnings(self) -> list[str]:
        """At most one sentence, of the pair with the longest row."""
        with self._lock:
            told = _sentence(self._most)
        return [] if told is None else [told]


def _sentence(rows: _Rows) -> str | None:
    if not rows:
        return None
    (first, second), row = max(rows.items(), key=lambda item: item[1].looks)
    others = len(rows) - 1
    so_did = f", and so did {others} other pair{'s' if others > 1 else ''} of drones" if others else ""
    return (
        f"{first} and {second} each showed crowd only where the other saw nobody, in {row.looks} looks "
        f"in a row, over {row.seconds:.0f} s{so_did}: zones lie beside their crowds, "
        "or the crowds are false alarms. Do heights of poses and map count from the same level, and is every "
        "heading right?"
    )
