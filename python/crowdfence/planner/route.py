"""The shortest way round the zones of one moment, and when it is where.

Where the zones are polygons, the shortest way turns at their corners only. The graph of corners that see each
other is searched by scipy's Dijkstra. Zones are grown by the clearance first; where they have more corners
than can be searched, the corners are those of outlines around them: a way that is found is clear, but it may
not be the shortest, and a narrow one may be missed. The rim of an area is turned round like a zone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.planner.place_and_time import MOST_PLACE_M, as_stamps, told
from crowdfence.planner.timed_way import earliest_way
from crowdfence.zones import Zone
from crowdfence.zones.grow import grown
from crowdfence.zones.zone import closed_of

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

MOST_CLEARANCE_M = 1e6
SPEEDS_M_S = (0.01, 10_000.0)
"""With the slower one a way across the Earth ends at a stamp that still fits a machine word."""
MOST_CORNERS = 350
TURN_M = 0.05
"""Corners of the way lie so far outside the zones and their clearance."""
_FIRST_TOLERANCE_M = 0.25


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
                  never in a zone. A zone without such an end stays closed for good

    NoRoute where there is none, ValueError for no place or stamp, and for a departure without a speed.
    """
    import shapely

    zones = closed_of(zones)
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
    ending = [zone for zone in zones if expires and zone.valid_until_ns is not None]
    lasting = [zone for zone in zones if not (expires and zone.valid_until_ns is not None)]
    closed = shapely.union_all(_grown(lasting, clearance_m))
    shapely.prepare(closed)
    shapely.prepare(within)
    # A goal in a zone that ends can be reached after its end.
    around_all = shapely.union_all([closed, *_grown(ending, clearance_m)]) if ending else closed
    for name, place, now in (("start", ends[0], around_all), ("goal", ends[1], closed)):
        _require_free(name, place, now, zones if now is around_all else lasting, clearance_m, within)
    if departure_ns is None or speed_m_s is None:
        return Route(_shortest(np.vstack([ends, _few_corners(closed, within)]), closed, within))
    if not ending:
        way = _shortest(np.vstack([ends, _few_corners(closed, within)]), closed, within)
        flown_m = np.concatenate([[0.0], np.linalg.norm(np.diff(way, axis=0), axis=1).cumsum()])
        return Route(way, _stamps_ns(departure_ns, flown_m / speed_m_s))
    corners = [_few_corners(closed, within), _few_corners(around_all, within)]
    places = np.vstack([ends, *corners])
    ends_s = np.array([(_end_ns(zone) - departure_ns) / 1e9 for zone in ending])
    edges = _seen(places, closed, within)
    found = earliest_way(places, edges, _grown(ending, clearance_m), ends_s, speed_m_s)
    if found is None:
        raise NoRoute(_closed_off(within))
    return _with_waits(places, found, departure_ns)


def _require_clock(departure_ns: int | None, speed_m_s: float | None, expires: bool) -> None:
    if (departure_ns is None) != (speed_m_s is None) or (expires and departure_ns is None):
        raise ValueError("departure_ns and speed_m_s belong together, and expires needs both")
    slowest, fastest = SPEEDS_M_S
    if speed_m_s is not None and not slowest <= speed_m_s <= fastest:
        raise ValueError(f"speed_m_s is {speed_m_s:g}; it must lie between {slowest:g} and {fastest:g}")


def _grown(zones: Sequence[Zone], clearance_m: float) -> list[Polygon | MultiPolygon]:
    return [grown(zone.polygon, clearance_m) for zone in zones]


def _end_ns(zone: Zone) -> int:
    assert zone.valid_until_ns is not None
    return zone.valid_until_ns


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


def _closed_off(within: Polygon | MultiPolygon | None) -> str:
    area = "" if within is None else " within the area"
    return f"there is no way{area}: zones close every one of them"


def _few_corners(closed: Any, within: Polygon | MultiPolygon | None) -> NDArray[np.float64]:
    """No more than can be searched."""
    import shapely

    around = closed
    if within is not None and not within.is_empty:
        frame = shapely.box(*within.bounds).buffer(1.0, join_style="mitre")
        around = shapely.union(closed, shapely.difference(frame, within))
    tolerance_m = 0.0
    while len(corners := _corners(around, closed, tolerance_m, within)) > MOST_CORNERS:
        tolerance_m = max(_FIRST_TOLERANCE_M, 2.0 * tolerance_m)
    return corners


def _require_free(
    name: str,
    place: NDArray[np.float64],
    closed: Any,
    zones: Sequence[Zone],
    clearance_m: float,
    within: Polygon | MultiPolygon | None,
) -> None:
    import shapely

    point = shapely.Point(place)
    if within is not None and not within.covers(point):
        raise NoRoute(f"the {name} ({place[0]:.1f}, {place[1]:.1f}) lies outside the area")
    if closed.intersects(point):
        nearest = min(zones, key=lambda zone: zone.polygon.distance(point))
        distance_m = nearest.polygon.distance(point)
        where = f"in zone {nearest.id}" if distance_m == 0.0 else f"{distance_m:.1f} m from zone {nearest.id}"
        raise NoRoute(
            f"the {name} ({place[0]:.1f}, {place[1]:.1f}) lies {where}; the clearance is {clearance_m:g} m"
        )


def _corners(
    around: Polygon | MultiPolygon,
    closed: Polygon | MultiPolygon,
    tolerance_m: float,
    within: Polygon | MultiPolygon | None,
) -> NDArray[np.float64]:
    """Corners [C, 2] of what is gone `around` that a shortest way can turn at: those that stick out, a little
    outside, and are neither `closed` nor beyond the area."""
    import shapely

    # One by one: of all together GEOS takes many times as long.
    parts = shapely.get_parts(around)
    if tolerance_m:
        # Grown by the tolerance and simplified within it: coarser, and still around everything.
        joined = shapely.union_all(shapely.buffer(parts, tolerance_m, join_style="mitre", mitre_limit=5.0))
        parts = shapely.simplify(shapely.get_parts(joined), tolerance_m)
    beside = shapely.buffer(parts, TURN_M, join_style="mitre", mitre_limit=5.0)
    outside: list[NDArray[np.float64]] = [np.empty((0, 2))]
    for polygon in shapely.get_parts(beside).tolist():
        if not polygon.is_empty:
            oriented = shapely.geometry.polygon.orient(polygon, 1.0)
            rings = (oriented.exterior, *oriented.interiors)
            outside += [_sticking_out(np.asarray(ring.coords)[:-1]) for ring in rings]
    corners = np.concatenate(outside)
    points = shapely.points(corners)
    free = ~shapely.intersects(closed, points)
    if within is not None:
        free &= shapely.covers(within, points)
    return corners[free]


def _sticking_out(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    return ring[before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] > 0.0]


def _shortest(
    places: NDArray[np.float64], closed: Any, within: Polygon | MultiPolygon | None
) -> NDArray[np.float64]:
    """From the first place to the second one over the others."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    first, second = _seen(places, closed, within).T
    lengths = np.linalg.norm(places[first] - places[second], axis=1)
    graph = coo_array((lengths, (first, second)), shape=(len(places), len(places)))
    distance, before = dijkstra(graph.tocsr(), directed=False, indices=0, return_predecessors=True)
    if not np.isfinite(distance[1]):
        raise NoRoute(_closed_off(within))
    order = [1]
    while order[-1] != 0:
        order.append(int(before[order[-1]]))
    return places[order[::-1]]


def _seen(
    places: NDArray[np.float64], closed: Any, within: Polygon | MultiPolygon | None
) -> NDArray[np.int64]:
    """[E, 2] Pairs of places with nothing closed between them."""
    import shapely

    pairs = np.stack(np.triu_indices(len(places), k=1), axis=1)
    lines = shapely.linestrings(places[pairs])
    seen = ~shapely.intersects(closed, lines)
    if within is not None:
        seen &= shapely.covers(within, lines)
    return pairs[seen]
