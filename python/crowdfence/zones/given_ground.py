"""The ground below zones that somebody else drew, from the map that they lie on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from crowdfence._core import Terrain
from crowdfence.zones.ground_heights import GroundHeights
from crowdfence.zones.zone import Zone, closed_of

SMALLEST_EARTH_RADIUS_M = 6.335e6
"""Of curvature: along meridians at the equator."""


def on_ground(given: Sequence[Zone], terrain: Terrain) -> tuple[Zone, ...]:
    """The zones with the heights of their ground, where the terrain holds all of it; the others as they are.

    A place in degrees is a vertical, and verticals far from the anchor lean: the outline, which was laid out
    at the anchor's height, grows by as much as they do between there and the ground (5 cm at 1 km and 300 m).
    """
    zones = closed_of(given)
    if all(zone.ground_is_known for zone in zones):
        return zones
    heights = GroundHeights(terrain)
    return tuple(zone if zone.ground_is_known else _placed(zone, heights) for zone in zones)


def _placed(zone: Zone, heights: GroundHeights) -> Zone:
    import shapely

    ground_m = heights.below(zone.polygon)
    if ground_m is None:
        return zone
    west, south, east, north = zone.polygon.bounds
    reach_m = float(np.hypot(max(abs(west), abs(east)), max(abs(south), abs(north))))
    # Above the height of the anchor: the ellipsoid falls away from the local plane.
    above_m = max(map(abs, ground_m)) + reach_m**2 / (2.0 * SMALLEST_EARTH_RADIUS_M)
    lean_m = reach_m * above_m / SMALLEST_EARTH_RADIUS_M
    outline = shapely.buffer(zone.polygon, lean_m, join_style="mitre", mitre_limit=2.0)
    return replace(zone, polygon=outline, lower_m=ground_m[0], upper_m=ground_m[1])
