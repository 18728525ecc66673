"""The earliest way over places that see each other, where some zones have an end.

An edge through such zones is flown so late that it enters each of them after its end; until then the vehicle
waits where the edge begins. Whoever leaves earlier therefore never arrives later, and Dijkstra's search by
arrival is exact on these places.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

MARGIN_S = 0.001
"""A zone is entered so long after its end."""


def earliest_way(
    places: NDArray[np.float64],
    edges: NDArray[np.int64],
    ending: Sequence[Polygon | MultiPolygon],
    ends_s: NDArray[np.float64],
    speed_m_s: float,
) -> tuple[list[int], list[float], list[float]] | None:
    """From the first place to the second one: numbers of the places on the way, when each is reached and when
    it is left, in seconds after the departure. None where there is no way.

    places  [P, 2] metres; edges [E, 2] pairs of places between which nothing is closed for good
    ending  zones [Z] that end, `ends_s` [Z] seconds after the departure
    """
    ready_s = _ready_s(places, edges, ending, ends_s, speed_m_s)
    flown_s = np.linalg.norm(places[edges[:, 0]] - places[edges[:, 1]], axis=1) / speed_m_s
    ways: list[list[tuple[int, float, float]]] = [[] for _ in places]
    for (one, other), flown, ready in zip(edges.tolist(), flown_s.tolist(), ready_s.tolist(), strict=True):
        ways[one].append((other, flown, ready[0]))
        ways[other].append((one, flown, ready[1]))
    arrival = [np.inf] * len(places)
    left: list[tuple[int, float]] = [(0, 0.0)] * len(places)
    arrival[0] = 0.0
    queue = [(0.0, 0)]
    while queue:
        now_s, place = heapq.heappop(queue)
        if place == 1:
            break
        if now_s > arrival[place]:
            continue
        for other, flown, ready in ways[place]:
            departure = max(now_s, ready)
            if departure + flown < arrival[other]:
                arrival[other] = departure + flown
                left[other] = (place, departure)
                heapq.heappush(queue, (arrival[other], other))
    if arrival[1] == np.inf:
        return None
    order, departures = [1], [arrival[1]]
    while order[-1] != 0:
        before, departure = left[order[-1]]
        order.append(before)
        departures.append(departure)
    order.reverse()
    return order, [arrival[place] for place in order], departures[::-1]


def _ready_s(
    places: NDArray[np.float64],
    edges: NDArray[np.int64],
    ending: Sequence[Polygon | MultiPolygon],
    ends_s: NDArray[np.float64],
    speed_m_s: float,
) -> NDArray[np.float64]:
    """[E, 2] When an edge may be left at the earliest, from its one end and from the other."""
    import shapely

    ready_s = np.zeros((len(edges), 2))
    if not len(ending) or not len(edges):
        return ready_s
    lines = shapely.linestrings(places[edges])
    edge, zone = shapely.STRtree(list(ending)).query(lines, predicate="intersects")
    inside = shapely.intersection(lines[edge], np.array(ending, dtype=object)[zone])
    for side in (0, 1):
        before_m = shapely.distance(shapely.points(places[edges[edge, side]]), inside)
        np.maximum.at(ready_s[:, side], edge, ends_s[zone] - before_m / speed_m_s + MARGIN_S)
    return ready_s
