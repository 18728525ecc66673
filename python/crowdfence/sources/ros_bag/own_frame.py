"""Frames that are called alike by all drones of a fleet, and are another one for each."""

from __future__ import annotations

import re

COUNTED_FROM = "counted_from"
"""Key of a bag's manifest: by drone the frame that its poses count from, and whose that is, where the bag
does not say where on Earth they are."""

_OF_MAVROS = re.compile(r"^(.*)/(?:local_position/|global_position/local/|odometry/in/)")
"""Topics of positions that it tells from where its autopilot began, or from its home."""
_ODOM = re.compile(r"(?:^|[/_])odom$", re.IGNORECASE)


def whose_frame(frame: str, topic: str) -> str:
    """Whose the frame is that poses of a topic count from, empty where it may be everybody's: `odom` is where
    a robot was switched on (REP 105), and local positions of MAVROS count from where that autopilot began,
    though every one calls it `map`."""
    if of_mavros := _OF_MAVROS.match(f"/{topic.strip('/')}/"):
        return of_mavros[1] or "/"
    return topic if _ODOM.search(frame) else ""
