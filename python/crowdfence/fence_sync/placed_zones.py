"""Zones, and where on Earth their local frame lies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from crowdfence.georeference import Georeference
from crowdfence.zones import Zone

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

_LEAST_EARTH_M, _MOST_EARTH_M = 6_335_000.0, 6_400_000.0
"""Radii of curvature."""


@dataclass(frozen=True, slots=True)
class PlacedZones:
    """What is to be closed."""

    zones: tuple[Zone, ...]
    georeference: Georeference
    begun_ns: int | None = None
    """The first instant of the mission that they are of, where it is told."""
    stamp_ns: int | None = None
    """The instant that they are of, where it is told."""

    def at(self, stamp_ns: int) -> tuple[Zone, ...]:
        """Without those that ended before a stamp by themselves."""
        return tuple(
            zone for zone in self.zones if zone.valid_until_ns is None or zone.valid_until_ns > stamp_ns
        )


def ground_heights(outline: Polygon | MultiPolygon) -> tuple[float, float]:
    """Local heights of ground at the anchor's height: it falls away from the local plane."""
    import shapely

    nearest_m = outline.distance(shapely.Point(0.0, 0.0))
    farthest_m = float(np.linalg.norm(shapely.get_coordinates(outline), axis=1).max())
    return -(farthest_m**2) / (2 * _LEAST_EARTH_M), -(nearest_m**2) / (2 * _MOST_EARTH_M)
