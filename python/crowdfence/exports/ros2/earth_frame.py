"""Where the local frame lies on the Earth, as a transform of ROS (REP 105: earth -> map)."""

from __future__ import annotations

from math import cos, radians, sin
from typing import Any

from crowdfence.georeference import Georeference
from crowdfence.sources.mission.layout import MAP_FRAME
from crowdfence.sources.mission.ros2_messages import header

EARTH_FRAME = "earth"
_GEOCENTRIC = "EPSG:4978"


def earth_from_map(anchor: Georeference, stamp_ns: int) -> dict[str, Any]:
    """geometry_msgs/TransformStamped: metres from the Earth's centre, and the turn of east, north and up."""
    x, y, z = anchor.projected_from_local(_GEOCENTRIC, [[0.0, 0.0, 0.0]])[0].tolist()
    # East lies 90 degrees ahead of the meridian, up 90 degrees from the axis less the latitude.
    turn = radians(anchor.longitude_deg + 90.0) / 2.0
    tilt = radians(90.0 - anchor.latitude_deg) / 2.0
    rotation = {
        "w": cos(turn) * cos(tilt),
        "x": cos(turn) * sin(tilt),
        "y": sin(turn) * sin(tilt),
        "z": sin(turn) * cos(tilt),
    }
    return {
        "header": header(stamp_ns, EARTH_FRAME),
        "child_frame_id": MAP_FRAME,
        "transform": {"translation": {"x": x, "y": y, "z": z}, "rotation": rotation},
    }
