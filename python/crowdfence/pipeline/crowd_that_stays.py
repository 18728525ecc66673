"""Looks that saw nobody at crowd that had not gone: who showed it before shows it there again.

What a look shows stands for 2 s. Where drones look less often than that, nothing stands when another one
looks there and sees nobody, and only the next look tells which of the two was right.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Observation
from crowdfence.zones.sorted_keys import are_among, united

LEAST_VOXELS = 20
"""That somebody shows within a look, or it says nothing."""
SHARP_M = 0.3
"""Metres per pixel up to which nobody should be missed there."""
NOBODY = 0.05
"""A smaller value shows nobody."""
NEARLY_ALL = 0.95
CROWD = 0.5
"""A larger value shows crowd."""
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
    """Looks at observations as they pass."""

    def __init__(self) -> None:
        self._shown: dict[str, NDArray[np.int64]] = {}
        """What each drone clearly showed and did not see empty since, sorted."""
        self._missed: dict[str, Missed] = {}
        """Of every drone that saw nobody since it last saw anybody."""

    def look(self, observation: Observation, shown_ids: NDArray[np.int64]) -> dict[str, Missed]:
        """By drone what it missed, where this observation shows the same crowd again; `shown_ids` are voxels
        that some look clearly shows as crowd after it."""
        drone, voxel_ids = observation.drone, observation.voxel_ids
        shows = voxel_ids[observation.mean > CROWD]
        if len(shows):
            self._missed.pop(drone, None)
        shows = shows[are_among(shows, shown_ids)]
        own = self._shown.get(drone, _NONE)
        again = shows[are_among(shows, own)]
        closely = looks_closely(observation)
        empty = voxel_ids[closely & (observation.mean < NOBODY)]
        self._shown[drone] = united(own[~are_among(own, empty)], shows)
        self._note(drone, voxel_ids[closely], empty, observation.stamp_ns)
        return self._stayed(again, observation.stamp_ns)

    def _note(self, drone: str, closely: NDArray[np.int64], empty: NDArray[np.int64], stamp_ns: int) -> None:
        """What a drone misses of the crowd that others showed, where nearly all of it looks empty to it."""
        of_others = [shown for other, shown in self._shown.items() if other != drone]
        there = np.concatenate([_NONE, *of_others])
        looked, missed = (ids[are_among(ids, there)] for ids in (closely, empty))
        if len(looked) < LEAST_VOXELS:
            return
        if len(missed) < NEARLY_ALL * len(looked):
            self._missed.pop(drone, None)
            return
        before = self._missed.get(drone, Missed(_NONE, stamp_ns))
        voxel_ids, looked_ns = united(before.voxel_ids, missed), max(stamp_ns, before.looked_ns)
        self._missed[drone] = before._replace(voxel_ids=voxel_ids, looked_ns=looked_ns)

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


def looks_closely(observation: Observation) -> NDArray[np.bool_]:
    """Of its voxels, whether nobody should be missed there."""
    near = observation.range_m <= SHARP_M * observation.focal_px
    return np.asarray(near & (observation.tilt_deg > 0.0))
