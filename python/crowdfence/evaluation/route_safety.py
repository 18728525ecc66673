"""How often a planner that trusts the zones would have flown over a crowd.

Across every crowd in view it is asked for a way from west to east and one from south to north, between points
that stay `BEYOND_M` away from the crowd's middle: the straight one would cross it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.evaluation.safety import Cells, CrowdsInView
from crowdfence.planner import NoRoute, safe_route
from crowdfence.zones import Zone
from crowdfence.zones.outline import outlines
from crowdfence.zones.regions import Runs, largest_first
from crowdfence.zones.sorted_keys import are_among
from crowdfence.zones.tracker import column_keys

if TYPE_CHECKING:
    from crowdfence._core import Terrain

BEYOND_M = 60.0
CLEARANCE_M = 5.0
MOST_CROWDS = 4
"""The largest are asked for."""
LEAST_CROWD_M2 = 10.0
_STEP_M = 0.2


class RouteSafety:
    """Sums over the moments that were counted."""

    def __init__(self) -> None:
        self.asked = 0
        self.crossing = 0
        """Ways over ground that a crowd stands on, in view of the fleet by then."""
        self.without = 0
        """No way: an end is closed, or everything around it."""

    @property
    def share_crossing(self) -> float:
        return self.crossing / self.asked if self.asked else float("nan")

    def add(self, crowds: CrowdsInView, closed: Cells, terrain: Terrain) -> None:
        """One moment: the crowds, and the columns that are closed [C, 2]."""
        zones = _zones(closed, terrain)
        for middle in _middles(crowds.ground, terrain):
            for along in ((BEYOND_M, 0.0), (0.0, BEYOND_M)):
                self.asked += 1
                start, goal = middle - along, middle + along
                try:
                    way = safe_route(start, goal, _near(zones, middle), clearance_m=CLEARANCE_M)
                except NoRoute:
                    self.without += 1
                    continue
                self.crossing += _crosses(np.asarray(way.waypoints), crowds.ground, terrain)


def _zones(closed: Cells, terrain: Terrain) -> list[Zone]:
    runs = Runs.of(closed)
    nan = float("nan")
    return [
        Zone(str(number), shape, 0, shape.area, nan, nan, nan, nan, 0, 0, ())
        for number, shape in enumerate(outlines(runs, largest_first(runs), terrain))
    ]


def _near(zones: list[Zone], middle: NDArray[np.float64]) -> list[Zone]:
    """Those that a way around the middle could meet."""
    from shapely import Point

    return [zone for zone in zones if zone.polygon.distance(Point(middle)) <= 3.0 * BEYOND_M]


def _middles(ground: Cells, terrain: Terrain) -> list[NDArray[np.float64]]:
    """Of the largest connected crowds, in local metres."""
    if not len(ground):
        return []
    ground = ground[np.argsort(column_keys(ground))]
    runs = Runs.of(ground)
    crowd = np.repeat(largest_first(runs), runs.length)
    origin = np.asarray(terrain.origin)[:2]
    size_m = terrain.voxel_size_m
    return [
        origin + (ground[crowd == number].mean(axis=0) + 0.5) * size_m
        for number in range(min(int(crowd.max()) + 1, MOST_CROWDS))
        if np.count_nonzero(crowd == number) * size_m**2 >= LEAST_CROWD_M2
    ]


def _crosses(way: NDArray[np.float64], ground: Cells, terrain: Terrain) -> bool:
    legs = np.diff(way, axis=0)
    steps = [np.linspace(0.0, 1.0, int(np.hypot(*leg) / _STEP_M) + 2)[:, None] for leg in legs]
    places = np.vstack([start + leg * step for start, leg, step in zip(way, legs, steps, strict=False)])
    columns = np.floor((places - np.asarray(terrain.origin)[:2]) / terrain.voxel_size_m).astype(np.int64)
    return bool(are_among(column_keys(columns), column_keys(ground)).any())
