"""Points and paths in space and time against zones.

At a stamp counts what was known then: the zones of the last instant up to it. Later than the last instant
they stay closed, because forgetting is no evidence that people left; `expires` opens them at their
`valid_until`. Before the first instant nothing is known, and nothing is clear. Nor is anything beyond the
ground that the map of a mission knows, at any height, unless asked for: nobody can look there.

Clear means in no zone. Ground within the map that nobody has looked at, or that nobody could clear, is in no
zone either, unless the zones are those of a run with `close_unseen`.

A zone closes its outline from its band above the lowest ground to its band above the highest, in local
heights. One of which the ground is not known is closed at every height: zones of others, and those that close
ground which the map lacks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.errors import quoted
from crowdfence.planner.place_and_time import as_area, as_places, as_stamps
from crowdfence.prepared import prepared
from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.history import ZoneHistory

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon, STRtree

_Between = tuple[NDArray[np.float64], NDArray[np.float64]]

_BEFORE = -1
_FOREVER_NS = np.iinfo(np.int64).max
_ROUNDING = 1e-6
"""Metres: far more than what is lost in places within 1000 km of the origin."""
_NEAREST = 3
"""Zones by their middles that are looked at for a first bound of a distance."""
_FIRST_REACH_M = 100.0


@dataclass(frozen=True, slots=True)
class Conflict:
    """Where a path enters what is closed or not known."""

    leg: int
    """From waypoint `leg` to the next."""
    zone: str | None
    """Id of the zone; None: before the first instant, when nothing is known, or beyond the map."""
    beyond_map: bool = False
    """Whether the leg leaves the ground that the map knows."""


class ClearAir:
    """Questions about the zones of a mission, or of one moment; vectorised.

    Clear means in no zone, not seen empty: make the run with `ZoneConfig(close_unseen=True)` to keep off what
    nobody has seen. Threads may share one.
    """

    def __init__(
        self,
        zones: ZoneHistory | ZoneSet,
        *,
        expires: bool = False,
        within: Polygon | MultiPolygon | None = None,
        beyond_map: bool = False,
    ) -> None:
        """A `ZoneSet` by itself holds at every stamp, and knows no map: `within` is the area beyond which
        nothing is clear. A `ZoneHistory` brings its own, the ground of its map, where `within` is None;
        `beyond_map` leaves it out. ValueError for an area whose outline crosses itself."""
        self._within = as_area(within)
        if isinstance(zones, ZoneHistory):
            self._stamps_ns = np.asarray(zones.stamps_ns, dtype=np.int64)
            self._sets: Sequence[ZoneSet] = zones.sets
            if within is None and not beyond_map:
                self._within = zones.ground
        elif isinstance(zones, ZoneSet):
            self._stamps_ns = np.array([np.iinfo(np.int64).min])
            self._sets = [zones]
        else:
            raise TypeError(f"zones are {quoted(zones)}; they must be a ZoneHistory or a ZoneSet")
        self._expires = expires
        self._closed: dict[int, _Closed] = {}

    def is_clear(self, points: ArrayLike, stamps_ns: ArrayLike) -> NDArray[np.bool_]:
        """Whether points [N, 3] (local metres) lie in no zone at their stamps, [N] or one for all, and within
        the map."""
        points = as_places(points)
        stamps_ns = as_stamps(stamps_ns, len(points))
        clear = np.zeros(len(points), dtype=np.bool_)
        for number, members in self._by_set(stamps_ns):
            if number != _BEFORE:
                closed = self._of(number)
                places = points[members, :2]
                z_m = points[members, 2]
                point, zone = closed.met(_shapes(points[members]), (places, places), (z_m, z_m))
                hit = self._alive(closed, zone, stamps_ns[members[point]])
                inside = np.zeros(len(members), dtype=np.bool_)
                inside[point[hit]] = True
                clear[members] = ~inside
        return clear & self._over_area(_shapes(points))

    def clearance_m(self, points: ArrayLike, stamps_ns: ArrayLike) -> NDArray[np.float64]:
        """Distance of points [N, 3] from the nearest zone in space, or from the rim of the map where that is
        nearer; negative inside a zone and beyond the map: how deep. inf where nothing is closed, -inf before
        the first instant."""
        points = as_places(points)
        stamps_ns = as_stamps(stamps_ns, len(points))
        clearance = np.full(len(points), -np.inf)
        for number, members in self._by_set(stamps_ns):
            if number != _BEFORE:
                clearance[members] = self._clearance(number, points[members], stamps_ns[members])
        return np.minimum(clearance, self._to_rim_m(points))

    def path_is_clear(self, waypoints: ArrayLike, stamps_ns: ArrayLike) -> bool:
        """Whether the straight legs between waypoints [N, 3], each flown evenly between its stamps [N], meet
        no zone that is known while it is flown, and stay within the map."""
        return self.first_conflict(waypoints, stamps_ns) is None

    def first_conflict(self, waypoints: ArrayLike, stamps_ns: ArrayLike) -> Conflict | None:
        """The first leg that meets a zone or leaves the map, the zone where it does both; None where none
        does. ValueError for fewer than two waypoints and for stamps that go back."""
        points = as_places(waypoints)
        stamps_ns = as_stamps(stamps_ns, len(points))
        if len(points) < 2 or (np.diff(stamps_ns) < 0).any():
            raise ValueError("a path has at least two waypoints and stamps that do not go back")
        first: Conflict | None = None
        flown = _Legs(points[:-1], points[1:], stamps_ns[:-1], stamps_ns[1:])
        for legs, zones in self._conflicts(flown):
            for leg, name in zip(legs.tolist(), zones, strict=True):
                if first is None or (leg, name or "") < (first.leg, first.zone or ""):
                    first = Conflict(leg, name)
        beyond = np.flatnonzero(~self._stays(flown))
        if len(beyond) and (first is None or beyond[0] < first.leg):
            first = Conflict(int(beyond[0]), None, beyond_map=True)
        return first

    def legs_are_clear(
        self, start: ArrayLike, end: ArrayLike, begin_ns: ArrayLike, end_ns: ArrayLike
    ) -> NDArray[np.bool_]:
        """The same for many legs [N] at once that need not follow each other: from places `start` [N, 3] at
        `begin_ns` to places `end` [N, 3] at `end_ns`. ValueError for one that ends before it begins."""
        starts, ends = as_places(start), as_places(end)
        legs = _Legs(starts, ends, as_stamps(begin_ns, len(starts)), as_stamps(end_ns, len(ends)))
        if len(starts) != len(ends) or (legs.end_ns < legs.begin_ns).any():
            raise ValueError("every leg has a start and an end, and does not end before it begins")
        clear = self._stays(legs)
        for meeting, _, _ in self._meetings(legs):
            clear[meeting] = False
        return clear

    def _over_area(self, shapes: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether shapes [N] lie within the area."""
        import shapely

        if self._within is None:
            return np.ones(len(shapes), dtype=np.bool_)
        # Anew for every question: threads may ask at once. For one shape it would only cost.
        area = prepared(self._within) if len(shapes) > 1 else self._within
        return np.asarray(shapely.covers(area, shapes))

    def _stays(self, legs: _Legs) -> NDArray[np.bool_]:
        """Whether legs [N] do."""
        everything = np.arange(len(legs.start))
        # A line without length lies nowhere, as shapely sees it: the ends are asked as points besides.
        hovers = (legs.start[:, :2] == legs.end[:, :2]).all(axis=1)
        stays = self._over_area(legs.lines(everything))
        stays[hovers] = self._over_area(_shapes(legs.start[hovers]))
        return stays

    def _to_rim_m(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of points [N] from the rim of the area, negative beyond it; inf without one."""
        import shapely

        if self._within is None:
            return np.full(len(points), np.inf)
        shapes = _shapes(points)
        rim_m = np.nan_to_num(shapely.distance(self._within.boundary, shapes), nan=np.inf)  # of an empty one
        return np.where(self._over_area(shapes), rim_m, -rim_m)

    def _conflicts(self, legs: _Legs) -> Iterator[tuple[NDArray[np.int64], list[str | None]]]:
        """Legs that meet a zone and its id, one set of zones after the other."""
        for meeting, closed, zone in self._meetings(legs):
            if closed is None:
                yield meeting, [None] * len(meeting)
            else:
                yield meeting, [closed.zones[k].id for k in zone.tolist()]

    def _meetings(self, legs: _Legs) -> Iterator[tuple[NDArray[np.int64], _Closed | None, NDArray[np.int64]]]:
        """Legs that meet zones, these and their positions in it, one set of zones after the other; before the
        first instant no set and no zones."""
        leg, pieces, number = legs.cut_at(self._stamps_ns)
        for one, members in _alike(number):
            if one == _BEFORE:
                yield leg[members], None, np.empty(0, dtype=np.int64)
                continue
            closed = self._of(one)
            start, end = pieces.start[members], pieces.end[members]
            heights = np.minimum(start[:, 2], end[:, 2]), np.maximum(start[:, 2], end[:, 2])
            piece, zone = closed.met(pieces.lines(members), (start[:, :2], end[:, :2]), heights)
            of = members[piece]
            meets = closed.met_while_closed(zone, pieces.take(of), expires=self._expires)
            yield leg[of[meets]], closed, zone[meets]

    def _clearance(
        self, number: int, points: NDArray[np.float64], stamps_ns: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        closed = self._of(number)
        result = np.full(len(points), np.inf)
        if not closed.zones:
            return result
        shapes = _shapes(points)
        point, zone = closed.met(shapes, (points[:, :2], points[:, :2]), (points[:, 2], points[:, 2]))
        alive = self._alive(closed, zone, stamps_ns[point])
        point, zone = point[alive], zone[alive]
        depth_m = np.minimum(closed.edge_m(zone, shapes[point]), -closed.over_m(zone, points[point, 2]))
        np.minimum.at(result, point, -depth_m)
        outside = np.ones(len(points), dtype=np.bool_)
        outside[point] = False
        rest = np.flatnonzero(outside)
        result[rest] = self._apart_m(closed, points[rest], shapes[rest], stamps_ns[rest])
        return result

    def _apart_m(
        self,
        closed: _Closed,
        points: NDArray[np.float64],
        shapes: NDArray[Any],
        stamps_ns: NDArray[np.int64],
    ) -> NDArray[np.float64]:
        """Distance of points that lie in no zone from the nearest one."""
        if not len(points):
            return np.empty(0)
        apart_m = closed.at_most_m(points, lambda zone, point: self._alive(closed, zone, stamps_ns[point]))
        # Nearer zones lie within this reach, because all are so far above or below.
        least_m = closed.least_over_m(points[:, 2])
        reach_m = np.sqrt(np.maximum(apart_m**2 - least_m**2, 0.0))
        reach_m[np.isinf(apart_m)] = _FIRST_REACH_M
        asked = np.arange(len(points))
        while len(asked):
            reach = reach_m[asked]
            row, zone = closed.tree.query(_boxes(points[asked], reach))
            point = asked[row]
            kept = self._alive(closed, zone, stamps_ns[point])
            kept &= closed.at_least_m(zone, points[point]) <= apart_m[point]
            point, zone = point[kept], zone[kept]
            over_m = closed.over_m(zone, points[point, 2]).clip(0.0)
            np.minimum.at(apart_m, point, np.hypot(closed.beside_m(zone, shapes[point]), over_m))
            told = (apart_m[asked] <= np.hypot(reach, least_m[asked])) | (
                reach > closed.span_m(points[asked])
            )
            asked = asked[~told]
            reach_m[asked] *= 2.0
        return np.asarray(apart_m)

    def _alive(
        self, closed: _Closed, zone: NDArray[np.int64], stamps_ns: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        if not self._expires:
            return np.ones(len(zone), dtype=np.bool_)
        return np.asarray(stamps_ns < closed.until_ns[zone])

    def _by_set(self, stamps_ns: NDArray[np.int64]) -> list[tuple[int, NDArray[np.int64]]]:
        number = np.searchsorted(self._stamps_ns, stamps_ns, "right") - 1
        return _alike(number)

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
        return self._places(_share_until(self, stamps_ns))

    def between(self, first: NDArray[np.float64], last: NDArray[np.float64]) -> _Legs:
        """The parts of them from one share of each to another one, [N] in [0, 1], on their ways."""
        return self._replace(start=self._places(first), end=self._places(last))

    def _places(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        places = self.start + share[:, None] * (self.end - self.start)
        return np.where((share == 1.0)[:, None], self.end, places)

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
        from scipy.spatial import cKDTree

        self.zones = zones = [zone for zone in zones if not zone.polygon.is_empty]
        self.outlines = np.array([zone.polygon for zone in zones], dtype=object)
        self.tree: STRtree = shapely.STRtree(self.outlines)
        self._edges = shapely.boundary(self.outlines)
        self._middle, self._inner_m, self._outer_m = _discs(self.outlines, self._edges)
        self._middles = cKDTree(self._middle)
        self.lower_m, self.upper_m = np.array([_heights(zone) for zone in zones]).reshape(-1, 2).T
        self.until_ns = np.array(
            [_FOREVER_NS if zone.valid_until_ns is None else zone.valid_until_ns for zone in zones],
            dtype=np.int64,
        )

    def met(
        self, shapes: NDArray[Any], ends: _Between, heights_m: _Between
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Which of the straight `shapes` [N] between two ends [N, 2] and two heights [N], the lower one
        first, meet which zones: positions of both [M]. Most pairs are told by a disc in the outline and one
        around it; the others are asked."""
        import shapely

        shape, zone = self.tree.query(shapes)
        low_m, high_m = heights_m
        between = (high_m[shape] >= self.lower_m[zone]) & (low_m[shape] <= self.upper_m[zone])
        shape, zone = shape[between], zone[between]
        aside_m = _distance_m(self._middle[zone], ends[0][shape], ends[1][shape])
        meets = aside_m <= self._inner_m[zone]
        asked = np.flatnonzero(~meets & (aside_m <= self._outer_m[zone]))
        meets[asked] = shapely.intersects(self.outlines[zone[asked]], shapes[shape[asked]])
        return shape[meets], zone[meets]

    def over_m(self, zone: NDArray[np.int64], z_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far heights lie above or below zones, negative between."""
        return np.maximum(self.lower_m[zone] - z_m, z_m - self.upper_m[zone])

    def least_over_m(self, z_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far they lie above or below all zones at the least."""
        return np.maximum(self.lower_m.min() - z_m, z_m - self.upper_m.max()).clip(0.0)

    def edge_m(self, zone: NDArray[np.int64], shapes: NDArray[Any]) -> NDArray[np.float64]:
        """Distance from the edges of outlines."""
        import shapely

        return np.asarray(shapely.distance(self._edges[zone], shapes))

    def beside_m(self, zone: NDArray[np.int64], shapes: NDArray[Any]) -> NDArray[np.float64]:
        """Distance from outlines, on the ground plane."""
        import shapely

        return np.asarray(shapely.distance(self.outlines[zone], shapes))

    def at_least_m(self, zone: NDArray[np.int64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the distance of points from zones is not below."""
        middle_m = np.hypot(*(points[:, :2] - self._middle[zone]).T)
        over_m = self.over_m(zone, points[:, 2]).clip(0.0)
        return np.hypot((middle_m - self._outer_m[zone]).clip(0.0), over_m)

    def at_most_m(
        self, points: NDArray[np.float64], counts: Callable[[Any, Any], NDArray[np.bool_]]
    ) -> NDArray[np.float64]:
        """What the distance of points from the nearest zone is not above, of those that count; inf where none
        near by does."""
        apart_m = np.full(len(points), np.inf)
        rows = np.arange(len(points))
        _, nearest = self._middles.query(points[:, :2], k=min(_NEAREST, len(self.zones)))
        for zone in np.reshape(nearest, (len(points), -1)).T:
            middle_m = np.hypot(*(points[:, :2] - self._middle[zone]).T)
            beside_m = (middle_m - self._inner_m[zone]).clip(0.0)
            told_m = np.hypot(beside_m, self.over_m(zone, points[:, 2]).clip(0.0))
            np.minimum(apart_m, np.where(counts(zone, rows), told_m, np.inf), out=apart_m)
        return apart_m

    def span_m(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """No outline reaches farther than this from points, east, west, north or south."""
        import shapely

        west, south, east, north = shapely.total_bounds(self.outlines)
        sides = (points[:, 0] - west, east - points[:, 0], points[:, 1] - south, north - points[:, 1])
        return np.maximum.reduce(sides)

    def met_while_closed(self, zone: NDArray[np.int64], legs: _Legs, *, expires: bool) -> NDArray[np.bool_]:
        """Whether legs that meet outlines of zones meet them between their heights, and, where it `expires`,
        before they end: a leg that climbs may pass the outline above or below."""
        import shapely

        enters, leaves = _between_heights(legs, self.lower_m[zone], self.upper_m[zone])
        met = enters <= leaves
        if expires:
            until_ns = self.until_ns[zone]
            met &= legs.begin_ns < until_ns
            leaves = np.minimum(leaves, _share_until(legs, until_ns))
        in_part = np.flatnonzero(met & ((enters > 0.0) | (leaves < 1.0)))
        flown = legs.take(in_part).between(enters[in_part], leaves[in_part])
        lines = flown.lines(np.arange(len(in_part)))
        met[in_part] = (enters <= leaves)[in_part] & shapely.intersects(self.outlines[zone[in_part]], lines)
        return np.asarray(met)


def _alike(numbers: NDArray[np.int64]) -> list[tuple[int, NDArray[np.int64]]]:
    """Each number that occurs, the smallest first, and its positions, sorted: thousands in a long mission."""
    order = np.argsort(numbers, kind="stable")
    each, first = np.unique(numbers[order], return_index=True)
    return list(zip(each.tolist(), np.split(order, first[1:]), strict=False))


def _boxes(points: NDArray[np.float64], reach_m: NDArray[np.float64]) -> NDArray[Any]:
    import shapely

    low, high = points[:, :2] - reach_m[:, None], points[:, :2] + reach_m[:, None]
    return np.asarray(shapely.box(*low.T, *high.T))


def _discs(
    outlines: NDArray[Any], edges: NDArray[Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The middle of each outline [Z, 2] and two distances from it [Z]: what is nearer than the one lies in
    the outline, what is farther than the other outside. A middle beside its outline has how far, below 0."""
    import shapely

    middle = shapely.centroid(outlines)
    edge_m = shapely.distance(edges, middle)
    inner_m = np.where(shapely.contains(outlines, middle), edge_m, -edge_m) - _ROUNDING
    outer_m = shapely.hausdorff_distance(outlines, middle) + _ROUNDING
    return np.stack([shapely.get_x(middle), shapely.get_y(middle)], axis=1), inner_m, outer_m


def _distance_m(
    place: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Of places [N, 2] from straight legs [N, 2]."""
    along, to_place = end - start, place - start
    squared = np.einsum("ij,ij->i", along, along)
    share = np.einsum("ij,ij->i", along, to_place) / np.where(squared > 0.0, squared, 1.0)
    apart = to_place - share.clip(0.0, 1.0)[:, None] * along
    return np.asarray(np.hypot(apart[:, 0], apart[:, 1]))


def _share_until(legs: _Legs, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Of each leg what is flown at a stamp [N] not before its begin; 1 after its end."""
    flown_ns = np.minimum(stamps_ns, legs.end_ns) - legs.begin_ns
    share = flown_ns / np.maximum(legs.end_ns - legs.begin_ns, 1)
    return np.asarray(np.where(stamps_ns >= legs.end_ns, 1.0, share))


def _between_heights(
    legs: _Legs, lower_m: NDArray[np.float64], upper_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The shares of legs [N] between which they fly at heights from `lower_m` to `upper_m` [N], all of level
    ones; the first is the larger one where a leg never does."""
    low_m, high_m = lower_m - _ROUNDING - legs.start[:, 2], upper_m + _ROUNDING - legs.start[:, 2]
    rise_m = legs.end[:, 2] - legs.start[:, 2]
    is_level = rise_m == 0.0
    at = np.stack([low_m, high_m]) / np.where(is_level, 1.0, rise_m)
    enters = np.where(is_level, 0.0, at.min(axis=0))
    leaves = np.where(is_level, 1.0, at.max(axis=0))
    return enters.clip(min=0.0), leaves.clip(max=1.0)


def _heights(zone: Zone) -> tuple[float, float]:
    """Local heights between which a zone is closed."""
    if zone.kind == "static" or zone.band.datum != "AGL" or not zone.ground_is_known:
        return -np.inf, np.inf
    # What closes from the ground closes what is below the ground too: nobody knows it that well.
    lower_m = -np.inf if zone.band.lower_m <= 0.0 else zone.lower_m + zone.band.lower_m
    return lower_m, zone.upper_m + zone.band.upper_m


def _shapes(points: NDArray[np.float64]) -> NDArray[Any]:
    import shapely

    return np.asarray(shapely.points(points[:, :2]))
