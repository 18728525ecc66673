"""The shortest way round the zones of one moment.

Where the zones are polygons, the shortest way turns at their corners only. The graph of corners that see each
other is searched by scipy's Dijkstra. Zones are grown by the clearance first; where they have more corners
than can be searched, the corners are those of outlines around them: a way that is found is clear, but it may
not be the shortest, and a narrow one may be missed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.zones import Zone
from crowdfence.zones.grow import grown

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

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
    """[N, 2] local metres, from the start to the goal."""

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
    within: Polygon | None = None,
) -> Route:
    """The shortest way from `start` to `goal` [2] (local metres) that keeps `clearance_m` >= 0 from every
    zone and stays `within` an area. NoRoute where there is none, ValueError for what is no place."""
    import shapely

    ends = np.asarray([start, goal], dtype=np.float64)
    if ends.shape != (2, 2) or not np.isfinite(ends).all():
        raise ValueError(f"start and goal must be two finite places [2], got {start!r} and {goal!r}")
    if not 0.0 <= clearance_m < np.inf:
        raise ValueError(f"clearance_m is {clearance_m:g}; it must be finite and >= 0")
    closed = shapely.union_all([grown(zone.polygon, clearance_m) for zone in zones])
    shapely.prepare(closed)
    for name, place in zip(("start", "goal"), ends, strict=True):
        _require_free(name, place, closed, zones, clearance_m, within)
    tolerance_m = 0.0
    while len(corners := _corners(closed, tolerance_m, within)) > MOST_CORNERS:
        tolerance_m = max(_FIRST_TOLERANCE_M, 2.0 * tolerance_m)
    return Route(_shortest(np.vstack([ends, corners]), closed, within))


def _require_free(
    name: str,
    place: NDArray[np.float64],
    closed: Any,
    zones: Sequence[Zone],
    clearance_m: float,
    within: Polygon | None,
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
    closed: Polygon | MultiPolygon, tolerance_m: float, within: Polygon | None
) -> NDArray[np.float64]:
    """Corners [C, 2] that a shortest way can turn at: those that stick out, a little outside."""
    import shapely

    # Grown by the tolerance and simplified within it: coarser, and still around everything.
    coarse = shapely.simplify(shapely.buffer(closed, tolerance_m), tolerance_m) if tolerance_m else closed
    around = shapely.buffer(coarse, TURN_M, join_style="mitre", mitre_limit=5.0)
    outside: list[NDArray[np.float64]] = [np.empty((0, 2))]
    for polygon in shapely.get_parts(around).tolist():
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


def _shortest(places: NDArray[np.float64], closed: Any, within: Polygon | None) -> NDArray[np.float64]:
    """From the first place to the second one over the others."""
    import shapely
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    first, second = np.triu_indices(len(places), k=1)
    lines = shapely.linestrings(np.stack([places[first], places[second]], axis=1))
    seen = ~shapely.intersects(closed, lines)
    if within is not None:
        seen &= shapely.covers(within, lines)
    first, second = first[seen], second[seen]
    lengths = np.linalg.norm(places[first] - places[second], axis=1)
    graph = coo_array((lengths, (first, second)), shape=(len(places), len(places)))
    distance, before = dijkstra(graph.tocsr(), directed=False, indices=0, return_predecessors=True)
    if not np.isfinite(distance[1]):
        raise NoRoute("there is no way: zones close every one of them")
    order = [1]
    while order[-1] != 0:
        order.append(int(before[order[-1]]))
    return places[order[::-1]]
