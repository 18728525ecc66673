"""Points and paths in space and time against zones.

At a stamp counts what was known then: the zones of the last instant up to it. Later than the last instant
they stay closed, because forgetting is no evidence that people left; `expires` opens them at their
`valid_until`. Before the first instant nothing is known, and nothing is clear.

A zone closes its outline from its band above the lowest ground to its band above the highest, in local
heights. A zone of others, of which the ground is not known, is closed at every height.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.history import ZoneHistory

if TYPE_CHECKING:
    from shapely import STRtree

_BEFORE = -1
_FOREVER_NS = np.iinfo(np.int64).max


@dataclass(frozen=True, slots=True)
class Conflict:
    """Where a path enters what is closed."""

    leg: int
    """From waypoint `leg` to the next."""
    zone: str | None
    """Id of the zone; None: before the first instant, when nothing is known."""


class ClearAir:
    """Questions about the zones of a mission, or of one moment; vectorised."""

    def __init__(self, zones: ZoneHistory | ZoneSet, *, expires: bool = False) -> None:
        """A `ZoneSet` by itself holds at every stamp."""
        if isinstance(zones, ZoneHistory):
            self._stamps_ns = np.asarray(zones.stamps_ns, dtype=np.int64)
            self._sets: Sequence[ZoneSet] = zones.sets
        else:
            self._stamps_ns = np.array([np.iinfo(np.int64).min])
            self._sets = [zones]
        self._expires = expires
        self._closed: dict[int, _Closed] = {}

    def is_clear(self, points: ArrayLike, stamps_ns: ArrayLike) -> NDArray[np.bool_]:
        """Whether points [N, 3] (local metres) lie in no zone at their stamps, [N] or one for all."""
        points = _points(points)
        stamps_ns = _stamps(stamps_ns, points)
        clear = np.zeros(len(points), dtype=np.bool_)
        for number, members in self._by_set(stamps_ns):
            if number != _BEFORE:
                closed = self._of(number)
                point, zone = closed.tree.query(_shapes(points[members]), predicate="intersects")
                hit = closed.holds_height(zone, points[members[point], 2])
                hit &= self._alive(closed, zone, stamps_ns[members[point]])
                inside = np.zeros(len(members), dtype=np.bool_)
                inside[point[hit]] = True
                clear[members] = ~inside
        return clear

    def clearance_m(self, points: ArrayLike, stamps_ns: ArrayLike) -> NDArray[np.float64]:
        """Distance of points [N, 3] from the nearest zone in space, negative inside: how deep. inf where
        nothing is closed, -inf before the first instant."""
        points = _points(points)
        stamps_ns = _stamps(stamps_ns, points)
        clearance = np.full(len(points), -np.inf)
        for number, members in self._by_set(stamps_ns):
            if number != _BEFORE:
                clearance[members] = self._clearance(number, points[members], stamps_ns[members])
        return clearance

    def path_is_clear(self, waypoints: ArrayLike, stamps_ns: ArrayLike) -> bool:
        """Whether the straight legs between waypoints [N, 3], each flown evenly between its stamps [N], meet
        no zone that is known while it is flown."""
        return self.first_conflict(waypoints, stamps_ns) is None

    def first_conflict(self, waypoints: ArrayLike, stamps_ns: ArrayLike) -> Conflict | None:
        """The first leg that meets a zone; None where none does. ValueError for fewer than two waypoints and
        for stamps that go back."""
        points = _points(waypoints)
        stamps_ns = _stamps(stamps_ns, points)
        if len(points) < 2 or (np.diff(stamps_ns) < 0).any():
            raise ValueError("a path has at least two waypoints and stamps that do not go back")
        first: Conflict | None = None
        for legs, zones in self._conflicts(_Legs(points[:-1], points[1:], stamps_ns[:-1], stamps_ns[1:])):
            for leg, name in zip(legs.tolist(), zones, strict=True):
                if first is None or (leg, name or "") < (first.leg, first.zone or ""):
                    first = Conflict(leg, name)
        return first

    def legs_are_clear(
        self, start: ArrayLike, end: ArrayLike, begin_ns: ArrayLike, end_ns: ArrayLike
    ) -> NDArray[np.bool_]:
        """The same for many legs [N] at once that need not follow each other: from places `start` [N, 3] at
        `begin_ns` to places `end` [N, 3] at `end_ns`. ValueError for one that ends before it begins."""
        starts, ends = _points(start), _points(end)
        legs = _Legs(starts, ends, _stamps(begin_ns, starts), _stamps(end_ns, ends))
        if len(starts) != len(ends) or (legs.end_ns < legs.begin_ns).any():
            raise ValueError("every leg has a start and an end, and does not end before it begins")
        clear = np.ones(len(starts), dtype=np.bool_)
        for meeting, _ in self._conflicts(legs):
            clear[meeting] = False
        return clear

    def _conflicts(self, legs: _Legs) -> Iterator[tuple[NDArray[np.int64], list[str | None]]]:
        """Legs that meet a zone and its id, one set of zones after the other."""
        leg, pieces, number = legs.cut_at(self._stamps_ns)
        for one in np.unique(number).tolist():
            members = np.flatnonzero(number == one)
            if one == _BEFORE:
                yield leg[members], [None] * len(members)
                continue
            closed = self._of(one)
            piece, zone = closed.tree.query(pieces.lines(members), predicate="intersects")
            of = members[piece]
            hit = closed.meets_heights(zone, pieces.start[of, 2], pieces.end[of, 2])
            if self._expires:
                hit &= closed.met_alive(zone, pieces.take(of))
            yield leg[of[hit]], [closed.zones[k].id for k in zone[hit].tolist()]

    def _clearance(
        self, number: int, points: NDArray[np.float64], stamps_ns: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        import shapely

        closed = self._of(number)
        if not closed.zones:
            return np.full(len(points), np.inf)
        shapes = _shapes(points)
        # The nearest outline is the nearest zone where the point is between its heights.
        (_, nearest), aside = closed.tree.query_nearest(shapes, return_distance=True, all_matches=False)
        exact = closed.holds_height(nearest, points[:, 2]) & (aside > 0.0)
        exact &= self._alive(closed, nearest, stamps_ns)
        result = np.where(exact, aside, np.inf)
        rest = np.flatnonzero(~exact)
        for zone in range(len(closed.zones) if len(rest) else 0):
            beside = shapely.distance(closed.outlines[zone], shapes[rest])
            over = np.maximum(closed.lower_m[zone] - points[rest, 2], points[rest, 2] - closed.upper_m[zone])
            apart = np.hypot(beside, np.maximum(over, 0.0))
            edge = shapely.distance(closed.outlines[zone].boundary, shapes[rest])
            depth = -np.minimum(edge, -over)
            inside = (beside == 0.0) & (over <= 0.0)
            alive = self._alive(closed, np.full(len(rest), zone), stamps_ns[rest])
            distance = np.where(alive, np.where(inside, depth, apart), np.inf)
            result[rest] = np.minimum(result[rest], distance)
        return result

    def _alive(
        self, closed: _Closed, zone: NDArray[np.int64], stamps_ns: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        if not self._expires:
            return np.ones(len(zone), dtype=np.bool_)
        return np.asarray(stamps_ns < closed.until_ns[zone])

    def _by_set(self, stamps_ns: NDArray[np.int64]) -> list[tuple[int, NDArray[np.int64]]]:
        number = np.searchsorted(self._stamps_ns, stamps_ns, "right") - 1
        return [(int(one), np.flatnonzero(number == one)) for one in np.unique(number)]

    def _of(self, number: int) -> _Closed:
        if number not in self._closed:
            self._closed[number] = _Closed(self._sets[number].closed)
        return self._closed[number]


class _Legs(NamedTuple):
    """Straight legs, each flown evenly."""

    start: NDArray[np.float64]
    """[N, 3]"""
    end: NDArray[np.float64]
    begin_ns: NDArray[np.int64]
    """[N]"""
    end_ns: NDArray[np.int64]

    def take(self, members: NDArray[np.int64]) -> _Legs:
        start, end, begin_ns, end_ns = self
        return _Legs(start[members], end[members], begin_ns[members], end_ns[members])

    def lines(self, members: NDArray[np.int64]) -> NDArray[Any]:
        """On the ground plane."""
        import shapely

        ends = np.stack([self.start[members, :2], self.end[members, :2]], axis=1)
        return np.asarray(shapely.linestrings(ends))

    def at(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Where each is at its stamp [N, 3]."""
        duration_ns = np.maximum(self.end_ns - self.begin_ns, 1)
        share = (stamps_ns - self.begin_ns) / duration_ns
        places = self.start + share[:, None] * (self.end - self.start)
        return np.where((stamps_ns == self.end_ns)[:, None], self.end, places)

    def cut_at(self, stamps_ns: NDArray[np.int64]) -> tuple[NDArray[np.int64], _Legs, NDArray[np.int64]]:
        """Cut where stamps, sorted, lie in them: the leg of each piece, the pieces, and how many stamps lie
        up to its begin, less one."""
        low = np.searchsorted(stamps_ns, self.begin_ns, "right")
        count = np.searchsorted(stamps_ns, self.end_ns, "right") - low + 1
        leg = np.repeat(np.arange(len(count)), count)
        piece = np.arange(len(leg)) - np.repeat(np.cumsum(count) - count, count)
        number = low[leg] - 1 + piece
        whole = self.take(leg)
        begin_ns = np.where(piece == 0, whole.begin_ns, stamps_ns[np.maximum(number, 0)])
        is_last = piece == count[leg] - 1
        end_ns = np.where(is_last, whole.end_ns, stamps_ns[np.minimum(number + 1, len(stamps_ns) - 1)])
        start = np.where((piece == 0)[:, None], whole.start, whole.at(begin_ns))
        end = np.where(is_last[:, None], whole.end, whole.at(end_ns))
        return leg, _Legs(start, end, begin_ns, end_ns), number


class _Closed:
    """The zones of one moment, ready for questions."""

    def __init__(self, zones: Sequence[Zone]) -> None:
        import shapely

        self.zones = zones
        self.outlines = np.array([zone.polygon for zone in zones], dtype=object)
        self.tree: STRtree = shapely.STRtree(self.outlines)
        self.lower_m, self.upper_m = np.array([_heights(zone) for zone in zones]).reshape(-1, 2).T
        self.until_ns = np.array(
            [_FOREVER_NS if zone.valid_until_ns is None else zone.valid_until_ns for zone in zones],
            dtype=np.int64,
        )

    def holds_height(self, zone: NDArray[np.int64], z_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        return np.asarray((z_m >= self.lower_m[zone]) & (z_m <= self.upper_m[zone]))

    def meets_heights(
        self, zone: NDArray[np.int64], start_m: NDArray[np.float64], end_m: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Whether a leg that meets the outline may do so between the zone's heights."""
        low, high = np.minimum(start_m, end_m), np.maximum(start_m, end_m)
        return np.asarray((high >= self.lower_m[zone]) & (low <= self.upper_m[zone]))

    def met_alive(self, zone: NDArray[np.int64], legs: _Legs) -> NDArray[np.bool_]:
        """Whether legs that meet outlines of zones meet them before the zones end."""
        import shapely

        until_ns = self.until_ns[zone]
        met = legs.begin_ns < until_ns
        ends_under_way = np.flatnonzero(met & (until_ns < legs.end_ns))
        flown = legs.take(ends_under_way)
        flown = flown._replace(end=flown.at(until_ns[ends_under_way]))
        lines = flown.lines(np.arange(len(ends_under_way)))
        met[ends_under_way] = shapely.intersects(self.outlines[zone[ends_under_way]], lines)
        return np.asarray(met)


def _heights(zone: Zone) -> tuple[float, float]:
    """Local heights between which a zone is closed."""
    if zone.kind == "static" or zone.band.datum != "AGL":
        return -np.inf, np.inf
    # What closes from the ground closes what is below the ground too: nobody knows it that well.
    lower_m = -np.inf if zone.band.lower_m <= 0.0 else zone.lower_m + zone.band.lower_m
    return lower_m, zone.upper_m + zone.band.upper_m


def _points(points: ArrayLike) -> NDArray[np.float64]:
    array = np.atleast_2d(np.asarray(points, dtype=np.float64))
    if array.ndim != 2 or array.shape[1] != 3 or not np.isfinite(array).all():
        raise ValueError(f"points must be finite and [N, 3], got shape {list(np.shape(points))}")
    return array


def _stamps(stamps_ns: ArrayLike, points: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.broadcast_to(np.asarray(stamps_ns, dtype=np.int64), len(points))


def _shapes(points: NDArray[np.float64]) -> NDArray[Any]:
    import shapely

    return np.asarray(shapely.points(points[:, :2]))
