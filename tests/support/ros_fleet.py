"""A fleet of ROS 2 over Zenoh on loopback: its node and the service meet at a router and nowhere else;
messages are written by rosbags."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import zenoh
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation
from zenoh.ext import AdvancedPublisher, CacheConfig, declare_advanced_publisher

from crowdfence import View, run
from crowdfence.georeference import Georeference
from crowdfence.service.inputs import Inputs
from crowdfence.service.opening import live
from crowdfence.service.ros.keys import RosKeys
from crowdfence.service.ros.link import RosLink
from crowdfence.service.ros.topics import live_topics
from crowdfence.service.service import Service
from crowdfence.service.timeline import Moment
from support.small_service import CONFIG, SECOND_NS, SETTINGS, plain, recording

STORE = get_typestore(Stores.ROS2_HUMBLE)
T = STORE.types
FRAME = "uav/camera_optical"
ANCHOR = Georeference(46.5, 8.0, 1200.0)


def header(stamp_ns: int, frame: str) -> Any:
    sec, nanosec = divmod(stamp_ns, SECOND_NS)
    return T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](sec, nanosec), frame)


def heatmap_message(view: View) -> Any:
    """32FC1, with rows that are longer than their pixels."""
    values = np.asarray(view.heatmap, np.float32)
    rows, columns = values.shape
    padded = np.zeros((rows, columns + 3), "<f4")
    padded[:, :columns] = values
    data = padded.view(np.uint8).reshape(-1)
    return T["sensor_msgs/msg/Image"](
        header(view.stamp_ns, FRAME), rows, columns, "32FC1", 0, (columns + 3) * 4, data
    )


def info_message(view: View) -> Any:
    """Pixel centres at whole numbers, as ROS counts them."""
    camera = view.camera
    k = [camera.fx, 0.0, camera.cx - 0.5, 0.0, camera.fy, camera.cy - 0.5, 0.0, 0.0, 1.0]
    p = [*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0]
    roi = T["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    return T["sensor_msgs/msg/CameraInfo"](
        header(view.stamp_ns, FRAME),
        camera.height,
        camera.width,
        "plumb_bob",
        np.zeros(5),
        np.array(k),
        np.eye(3).reshape(-1),
        np.array(p),
        0,
        0,
        roi,
    )


def turned(pose: np.ndarray) -> Any:
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return T["geometry_msgs/msg/Quaternion"](x, y, z, w)


def pose_message(stamp_ns: int, pose: np.ndarray, frame: str = "map") -> Any:
    place = T["geometry_msgs/msg/Point"](*pose[:3, 3])
    return T["geometry_msgs/msg/PoseStamped"](
        header(stamp_ns, frame), T["geometry_msgs/msg/Pose"](place, turned(pose))
    )


def odometry_message(stamp_ns: int, pose: np.ndarray, child: str, frame: str = "map") -> Any:
    place = T["geometry_msgs/msg/Point"](*pose[:3, 3])
    with_covariance = T["geometry_msgs/msg/PoseWithCovariance"](
        T["geometry_msgs/msg/Pose"](place, turned(pose)), np.zeros(36)
    )
    nothing = T["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    twist = T["geometry_msgs/msg/TwistWithCovariance"](
        T["geometry_msgs/msg/Twist"](nothing, nothing), np.zeros(36)
    )
    return T["nav_msgs/msg/Odometry"](header(stamp_ns, frame), child, with_covariance, twist)


def tf_message(stamp_ns: int, parent: str, child: str, pose: np.ndarray) -> Any:
    place = T["geometry_msgs/msg/Vector3"](*pose[:3, 3])
    transform = T["geometry_msgs/msg/TransformStamped"](
        header(stamp_ns, parent), child, T["geometry_msgs/msg/Transform"](place, turned(pose))
    )
    return T["tf2_msgs/msg/TFMessage"]([transform])


@contextmanager
def session(mode: str, endpoints: str, endpoint: str) -> Iterator[zenoh.Session]:
    config = zenoh.Config()
    config.insert_json5("mode", f'"{mode}"')
    config.insert_json5(endpoints, f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("timestamping/enabled", "true")  # as rmw_zenoh has it: what is latched needs it
    with zenoh.open(config) as opened:
        yield opened


class Node:
    """Of somebody else; publishes as rmw_zenoh does, or as a bridge."""

    def __init__(self, kind: str, session: zenoh.Session) -> None:
        self.kind, self.session = kind, session
        self.latched: list[AdvancedPublisher] = []

    def latch(self, topic: str, message: Any) -> None:
        """Once, transient local: whoever subscribes later gets it too."""
        name = message.__msgtype__
        kept = CacheConfig(max_samples=1)
        publisher = declare_advanced_publisher(
            self.session, self.key_of(topic, name), cache=kept, publisher_detection=True
        )
        publisher.put(bytes(STORE.serialize_cdr(message, name)))
        self.latched.append(publisher)

    def publish(self, topic: str, message: Any) -> None:
        name = message.__msgtype__
        self.session.put(self.key_of(topic, name), bytes(STORE.serialize_cdr(message, name)))

    def key_of(self, topic: str, name: str) -> str:
        package, _, short = name.split("/")
        rmw = f"7{topic}/{package}::msg::dds_::{short}_/{STORE.hash_rihs01(name)}"
        return rmw if self.kind == "rmw" else f"fleet{topic}"


KEYS = {"rmw": RosKeys("rmw", domain=7), "bridge": RosKeys("bridge", namespace="fleet")}


@contextmanager
def fleet(
    folder: Path, kind: str, topics: list[str], before: Callable[[Node], None] = lambda node: None
) -> Iterator[tuple[Node, Service]]:
    """A router, and on it a node and the service; nobody scouts: the router alone brings them together.
    `before`: what the node does before the service starts."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{one.getsockname()[1]}"
    link = RosLink(endpoint=endpoint, keys=KEYS[kind], topics=live_topics(topics))
    settings = replace(SETTINGS, pose_wait_s=20.0)
    with (
        session("router", "listen/endpoints", endpoint) as router,
        session("client", "connect/endpoints", endpoint) as client,
        _did(Node(kind, client), before) as node,
        live(
            folder,
            plain(),
            CONFIG,
            name="plain",
            georeference=ANCHOR,
            settings=settings,
            inputs=Inputs(ros=link),
        ) as service,
    ):
        assert [str(one) for one in client.info.routers_zid()] == [str(router.info.zid())]
        assert not client.info.peers_zid()
        yield node, service


@contextmanager
def _did(node: Node, before: Callable[[Node], None]) -> Iterator[Node]:
    before(node)
    yield node


def until(true: Callable[[], Any], seconds: float = 60.0) -> None:
    give_up_s = time.monotonic() + seconds
    while not true():
        if time.monotonic() > give_up_s:
            raise TimeoutError("it never became true")
        time.sleep(0.02)


def again(publish: Callable[[], None], true: Callable[[], Any]) -> None:
    """Publish until it is true: what is published before a router knows of a subscriber is lost."""
    for _ in range(100):
        publish()
        for _ in range(50):
            if true():
                return
            time.sleep(0.02)
    raise TimeoutError("it never became true")


def decoded(message: Any) -> Any:
    """Through the wire: written by rosbags, read by the service."""
    from crowdfence.sources.mission import ros2_messages

    name = message.__msgtype__
    return ros2_messages.decode(name, bytes(STORE.serialize_cdr(message, name)))


def straight_down(east: float) -> np.ndarray:
    """A camera 20 m up that looks down, the top of its picture north."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = (east, 3.0, 20.0)
    return pose


def level_body(east: float) -> np.ndarray:
    """Forward (north), left (west), up."""
    pose = np.eye(4)
    pose[:3, :3] = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    pose[:3, 3] = (east, 3.0, 20.0)
    return pose


def with_the_zones_of(flown: list[View], service: Service) -> Moment:
    """Its newest moment, which has the zones of a run over the same views."""
    moment = service.mission.newest
    assert moment is not None
    same = run(recording(flown), plain(), CONFIG).zones
    assert len(moment.zones) == len(same) > 0
    for ours, theirs in zip(moment.zones, same, strict=True):
        # Quaternions carry a rotation to 1e-16.
        assert ours.polygon.symmetric_difference(theirs.polygon).area < 1e-6
    return moment
