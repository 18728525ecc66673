"""Robots that each count from an origin of their own, which they tell on a topic."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import get_types_from_msg

from crowdfence import View
from crowdfence.georeference import Georeference
from crowdfence.service.ros.link import RosLink
from crowdfence.service.ros.own_origin import OwnOrigin
from crowdfence.service.ros.poses import RosPoses
from crowdfence.service.ros.topics import live_topics
from support.ros_fleet import (
    ANCHOR,
    FRAME,
    STORE,
    Node,
    T,
    again,
    decoded,
    fleet,
    header,
    heatmap_message,
    info_message,
    pose_message,
    straight_down,
    tf_message,
    with_the_zones_of,
)
from support.small_service import SECOND_NS, START_NS, views

STORE.register(
    get_types_from_msg(
        "std_msgs/Header header\nGeoPoint position\n" + 80 * "=" + "\nMSG: geographic_msgs/GeoPoint\n"
        "float64 latitude\nfloat64 longitude\nfloat64 altitude\n",
        "geographic_msgs/msg/GeoPointStamped",
    )
)


def place(east: float, north: float, up: float) -> tuple[float, float, float]:
    latitude, longitude, height = ANCHOR.geodetic_from_local(np.array([[east, north, up]]))
    return float(latitude[0]), float(longitude[0]), float(height[0])


def geo_point(told: tuple[float, float, float]) -> Any:
    point = T["geographic_msgs/msg/GeoPoint"](*told)
    return T["geographic_msgs/msg/GeoPointStamped"](header(START_NS, "map"), point)


def fix(told: tuple[float, float, float], status: int = 0) -> Any:
    of = T["sensor_msgs/msg/NavSatStatus"](status, 1)
    return T["sensor_msgs/msg/NavSatFix"](header(START_NS, "gps"), of, *told, np.zeros(9), 0)


def counted_from(origin: Georeference, pose: np.ndarray) -> np.ndarray:
    """A pose [4, 4] of the mission in the frame of a robot, by points on Earth: the camera, and what lies a
    kilometre along its axes."""
    points = np.vstack([pose[:3, 3], pose[:3, 3] + 1000.0 * pose[:3, :3].T])
    there = origin.local_from_geodetic(*ANCHOR.geodetic_from_local(points))
    own = np.eye(4)
    own[:3, :3] = (there[1:] - there[0]).T / 1000.0
    own[:3, 3] = there[0]
    return own


def off_the_grid(view: View) -> View:
    """Its rays meet no border between two columns, which a rounding would decide."""
    pose = view.world_from_camera.copy()
    pose[:3, 3] += (0.3217, 0.1931, 0.0617)
    return View(view.drone, view.stamp_ns, view.camera, pose, view.heatmap)


def two_poses(feed: RosPoses, east: float) -> None:
    for number in range(2):
        message = pose_message(START_NS + number * SECOND_NS // 2, straight_down(east), "odom")
        feed.posed(decoded(message))


def east_of(feed: RosPoses) -> float:
    return float(feed.pose_at(START_NS + SECOND_NS // 4)[0, 3])


def test_poses_wait_for_their_origin_and_count_from_it() -> None:
    feed = RosPoses("camera_pose", None, origin=OwnOrigin(ANCHOR, "/uav1/gp_origin"))
    two_poses(feed, 10.0)
    assert feed.newest_ns is None
    assert feed.lacks == "nothing on /uav1/gp_origin, which says where its poses count from"
    feed.placed(decoded(fix(place(300.0, 0.0, 0.0), status=-1)))  # no fix
    assert feed.newest_ns is None
    for nowhere in ((0.0, 0.0, 0.0), (91.0, 8.0, 0.0), (46.5, 8.0, float("nan"))):
        with pytest.raises(ValueError, match="no position"):
            feed.placed(decoded(geo_point(nowhere)))
    feed.placed(decoded(geo_point(place(300.0, -200.0, 50.0))))
    # The frames are turned against each other by 300 m of 6400 km, and the camera is 20 m up.
    np.testing.assert_allclose(
        feed.pose_at(START_NS + SECOND_NS // 4)[:3, 3], (310.0, -197.0, 70.0), atol=0.01
    )
    assert feed.frame is None and feed.doubt is None


def test_an_origin_that_is_another_one_begins_poses_anew_and_is_told() -> None:
    feed = RosPoses("camera_pose", None, origin=OwnOrigin(ANCHOR, "/uav1/fix_origin"))
    feed.placed(decoded(fix(place(300.0, 0.0, 0.0))))
    two_poses(feed, 10.0)
    feed.placed(decoded(fix(place(300.05, 0.0, 0.0))))
    assert east_of(feed) == pytest.approx(310.0, abs=0.01) and feed.doubt is None
    feed.placed(decoded(fix(place(340.0, 0.0, 0.0))))
    assert feed.newest_ns is None and "told another origin of its poses" in (feed.doubt or "")
    two_poses(feed, 10.0)
    assert east_of(feed) == pytest.approx(350.0, abs=0.01)


def test_a_tree_of_transforms_counts_from_it_too() -> None:
    feed = RosPoses("tf", None, origin=OwnOrigin(ANCHOR, "/uav1/gp_origin"))
    feed.camera_frame = FRAME
    for number in range(2):
        feed.transformed(
            decoded(tf_message(START_NS + number * SECOND_NS // 2, "odom", FRAME, straight_down(10.0))),
            fixed=False,
        )
    assert feed.newest_ns is None
    feed.placed(decoded(geo_point(place(0.0, 500.0, 0.0))))
    assert feed.pose_at(START_NS + SECOND_NS // 4)[1, 3] == pytest.approx(503.0, abs=0.01)


def test_one_origin_that_is_told_of_two_robots_leaves_their_frames_in_doubt() -> None:
    """`odom` is where each was switched on, whatever one topic says."""

    def frames(*origins: str) -> list[str | None]:
        asked = [
            f"drone=d{n},heatmap=/h{n},info=/i,pose=/r{n}/odom,origin={origin}"
            for n, origin in enumerate(origins)
        ]
        feeds = RosLink(topics=live_topics(asked)).feeds(ANCHOR)
        for feed in feeds.values():
            assert isinstance(feed, RosPoses)
            feed.posed(decoded(pose_message(START_NS, straight_down(10.0), "odom")))
        return [feed.frame for feed in feeds.values()]

    assert frames("/r0/origin", "/r1/origin") == [None, None]
    assert frames("/datum", "datum/") == ["odom of /r0/odom", "odom of /r1/odom"]


def test_an_origin_without_poses_or_without_a_map_on_earth_is_refused() -> None:
    with pytest.raises(ValueError, match="origin= says where its poses count from; name camera_pose="):
        live_topics(["heatmap=/uav1/heatmap,info=/uav1/info,origin=/uav1/gp_origin"])
    topics = live_topics(["heatmap=/uav1/heatmap,info=/uav1/info,pose=/uav1/odom,origin=/uav1/gp_origin"])
    with pytest.raises(ValueError, match="nothing says where the map lies: give --origin"):
        RosLink(topics=topics).feeds(None)


@pytest.mark.parametrize("kind", ["rmw", "bridge"])
def test_robots_that_count_from_their_own_origins_give_the_zones_of_one_frame(
    tmp_path: Path, kind: str
) -> None:
    """1.3 and 2.1 km apart and 30 m higher; told once, before the service comes."""
    drones = ("uav1", "uav2")
    origins = {
        "uav1": Georeference(*place(1300.0, 200.0, 0.0)),
        "uav2": Georeference(*place(-400.0, -2000.0, 30.0)),
    }
    flown = [off_the_grid(view) for view in views(4, drones)]

    def before(node: Node) -> None:
        for drone, tell, topic in (("uav1", geo_point, "gp_origin"), ("uav2", fix, "fix_origin")):
            at = origins[drone]
            node.latch(f"/{drone}/{topic}", tell((at.latitude_deg, at.longitude_deg, at.height_m)))

    topics = [
        f"heatmap=/{drone}/heatmap,info=/{drone}/info,camera_pose=/{drone}/pose,origin=/{drone}/{topic}"
        for drone, topic in (("uav1", "gp_origin"), ("uav2", "fix_origin"))
    ]
    with fleet(tmp_path, kind, topics, before) as (node, service):
        assert service.live is not None
        heard = service.live.heard
        for number, view in enumerate(flown):

            def publish(view: View = view) -> None:
                own = counted_from(origins[view.drone], view.world_from_camera)
                node.publish(f"/{view.drone}/info", info_message(view))
                node.publish(f"/{view.drone}/pose", pose_message(view.stamp_ns, own))
                node.publish(f"/{view.drone}/heatmap", heatmap_message(view))

            again(publish, lambda wanted=number + 1: sum(heard.accepted.values()) == wanted)
        service.live.finish()
        with_the_zones_of(flown, service)
        for drone in drones:
            seen = service.fleet.last(drone)
            newest = [view for view in flown if view.drone == drone][-1]
            assert seen is not None
            np.testing.assert_allclose(seen.world_from_camera, newest.world_from_camera, atol=1e-6)
