"""Where on Earth a NavSatFix or GeoPointStamped of ROS says that something is."""

from __future__ import annotations

import math
from typing import Any

from crowdfence.georeference import on_earth

_NO_FIX = -1


def heights_assumed(topic: str) -> str:
    """What to tell of heights on a topic of NavSatFix that poses on Earth rest on."""
    return (
        f"heights of {topic} are taken as above the ellipsoid (WGS84), as NavSatFix has them; where what "
        "publishes it tells those above the sea, all cameras are too high or too low by the geoid there: "
        "--ground-start shows by how much, of a drone that began on the ground"
    )


def told_place(message: Any) -> tuple[float, float, float] | None:
    """Latitude, longitude in degrees and height above the WGS84 ellipsoid in metres of a decoded message;
    None of a receiver without a fix. ValueError for what is no place on Earth."""
    at = getattr(message, "position", None)
    if at is None:
        if message.status.status <= _NO_FIX:
            return None
        at = message
    place = float(at.latitude), float(at.longitude), float(at.altitude)
    # As in photographs and logs, 0, 0 is what somebody tells who knows none.
    if not (all(map(math.isfinite, place)) and on_earth(*place[:2]) and any(place[:2])):
        raise ValueError(f"no position: {place}")
    return place
