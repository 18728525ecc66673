"""Closed ground -> the regions of it that are zones, and which zone each is.

Those who draw zones and those who only count who stands in them both begin here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap
from crowdfence.zones.belief import ColumnBelief
from crowdfence.zones.closed_ground import ClosedGround
from crowdfence.zones.find import by_region
from crowdfence.zones.least_area import least_columns, of_those_kept
from crowdfence.zones.regions import Runs, largest_first, reach_columns
from crowdfence.zones.rules import CONTINUES_WITHIN_M, ZoneRules
from crowdfence.zones.tracker import Track, ZoneEvent, ZoneTracker, column_places


@dataclass(frozen=True, slots=True, eq=False)
class GroundStep:
    """What became of the ground at an instant."""

    belief: ColumnBelief
    """What the map says of all columns that are closed [C]."""
    keys: NDArray[np.int64]
    """[C] Their `column_keys`, sorted."""
    region: NDArray[np.int64]
    """[C] Which region each belongs to, the largest first; -1 for those too small for a zone."""
    dropped: list[int]
    """Columns of each region that is too small."""
    tracks: list[Track]
    """The zone that each region is."""
    events: list[ZoneEvent]


class ZoneGround:
    """Follows the ground of the zones of one crowd map; `step` after every instant, in order."""

    def __init__(self, crowd_map: CrowdMap, rules: ZoneRules) -> None:
        self._voxel_size_m = crowd_map.terrain.voxel_size_m
        self._rules = rules
        self.closed = ClosedGround(crowd_map, rules.threshold, rules.off_threshold, rules.opening_looks)
        self.tracker = ZoneTracker("Z", CONTINUES_WITHIN_M / self._voxel_size_m)

    @property
    def columns(self) -> NDArray[np.int64]:
        """(i, j) of what zones hold closed as of the last step [Z, 2], without what is closed around it."""
        alive = [track.columns for track in self.tracker.alive]
        return column_places(np.sort(np.concatenate([np.empty(0, np.int64), *alive])))

    def step(self, stamp_ns: int) -> GroundStep:
        """At the newest instant, or later if nothing came."""
        belief, keys = self.closed.step(stamp_ns)
        runs = Runs.of(belief.columns.indices)
        region = np.repeat(largest_first(runs, reach_columns(self._voxel_size_m)), runs.length)
        region, dropped = self._without_small(region, keys)
        order, first = by_region(region, int(region.max(initial=-1)) + 1)
        columns = np.split(keys[order], first[1:]) if len(first) else []
        tracks, events = self.tracker.step(columns, stamp_ns)
        return GroundStep(belief, keys, region, dropped, tracks, events)

    def _without_small(
        self, region: NDArray[np.int64], keys: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], list[int]]:
        """Regions that are large enough, still numbered by size, others -1; the columns of each of these. A
        region that continues a zone need only be half as large."""
        least = least_columns(self._rules.min_area_m2, self._voxel_size_m)
        size = np.bincount(region)
        kept = size >= least
        half = np.flatnonzero(size >= least / 2)
        if not kept[half].all():
            order, first = by_region(region, len(size))
            columns = np.split(keys[order], first[1:])
            kept[half[self.tracker.continuing([columns[number] for number in half])]] = True
        return of_those_kept(region, kept), size[~kept].tolist()
