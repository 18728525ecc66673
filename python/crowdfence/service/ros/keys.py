"""Topics of ROS 2 <-> key expressions of Zenoh.

    rmw_zenoh                 DOMAIN/TOPIC/TYPE/HASH    0/uav1/odom/nav_msgs::msg::dds_::Odometry_/RIHS01_...
    zenoh-bridge-ros2dds      [NAMESPACE/]TOPIC         uav1/odom

rmw_zenoh is RMW_IMPLEMENTATION=rmw_zenoh_cpp (its docs/design.md); the bridge carries the topics of any other
middleware.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from crowdfence.sources.mission import ros2_messages

KeyKind = Literal["rmw", "bridge"]

TYPE_HASHES = {
    ros2_messages.MARKER_ARRAY: "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
    ros2_messages.OCCUPANCY_GRID: "RIHS01_8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
    ros2_messages.TF_MESSAGE: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
}
"""REP 2011, of the types that are published."""

_DDS_TYPE = re.compile(r"(\w+)::msg::dds_::(\w+)_")


@dataclass(frozen=True, slots=True)
class RosKeys:
    """How a fleet's keys are made."""

    kind: KeyKind = "rmw"
    domain: int = 0
    """ROS_DOMAIN_ID, for rmw."""
    namespace: str = ""
    """That of the bridge, for bridge."""

    def __post_init__(self) -> None:
        if not 0 <= self.domain <= 232:
            raise ValueError(f"the domain {self.domain} must be between 0 and 232")

    def subscribed(self, topic: str) -> str:
        """The key expression of a topic, whatever its type."""
        name = topic.strip("/")
        return f"{self.domain}/{name}/*/*" if self.kind == "rmw" else self._bridged(name)

    def published(self, topic: str, message_type: str) -> str:
        name = topic.strip("/")
        if self.kind == "bridge":
            return self._bridged(name)
        package, _, kind = message_type.split("/")
        return f"{self.domain}/{name}/{package}::msg::dds_::{kind}_/{TYPE_HASHES[message_type]}"

    def type_of(self, key: str) -> str | None:
        """Such as sensor_msgs/msg/Image; None where the key does not say it."""
        found = _DDS_TYPE.search(key)
        return None if found is None else f"{found[1]}/msg/{found[2]}"

    def _bridged(self, name: str) -> str:
        return "/".join(part for part in (self.namespace.strip("/"), name) if part)
