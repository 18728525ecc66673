"""Which zone is which from one instant to the next: ids that last, and what becomes of the zones.

A region of columns continues the zones whose columns it shares; where it shares none, the nearest zone that
nobody else continues, within a distance, so that an id survives a step of motion. Zones choose by age, the
oldest first: each keeps the region that shares most with it, unless an older zone has that one. A merge
therefore keeps the oldest id and a split leaves the id with the part that shares most; of equal shares the
first region's counts, and regions come in a fixed order (`regions.largest_first`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence.zones.zone_id import MOST_ID, zone_id

_ROUNDED = 1.0 + 1e-12
"""Distances between columns are roots of whole numbers, far farther apart than this."""
EventKind = Literal["created", "updated", "merged", "split", "expired"]


@dataclass(frozen=True, slots=True)
class ZoneEvent:
    """What became of a zone at an instant."""

    stamp_ns: int
    kind: EventKind
    """created: crowd where there was none; updated: other ground is closed; merged: it went into `other`;
    split: it came out of `other`; expired: no crowd is left of it, or too little for a zone."""
    id: str
    other: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A zone that is alive."""

    id: str
    number: int
    """Counts zones in the order of their creation: the smaller, the older."""
    created_ns: int
    columns: NDArray[np.int64]
    """Its columns as sorted keys [C], see `column_keys`."""


def column_keys(indices: NDArray[np.int64]) -> NDArray[np.int64]:
    """One number per column (i, j) [C, 2], sorted as they are: by i, then j."""
    return np.asarray((indices[:, 0] << 32) + indices[:, 1])


def column_places(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """(i, j) [C, 2] of keys."""
    j = ((keys + (1 << 31)) & 0xFFFFFFFF) - (1 << 31)
    return np.stack([(keys - j) >> 32, j], axis=1)


class ZoneTracker:
    """Remembers the zones that are alive. No id is used twice before two thousand million others were."""

    def __init__(self, letter: str = "Z", nearness_columns: float = 0.0) -> None:
        """`nearness_columns`: how far, in columns, a region may lie from the zone that it continues."""
        self._letter = letter
        self._nearness = nearness_columns
        self._created = 0
        self.alive: tuple[Track, ...] = ()

    def arrays(self) -> dict[str, NDArray[np.int64]]:
        """The columns of the zones that are alive, one after the other, and how many each has."""
        columns = [np.empty(0, dtype=np.int64), *(track.columns for track in self.alive)]
        return {
            "columns": np.concatenate(columns),
            "sizes": np.array([len(one) for one in columns[1:]], np.int64),
        }

    def to_json(self) -> dict[str, Any]:
        """Their names and ages."""
        return {
            "created": self._created,
            "tracks": [[track.id, track.number, track.created_ns] for track in self.alive],
        }

    def restore(self, told: Mapping[str, Any], arrays: Mapping[str, NDArray[np.int64]]) -> None:
        """What both gave. KeyError, TypeError or ValueError for anything else."""
        columns = np.split(arrays["columns"], np.cumsum(arrays["sizes"])[:-1])
        self.alive = tuple(
            Track(name, number, created_ns, one)
            for (name, number, created_ns), one in zip(told["tracks"], columns, strict=False)
        )
        self._created = told["created"]

    def step(
        self, regions: Sequence[NDArray[np.int64]], stamp_ns: int
    ) -> tuple[list[Track], list[ZoneEvent]]:
        """The zone of each region (sorted keys of its columns), and what became of all zones. "updated" is
        left to those who know the outlines."""
        shared = self._shared(regions)
        events: list[ZoneEvent] = []
        chosen: dict[int, Track] = {}
        last: dict[int, list[Track]] = {}
        for track in self.alive:  # the oldest first
            candidates = sorted(shared[track.id].items(), key=lambda entry: (-entry[1], entry[0]))
            for region, _ in candidates:
                last.setdefault(region, []).append(track)
            free = next((region for region, _ in candidates if region not in chosen), None)
            if free is not None:
                chosen[free] = track
            elif candidates:
                into = chosen[candidates[0][0]].id
                events.append(ZoneEvent(stamp_ns, "merged", track.id, into))
            else:
                events.append(ZoneEvent(stamp_ns, "expired", track.id))
        now = []
        for region, columns in enumerate(regions):
            old = chosen.get(region)
            if old is None:
                old = self._new(columns, stamp_ns)
                origin = last.get(region)
                kind: EventKind = "split" if origin else "created"
                events.append(ZoneEvent(stamp_ns, kind, old.id, origin[0].id if origin else None))
            now.append(Track(old.id, old.number, old.created_ns, columns))
        self.alive = tuple(sorted(now, key=lambda track: track.number))
        return now, events

    def continuing(self, regions: Sequence[NDArray[np.int64]]) -> list[int]:
        """Positions of the regions that continue a zone that is alive, sorted."""
        return sorted({region for shares in self._shared(regions).values() for region in shares})

    def _new(self, columns: NDArray[np.int64], stamp_ns: int) -> Track:
        alive = {track.id for track in self.alive}
        while True:  # once only, until every id has been used
            self._created += 1
            name = zone_id(1 + (self._created - 1) % MOST_ID, self._letter)
            if name not in alive:
                return Track(name, self._created, stamp_ns, columns)

    def _shared(self, regions: Sequence[NDArray[np.int64]]) -> dict[str, dict[int, int]]:
        """How many columns each zone shares with each region, none left out that shares any."""
        shared: dict[str, dict[int, int]] = {track.id: {} for track in self.alive}
        if not self.alive or not regions:
            return shared
        old = np.concatenate([track.columns for track in self.alive])
        old_zone = np.repeat(np.arange(len(self.alive)), [len(track.columns) for track in self.alive])
        new = np.concatenate(list(regions))
        new_region = np.repeat(np.arange(len(regions)), [len(columns) for columns in regions])
        _, at_old, at_new = np.intersect1d(old, new, assume_unique=True, return_indices=True)
        self._count(shared, old_zone[at_old], new_region[at_new])
        lonely_zones = np.setdiff1d(old_zone, old_zone[at_old])
        lonely_regions = np.setdiff1d(new_region, new_region[at_new])
        if self._nearness > 0.0 and len(lonely_zones) and len(lonely_regions):
            of_old, of_new = np.isin(old_zone, lonely_zones), np.isin(new_region, lonely_regions)
            near_old, near_new = _near(old[of_old], new[of_new], self._nearness)
            self._count(shared, old_zone[of_old][near_old], new_region[of_new][near_new])
        return shared

    def _count(
        self, shared: dict[str, dict[int, int]], zones: NDArray[np.int64], regions: NDArray[np.int64]
    ) -> None:
        # One number a pair: numpy sorts pairs as records, at several times the cost.
        width = int(regions.max(initial=0)) + 1
        pairs, counts = np.unique(zones * width + regions, return_counts=True)
        for pair, count in zip(pairs.tolist(), counts.tolist(), strict=True):
            zone, region = divmod(pair, width)
            shared[self.alive[zone].id][region] = count


def _near(
    old: NDArray[np.int64], new: NDArray[np.int64], reach: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Positions of the columns of `old` that are nearest to those of `new`, where they are within reach."""
    from scipy.spatial import cKDTree

    places, tree = column_places(new), cKDTree(column_places(old))
    distance, _ = tree.query(places, distance_upper_bound=np.nextafter(reach, np.inf))
    found = np.flatnonzero(np.isfinite(distance))
    # Equal distances go to the first: the oldest zone, since zones come by age. The tree names any of them.
    as_near = tree.query_ball_point(places[found], distance[found] * _ROUNDED)
    return np.array([min(equal) for equal in as_near], dtype=np.int64), found
