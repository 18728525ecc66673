"""Between which local heights the ground lies below a shape around several zones, such as one of a fence.

An outline goes to longitude and latitude at the height of its ground. Zones of others whose ground nobody
knows stand at the anchor's height above the ellipsoid (`geographic_outline`), which the local plane leaves:
100 km from the anchor it lies 785 m above that, and verticals there lean by 16 m in a kilometre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from crowdfence.prepared import prepared
from crowdfence.zones import Zone

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

_LEAST_EARTH_M, _MOST_EARTH_M = 6_335_000.0, 6_400_000.0
"""Radii of curvature of the ellipsoid."""


class GroundOfShapes:
    """Made once for the zones that shapes are drawn around."""

    def __init__(self, zones: Sequence[Zone]) -> None:
        self._zones = zones
        self._outlines = np.array([zone.polygon for zone in zones], dtype=object)
        self._heights_m = np.array([_stands_between_m(zone) for zone in zones]).reshape(-1, 2)

    def between_m(self, shape: Polygon | MultiPolygon) -> tuple[float, float]:
        """Lowest and highest local height of the ground of those zones that lie in the shape."""
        import shapely

        inside = shapely.intersects(prepared(shape), self._outlines)
        lowest_m, highest_m = self._heights_m[inside if inside.any() else slice(None)].T
        return float(lowest_m.min()), float(highest_m.max())

    def as_zone(self, shape: Polygon | MultiPolygon) -> Zone:
        """The shape as something that has an outline, on that ground."""
        lowest_m, highest_m = self.between_m(shape)
        return replace(self._zones[0], id="fence", polygon=shape, lower_m=lowest_m, upper_m=highest_m)


def _stands_between_m(zone: Zone) -> tuple[float, float]:
    import shapely

    if zone.lower_m < zone.upper_m:
        return zone.lower_m, zone.upper_m
    nearest_m = float(shapely.distance(zone.polygon, shapely.Point(0.0, 0.0)))
    farthest_m = float(np.linalg.norm(shapely.get_coordinates(zone.polygon), axis=1).max())
    below_m = _below_plane_m(farthest_m, _LEAST_EARTH_M), _below_plane_m(nearest_m, _MOST_EARTH_M)
    return zone.lower_m - below_m[0], zone.upper_m - below_m[1]


def _below_plane_m(distance_m: float, earth_m: float) -> float:
    """How far a sphere lies below the plane that touches it, at a distance on the plane."""
    return earth_m - float(np.sqrt(max(0.0, earth_m**2 - distance_m**2)))
