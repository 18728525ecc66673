"""The shortest way round the zones of one moment, and when it is where.

Where the zones are polygons, the shortest way turns at their corners only. The graph of corners that see each
other is searched by scipy's Dijkstra, first round no zones, then round those that the way met, until it meets
no other. Zones are grown by the clearance first; where those met have more corners than can be searched, the
corners are those of outlines around them, and another way is looked for, over open ground from triangle to
triangle: the better one is clear, but it may not be the shortest. The rim of an area is turned round like a
zone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.planner.corners import MOST_CORNERS, Corners, TooManyCorners, corners_round, joined, seen
from crowdfence.planner.open_ground import ground_round, way_over_open_ground
from crowdfence.planner.place_and_time import MOST_PLACE_M, MOST_STAMP_NS, as_area, as_stamps, told
from crowdfence.planner.timed_way import earliest_way
from crowdfence.planner.zones_met import ZonesMet
from crowdfence.prepared import prepared
from crowdfence.unmasked import require_unmasked
from crowdfence.zones import Zone
from crowdfence.zones.zone import closed_of

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

MOST_CLEARANCE_M = 1e6
MOST_ROUGH_ROUNDS = 5
"""Ways over corners of coarser outlines before all zones are taken at once."""
SPEEDS_M_S = (0.01, 10_000.0)
"""With the slower one a way across the Earth ends at a stamp that still fits a machine word."""


class NoRoute(ValueError):
    """There is no way; the message says why."""


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """A way in the local plane."""

    waypoints: NDArray[np.float64]
    """[N, 2] local metres, from the start to the goal. A place where the vehicle waits stands there twice."""
    stamps_ns: NDArray[np.int64] | None = None
    """[N] When it is there; None where no departure was given."""

    @property
    def length_m(self) -> float:
        return float(np.linalg.norm(np.diff(self.waypoints, axis=0), axis=1).sum())

    @property
    def direct_m(self) -> float:
        """As the crow flies."""
        return float(np.linalg.norm(self.waypoints[-1] - self.waypoints[0]))


def safe_route(
    start: ArrayLike,
    goal: ArrayLike,
    zones: Sequence[Zone],
    *,
    clearance_m: float = 0.0,
    within: Polygon | MultiPolygon | None = None,
    departure_ns: int | None = None,
    speed_m_s: float | None = None,
    expires: bool = False,
) -> Route:
    """The shortest way from `start` to `goal` [2] (local metres) that keeps `clearance_m` >= 0 from every
    zone and stays `within` an area.

    Clear means in no zone, not seen empty: make the run with `ZoneConfig(close_unseen=True)` to keep off what
    nobody has seen.

    zones         those known at the departure; all of them stay closed. Of a `ZoneSet` all that it closes
                  (`ZoneSet.closed`), unseen ground and zones of others too
    within        the area, most often the ground that the map knows, `ZoneHistory.ground`: beyond it there
                  are no zones because nobody can look, not because nobody is there. None: no bound
    departure_ns  and `speed_m_s`, .01 to 10,000: the way says when it is where
    expires       zones may be flown through after their `valid_until_ns`: the earliest way, which may wait,
                  never in a zone. A zone without such an end, or with one beyond 2116, stays closed for good

    NoRoute where there is none, ValueError for no place, stamp or area, and for a departure without a speed.
    """
    import shapely

    zones = closed_of(zones)
    within = as_area(within)
    for end in (start, goal):
        require_unmasked(end, "start and goal")
    ends = np.asarray([start, goal], dtype=np.float64)
    if ends.shape != (2, 2) or not (np.abs(ends) <= MOST_PLACE_M).all():
        raise ValueError(
            f"start and goal must be two places [2] within {MOST_PLACE_M:g} m, got {told(start)} and "
            f"{told(goal)}"
        )
    if not 0.0 <= clearance_m <= MOST_CLEARANCE_M:
        raise ValueError(f"clearance_m is {clearance_m:g}; it must lie between 0 and {MOST_CLEARANCE_M:g}")
    _require_clock(departure_ns, speed_m_s, expires)
    if departure_ns is not None:
        departure_ns = int(as_stamps(departure_ns, 1)[0])
    if expires and departure_ns is not None:  # what has ended by then is open, at the start too
        zones = tuple(zone for zone in zones if _end_ns(zone) > departure_ns)
    # Who waits until the last stamps that there are arrives beyond them.
    does_end = [expires and _end_ns(zone) <= MOST_STAMP_NS for zone in zones]
    lasting = ZonesMet([zone for zone, ends in zip(zones, does_end, strict=True) if not ends], clearance_m)
    ending = ZonesMet([zone for zone, ends in zip(zones, does_end, strict=True) if ends], clearance_m)
    _require_free("start", ends[0], (lasting, ending), clearance_m, within)
    # A goal in a zone that ends can be reached after its end.
    _require_free("goal", ends[1], (lasting,), clearance_m, within)
    within = None if within is None else prepared(within)
    area, few, rough_rounds = None, False, 0
    while True:
        try:
            route, is_exact = _round(ends, lasting, ending, area, departure_ns, speed_m_s, few=few)
        except TooManyCorners:
            few = True
            continue
        if route is None:
            other = None if is_exact else _over_open_ground(ends, lasting, ending, within)
            if other is None:
                raise NoRoute(_none_found(ends, lasting, within, is_exact=is_exact))
            return _timed(other, departure_ns, speed_m_s)
        way = shapely.LineString(route.waypoints)
        leaves = area is None and within is not None and not within.covers(way)
        if leaves:
            area = within
        # Round some zones the way is no longer than round all: where it meets no other it is the same.
        if not any([lasting.add(way), ending.add(way), leaves]):
            other = None if is_exact else _over_open_ground(ends, lasting, ending, within)
            if other is None:
                return route
            return min(route, _timed(other, departure_ns, speed_m_s), key=_arrival)
        rough_rounds += not is_exact
        if rough_rounds == MOST_ROUGH_ROUNDS:
            lasting.add_all()
            ending.add_all()


def _round(
    ends: NDArray[np.float64],
    lasting: ZonesMet,
    ending: ZonesMet,
    within: Polygon | MultiPolygon | None,
    departure_ns: int | None,
    speed_m_s: float | None,
    *,
    few: bool,
) -> tuple[Route | None, bool]:
    """The way from the first of two places to the second round the zones that were met so far, None where
    there is none; whether all corners were looked at. TooManyCorners unless a `few` do."""
    import shapely

    closed = shapely.union_all(lasting.grown)
    shapely.prepare(closed)
    between = Corners.at_any_angle(ends)
    if not ending.zones:
        corners = joined(between, corners_round(closed, within, few=few))
        way = _shortest(corners, closed, within, few=few)
        return None if way is None else _timed(way, departure_ns, speed_m_s), corners.are_all
    assert departure_ns is not None and speed_m_s is not None  # expires needs both
    # A way that waits for the end of a zone may lead through it from its corner, at any angle.
    around_all = shapely.union_all([closed, *ending.grown])
    corners = between
    for one in (closed, around_all):
        some = corners_round(one, within, few=True)
        corners = joined(corners, some)
        if not (some.are_all or few):
            corners = joined(corners, corners_round(one, within))
    ends_s = np.array([(_end_ns(zone) - departure_ns) / 1e9 for zone in ending.zones])
    edges = seen(corners, closed, within, few=few)
    found = earliest_way(corners.places, edges, ending.grown, ends_s, speed_m_s)
    flown = None if found is None else _with_waits(corners.places, found, departure_ns)
    # Beside coarser ones all of them are there, unless a few are asked.
    return flown, corners.are_all or not few


def _timed(way: NDArray[np.float64], departure_ns: int | None, speed_m_s: float | None) -> Route:
    """Places [N, 2] flown one after the other without a wait."""
    if departure_ns is None or speed_m_s is None:
        return Route(way)
    flown_m = np.concatenate([[0.0], np.linalg.norm(np.diff(way, axis=0), axis=1).cumsum()])
    return Route(way, _stamps_ns(departure_ns, flown_m / speed_m_s))


def _arrival(route: Route) -> float:
    return route.length_m if route.stamps_ns is None else float(route.stamps_ns[-1])


def _over_open_ground(
    ends: NDArray[np.float64], lasting: ZonesMet, ending: ZonesMet, within: Polygon | MultiPolygon | None
) -> NDArray[np.float64] | None:
    """A way [N, 2] past the grown outlines of all zones, whether they end or not, over its own corners as
    short as it can be; None where none was found."""
    import shapely

    closed = shapely.union_all([*lasting.all_grown, *ending.all_grown])
    shapely.prepare(closed)
    way = way_over_open_ground(ends, closed, within or ground_round(closed, ends))
    if way is None or len(way) > MOST_CORNERS:
        return way
    corners = Corners.at_any_angle(np.vstack([ends, way[1:-1]]))
    return _shortest(corners, closed, within, few=True)


def _require_clock(departure_ns: int | None, speed_m_s: float | None, expires: bool) -> None:
    if (departure_ns is None) != (speed_m_s is None) or (expires and departure_ns is None):
        raise ValueError("departure_ns and speed_m_s belong together, and expires needs both")
    slowest, fastest = SPEEDS_M_S
    if speed_m_s is not None and not slowest <= speed_m_s <= fastest:
        raise ValueError(f"speed_m_s is {speed_m_s:g}; it must lie between {slowest:g} and {fastest:g}")


def _end_ns(zone: Zone) -> float:
    return math.inf if zone.valid_until_ns is None else zone.valid_until_ns


def _with_waits(
    places: NDArray[np.float64], found: tuple[list[int], list[float], list[float]], departure_ns: int
) -> Route:
    way, at_s = [], []
    for place, arrival_s, left_s in zip(*found, strict=True):
        way += [places[place]]
        at_s += [arrival_s]
        if left_s > arrival_s:
            way += [places[place]]
            at_s += [left_s]
    return Route(np.array(way), _stamps_ns(departure_ns, np.array(at_s)))


def _stamps_ns(departure_ns: int, after_s: NDArray[np.float64]) -> NDArray[np.int64]:
    return departure_ns + np.ceil(after_s * 1e9).astype(np.int64)


def _none_found(
    ends: NDArray[np.float64], lasting: ZonesMet, within: Polygon | MultiPolygon | None, *, is_exact: bool
) -> str:
    """Why there is no way: over corners of coarser outlines a narrow one is missed."""
    area = "" if within is None else " within the area"
    if is_exact or not lasting.leave_open(ends, within):
        return f"there is no way{area}: zones close every one of them"
    return (
        f"no way was found{area}, though zones leave one open: their outlines have too many corners to look "
        "at all, and over coarser ones it is too narrow; plan it over places between"
    )


def _require_free(
    name: str,
    place: NDArray[np.float64],
    closed: Sequence[ZonesMet],
    clearance_m: float,
    within: Polygon | MultiPolygon | None,
) -> None:
    import shapely

    point = shapely.Point(place)
    if within is not None and not within.covers(point):
        raise NoRoute(f"the {name} ({place[0]:.1f}, {place[1]:.1f}) lies outside the area")
    zones = [zone for some in closed for zone in some.closing(point)]
    if zones:
        nearest = min(zones, key=lambda zone: zone.polygon.distance(point))
        distance_m = nearest.polygon.distance(point)
        where = f"in zone {nearest.id}" if distance_m == 0.0 else f"{distance_m:.1f} m from zone {nearest.id}"
        raise NoRoute(
            f"the {name} ({place[0]:.1f}, {place[1]:.1f}) lies {where}; the clearance is {clearance_m:g} m"
        )


def _shortest(
    corners: Corners, closed: Any, within: Polygon | MultiPolygon | None, *, few: bool
) -> NDArray[np.float64] | None:
    """From the first place to the second one over the others."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    places = corners.places
    first, second = seen(corners, closed, within, few=few).T
    lengths = np.linalg.norm(places[first] - places[second], axis=1)
    graph = coo_array((lengths, (first, second)), shape=(len(places), len(places)))
    distance, before = dijkstra(graph.tocsr(), directed=False, indices=0, return_predecessors=True)
    if not np.isfinite(distance[1]):
        return None
    order = [1]
    while order[-1] != 0:
        order.append(int(before[order[-1]]))
    return places[order[::-1]]
