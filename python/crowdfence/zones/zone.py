"""What a zone is, and the zones of one moment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, overload

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

MAX_ID_LENGTH = 7
"""Longest identifier that ED-318 and ED-269 accept."""


@dataclass(frozen=True, slots=True)
class Zone:
    """One connected region of crowd, in local metres."""

    id: str
    """At most 7 characters, unique within one call of `find_zones` only."""
    polygon: Polygon | MultiPolygon
    """Outline in the local plane (x east, y north). A region whose cells touch only at corners is a
    MultiPolygon; ground enclosed by crowd, but below the threshold, is a hole."""
    cell_count: int
    area_m2: float
    probability_max: float
    probability_mean: float
    lower_m: float
    """Local height of the underside of the lowest terrain voxel in the zone's columns."""
    upper_m: float
    """Local height of the top of the highest terrain voxel in the zone's columns."""
    last_seen_ns: int
    """Newest look at any of its cells."""
    oldest_look_ns: int
    """Last look at the cell that has gone unseen for longest."""
    seen_by: tuple[str, ...]
    """Drones that have ever seen one of its crowd voxels, by name. A crowd map that was saved by a build that
    did not keep this knows nobody."""


@dataclass(frozen=True, slots=True)
class ZoneSet(Sequence[Zone]):
    """The zones of one call, largest first, and what was left out of them."""

    zones: tuple[Zone, ...]
    threshold: float
    min_area_m2: float
    dropped_count: int
    """Regions smaller than `min_area_m2`: crowd that no zone covers."""
    dropped_area_m2: float

    @overload
    def __getitem__(self, index: int) -> Zone: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Zone, ...]: ...
    def __getitem__(self, index: int | slice) -> Zone | tuple[Zone, ...]:
        return self.zones[index]

    def __len__(self) -> int:
        return len(self.zones)

    def __iter__(self) -> Iterator[Zone]:
        return iter(self.zones)

    @property
    def area_m2(self) -> float:
        return sum(zone.area_m2 for zone in self.zones)
