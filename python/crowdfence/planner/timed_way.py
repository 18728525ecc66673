"""The earliest way over places that see each other, where some zones have an end.

An edge through such zones is flown so late that it enters each of them after its end; until then the vehicle
waits where the edge begins. Whoever leaves earlier therefore never arrives later, and a search by arrival is
exact on these places (A*, with the straight way to the goal as what is left at the least).
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
    edges_from = _EdgesFrom(places, edges, ending, ends_s, speed_m_s)
    least_s = np.linalg.norm(places - places[1], axis=1) / speed_m_s
    arrival = np.full(len(places), np.inf)
    left: list[tuple[int, float]] = [(0, 0.0)] * len(places)
    arrival[0] = 0.0
    queue = [(float(least_s[0]), 0.0, 0)]
    while queue:
        _, now_s, place = heapq.heappop(queue)
        if place == 1:
            break
        if now_s > arrival[place]:
            continue
        others, flown_s = edges_from.of(place)
        # What comes no sooner even without waiting needs no look at the zones on the way, which costs most.
        earliest_s = now_s + flown_s
        may = (earliest_s < arrival[others]) & (earliest_s + least_s[others] < arrival[1] + MARGIN_S)
        others, flown_s = others[may], flown_s[may]
        departures_s = edges_from.left_s(place, others, now_s)
        for other, departure, flown in zip(
            others.tolist(), departures_s.tolist(), flown_s.tolist(), strict=True
        ):
            if departure + flown < arrival[other]:
                arrival[other] = departure + flown
                left[other] = (place, departure)
                heapq.heappush(queue, (departure + flown + float(least_s[other]), departure + flown, other))
    if arrival[1] == np.inf:
        return None
    order, departures = [1], [float(arrival[1])]
    while order[-1] != 0:
        before, departure = left[order[-1]]
        order.append(before)
        departures.append(departure)
    order.reverse()
    return order, arrival[order].tolist(), departures[::-1]


class _EdgesFrom:
    """Edges by the place where they begin, and how long the zones on them are closed: asked of few places."""

    def __init__(
        self,
        places: NDArray[np.float64],
        edges: NDArray[np.int64],
        ending: Sequence[Polygon | MultiPolygon],
        ends_s: NDArray[np.float64],
        speed_m_s: float,
    ) -> None:
        import shapely

        self._places, self._ends_s, self._speed_m_s = places, ends_s, speed_m_s
        both_ways = np.concatenate([edges, edges[:, ::-1]])
        both_ways = both_ways[np.argsort(both_ways[:, 0], kind="stable")]
        self._others = both_ways[:, 1]
        self._begin = np.searchsorted(both_ways[:, 0], np.arange(len(places) + 1))
        self._zones = np.array(ending, dtype=object)
        self._tree = shapely.STRtree(self._zones)

    def of(self, place: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Where edges from a place lead [E], and how long each is flown [E]."""
        others = self._others[self._begin[place] : self._begin[place + 1]]
        way_m = np.linalg.norm(self._places[others] - self._places[place], axis=1)
        return others, way_m / self._speed_m_s

    def left_s(self, place: int, others: NDArray[np.int64], now_s: float) -> NDArray[np.float64]:
        """[E] When the edge to each other place may be left at the earliest by who is there now."""
        import shapely

        left_s = np.full(len(others), now_s)
        if not len(self._zones) or not len(others):
            return left_s
        here = shapely.Point(self._places[place])
        # A zone on the way is no nearer than it is in any direction: nothing has to wait longer for it.
        most_s = self._ends_s - shapely.distance(here, self._zones) / self._speed_m_s + MARGIN_S
        begin = np.broadcast_to(self._places[place], (len(others), 2))
        lines = shapely.linestrings(np.stack([begin, self._places[others]], axis=1))
        edge, zone = self._tree.query(lines)
        order = np.lexsort((-most_s[zone], edge))
        edge, zone = edge[order], zone[order]
        while True:
            counts = most_s[zone] > left_s[edge]
            edge, zone = edge[counts], zone[counts]
            if not len(edge):
                return left_s
            # Of each edge the zone that may hold longest: behind it most others do not count any more.
            is_first = np.append(True, edge[1:] != edge[:-1])
            asked, of = edge[is_first], zone[is_first]
            inside = shapely.intersection(lines[asked], self._zones[of])
            before_m = shapely.distance(here, inside)  # NaN where they do not meet
            ready_s = self._ends_s[of] - before_m / self._speed_m_s + MARGIN_S
            left_s[asked] = np.fmax(left_s[asked], ready_s)
            edge, zone = edge[~is_first], zone[~is_first]
