"""What a zone is, and the zones of one moment."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, overload

from crowdfence.zones.altitude_band import DEFAULT_BAND, AltitudeBand
from crowdfence.zones.area import require_area
from crowdfence.zones.evidence import DroneEvidence
from crowdfence.zones.rules import Restriction
from crowdfence.zones.square_metres import square_metres
from crowdfence.zones.tracker import ZoneEvent

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon
    from shapely.geometry.base import BaseGeometry

NEVER_NS = -1
"""Stamp of a look that there was not."""

ZoneKind = Literal["crowd", "unseen", "static"]
"""Crowd; ground that is not known to be empty; a zone that somebody else drew."""

Reason = Literal["seen", "not_cleared", "not_looked_at", "held", "never_cleared", "given"]
"""Why a zone is closed:

seen           a drone saw crowd in it at this instant
not_cleared    drones looked at it at this instant and saw too little to be sure that nobody is there
not_looked_at  crowd was seen, nobody has looked since, and it is not forgotten yet
held           below the threshold, but not below the one at which a zone ends, or not at enough looks,
               or at looks too coarse to tell, or not for 2 s since a drone clearly showed crowd
never_cleared  ground that was never seen, is hidden, was looked at and not cleared, or was seen too long ago
given          somebody else closed it
"""


@dataclass(frozen=True, slots=True)
class Zone:
    """One region of crowd, of one or more parts, in local metres."""

    id: str
    """At most 7 characters: `find_zones` counts, a `ZoneEngine` keeps it as long as the zone lives."""
    polygon: Polygon | MultiPolygon
    """What is closed, in the local plane (x east, y north). Of crowd that lies together and does not touch,
    or at corners only, a MultiPolygon; ground enclosed by crowd, but below the threshold, is a hole."""
    cell_count: int
    area_m2: float
    """Of the columns that hold crowd; `polygon.area` is what is closed. Zones that no look at crowd made have
    no such columns, and the area of all that they close."""
    probability_max: float
    probability_mean: float
    lower_m: float
    """Local height of the underside of the lowest terrain voxel in the zone's columns (where more than these
    is closed: in the bounds of all that is)."""
    upper_m: float
    """Local height of the top of the highest terrain voxel, likewise. Equal to `lower_m` where nobody knows
    the ground: below zones of others that the map does not hold."""
    last_seen_ns: int
    """Newest look at any of its cells."""
    oldest_look_ns: int
    """Last look at the cell that has gone unseen for longest."""
    seen_by: tuple[str, ...]
    """Drones that have ever seen one of its crowd voxels, by name. A crowd map that was saved by a build that
    did not keep this knows nobody."""
    kind: ZoneKind = "crowd"
    restriction: Restriction = "prohibited"
    band: AltitudeBand = DEFAULT_BAND
    crowd_outline: Polygon | MultiPolygon | None = None
    """The columns of crowd alone, where more is closed."""
    created_ns: int | None = None
    """Instant at which it appeared."""
    valid_until_ns: int | None = None
    """When the zone ends if nobody looks at it again; None where the method knows no such time."""
    forgotten_ns: int | None = None
    """When, if nobody looks again, it is no longer known whether crowd is there, for methods that forget
    towards "not known". The zone stays: only a look ends it."""
    interval: tuple[float, float] | None = None
    """Bounds between which its largest probability lies, nine times in ten, where the method has them
    (`CrowdMap.interval`); those of `paper` and `or` are no measured rates."""
    evidence: tuple[DroneEvidence, ...] = ()
    """What each drone showed of it, by name, since it was created."""
    reason: Reason | None = None
    """Why it is closed at the instant of its zone set."""
    leaves_map: bool = False
    """Whether it closes ground that the map lacks, beyond its rim or in a hole, of which `lower_m` and
    `upper_m` say nothing."""
    name: str | None = None
    """What the file of somebody else calls it, where its id does not say so."""

    def __eq__(self, other: object) -> bool:
        """All of both is the same. In the comparison that a dataclass has by itself no NaN is another one,
        from Python 3.13 on, and zones that no look made would be new ones whenever they come."""
        if not isinstance(other, Zone):
            return NotImplemented
        pairs = ((getattr(self, one.name), getattr(other, one.name)) for one in fields(self))
        return self is other or all(
            mine == theirs or (mine != mine and theirs != theirs) for mine, theirs in pairs
        )

    @classmethod
    def of_no_look(
        cls,
        id: str,
        polygon: Polygon | MultiPolygon,
        kind: ZoneKind,
        reason: Reason,
        *,
        ground_m: tuple[float, float] = (0.0, 0.0),
        leaves_map: bool = False,
        restriction: Restriction = "prohibited",
        band: AltitudeBand = DEFAULT_BAND,
        created_ns: int | None = None,
        name: str | None = None,
    ) -> Zone:
        """A zone that no look at crowd made, which knows no probability. `ground_m`: its lowest and highest
        ground, equal where nobody knows them. ValueError for an outline that crosses itself."""
        if kind != "unseen":  # that is an engine's own, of up to a million corners
            require_area(polygon, f"zone {id}")
        return cls(
            id=id,
            polygon=polygon,
            cell_count=0,
            area_m2=float(polygon.area),
            probability_max=math.nan,
            probability_mean=math.nan,
            lower_m=ground_m[0],
            upper_m=ground_m[1],
            last_seen_ns=NEVER_NS,
            oldest_look_ns=NEVER_NS,
            seen_by=(),
            kind=kind,
            restriction=restriction,
            band=band,
            created_ns=created_ns,
            reason=reason,
            leaves_map=leaves_map,
            name=name,
        )

    @property
    def ground_is_known(self) -> bool:
        """Whether all of its ground lies between `lower_m` and `upper_m`; the map's voxels are never flat."""
        return self.lower_m < self.upper_m and not self.leaves_map

    def __repr__(self) -> str:
        crowd = f"{square_metres(self.area_m2)} of crowd, P up to {self.probability_max:.2f}"
        what = crowd if self.kind == "crowd" else f"{self.kind}, {square_metres(self.polygon.area)}"
        return f"Zone({self.id!r}, {what})"


@dataclass(frozen=True, slots=True)
class ZoneSet(Sequence[Zone]):
    """The zones of crowd of one moment, largest first, what was left out of them, and what else is closed."""

    zones: tuple[Zone, ...]
    threshold: float
    min_area_m2: float
    dropped_count: int
    """Regions smaller than `min_area_m2`: crowd in no zone but, where it is closed, that of
    unseen ground."""
    dropped_area_m2: float
    unseen: tuple[Zone, ...] = ()
    """Ground that is closed because it is not known to be empty."""
    static: tuple[Zone, ...] = ()
    """Zones that somebody else drew."""
    events: tuple[ZoneEvent, ...] = ()
    """What became of the zones at this instant."""

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
    def closed(self) -> tuple[Zone, ...]:
        """Everything that is closed: crowd, unseen ground, zones of others."""
        return (*self.zones, *self.unseen, *self.static)

    @property
    def closed_m2(self) -> float:
        """Of everything that is closed, ground in several zones once."""
        import shapely

        def beyond(drawn: BaseGeometry, other: BaseGeometry) -> BaseGeometry:
            """What is drawn outside of another; that has thousands of corners, few of them near."""
            if drawn.is_empty:
                return drawn
            return shapely.difference(drawn, shapely.intersection(other, shapely.box(*drawn.bounds)))

        given = _Together.of(tuple(zone.polygon for zone in self.static))
        crowd = shapely.union_all([zone.polygon for zone in self.zones])
        crowd = beyond(crowd, given.near(crowd))
        # One zone as a rule.
        outlines = [zone.polygon for zone in self.unseen]
        unseen = outlines[0] if len(outlines) == 1 else shapely.union_all(outlines)
        twice_m2 = shapely.intersection(unseen, given.near(unseen)).area
        return float(unseen.area + given.area_m2 - twice_m2 + beyond(crowd, unseen).area)

    @property
    def area_m2(self) -> float:
        """Of the crowd in the zones."""
        return sum(zone.area_m2 for zone in self.zones)


class _Together:
    """The ground of zones of others, which may be thousands, and are the same at every instant."""

    def __init__(self, outlines: Sequence[Polygon | MultiPolygon]) -> None:
        import shapely

        # Those that touch no other are not joined: all at once takes seconds.
        self._parts = shapely.get_parts(shapely.disjoint_subset_union_all(list(outlines)))
        self._tree = shapely.STRtree(self._parts)
        self.area_m2 = float(shapely.area(self._parts).sum())

    @staticmethod
    @lru_cache(maxsize=4)
    def of(outlines: tuple[Polygon | MultiPolygon, ...]) -> _Together:
        return _Together(outlines)

    def near(self, drawn: BaseGeometry) -> MultiPolygon:
        """Its parts whose bounds meet those of what is drawn."""
        import shapely

        return shapely.MultiPolygon(list(self._parts[self._tree.query(drawn)]))


def are_same(zones: Sequence[Zone], others: Sequence[Zone]) -> bool:
    """Nobody changes zones: what stayed as it was is the same object."""
    return len(zones) == len(others) and all(one is other for one, other in zip(zones, others, strict=True))


def closed_of(zones: Sequence[Zone]) -> tuple[Zone, ...]:
    """All that zones close: of a `ZoneSet`, which is a sequence of its crowds alone, the rest too."""
    return zones.closed if isinstance(zones, ZoneSet) else tuple(zones)
