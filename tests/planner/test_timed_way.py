"""The earliest way against one that asks every zone on every edge."""

import heapq
from itertools import combinations

import numpy as np
import pytest
import shapely

from crowdfence.planner.timed_way import MARGIN_S, earliest_way

SPEED_M_S = 5.0


def earliest_by_hand_s(places: np.ndarray, zones: list[shapely.Polygon], ends_s: np.ndarray) -> float:
    """Arrival at the second place, all of which see each other."""
    arrival = {0: 0.0}
    queue = [(0.0, 0)]
    done = set()
    while queue:
        now_s, place = heapq.heappop(queue)
        if place == 1:
            return now_s
        if place in done:
            continue
        done.add(place)
        for other in set(range(len(places))) - done:
            line = shapely.LineString(places[[place, other]])
            leaves_s = now_s
            for zone, end_s in zip(zones, ends_s, strict=True):
                if line.intersects(zone):
                    before_m = shapely.Point(places[place]).distance(line.intersection(zone))
                    leaves_s = max(leaves_s, end_s - before_m / SPEED_M_S + MARGIN_S)
            there_s = leaves_s + line.length / SPEED_M_S
            if there_s < arrival.get(other, np.inf):
                arrival[other] = there_s
                heapq.heappush(queue, (there_s, other))
    raise AssertionError("all places see each other")


@pytest.mark.parametrize("seed", range(20))
def test_no_other_way_arrives_earlier(seed: int) -> None:
    random = np.random.default_rng(seed)
    zones = [
        shapely.Point(centre).buffer(radius, quad_segs=2)
        for centre, radius in zip(random.uniform(0, 100, (12, 2)), random.uniform(3, 15, 12), strict=True)
    ]
    places = np.concatenate([[[-20.0, -20.0], [120.0, 120.0]], random.uniform(-20, 120, (18, 2))])
    ends_s = random.uniform(-5.0, 60.0, len(zones))
    edges = np.array(list(combinations(range(len(places)), 2)))
    found = earliest_way(places, edges, zones, ends_s, SPEED_M_S)
    assert found is not None
    order, arrivals, departures = found
    assert (order[0], order[-1]) == (0, 1) and arrivals[0] == 0.0
    assert arrivals[-1] == pytest.approx(earliest_by_hand_s(places, zones, ends_s), abs=1e-9)
    assert all(leaves >= there for there, leaves in zip(arrivals, departures, strict=True))


def test_places_that_nothing_joins_have_no_way() -> None:
    places = np.array([[0.0, 0.0], [9.0, 9.0], [3.0, 3.0]])
    assert earliest_way(places, np.array([[0, 2]]), [], np.empty(0), SPEED_M_S) is None
