"""Zones grown by a clearance, each once it is met: of thousands of zones a way meets a few."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.planner.open_ground import ground_round
from crowdfence.zones import Zone
from crowdfence.zones.grow import grown

if TYPE_CHECKING:
    from shapely import LineString, MultiPolygon, Point, Polygon


class ZonesMet:
    """Of all zones those that ways have met so far."""

    def __init__(self, zones: Sequence[Zone], clearance_m: float) -> None:
        import shapely

        self._all = zones
        self._clearance_m = clearance_m
        # Grown outlines reach 5 % farther than the clearance, and of a tiny one a millimetre.
        self._reach_m = 1.1 * clearance_m + 0.01
        self._tree = shapely.STRtree([zone.polygon for zone in zones])
        self._grown: dict[int, Polygon | MultiPolygon] = {}
        self._met: set[int] = set()

    @property
    def zones(self) -> list[Zone]:
        return [self._all[number] for number in sorted(self._met)]

    @property
    def grown(self) -> list[Polygon | MultiPolygon]:
        """Their outlines, grown."""
        return [self._outline(number) for number in sorted(self._met)]

    @property
    def all_grown(self) -> list[Polygon | MultiPolygon]:
        """Those of all zones, met or not."""
        return [self._outline(number) for number in range(len(self._all))]

    def add(self, way: LineString) -> bool:
        """Those that a way meets too. Whether there are any that no way has met before."""
        before = len(self._met)
        self._met.update(self._meeting(way))
        return len(self._met) > before

    def add_all(self) -> None:
        self._met.update(range(len(self._all)))

    def leave_open(self, ends: NDArray[np.float64], within: Polygon | MultiPolygon | None) -> bool:
        """Whether all zones together leave any way between two places, within an area."""
        import shapely

        closed = shapely.union_all(self.all_grown)
        start, goal = shapely.points(ends)
        parts = shapely.get_parts(shapely.difference(within or ground_round(closed, ends), closed))
        return bool((shapely.intersects(parts, start) & shapely.intersects(parts, goal)).any())

    def closing(self, place: Point) -> list[Zone]:
        """All zones, met before or not, in which a place lies when they are grown."""
        return [self._all[number] for number in self._meeting(place)]

    def _meeting(self, shape: Point | LineString) -> list[int]:
        near = self._tree.query(shape, predicate="dwithin", distance=self._reach_m).tolist()
        return [number for number in near if self._outline(number).intersects(shape)]

    def _outline(self, number: int) -> Polygon | MultiPolygon:
        if number not in self._grown:
            self._grown[number] = grown(self._all[number].polygon, self._clearance_m)
        return self._grown[number]
