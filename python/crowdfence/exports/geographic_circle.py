"""Circles on Earth, with a radius that covers the true one by the distance that autopilots compute.

They take the Earth for a sphere (PX4: haversine, 6371 km; ArduPilot: 111.319 km a degree, 6378 km), on
which a degree of latitude near the equator is 0.7 % longer than on the ellipsoid. The radius is what the
larger sphere measures to the farthest point of the circle.
"""

from __future__ import annotations

import math

import numpy as np

from crowdfence.georeference import MAX_LATITUDE_DEG, Georeference, longitude_latitude
from crowdfence.great_circle import great_circle_m
from crowdfence.zones.capacity import Circle

SPHERE_M = 6_378_137.0
"""The largest radius that autopilots take for the Earth's."""
_BEARINGS = 64
_MARGIN_M = 0.02
_MARGIN = 1e-6


def geographic_circle(
    circle: Circle, georeference: Georeference, lowest_m: float, highest_m: float, decimals: int
) -> tuple[float, float, float]:
    """Longitude, latitude and radius in metres, in whole centimetres, of a circle on ground between two local
    heights. ValueError within one degree of a pole."""
    centre = np.array([[circle.east_m, circle.north_m]])
    (degrees,) = longitude_latitude(centre, (lowest_m + highest_m) / 2, georeference).tolist()
    middle = (round(degrees[0], decimals), round(degrees[1], decimals))
    angle = 2 * np.pi * np.arange(_BEARINGS) / _BEARINGS
    reach_m = circle.radius_m / math.cos(math.pi / _BEARINGS)  # around the circle, not in it
    rim = [circle.east_m, circle.north_m] + reach_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    radius_m = 0.0
    for height_m in (lowest_m, highest_m):
        longitude, latitude = longitude_latitude(rim, height_m, georeference).T
        if np.abs(latitude).max() > MAX_LATITUDE_DEG:
            raise ValueError(
                f"a circle reaches latitude {latitude[np.argmax(np.abs(latitude))]:.4f}; zones are written "
                f"up to {MAX_LATITUDE_DEG} degrees, because longitude loses its meaning at the poles"
            )
        radius_m = max(radius_m, float(great_circle_m(middle, longitude, latitude, SPHERE_M).max()))
    # ArduPilot takes the width of a degree of longitude at one end of the way.
    flat_m = radius_m**2 * math.tan(math.radians(abs(middle[1]))) / SPHERE_M
    return *middle, math.ceil((radius_m * (1.0 + _MARGIN) + flat_m + _MARGIN_M) * 100) / 100
