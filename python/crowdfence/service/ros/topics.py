"""Which topics of a fleet are whose camera, intrinsics and pose: `--topics`, in its words for bags."""

from __future__ import annotations

import re
from collections.abc import Sequence

from crowdfence.service.ros.poses import POSE_ROLES
from crowdfence.sources.mission import ros2_messages
from crowdfence.sources.ros_bag.topic_choice import DroneTopics, each_once

_POSES = (ros2_messages.POSE_STAMPED, ros2_messages.ODOMETRY, ros2_messages.POSE_WITH_COVARIANCE)
ROLES: dict[str, tuple[str, ...]] = {
    "camera": (ros2_messages.IMAGE, ros2_messages.COMPRESSED_IMAGE),
    "info": (ros2_messages.CAMERA_INFO,),
    "heatmap": (ros2_messages.IMAGE,),
    "camera_pose": _POSES,
    "pose": _POSES,
    "tf": (ros2_messages.TF_MESSAGE,),
    "origin": (ros2_messages.GEO_POINT_STAMPED, ros2_messages.NAV_SAT_FIX),
}
"""And the message types that each may have. Positions on Earth come by telemetry (`--mavlink`)."""
_OF_ONE_CAMERA = ("camera", "heatmap", "camera_pose")
"""Two cameras of one drone may share a pose of its body and tf."""
_TOPIC = re.compile(r"/?[^/*$?#]+(?:/[^/*$?#]+)*/?")
"""With what means several to Zenoh, the pictures of a fleet would be those of one drone."""


def live_topics(texts: Sequence[str]) -> list[DroneTopics]:
    """From ROLE=TOPIC,... for one drone each. ValueError for what is no role, a drone without pictures or
    intrinsics, a name twice, a topic of one camera for two drones, and what names several topics."""
    drones = [_of_drone(text) for text in texts]
    names = [one.drone for one in drones]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ValueError(f"--topics: two drones are called {min(twice)!r}; name them with drone=NAME,...")
    for role in _OF_ONE_CAMERA:
        whose: dict[str, str] = {}
        for one in drones:
            topic = getattr(one, role)
            if topic is not None and (other := whose.setdefault(topic.strip("/"), one.drone)) != one.drone:
                raise ValueError(
                    f"--topics: {role}={topic} is given for {other} and for {one.drone}; what one camera "
                    "shows would count as seen by two drones: name that of each"
                )
    return drones


def message_type(role: str, topic: str) -> str:
    """Of a topic whose key does not say it: by its role and name."""
    match role:
        case "camera":
            packed = topic.endswith("/compressed")
            return ros2_messages.COMPRESSED_IMAGE if packed else ros2_messages.IMAGE
        case "heatmap":
            return ros2_messages.IMAGE
        case "info":
            return ros2_messages.CAMERA_INFO
        case "tf":
            return ros2_messages.TF_MESSAGE
        case "origin":
            name = topic.lower()
            is_fix = "fix" in name or "navsat" in name
            return ros2_messages.NAV_SAT_FIX if is_fix else ros2_messages.GEO_POINT_STAMPED
        case _:
            return ros2_messages.ODOMETRY if "odom" in topic.lower() else ros2_messages.POSE_STAMPED


def _of_drone(text: str) -> DroneTopics:
    pairs: list[tuple[str, str]] = []
    for part in text.split(","):
        role, equals, topic = part.strip().partition("=")
        if not (equals and topic) or role not in (*ROLES, "drone"):
            raise ValueError(
                f"--topics {text!r}: {part!r} must be ROLE=TOPIC, roles: drone, {', '.join(ROLES)}"
            )
        if role != "drone" and not _TOPIC.fullmatch(topic):
            raise ValueError(f"--topics {text!r}: {topic} names no topic; it has no *, $, ?, # and no //")
        pairs.append((role, topic))
    named = each_once(pairs, text)
    pictures = named.get("camera") or named.get("heatmap") or ""
    drone = named.pop("drone", "") or pictures.strip("/").partition("/")[0]
    if not (drone and ("camera" in named or "heatmap" in named) and "info" in named):
        raise ValueError(f"--topics {text!r}: a drone needs camera= or heatmap=, and info=")
    if "origin" in named and not named.keys() & POSE_ROLES:
        raise ValueError(
            f"--topics {text!r}: origin= says where its poses count from; name camera_pose=, pose= or tf= too"
        )
    return DroneTopics(drone, **named)
