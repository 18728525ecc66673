"""What a way keeps from zones where both are told in degrees.

Local verticals are parallel, real ones are not: ground dz higher lies dz * distance from the anchor / 6335 km
farther out in local metres. Zones go to degrees at the height of their ground (`geographic_outline`), a way
at one height for all of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from crowdfence.exports.geographic_outline import MARGIN_M
from crowdfence.georeference import Georeference
from crowdfence.zones import Zone
from crowdfence.zones.given_ground import SMALLEST_EARTH_RADIUS_M

_SMALL_M = 1e-3
"""A difference of heights that moves nothing within 100 km by more than 0.02 mm."""


def at_one_height(zones: Sequence[Zone], ground_m: float = 0.0) -> tuple[float, tuple[Zone, ...]]:
    """The local height half way up the ground of all zones of which it is known, at which a way is told, else
    `ground_m`; and the zones as it must pass them: grown by as much as they move between it and their own
    ground, and as the files of zones grow them."""
    import shapely

    if not zones:
        return ground_m, ()
    lower_m, upper_m = np.array([(zone.lower_m, zone.upper_m) for zone in zones]).T
    is_known = lower_m < upper_m
    # What nobody knows the ground of, such as zones of others, may be farther below than any ground there.
    height_m = float(lower_m[is_known].min() + upper_m[is_known].max()) / 2 if is_known.any() else ground_m
    outlines = np.array([zone.polygon for zone in zones], dtype=object)
    west, south, east, north = np.abs(shapely.bounds(outlines)).T
    reach_m = np.hypot(np.maximum(west, east), np.maximum(south, north))
    # Where nobody knows the ground, the outline stands at the height of the anchor, below the local plane.
    below_m = np.where(is_known, 0.0, reach_m**2 / (2.0 * SMALLEST_EARTH_RADIUS_M))
    apart_m = np.maximum(height_m - lower_m, upper_m - height_m)
    margin_m = 2.0 * MARGIN_M + reach_m * (apart_m + below_m) / SMALLEST_EARTH_RADIUS_M
    grown = shapely.buffer(outlines, margin_m, join_style="mitre", mitre_limit=2.0)
    return height_m, tuple(replace(zone, polygon=polygon) for zone, polygon in zip(zones, grown, strict=True))


def local_place(
    georeference: Georeference, latitude_deg: float, longitude_deg: float, height_m: float
) -> NDArray[np.float64]:
    """Local metres [2] of a place on a vertical, where that passes a local height. ValueError for what is no
    place."""
    above_m = georeference.height_m + height_m
    place = georeference.local_from_geodetic(latitude_deg, longitude_deg, above_m)[0]
    off_m = height_m - float(place[2])
    if abs(off_m) > _SMALL_M:  # the plane leaves the ellipsoid far from the anchor: by 8 m at 10 km
        place = georeference.local_from_geodetic(latitude_deg, longitude_deg, above_m + off_m)[0]
    return np.asarray(place[:2])
