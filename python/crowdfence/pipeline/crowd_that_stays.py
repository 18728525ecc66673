"""Looks that saw nobody at crowd that had not gone: who showed it before shows it there again.

What a look shows stands for 2 s. Where drones look less often than that, nothing stands when another one
looks there and sees nobody, and only the next look tells which of the two was right.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence.pipeline.close_look import LEAST_VOXELS, CloseLook
from crowdfence.zones.sorted_keys import are_among, distinct, united

_NONE = np.empty(0, np.int64)


class Missed(NamedTuple):
    """Ground at which a drone saw nobody, and others crowd before it."""

    voxel_ids: NDArray[np.int64]
    """Of its looks since the crowd was last shown there again, sorted."""
    looked_ns: int
    """Its last look there."""
    times: int = 0
    """How often in a row the crowd was shown again after such looks."""
    first_ns: int = 0
    """The first of the looks before those."""


class CrowdThatStays:
    """Asks looks as they pass."""

    def __init__(self) -> None:
        self._shown: dict[str, NDArray[np.int64]] = {}
        """What each drone clearly showed and did not see empty since, sorted."""
        self._missed: dict[str, Missed] = {}
        """Of every drone that saw nobody since it last saw anybody."""

    def look(self, look: CloseLook, shown_ids: NDArray[np.int64]) -> dict[str, Missed]:
        """By drone what it missed, where this look shows the same crowd again; `shown_ids` are voxels that
        some look clearly shows as crowd after it."""
        if len(look.crowd_ids):
            self._missed.pop(look.drone, None)
        shows = look.shows(shown_ids)
        own = self._shown.get(look.drone, _NONE)
        again = shows[are_among(shows, own)]
        self._shown[look.drone] = united(own[~are_among(own, look.closely(own).empty)], shows)
        self._note(look)
        return self._stayed(again, look.stamp_ns)

    def _note(self, look: CloseLook) -> None:
        """What a drone misses of the crowd that others showed, where nearly all of it looks empty to it."""
        of_others = [shown for other, shown in self._shown.items() if other != look.drone]
        there = look.closely(distinct(np.concatenate([_NONE, *of_others])))
        if there.is_denied is None:
            return
        if not there.is_denied:
            self._missed.pop(look.drone, None)
            return
        before = self._missed.get(look.drone, Missed(_NONE, look.stamp_ns))
        voxel_ids, looked_ns = united(before.voxel_ids, there.empty), max(look.stamp_ns, before.looked_ns)
        self._missed[look.drone] = before._replace(voxel_ids=voxel_ids, looked_ns=looked_ns)

    def _stayed(self, again: NDArray[np.int64], stamp_ns: int) -> dict[str, Missed]:
        stayed = {}
        for drone, missed in self._missed.items():
            is_again = np.count_nonzero(are_among(missed.voxel_ids, again)) >= LEAST_VOXELS
            if is_again and missed.looked_ns < stamp_ns:
                first_ns = missed.first_ns if missed.times else missed.looked_ns
                stayed[drone] = missed._replace(times=missed.times + 1, first_ns=first_ns)
        for drone, missed in stayed.items():
            self._missed[drone] = missed._replace(voxel_ids=_NONE)
        return stayed
