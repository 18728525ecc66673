"""A fleet of ROS 2 over Zenoh: messages are written by rosbags, and zones and maps read by rosbags."""

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation
from zenoh.ext import Int64, z_deserialize

from crowdfence import View
from crowdfence.service.inputs import Inputs
from crowdfence.service.opening import live
from crowdfence.service.ros.keys import TYPE_HASHES, RosKeys
from crowdfence.service.ros.link import RosLink, static_topics
from crowdfence.service.ros.poses import RosPoses
from crowdfence.service.ros.topics import live_topics
from crowdfence.service.watch import Watch
from crowdfence.sources.camera_mount import CameraMount
from crowdfence.sources.ros_bag.topic_choice import DroneTopics
from support.ros_fleet import (
    ANCHOR,
    FRAME,
    KEYS,
    STORE,
    Node,
    again,
    decoded,
    fleet,
    heatmap_message,
    info_message,
    level_body,
    odometry_message,
    pose_message,
    straight_down,
    tf_message,
    until,
    with_the_zones_of,
)
from support.small_service import (
    CONFIG,
    DRONES,
    SECOND_NS,
    SETTINGS,
    START_NS,
    plain,
    running,
    views,
)


@pytest.mark.parametrize("kind", ["rmw", "bridge"])
def test_a_fleet_of_ros_gives_the_zones_of_the_same_recording(tmp_path: Path, kind: str) -> None:
    """Heatmaps, intrinsics and camera poses as CDR in; zones and grids as CDR out."""
    topics = [f"heatmap=/{drone}/heatmap,info=/{drone}/info,camera_pose=/{drone}/pose" for drone in DRONES]
    flown = views(6)
    with fleet(tmp_path, kind, topics) as (node, service):
        heard: dict[str, list[Any]] = {"zones": [], "belief": [], "closed": []}
        types = {"zones": "visualization_msgs/msg/MarkerArray"}
        for name, samples in heard.items():
            message_type = types.get(name, "nav_msgs/msg/OccupancyGrid")
            key = node.key_of(f"/crowdfence/{name}", message_type)
            node.session.declare_subscriber(key, lambda sample, samples=samples: samples.append(sample))
        live_service = service.live
        assert live_service is not None
        for number, view in enumerate(flown):
            # The pose comes after its picture, as it does where a filter makes it.
            def publish(view: View = view) -> None:
                node.publish(f"/{view.drone}/info", info_message(view))
                node.publish(f"/{view.drone}/heatmap", heatmap_message(view))
                node.publish(f"/{view.drone}/pose", pose_message(view.stamp_ns, view.world_from_camera))

            again(publish, lambda wanted=number + 1: sum(live_service.heard.accepted.values()) == wanted)
        live_service.finish()
        moment = with_the_zones_of(flown, service)
        until(lambda: heard["closed"] and _stamp(heard["closed"][-1]) == moment.stamp_ns)
        until(lambda: heard["belief"] and _stamp(heard["belief"][-1]) == moment.stamp_ns)
        until(lambda: heard["zones"] and _marked(heard["zones"][-1], moment.stamp_ns))
        markers = STORE.deserialize_cdr(
            heard["zones"][-1].payload.to_bytes(), "visualization_msgs/msg/MarkerArray"
        ).markers
        fills = [one for one in markers if one.ns == "crowd ground"]
        corners = np.array([[p.x, p.y] for one in fills for p in one.points]).reshape(-1, 3, 2)
        drawn = shapely.union_all([shapely.Polygon(corner) for corner in corners])
        closed = shapely.union_all([zone.polygon for zone in moment.zones.closed])
        assert drawn.symmetric_difference(closed).area < 1e-3 * closed.area
        grid = STORE.deserialize_cdr(heard["closed"][-1].payload.to_bytes(), "nav_msgs/msg/OccupancyGrid")
        cells = np.array(grid.data).reshape(grid.info.height, grid.info.width)
        at = grid.info.origin.position
        for zone in moment.zones.closed:
            inside = zone.polygon.representative_point()
            row, column = (
                int((inside.y - at.y) / grid.info.resolution),
                int((inside.x - at.x) / grid.info.resolution),
            )
            assert cells[row, column] == 100
        assert {-1, 100} <= set(cells.ravel().tolist()) <= {-1, 0, 100}
        belief = STORE.deserialize_cdr(heard["belief"][-1].payload.to_bytes(), "nav_msgs/msg/OccupancyGrid")
        likeliest = service.mission.loop.crowd_map.probability(moment.stamp_ns).max()
        assert max(belief.data) == np.ceil(100 * likeliest) and belief.header.frame_id == "map"
        # What rmw_zenoh wants beside a message, in its order.
        parts = tuple[str, Int64, str, Int64, str, bytes]
        told = z_deserialize(parts, heard["zones"][-1].attachment)
        assert told[::2] == ("sequence_number", "source_timestamp", "source_gid")
        assert told[1] > 0 and abs(told[3] - time.time_ns()) < 600 * SECOND_NS and len(told[5]) == 16


def _stamp(sample: Any) -> int:
    message = STORE.deserialize_cdr(sample.payload.to_bytes(), "nav_msgs/msg/OccupancyGrid")
    return int(message.header.stamp.sec) * SECOND_NS + int(message.header.stamp.nanosec)


def _marked(sample: Any, stamp_ns: int) -> bool:
    message = STORE.deserialize_cdr(sample.payload.to_bytes(), "visualization_msgs/msg/MarkerArray")
    stamp = message.markers[0].header.stamp
    return bool(stamp.sec * SECOND_NS + stamp.nanosec == stamp_ns)


@pytest.mark.parametrize(
    ("kind", "static"), [("rmw", "/tf_static"), ("bridge", "/tf_static"), ("rmw", "/uav1/tf_static")]
)
def test_what_is_told_once_before_the_service_starts_is_heard(tmp_path: Path, kind: str, static: str) -> None:
    """/tf_static and camera_info of nodes that came first: no view ever got a pose, and nobody said why."""
    (view,) = views(1, ("uav1",))
    body = level_body(20.0)
    body_from_camera = np.linalg.inv(body) @ view.world_from_camera

    def before(node: Node) -> None:
        node.latch("/uav1/info", info_message(view))
        node.latch(static, tf_message(0, "uav1/base", FRAME, body_from_camera))

    topics = ["drone=uav1,heatmap=/uav1/heatmap,info=/uav1/info,pose=/uav1/odom"]
    with fleet(tmp_path, kind, topics, before) as (node, service):
        assert service.live is not None
        heard = service.live.heard

        def publish() -> None:
            node.publish("/uav1/odom", odometry_message(view.stamp_ns, body, "uav1/base"))
            node.publish("/uav1/heatmap", heatmap_message(view))

        again(publish, lambda: heard.accepted["uav1"] == 1)
        service.live.applying.settled(30.0)
        service.live.finish()
        known = service.fleet.last("uav1")
        assert known is not None and np.allclose(known.world_from_camera, view.world_from_camera, atol=1e-9)


def test_fixed_transforms_are_asked_for_wherever_a_drone_may_tell_them() -> None:
    of_all = ("/tf_static",)
    assert static_topics(DroneTopics("a", camera="/image", tf="/tf")) == of_all
    own = DroneTopics("a", camera="/uav1/front/image", pose="/mavros/uav1/odom", tf="/robot/tf")
    places = ("/mavros", "/mavros/uav1", "/robot", "/uav1", "/uav1/front")
    assert static_topics(own) == (*of_all, *(f"{place}/tf_static" for place in places))


def test_zones_go_on_being_told_when_views_stop_and_damage_is_an_alert(tmp_path: Path) -> None:
    topics = ["drone=uav1,heatmap=/uav1/heatmap,info=/uav1/info,camera_pose=/uav1/pose"]
    with fleet(tmp_path, "rmw", topics) as (node, service):
        heard: list[Any] = []
        key = node.key_of("/crowdfence/zones", "visualization_msgs/msg/MarkerArray")
        node.session.declare_subscriber(key, heard.append)
        live_service = service.live
        assert live_service is not None
        for number, view in enumerate(views(3, ("uav1",))):

            def publish(view: View = view) -> None:
                node.publish("/uav1/info", info_message(view))
                node.publish("/uav1/pose", pose_message(view.stamp_ns, view.world_from_camera))
                node.publish("/uav1/heatmap", heatmap_message(view))

            again(publish, lambda wanted=number + 1: live_service.heard.accepted["uav1"] == wanted)
        live_service.finish()
        until(lambda: heard)
        before = len(heard)
        until(lambda: len(heard) > before + 1)  # nothing new: said again
        key = node.key_of("/uav1/heatmap", "sensor_msgs/msg/Image")
        node.session.put(key, b"\x00\x01\x00\x00short")
        until(lambda: service.alerts.active("refused_views", "uav1"))
        assert (
            live_service.applying.works
            and live_service.heard.refused["uav1"] == 1
            and live_service.heard.accepted["uav1"] == 3
        )


def test_no_router_is_said_at_the_start(tmp_path: Path) -> None:
    link = RosLink(endpoint="tcp/127.0.0.1:9")
    started = live(tmp_path, plain(), CONFIG, name="plain", settings=SETTINGS, inputs=Inputs(ros=link))
    with pytest.raises(OSError) as refused, started:
        pass
    said = str(refused.value)
    assert said.startswith("no Zenoh session with tcp/127.0.0.1:9: Unable to connect") and ".rs" not in said


def test_the_hashes_of_types_are_those_of_another_implementation() -> None:
    assert {name: STORE.hash_rihs01(name) for name in TYPE_HASHES} == TYPE_HASHES


def test_keys_are_those_of_rmw_zenoh_and_of_the_bridge() -> None:
    rmw, bridge = KEYS["rmw"], KEYS["bridge"]
    assert rmw.subscribed("/uav1/odom") == "7/uav1/odom/*/*"
    assert rmw.published("/tf_static", "tf2_msgs/msg/TFMessage").startswith(
        "7/tf_static/tf2_msgs::msg::dds_::TFMessage_/RIHS01_"
    )
    assert rmw.type_of("7/uav1/odom/nav_msgs::msg::dds_::Odometry_/RIHS01_0") == "nav_msgs/msg/Odometry"
    assert bridge.subscribed("/uav1/odom") == "fleet/uav1/odom" and bridge.type_of("fleet/uav1/odom") is None
    with pytest.raises(ValueError, match="233"):
        RosKeys(domain=233)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("camera=/a", "info="),
        ("info=/a,drone=x", "camera= or heatmap="),
        ("camera=/a,info=/b,fix=/c", "roles: drone, camera"),
        ("camera", "ROLE=TOPIC"),
        ("drone=x,camera=/*/image,info=/a", r"/\*/image names no topic"),
        ("drone=x,camera=/uav1/image,info=/uav$*/info", "names no topic"),
        ("camera=/a//image,info=/b", "names no topic"),
        ("camera=/a,info=/b,camera=/c", "camera is given twice, a drone has one"),
    ],
)
def test_topics_that_cannot_be_used_are_refused(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        live_topics([text])


def test_two_drones_need_two_names() -> None:
    with pytest.raises(ValueError, match="two drones"):
        live_topics(["camera=/a/1,info=/b", "camera=/a/2,info=/b"])


@pytest.mark.parametrize("role", ["camera", "heatmap", "camera_pose"])
def test_a_topic_of_one_camera_is_not_that_of_two_drones(role: str) -> None:
    """A line that was copied: what uav1 saw counted twice, or uav2's crowds lay under uav1."""
    own = {"heatmap": "/{}/h", "info": "/{}/i", "camera_pose": "/{}/p"}
    if role == "camera":
        own["camera"] = own.pop("heatmap")
    texts = []
    for drone in ("uav1", "uav2"):
        topics = {name: topic.format(drone) for name, topic in own.items()}
        topics[role] = "uav1/x" if drone == "uav2" else "/uav1/x"
        texts.append(",".join([f"drone={drone}", *(f"{name}={topic}" for name, topic in topics.items())]))
    with pytest.raises(ValueError, match=f"{role}=uav1/x is given for uav1 and for uav2"):
        live_topics(texts)
    assert live_topics(["drone=front,camera=/a,info=/i,pose=/p", "drone=rear,camera=/b,info=/i,pose=/p"])


# --- poses, message by message ---


def halfway(feed: RosPoses) -> np.ndarray:
    assert feed.newest_ns == START_NS + SECOND_NS // 2
    return feed.pose_at(START_NS + SECOND_NS // 4)


def test_camera_poses_are_taken_as_they_are() -> None:
    feed = RosPoses("camera_pose", None)
    for number, east in enumerate((10.0, 12.0)):
        feed.posed(decoded(pose_message(START_NS + number * SECOND_NS // 2, straight_down(east))))
    assert np.allclose(halfway(feed), straight_down(11.0))


def test_a_body_with_a_mount_carries_its_camera() -> None:
    """Straight down from a drone that flies north: the top of the picture is north."""
    feed = RosPoses("pose", CameraMount("level", -90.0))
    for number, east in enumerate((10.0, 12.0)):
        message = odometry_message(START_NS + number * SECOND_NS // 2, level_body(east), "base_link")
        feed.posed(decoded(message))
    assert np.allclose(halfway(feed), straight_down(11.0), atol=1e-9)


def test_attitudes_that_nobody_set_are_told_of_as_in_a_bag() -> None:
    """A node that fills in positions alone: with --mount each camera looked east of a drone that flew north,
    and nothing was said. Where the mount counts from north the body's attitude is not used."""

    def doubt_of(kind: str, body: np.ndarray) -> str | None:
        feed = RosPoses("pose", CameraMount(kind, -60.0))  # type: ignore[arg-type]
        for number in range(3):
            feed.posed(decoded(pose_message(START_NS + number * SECOND_NS // 4, body)))
        feed.pose_at(START_NS + SECOND_NS // 3)
        return feed.doubt

    unset = np.eye(4)
    assert "its attitudes are 0, 0, 0, 1 to the last digit" in (doubt_of("level", unset) or "")
    assert doubt_of("level", level_body(0.0)) is None
    assert doubt_of("north", unset) is None


def test_a_body_with_tf_carries_its_camera() -> None:
    body_from_camera = np.linalg.inv(level_body(0.0)) @ straight_down(0.0)
    feed = RosPoses("pose", None)
    feed.camera_frame = FRAME
    feed.transformed(decoded(tf_message(0, "uav/base", FRAME, body_from_camera)), fixed=True)
    for number, east in enumerate((10.0, 12.0)):
        message = odometry_message(START_NS + number * SECOND_NS // 2, level_body(east), "uav/base")
        feed.posed(decoded(message))
    assert np.allclose(halfway(feed), straight_down(11.0), atol=1e-9)


def test_pictures_that_name_the_link_of_their_camera_get_the_optical_frame_below_it() -> None:
    """As in bags: the link looks along its x."""
    link = np.linalg.inv(level_body(0.0)) @ straight_down(0.0)
    optical = np.eye(4)
    optical[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
    feed = RosPoses("pose", None)
    feed.camera_frame = "camera_link"
    fixed = [
        tf_message(0, "uav/base", "camera_link", link @ np.linalg.inv(optical)),
        tf_message(0, "camera_link", "camera_optical_frame", optical),
    ]
    for message in fixed:
        feed.transformed(decoded(message), fixed=True)
    for number, east in enumerate((10.0, 12.0)):
        message = odometry_message(START_NS + number * SECOND_NS // 2, level_body(east), "uav/base")
        feed.posed(decoded(message))
    assert np.allclose(halfway(feed), straight_down(11.0), atol=1e-9)


def test_tf_alone_carries_a_camera() -> None:
    body_from_camera = np.linalg.inv(level_body(0.0)) @ straight_down(0.0)
    feed = RosPoses("tf", None)
    feed.camera_frame = FRAME
    assert feed.newest_ns is None
    feed.transformed(decoded(tf_message(0, "uav/base", FRAME, body_from_camera)), fixed=True)
    for number, east in enumerate((10.0, 12.0)):
        stamp_ns = START_NS + number * SECOND_NS // 2
        feed.transformed(decoded(tf_message(stamp_ns, "map", "uav/base", level_body(east))), fixed=False)
    assert np.allclose(halfway(feed), straight_down(11.0), atol=1e-9)


NED = np.array([[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""North-east-down in east-north-up, and the other way round."""
FRD = np.diag([1.0, -1.0, -1.0, 1.0])
"""Forward-right-down in forward-left-up."""


def test_camera_poses_that_are_north_east_down_by_name_are_turned(caplog: pytest.LogCaptureFixture) -> None:
    """Taken as they are, the camera was 20 m under the ground, with north and east exchanged."""
    feed = RosPoses("camera_pose", None)
    for number, east in enumerate((10.0, 12.0)):
        stamp_ns = START_NS + number * SECOND_NS // 2
        feed.posed(decoded(pose_message(stamp_ns, NED @ straight_down(east), "map_ned")))
    assert np.allclose(halfway(feed), straight_down(11.0), atol=1e-9)
    assert [one.message for one in caplog.records] == [
        "map_ned is north-east-down by its name: its poses are turned"
    ]


@pytest.mark.parametrize("frame", ["world_ned", "uav1"])
@pytest.mark.parametrize("mount", [None, CameraMount("level", -90.0), CameraMount("body", -90.0)])
def test_odometry_that_is_north_east_down_by_its_frames_is_turned(
    frame: str, mount: CameraMount | None
) -> None:
    """As the ROS wrapper of AirSim tells it: at times the child alone says it."""
    child = "uav1/odom_local_ned"
    feed = RosPoses("pose", mount)
    feed.camera_frame = FRAME
    body_from_camera = FRD @ np.linalg.inv(level_body(0.0)) @ straight_down(0.0)
    feed.transformed(decoded(tf_message(0, child, FRAME, body_from_camera)), fixed=True)
    for number, east in enumerate((10.0, 12.0)):
        stamp_ns = START_NS + number * SECOND_NS // 2
        feed.posed(decoded(odometry_message(stamp_ns, NED @ level_body(east) @ FRD, child, frame)))
    assert np.allclose(halfway(feed), straight_down(11.0), atol=1e-9)


def test_a_tree_that_hangs_on_a_world_that_is_north_east_down_is_turned() -> None:
    feed = RosPoses("tf", None)
    feed.camera_frame = FRAME
    for number, east in enumerate((10.0, 12.0)):
        stamp_ns = START_NS + number * SECOND_NS // 2
        told = tf_message(stamp_ns, "world_ned", FRAME, NED @ straight_down(east))
        feed.transformed(decoded(told), fixed=False)
    assert np.allclose(halfway(feed), straight_down(11.0), atol=1e-9)


def test_poses_told_in_other_axes_from_now_on_are_not_mixed_with_those_of_before() -> None:
    feed = RosPoses("camera_pose", None)
    feed.posed(decoded(pose_message(START_NS, straight_down(10.0))))
    later_ns = START_NS + SECOND_NS // 2
    feed.posed(decoded(pose_message(later_ns, NED @ straight_down(12.0), "map_ned")))
    with pytest.raises(ValueError, match="before the first"):
        feed.pose_at(START_NS + SECOND_NS // 4)
    assert np.allclose(feed.pose_at(later_ns), straight_down(12.0), atol=1e-9)


def test_poses_in_two_frames_by_turns_are_not_mixed_and_are_told_of() -> None:
    """Two nodes on one topic: a view between two rows stood in the middle between odom and map."""
    feed = RosPoses("camera_pose", None)
    feed.posed(decoded(pose_message(START_NS, straight_down(10.0), "/map")))
    feed.posed(decoded(pose_message(START_NS + SECOND_NS // 4, straight_down(10.0), "map")))
    assert feed.doubt is None
    feed.posed(decoded(pose_message(START_NS + SECOND_NS // 2, straight_down(60.0), "odom")))
    with pytest.raises(ValueError, match="before the first"):
        feed.pose_at(START_NS + 3 * SECOND_NS // 8)
    assert feed.doubt is not None and "its poses come in the frames map and odom: all are" in feed.doubt


def test_a_body_that_hangs_on_two_frames_has_no_pose() -> None:
    """MAVROS may tell tf from map and from odom: the camera stood in either by turns, as the window fell."""
    feed = RosPoses("tf", None)
    feed.camera_frame = FRAME
    body_from_camera = np.linalg.inv(level_body(0.0)) @ straight_down(0.0)
    feed.transformed(decoded(tf_message(0, "base", FRAME, body_from_camera)), fixed=True)
    for number in range(200):
        stamp_ns = START_NS + number * SECOND_NS // 10
        parent, east = ("odom", 60.0) if 50 <= number < 100 and number % 2 else ("/map", 10.0)
        feed.transformed(decoded(tf_message(stamp_ns, parent, "base", level_body(east))), fixed=False)
    for seconds in (2.0, 15.0):
        found = feed.pose_at(START_NS + round(seconds * SECOND_NS))
        assert np.allclose(found, straight_down(10.0), atol=1e-9)
    for seconds in (5.0, 7.05, 9.95):
        with pytest.raises(ValueError, match="tf says that base hangs on map and on odom: stop all but one"):
            feed.pose_at(START_NS + round(seconds * SECOND_NS))


def test_a_gimbal_that_was_told_as_fixed_too_moves() -> None:
    """As by the description of a robot, before its driver runs: it was where it would be seconds later."""
    feed = RosPoses("tf", None)
    feed.camera_frame = FRAME
    feed.transformed(decoded(tf_message(0, "base", FRAME, straight_down(0.0))), fixed=True)
    for number in range(100):
        stamp_ns = START_NS + number * SECOND_NS // 10
        feed.transformed(decoded(tf_message(stamp_ns, "map", "base", np.eye(4))), fixed=False)
        feed.transformed(decoded(tf_message(stamp_ns, "base", FRAME, straight_down(number))), fixed=False)
    found = feed.pose_at(START_NS + 5 * SECOND_NS)
    assert np.allclose(found, straight_down(50.0), atol=1e-9)


def test_what_is_told_as_fixed_and_again_and_again_stays_fixed() -> None:
    feed = RosPoses("tf", None)
    feed.camera_frame = FRAME
    feed.transformed(decoded(tf_message(0, "base", FRAME, straight_down(0.0))), fixed=True)
    for stamp_ns in (START_NS, START_NS + SECOND_NS // 2):
        feed.transformed(decoded(tf_message(stamp_ns, "map", "base", np.eye(4))), fixed=False)
        feed.transformed(decoded(tf_message(stamp_ns - 1, "base", FRAME, straight_down(0.0))), fixed=False)
    assert np.allclose(feed.pose_at(START_NS + SECOND_NS // 4), straight_down(0.0), atol=1e-9)


def test_a_camera_that_is_fixed_in_two_ways_is_told_of() -> None:
    """A description of the robot and a calibration may both tell it, and the last turned every look."""
    down = np.linalg.inv(level_body(0.0)) @ straight_down(0.0)
    feed = RosPoses("tf", None)
    feed.camera_frame = FRAME
    for number, east in enumerate((10.0, 12.0)):
        stamp_ns = START_NS + number * SECOND_NS // 2
        feed.transformed(decoded(tf_message(stamp_ns, "map", "base", level_body(east))), fixed=False)
    for child, pose in ((FRAME, down), (FRAME, down), ("other", np.eye(4)), ("other", down)):
        feed.transformed(decoded(tf_message(0, "base", child, pose)), fixed=True)
    assert np.allclose(halfway(feed), straight_down(11.0), atol=1e-9) and feed.doubt is None
    feed.transformed(decoded(tf_message(0, "base", FRAME, np.eye(4))), fixed=True)
    assert np.allclose(halfway(feed), level_body(11.0), atol=1e-9)
    assert feed.doubt is not None and f"/tf_static told {FRAME} in different places" in feed.doubt


def test_tf_that_says_where_the_map_is_on_earth_moves_no_camera() -> None:
    """The service itself tells the fleet, on the topic that it listens to: cameras went to the middle of the
    Earth."""
    feed = RosPoses("tf", None)
    feed.camera_frame = FRAME
    earth_from_map = np.diag([1.0, -1.0, -1.0, 1.0])
    earth_from_map[:3, 3] = (4.3e6, 6.1e5, 4.6e6)
    feed.transformed(decoded(tf_message(0, "earth", "map", earth_from_map)), fixed=True)
    for number, east in enumerate((10.0, 12.0)):
        stamp_ns = START_NS + number * SECOND_NS // 2
        feed.transformed(decoded(tf_message(stamp_ns, "map", FRAME, straight_down(east))), fixed=False)
    assert np.allclose(halfway(feed), straight_down(11.0), atol=1e-9)


def test_drones_that_count_from_frames_of_their_own_are_told_of(tmp_path: Path) -> None:
    """They were all taken to have begun at one place; only tf says how their frames lie."""
    with running(tmp_path) as service:
        assert service.live is not None

        def told(**feeds: RosPoses) -> list[tuple[str, str]]:
            assert service.live is not None
            service.live.poses.feeds.clear()
            service.live.poses.feeds.update(feeds)
            Watch(service).look()
            alert = service.alerts.active("pose_frames")
            return [] if alert is None else [(alert.level, alert.text)]

        def posed(frame: str) -> RosPoses:
            feed = RosPoses("camera_pose", None)
            feed.posed(decoded(pose_message(START_NS, straight_down(10.0), frame)))
            return feed

        def by_tf(world: str | None) -> RosPoses:
            feed = RosPoses("tf", None)
            feed.camera_frame = FRAME
            feed.transformed(
                decoded(tf_message(START_NS, "uav3/odom", FRAME, straight_down(10.0))), fixed=False
            )
            if world is not None:
                feed.transformed(decoded(tf_message(0, world, "uav3/odom", np.eye(4))), fixed=True)
            return feed

        assert not told(uav1=posed("/map"), uav2=posed("map"), uav3=by_tf("map"))
        ((level, text),) = told(uav1=posed("uav1/odom"), uav2=posed("uav2/odom"))
        assert level == "warning"
        assert text.startswith(
            "poses come in frames that nothing joins (uav1 in uav1/odom, uav2 in uav2/odom): all are taken"
        )
        assert told(uav1=posed("uav1/odom"), uav2=RosPoses("camera_pose", None)), "not known yet: it stays"
        assert not told(uav1=posed("uav1/odom")), "one alone counts from --origin"
        assert told(uav1=posed("map"), uav3=by_tf(None))
        assert not told(uav1=posed("map"), uav2=posed("map"))

        def by_mavros(*topics: str) -> list[tuple[str, str]]:
            asked = [f"drone=d{n},heatmap=/h{n},info=/i,pose={topic}" for n, topic in enumerate(topics)]
            feeds = RosLink(topics=live_topics(asked)).feeds(ANCHOR)
            for feed in feeds.values():
                assert isinstance(feed, RosPoses)
                feed.posed(decoded(pose_message(START_NS, straight_down(10.0), "map")))
            return told(**feeds)

        ((_, text),) = by_mavros("/uav1/mavros/local_position/pose", "/uav2/mavros/local_position/odom")
        assert "(d0 in map of /uav1/mavros, d1 in map of /uav2/mavros)" in text and "--mavlink" in text
        assert by_mavros("/uav1/mavros/odometry/in", "/uav2/mavros/global_position/local")
        assert not by_mavros("/uav1/mavros/local_position/pose", "/uav1/mavros/odometry/in")
        assert not by_mavros("/uav1/vicon/pose", "/uav2/vicon/pose")

        def switched_on(*topics: str) -> list[tuple[str, str]]:
            feeds = {f"uav{n}": RosPoses("camera_pose", None, topic=topic) for n, topic in enumerate(topics)}
            for feed in feeds.values():
                feed.posed(decoded(pose_message(START_NS, straight_down(10.0), "odom")))
            return told(**feeds)

        ((_, text),) = switched_on("/uav1/vio/pose", "/uav2/vio/pose")
        assert "(uav0 in odom of /uav1/vio/pose, uav1 in odom of /uav2/vio/pose)" in text


def test_gaps_and_frames_without_a_way_are_refused() -> None:
    feed = RosPoses("camera_pose", None)
    with pytest.raises(ValueError, match="no pose"):
        feed.pose_at(START_NS)
    for seconds in (0, 2):
        feed.posed(decoded(pose_message(START_NS + seconds * SECOND_NS, straight_down(10.0))))
    with pytest.raises(ValueError, match="gap of 2"):
        feed.pose_at(START_NS + SECOND_NS)
    body = RosPoses("pose", None)
    body.posed(decoded(odometry_message(START_NS, level_body(1.0), "base_link")))
    with pytest.raises(ValueError, match="--mount"):
        body.pose_at(START_NS)
    by_tf = RosPoses("tf", None)
    assert by_tf.newest_ns is None and "no picture" in by_tf.lacks
    by_tf.camera_frame = FRAME
    by_tf.transformed(decoded(tf_message(START_NS, "map", "uav/base", level_body(1.0))), fixed=False)
    assert by_tf.newest_ns is None and by_tf.lacks == f"no tf of something that moves leads to {FRAME}"


def turning(time_s: float) -> np.ndarray:
    """A right angle from 1.0 to 1.45 s, a camera 20 m up that looks down ahead."""
    pose = np.eye(4)
    heading_deg = 90.0 * np.clip((time_s - 1.0) / 0.45, 0.0, 1.0)
    down = Rotation.from_euler("x", 135.0, degrees=True)
    pose[:3, :3] = (Rotation.from_euler("z", -heading_deg, degrees=True) * down).as_matrix()
    pose[:3, 3] = (0.0, 0.0, 20.0)
    return pose


@pytest.mark.parametrize("step_s", [0.02, 0.5])
@pytest.mark.parametrize("role", ["camera_pose", "tf"])
def test_a_turn_that_nobody_told_is_not_made_up(role: Any, step_s: float) -> None:
    """As in bags: 40 degrees off in the middle of a pause of 0.9 s; poses that come seldom are bridged."""
    feed = RosPoses(role, None)
    feed.camera_frame = FRAME
    for number in range(round(2.5 / step_s)):
        time_s = number * step_s
        stamp_ns = START_NS + round(time_s * SECOND_NS)
        if step_s < 0.1 and 0.6 < time_s < 1.5:
            continue
        if role == "tf":
            feed.transformed(decoded(tf_message(stamp_ns, "map", FRAME, turning(time_s))), fixed=False)
        else:
            feed.posed(decoded(pose_message(stamp_ns, turning(time_s))))
    if step_s < 0.1:
        with pytest.raises(ValueError, match=r"gap of 0\.900 s there \(limit max_pose_gap_s = 0\.25 s\)"):
            feed.pose_at(START_NS + SECOND_NS)
    for time_s in (0.55, 1.9):
        assert np.allclose(feed.pose_at(START_NS + round(time_s * SECOND_NS)), turning(time_s))


@pytest.mark.parametrize("role", ["camera_pose", "tf"])
def test_poses_that_two_nodes_tell_by_turns_are_given_to_no_view(role: Any) -> None:
    """Joints of a gimbal that nobody set beside its driver: views were put between the two, and no word."""
    feed = RosPoses(role, None)
    feed.camera_frame = FRAME
    for number in range(100):
        stamp_ns, pose = START_NS + number * 20_000_000, turning(2.0 if number % 2 else 0.0)
        if role == "tf":
            feed.transformed(decoded(tf_message(stamp_ns, "map", FRAME, pose)), fixed=False)
        else:
            feed.posed(decoded(pose_message(stamp_ns, pose)))
    with pytest.raises(ValueError, match="jumps 90 degrees away and back, again and again: stop all but one"):
        feed.pose_at(START_NS + SECOND_NS)


def test_poses_are_kept_for_as_long_as_views_may_be_late() -> None:
    feed = RosPoses("camera_pose", None)
    message = decoded(pose_message(START_NS, straight_down(1.0)))
    for number in range(2000):
        stamp_ns = START_NS + number * SECOND_NS // 10
        sec, nanosec = divmod(stamp_ns, SECOND_NS)
        stamped = SimpleNamespace(
            header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id="map"),
            pose=message.pose,
        )
        feed.posed(stamped)
    assert len(feed._rows) <= 701


@pytest.mark.parametrize("role", ["camera_pose", "tf"])
def test_one_stamp_of_a_wrong_clock_does_not_end_all_poses(role: Any) -> None:
    """An hour ahead, once, as of a node that was just started; and a clock that is set back by an hour."""
    feed = RosPoses(role, None)
    feed.camera_frame = FRAME

    def tell(seconds: float, east: float) -> None:
        stamp_ns = START_NS + round(seconds * SECOND_NS)
        if role == "tf":
            feed.transformed(decoded(tf_message(stamp_ns, "map", FRAME, straight_down(east))), fixed=False)
        else:
            feed.posed(decoded(pose_message(stamp_ns, straight_down(east))))

    tell(3600.0, 99.0)
    for seconds, east in ((0.0, 10.0), (0.5, 12.0)):
        tell(seconds, east)
    assert np.allclose(halfway(feed), straight_down(11.0), atol=1e-9)
    tell(0.2, 50.0)  # overtaken on its way, and no new clock
    assert np.allclose(halfway(feed), straight_down(11.0), atol=1e-9)


@pytest.mark.parametrize("role", ["camera_pose", "tf"])
def test_a_clock_that_is_set_back_moves_no_view(role: Any) -> None:
    """Views taken since then must not get the poses that were told at their stamps before."""
    feed = RosPoses(role, None)
    feed.camera_frame = FRAME
    times = [(seconds, 10.0 * seconds) for seconds in np.arange(0.0, 10.0, 0.25)]
    times += [(seconds, 10.0 * (seconds + 5.0)) for seconds in np.arange(5.0, 7.0, 0.25)]
    for seconds, east in times:
        stamp_ns = START_NS + round(seconds * SECOND_NS)
        if role == "tf":
            feed.transformed(decoded(tf_message(stamp_ns, "map", FRAME, straight_down(east))), fixed=False)
        else:
            feed.posed(decoded(pose_message(stamp_ns, straight_down(east))))
    assert feed.newest_ns == START_NS + 6 * SECOND_NS + 3 * SECOND_NS // 4
    assert np.allclose(feed.pose_at(START_NS + 6 * SECOND_NS), straight_down(110.0), atol=1e-9)
