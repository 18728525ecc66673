"""Drones that see nobody wherever others clearly show a crowd: blind, most likely.

A covered lens, or a detector that fails at dusk, shows an empty field with full weight. What another drone
clearly shows at the time is closed all the same (`CrowdMap.shown_ids`); ground that the blind one alone has
in view opens, and so does what others look at seldom (`crowd_that_stays.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence.pipeline.close_look import CloseLook
from crowdfence.pipeline.crowd_that_stays import CrowdThatStays, Missed
from crowdfence.pipeline.looks_in_a_row import LooksInARow
from crowdfence.zones.sorted_keys import are_among, distinct, united

_APART_S = 10.0
"""Longer between two of them, and they are of two occasions: false alarms that flash up now and then make no
row, however long the flight."""
_SHOWS_NS = 2_000_000_000
"""So long it stands what a drone showed itself (`crowd_map/shown.rs`)."""
_GONE_NS = 60_000_000_000
"""A drone that looked at no ground for longer opens nothing now: older views are refused."""
_NONE = np.empty(0, np.int64)


class Denial(NamedTuple):
    """Of a drone that saw nobody where others showed crowd."""

    text: str
    since_ns: int
    """First look of the newest occasion that is long enough to be told by itself."""


@dataclass(slots=True)
class _Doubt:
    """Whether one drone sees anything."""

    row: LooksInARow
    """One that was told goes on with the next occasion, or a blind drone would see again for a moment each
    time that it comes back."""
    occasion: LooksInARow
    """The newest part of the row without a long pause."""
    since_ns: int
    unsettled: NDArray[np.int64] = field(default_factory=lambda: _NONE)
    """Ground with crowd, ever, that it looked at since the row began and nobody else after it; sorted."""
    looked_ns: int = 0
    """Its newest look at any ground."""

    def denied(self, stamp_ns: int) -> None:
        if _is_over(self.occasion, stamp_ns):
            self.occasion = LooksInARow.begun(stamp_ns)
            if not self.row.are_many:
                self.row, self.unsettled = LooksInARow.begun(stamp_ns), _NONE
        self.row, self.occasion = self.row.and_at(stamp_ns), self.occasion.and_at(stamp_ns)
        if self.occasion.are_many:
            self.since_ns = self.occasion.first_ns

    def is_settled(self, now_ns: int) -> bool:
        """Whether nothing rests on its word: it opens nothing now, and what it may have opened others have
        looked at since. Time alone settles nothing."""
        return not len(self.unsettled) and now_ns - self.looked_ns > _GONE_NS


class DeniedCrowd:
    """Asks looks as they pass; may be shared between threads."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._now: dict[str, _Doubt | None] = {}
        """Of every drone that looked at what others showed."""
        self._decided: set[str] = set()
        """Drones of which it was known at some time whether they see anything."""
        self._most: dict[str, LooksInARow] = {}
        """The longest rows of each drone that are long enough to be told."""
        self._stays = CrowdThatStays()
        self._showed_ns: dict[str, int] = {}
        self._ever = _NONE
        """All ground that was crowd at any time, sorted."""

    def look(
        self,
        looks: Sequence[CloseLook],
        shown_ids: NDArray[np.int64],
        crowd_ids: NDArray[np.int64],
    ) -> None:
        """What was taken in together, the voxels that some look clearly shows as crowd after it, and those
        that are crowd on the map."""
        with self._lock:
            for look in looks:
                self._look(look, shown_ids)
                for drone, missed in self._stays.look(look, shown_ids).items():
                    self._stayed(drone, missed)
            # Behind the looks: what one of them opened was crowd before.
            for ids in (shown_ids, crowd_ids):
                new = ids[~are_among(ids, self._ever)]
                self._ever = united(self._ever, distinct(new))
            for look in looks:
                self._settle(look)

    def _look(self, look: CloseLook, shown_ids: NDArray[np.int64]) -> None:
        drone, stamp_ns = look.drone, look.stamp_ns
        if len(look.crowd_ids):
            self._showed_ns[drone] = max(stamp_ns, self._showed_ns.get(drone, stamp_ns))
            self._now[drone] = None
            self._decided.add(drone)
            return
        shows_itself = stamp_ns - self._showed_ns.get(drone, -_SHOWS_NS - 1) <= _SHOWS_NS
        is_denied = None if shows_itself else look.closely(shown_ids).is_denied
        if is_denied is None:
            return
        if not is_denied:
            self._now[drone] = None
            self._decided.add(drone)
            return
        doubt = self._now.get(drone)
        if doubt is None:
            begun = LooksInARow.begun(stamp_ns)
            doubt = self._now[drone] = _Doubt(begun, begun, stamp_ns)
        doubt.denied(stamp_ns)
        self._tell(drone, doubt.row)

    def _stayed(self, drone: str, missed: Missed) -> None:
        """A look of a drone that saw nobody was wrong, however long ago it was that the crowd was shown."""
        row = LooksInARow(missed.times, missed.first_ns, missed.looked_ns)
        if not row.are_many:
            return
        doubt = self._now.get(drone)
        if doubt is None or not doubt.row.are_many:
            self._now[drone] = _Doubt(row, row, row.first_ns, missed.voxel_ids, missed.looked_ns)
        self._tell(drone, row)

    def _tell(self, drone: str, row: LooksInARow) -> None:
        if not row.are_many:
            return
        self._decided.add(drone)
        if drone not in self._most or row.looks > self._most[drone].looks:
            self._most[drone] = row

    def _settle(self, look: CloseLook) -> None:
        """What a drone in doubt looks at rests on its word until one that is not in doubt looks there."""
        own = self._now.get(look.drone)
        if own is not None and len(look):
            own.unsettled = distinct(np.concatenate([own.unsettled, look.seen(self._ever)]))
            own.looked_ns = max(own.looked_ns, look.stamp_ns)
        if own is not None and (own.row.are_many or not _is_over(own.occasion, look.stamp_ns)):
            return
        for drone, doubt in self._now.items():
            if doubt is None or drone == look.drone or look.stamp_ns <= doubt.looked_ns:
                continue
            if len(doubt.unsettled):
                settled = look.closely(doubt.unsettled).seen
                doubt.unsettled = doubt.unsettled[~are_among(doubt.unsettled, settled)]

    def now(self, now_ns: int) -> dict[str, Denial | None]:
        """Of drones that looked at what others show: what is told where they see nobody there, until they see
        somebody, or they are gone and others have looked at all ground in question since. One that comes back
        then is told again."""
        with self._lock:
            return {
                drone: Denial(_sentence(drone, doubt.row), doubt.since_ns)
                if doubt and doubt.row.are_many and not doubt.is_settled(now_ns)
                else None
                for drone, doubt in sorted(self._now.items())
            }

    @property
    def undecided(self) -> frozenset[str]:
        """Of them those that saw nobody there so far, in too few looks to say anything."""
        with self._lock:
            return frozenset(self._now) - self._decided

    @property
    def warnings(self) -> list[str]:
        """One sentence for each drone that saw nobody there at any time."""
        with self._lock:
            return [_sentence(drone, row) for drone, row in sorted(self._most.items())]


def _is_over(occasion: LooksInARow, stamp_ns: int) -> bool:
    """Whether a look at a stamp is of another occasion."""
    return stamp_ns - occasion.last_ns > _APART_S * 1e9


def _sentence(drone: str, row: LooksInARow) -> str:
    return (
        f"{drone} saw nobody in {row.looks} looks in a row, over {row.seconds:.0f} s, where other drones "
        "clearly showed a crowd: is its camera covered, or its detector failing? What it alone has in view "
        "opens: leave it out; or the others are wrong"
    )
