"""A fleet of ROS 2 on one Zenoh session (extra `zenoh`, EPL-2.0 OR Apache-2.0)."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from crowdfence.errors import one_line
from crowdfence.exports.ros2.topics import TF_STATIC
from crowdfence.georeference import Georeference
from crowdfence.service.poses import PoseFeed
from crowdfence.service.ros.intake import Intake
from crowdfence.service.ros.keys import RosKeys
from crowdfence.service.ros.own_origin import OwnOrigin
from crowdfence.service.ros.poses import POSE_ROLES, RosPoses
from crowdfence.service.ros.publisher import RosPublisher
from crowdfence.service.ros.topics import ROLES, message_type
from crowdfence.service.service import Service
from crowdfence.sources.camera_mount import CameraMount
from crowdfence.sources.mission.camera_info import is_rectified
from crowdfence.sources.pose_noise import GivenNoise
from crowdfence.sources.ros_bag.topic_choice import DroneTopics, places_of

_SOURCE_LINE = re.compile(r" at \S+\.rs:\d+\.")  # of the library, where it was built


@dataclass(frozen=True, slots=True)
class RosLink:
    """Where the fleet is and what it publishes."""

    endpoint: str = ""
    """Of a Zenoh router or peer, such as tcp/127.0.0.1:7447; empty: as the configuration says."""
    config: Path | None = None
    """Zenoh's own configuration (JSON5), for TLS and access control."""
    keys: RosKeys = field(default_factory=RosKeys)
    topics: Sequence[DroneTopics] = ()
    mount: CameraMount | None = None
    noise: GivenNoise | None = None
    """What each pose is off by itself."""

    def feeds(self, anchor: Georeference | None) -> dict[str, PoseFeed]:
        """Of the drones whose poses are published, in the frame of a mission at `anchor`. ValueError for
        poses of an origin of their own in a mission that has no place on Earth."""
        found: dict[str, PoseFeed] = {}
        for one in self.topics:
            role = next((role for role in POSE_ROLES if getattr(one, role)), None)
            if role is not None:
                found[one.drone] = RosPoses(
                    role,
                    self.mount if role == "pose" else None,
                    noise=self.noise,
                    topic=getattr(one, role),
                    origin=self._origin(one, anchor),
                )
        return found

    def _origin(self, one: DroneTopics, anchor: Georeference | None) -> OwnOrigin | None:
        if one.origin is None:
            return None
        if anchor is None:
            raise ValueError(
                f"--topics: origin={one.origin} says where on Earth the poses of {one.drone} count from, and "
                "nothing says where the map lies: give --origin"
            )
        topics = [other.origin.strip("/") for other in self.topics if other.origin]
        return OwnOrigin(anchor, one.origin, shared=topics.count(one.origin.strip("/")) > 1)

    @contextmanager
    def connected(self, service: Service, feeds: Mapping[str, PoseFeed]) -> Iterator[None]:
        """While the block runs. OSError where nobody answers at the endpoint; ModuleNotFoundError without
        Zenoh."""
        with ExitStack() as opened:
            session = self._session()
            opened.callback(session.close)
            put = _Put(session, self.keys)
            publisher = RosPublisher(service.mission, put)
            publisher.start()
            opened.callback(publisher.stop)
            for one in self.topics:
                feed = feeds.get(one.drone)
                assert service.live is not None
                intake = Intake(
                    one.drone,
                    service.live,
                    service.alerts,
                    service.clock,
                    feed if isinstance(feed, RosPoses) else None,
                    rectified=is_rectified(one.camera or one.heatmap or ""),
                )
                intake.start()
                opened.callback(intake.stop)
                for subscriber in self._subscribers(session, one, intake):
                    opened.callback(subscriber.undeclare)
            yield

    def _session(self) -> Any:
        import zenoh

        try:
            config = zenoh.Config() if self.config is None else zenoh.Config.from_file(str(self.config))
            if self.endpoint:
                config.insert_json5("mode", '"client"')
                config.insert_json5("connect/endpoints", json.dumps([self.endpoint]))
                config.insert_json5("scouting/multicast/enabled", "false")
            return zenoh.open(config)
        except zenoh.ZError as error:
            why = _SOURCE_LINE.sub("", one_line(error))
            raise OSError(f"no Zenoh session with {self.endpoint or self.config}: {why}") from error

    def _subscribers(self, session: Any, one: DroneTopics, intake: Intake) -> Iterator[Any]:
        for role in ROLES:
            topic = getattr(one, role)
            if topic is None:
                continue
            yield self._subscribed(session, topic, role, intake, fixed=topic.endswith("_static"))
        if one.tf or (one.pose and self.mount is None):
            for topic in static_topics(one):
                if topic != one.tf:
                    yield self._subscribed(session, topic, "tf", intake, fixed=True)

    def _subscribed(self, session: Any, topic: str, role: str, intake: Intake, *, fixed: bool) -> Any:
        from zenoh.ext import HistoryConfig, declare_advanced_subscriber

        def heard(sample: Any) -> None:
            kind = self.keys.type_of(str(sample.key_expr)) or message_type(role, topic)
            intake.take(role, kind, sample.payload.to_bytes(), fixed=fixed)

        key = self.keys.subscribed(topic)
        if not (fixed or role in ("info", "origin")):
            return session.declare_subscriber(key, heard)
        # Told once, perhaps before we came: publishers of ROS that are transient local keep it.
        history = HistoryConfig(detect_late_publishers=True)
        return declare_advanced_subscriber(session, key, heard, history=history)


def static_topics(one: DroneTopics) -> tuple[str, ...]:
    """Where fixed transforms of a drone may be told: to all at once, or in a namespace of its own
    (/uav1/tf_static)."""
    return tuple(place + TF_STATIC for place in sorted({"", *places_of(one)}))


class _Put:
    """Publishes under the keys of a fleet, with what rmw_zenoh wants beside a message: its number, its time
    and who sent it."""

    def __init__(self, session: Any, keys: RosKeys) -> None:
        self._session, self._keys = session, keys
        self._number = 0
        self._sender = bytes.fromhex(str(session.info.zid()).rjust(32, "0"))

    def __call__(self, topic: str, kind: str, data: bytes) -> None:
        from zenoh.ext import Int64, z_serialize

        self._number += 1
        parts: tuple[Callable[[], Any] | Any, ...] = (
            "sequence_number",
            Int64(self._number),
            "source_timestamp",
            Int64(time.time_ns()),
            "source_gid",
            self._sender,
        )
        self._session.put(self._keys.published(topic, kind), data, attachment=z_serialize(parts))
