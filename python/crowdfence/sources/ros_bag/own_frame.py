"""Frames that are called alike by all drones of a fleet, and are another one for each."""

from __future__ import annotations

import re

COUNTED_FROM = "counted_from"
"""Key of a bag's manifest: by drone the frame that its poses count from, and whose that is, where the bag
does not say where on Earth they are."""

_ODOM = re.compile(r"(?:^|[/_])odom$", re.IGNORECASE)


def whose_frame(frame: str, topic: str) -> str:
    """Whose the frame is that poses of a topic count from, empty where it may be everybody's: `odom` is where
    a robot was switched on (REP 105), and the `local_position` of MAVROS counts from where that autopilot
    began, though every one calls it `map`."""
    above, named, _ = f"/{topic.strip('/')}/".partition("/local_position/")
    if named:
        return above or "/"
    return topic if _ODOM.search(frame) else ""
