"""Bags of ROS, written by rosbags: the same frames, poses and zones as the mission they were made from."""

from __future__ import annotations

import json
import shlex
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from scipy.spatial.transform import Rotation

from crowdfence import Camera, open_recording
from crowdfence.georeference import Georeference
from crowdfence.sources.convert import convert
from crowdfence.sources.ros_bag.common_world import heading_doubt
from crowdfence.sources.ros_bag.picture import encoded_picture
from crowdfence.sources.ros_bag.two_clocks import Arrivals, behind_s, drones_apart
from support.foreign_recordings import (
    DRONE,
    agreement,
    camera_pose_messages,
    closed,
    frames,
    header,
    mission,
    picture_messages,
    pose,
    reference,
    rows,
    transform,
    write_bag,
)

POSE = "geometry_msgs/msg/PoseStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
TF = "tf2_msgs/msg/TFMessage"
OPTICAL = "cam_optical"
# A camera that looks 40 degrees down, 0.3 m before and 0.1 m under the body; optical axes from body axes by
# where they point: right is minus left, down is minus up.
DOWN_DEG = 40.0
MOUNT_POSITION = np.array([0.3, 0.0, -0.1])
_C, _S = np.cos(np.radians(DOWN_DEG)), np.sin(np.radians(DOWN_DEG))
MOUNT = Rotation.from_matrix(np.array([[0, -_S, _C], [-1, 0, 0], [0, -_C, -_S]]))


def body(drone: str = DRONE) -> list[tuple[int, np.ndarray, Rotation]]:
    """Poses of a body that carries the camera at the mount."""
    poses = []
    for row in rows(drone):
        turn = row.turn * MOUNT.inv()
        poses.append((row.stamp_ns, row.position - turn.apply(MOUNT_POSITION), turn))
    return poses


def odometry(drone: str = DRONE) -> list[tuple[str, str, int, Any]]:
    return [
        (
            f"/{drone}/odom",
            ODOMETRY,
            stamp,
            {
                "header": header(stamp, "map"),
                "child_frame_id": "base_link",
                "pose": {"pose": pose(position, turn), "covariance": [0.0] * 36},
                "twist": {"covariance": [0.0] * 36},
            },
        )
        for stamp, position, turn in body(drone)
    ]


def static_mount(stamp_ns: int) -> tuple[str, str, int, Any]:
    mounted = transform(stamp_ns, "base_link", OPTICAL, MOUNT_POSITION, MOUNT)
    return "/tf_static", TF, stamp_ns, {"transforms": [mounted]}


def moving_tree(drone: str = DRONE) -> list[tuple[str, str, int, Any]]:
    """map -> base_link as flown, base_link -> gimbal turning, gimbal -> camera fixed."""
    messages = []
    for number, (stamp, position, turn) in enumerate(body(drone)):
        swing = Rotation.from_euler("z", 5 * np.sin(number / 50), degrees=True)
        carried = transform(stamp, "map", "base_link", position, turn * swing.inv())
        gimbal = transform(stamp, "base_link", "gimbal", np.zeros(3), swing)
        messages.append(("/tf", TF, stamp, {"transforms": [carried, gimbal]}))
    fixed = transform(rows(drone)[0].stamp_ns, "gimbal", OPTICAL, MOUNT_POSITION, MOUNT)
    return [*messages, ("/tf_static", TF, rows(drone)[0].stamp_ns, {"transforms": [fixed]})]


def assert_same_frames(
    found: Any, drones: tuple[str, ...], tolerance: float, with_heatmaps: tuple[str, ...] | None = None
) -> None:
    """`with_heatmaps`: drones that have heatmaps, the others have none; None: all."""
    assert found.drones == drones and not found.refused
    expected = reference(drones).frames
    assert [(f.drone, f.stamp_ns) for f in found.frames] == [(f.drone, f.stamp_ns) for f in expected]
    for ours, theirs in zip(found.frames, expected, strict=True):
        assert np.allclose(ours.world_from_camera, theirs.world_from_camera, rtol=0, atol=tolerance)
        if with_heatmaps is None or ours.drone in with_heatmaps:
            assert np.array_equal(ours.heatmap(), theirs.heatmap())
        else:
            assert ours.pixels.heatmap is None
        one, other = ours.camera, theirs.camera
        assert (one.width, one.height, one.fx, one.fy) == (other.width, other.height, other.fx, other.fy)
        assert (one.cx, one.cy) == (other.cx, other.cy)


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_a_fleet_with_camera_poses_gives_the_same_zones(tmp_path: Path, kind: str) -> None:
    drones = ("uav1", "uav2")
    messages = [
        message
        for drone in drones
        for message in (*picture_messages(drone, f"{drone}/{OPTICAL}"), *camera_pose_messages(drone))
    ]
    bag = write_bag(tmp_path / ("flight.bag" if kind == "ros1" else "flight"), kind, messages)
    found = open_recording(bag)
    assert_same_frames(found, drones, 1e-12)
    for ours, theirs in zip(found.frames, reference(drones).frames, strict=True):
        assert ours.encoded_image() == theirs.encoded_image()
    if kind == "sqlite3":
        zones = closed(found)
        assert not zones.is_empty and agreement(zones, closed(reference(drones))) > 1 - 1e-9
    guess = "uav1: camera=/uav1/cam/image_raw/compressed,info=/uav1/cam/camera_info,heatmap=/uav1/heatmap,"
    assert any(guess + "camera_pose=/uav1/cam/pose" in warning for warning in found.warnings)


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize("mode", [CompressionMode.MESSAGE, CompressionMode.FILE])
def test_bags_that_their_recorder_packed(
    tmp_path: Path, mode: CompressionMode, storage: StoragePlugin
) -> None:
    """In MCAP a message that was packed by itself was refused as no CDR, and with it the whole flight."""
    plain = write_bag(tmp_path / "plain", "sqlite3", [*picture_messages(DRONE, OPTICAL), *moving_tree()])
    packed = Writer(tmp_path / "packed", version=9, storage_plugin=storage)
    packed.set_compression(mode, CompressionFormat.ZSTD)
    with AnyReader([plain]) as reader, packed as writer:
        connections = {
            one.id: writer.add_connection(one.topic, one.msgtype, typestore=reader.typestore)
            for one in reader.connections
        }
        for connection, log_ns, data in reader.messages():
            writer.write(connections[connection.id], log_ns, data)
    found, same = open_recording(tmp_path / "packed"), open_recording(plain)
    assert len(found.frames) == len(same.frames) == len(frames()) and not found.refused
    for one, other in zip(found.frames, same.frames, strict=True):
        assert one.stamp_ns == other.stamp_ns and one.encoded_image() == other.encoded_image()
        assert np.array_equal(one.world_from_camera, other.world_from_camera)


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_tree_of_frames_with_a_gimbal(tmp_path: Path, kind: str) -> None:
    messages = [*picture_messages(DRONE, OPTICAL), *moving_tree()]
    bag = write_bag(tmp_path / ("flight.bag" if kind == "ros1" else "flight"), kind, messages)
    # Interpolating two turning joints is not quite interpolating their product.
    assert_same_frames(open_recording(bag), (DRONE,), 1e-4)


def test_odometry_with_the_camera_on_the_body(tmp_path: Path) -> None:
    stamp = rows()[0].stamp_ns
    bag = write_bag(
        tmp_path / "flight",
        "sqlite3",
        [*picture_messages(DRONE, OPTICAL, raw=True), *odometry(), static_mount(stamp)],
    )
    found = open_recording(bag)
    assert_same_frames(found, (DRONE,), 1e-4)  # the lever arm turns between two rows
    assert np.array_equal(found.frames[0].image(), frames()[0].image())
    convert(found, tmp_path / "copy.mcap")
    copy = open_recording(tmp_path / "copy.mcap")
    for ours, theirs in zip(copy.frames, found.frames, strict=True):
        assert np.array_equal(ours.world_from_camera, theirs.world_from_camera)
        assert np.array_equal(ours.image(), theirs.image())


def test_a_camera_that_is_fixed_in_two_ways_is_told(tmp_path: Path) -> None:
    """A description of the robot and a calibration may both tell it: the last one turned every look by 145
    degrees, and nothing said so."""
    topic, kind, stamp, _ = static_mount(rows()[0].stamp_ns)
    level = {"transforms": [transform(stamp, "base_link", OPTICAL, MOUNT_POSITION, Rotation.identity())]}
    common = [*picture_messages(DRONE, OPTICAL), *odometry(), static_mount(stamp)]
    said = f"tf: {OPTICAL} is told to be fixed to base_link in different places"
    for name, more, count in (
        ("again", [static_mount(stamp)] * 9, 0),
        ("other", [(topic, kind, stamp, level)], 1),
    ):
        found = open_recording(write_bag(tmp_path / name, "mcap", [*common, *more]))
        assert sum(said in warning for warning in found.warnings) == count


def test_a_frame_on_two_others_hides_no_other_warning(tmp_path: Path) -> None:
    stamp = rows()[0].stamp_ns
    level = {"transforms": [transform(stamp, "base_link", OPTICAL, MOUNT_POSITION, Rotation.identity())]}
    elsewhere = {"transforms": [transform(stamp, "other", OPTICAL, MOUNT_POSITION, MOUNT)]}
    common = [*picture_messages(DRONE, OPTICAL), *odometry(), static_mount(stamp)]
    more = [*[("/tf_static", TF, stamp + 1, elsewhere)] * 9, ("/tf_static", TF, stamp + 2, level)]
    found = open_recording(write_bag(tmp_path / "flight", "mcap", [*common, *more]))
    assert [warning for warning in found.warnings if warning.startswith("tf: ")] == [
        f"tf: {OPTICAL} hangs on base_link and on other; the first is taken",
        f"tf: {OPTICAL} is told to be fixed to base_link in different places or attitudes: the last is taken "
        "for the whole flight, and what was seen may be put elsewhere; let one node tell it",
    ]


def test_a_mount_by_hand_and_topics_by_name(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "flight", "mcap", [*picture_messages(DRONE, OPTICAL), *odometry()])
    with pytest.raises(ValueError, match=r"nothing says how the camera .* --mount, such as level:-60"):
        open_recording(bag)
    topics = (
        f"camera=/{DRONE}/cam/image_raw/compressed,info=/{DRONE}/cam/camera_info,heatmap=/{DRONE}/heatmap,"
        f"pose=/{DRONE}/odom"
    )
    found = open_recording(bag, topics=topics, mount=f"body:{-DOWN_DEG}")
    for ours, theirs in zip(found.frames, reference().frames, strict=True):
        assert np.allclose(ours.world_from_camera[:3, :3], theirs.world_from_camera[:3, :3], atol=1e-6)
        # What the mount cannot say: 0.3 m before and 0.1 m under the body.
        apart = np.linalg.norm(ours.world_from_camera[:3, 3] - theirs.world_from_camera[:3, 3])
        assert apart == pytest.approx(np.hypot(0.3, 0.1), abs=1e-3)


def test_a_mount_beside_a_recorded_attitude_is_not_left_out_in_silence(tmp_path: Path) -> None:
    messages = [*picture_messages(DRONE, OPTICAL), *camera_pose_messages()]
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages), mount="level:-90")
    assert_same_frames(found, (DRONE,), 1e-9)
    assert any("--mount is not used, /uav1/cam/pose tells" in warning for warning in found.warnings)
    tree = write_bag(tmp_path / "tree", "mcap", [*picture_messages(DRONE, OPTICAL), *moving_tree()])
    assert any("--mount is not used, /tf" in one for one in open_recording(tree, mount="level:-90").warnings)


NED = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
"""North-east-down in east-north-up, and the other way round."""
FRD = Rotation.from_matrix(np.diag([1, -1, -1]))
"""Forward-right-down in forward-left-up."""


def airsim_odometry(parent: str, child: str) -> list[tuple[str, str, int, Any]]:
    """As the ROS wrapper of AirSim tells it unless it is asked for east-north-up."""
    messages = []
    for topic, kind, stamp, fields in odometry():
        at = fields["pose"]["pose"]
        position = NED.apply([at["position"][axis] for axis in "xyz"])
        turn = NED * Rotation.from_quat([at["orientation"][axis] for axis in "xyzw"]) * FRD
        told = {"header": header(stamp, parent), "child_frame_id": child}
        told["pose"] = {"pose": pose(position, turn), "covariance": [0.0] * 36}
        messages.append((topic.replace("odom", "odom_local_ned"), kind, stamp, fields | told))
    return messages


@pytest.mark.parametrize("parent", ["world_ned", DRONE])
def test_odometry_that_is_north_east_down_by_its_frames_is_turned(tmp_path: Path, parent: str) -> None:
    """Its heights are negative: taken as they are, the camera is under the ground."""
    told = airsim_odometry(parent, f"{DRONE}/odom_local_ned")
    bag = write_bag(tmp_path / "flight", "mcap", [*picture_messages(DRONE, OPTICAL), *told])
    found = open_recording(bag, mount=f"body:{-DOWN_DEG}")
    for ours, theirs in zip(found.frames, reference().frames, strict=True):
        assert np.allclose(ours.world_from_camera[:3, :3], theirs.world_from_camera[:3, :3], atol=1e-6)
        apart = np.linalg.norm(ours.world_from_camera[:3, 3] - theirs.world_from_camera[:3, 3])
        assert apart == pytest.approx(np.hypot(0.3, 0.1), abs=1e-3)
    mounted = transform(
        rows()[0].stamp_ns, f"{DRONE}/odom_local_ned", OPTICAL, FRD.apply(MOUNT_POSITION), FRD * MOUNT
    )
    static = ("/tf_static", TF, rows()[0].stamp_ns, {"transforms": [mounted]})
    bag = write_bag(tmp_path / "with tf", "mcap", [*picture_messages(DRONE, OPTICAL), *told, static])
    assert_same_frames(open_recording(bag), (DRONE,), 1e-4)


@pytest.mark.parametrize("start", [None, np.array([7.0, -3.0, 1.0])])
def test_a_tree_that_hangs_on_a_world_that_is_north_east_down_is_turned(
    tmp_path: Path, start: np.ndarray | None
) -> None:
    """Of a fleet every vehicle may begin elsewhere: world_ned -> uav1, fixed, -> uav1/odom_local_ned."""
    odom, first = f"{DRONE}/odom_local_ned", rows()[0].stamp_ns
    parent, begin = ("world_ned", np.zeros(3)) if start is None else (DRONE, start)
    fixed = [transform(first, odom, OPTICAL, FRD.apply(MOUNT_POSITION), FRD * MOUNT)]
    if start is not None:
        fixed.append(transform(first, "world_ned", DRONE, start, Rotation.identity()))
    moving = [
        ("/tf", TF, stamp, {"transforms": [transform(stamp, parent, odom, NED.apply(at) - begin, turned)]})
        for stamp, at, turn in body()
        for turned in [NED * turn * FRD]
    ]
    messages = [*picture_messages(DRONE, OPTICAL), *moving, ("/tf_static", TF, first, {"transforms": fixed})]
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    assert_same_frames(found, (DRONE,), 1e-4)
    assert "world_ned is north-east-down by its name: its poses are turned" in found.warnings


def test_tf_that_says_where_the_map_is_on_earth_moves_no_camera(tmp_path: Path) -> None:
    """As the live service tells a fleet that is recorded."""
    first = rows()[0].stamp_ns
    moving = [
        ("/tf", TF, stamp, {"transforms": [transform(stamp, "map", OPTICAL, at, turn)]})
        for row in rows()
        for stamp, at, turn in [(row.stamp_ns, np.array(row.position), row.turn)]
    ]
    on_earth = transform(first, "earth", "map", np.array([4.3e6, 6.1e5, 4.6e6]), FRD)
    static = ("/tf_static", TF, first, {"transforms": [on_earth]})
    bag = write_bag(tmp_path / "flight", "mcap", [*picture_messages(DRONE, OPTICAL), *moving, static])
    assert_same_frames(open_recording(bag), (DRONE,), 1e-9)


def test_camera_poses_that_are_north_east_down_are_turned(tmp_path: Path) -> None:
    told = [
        (f"/{DRONE}/cam/pose", POSE, row.stamp_ns, {"header": header(row.stamp_ns, "map_ned")} | {"pose": at})
        for row in rows()
        for at in [pose(NED.apply(np.array(row.position)), NED * row.turn)]
    ]
    bag = write_bag(tmp_path / "flight", "mcap", [*picture_messages(DRONE, OPTICAL), *told])
    assert_same_frames(open_recording(bag), (DRONE,), 1e-9)


def test_a_bag_whose_topics_are_called_like_ours_is_turned_too(tmp_path: Path) -> None:
    """Read as a mission file its cameras were under the ground, with north and east exchanged."""
    ours = [
        (topic.replace("/cam/image_raw", "/camera/image").replace("/cam/", "/camera/"), *rest)
        for topic, *rest in picture_messages(DRONE, OPTICAL)
    ]
    told = [
        (
            f"/{DRONE}/camera/pose",
            POSE,
            row.stamp_ns,
            {"header": header(row.stamp_ns, "world_ned"), "pose": at},
        )
        for row in rows()
        for at in [pose(NED.apply(np.array(row.position)), NED * row.turn)]
    ]
    bag = write_bag(tmp_path / "flight", "mcap", [*ours, *told])
    (file,) = bag.glob("*.mcap")
    assert_same_frames(open_recording(file), (DRONE,), 1e-9)


def fleet_in_frames_of_their_own() -> tuple[list[Any], list[dict[str, Any]]]:
    """Camera poses of two drones, each from where it was switched on, heading as it did; where that was."""
    messages: list[Any] = []
    fixed = []
    for drone, begin, heading in (("uav1", [0.0, 0.0, 0.0], 0.0), ("uav2", [40.0, -15.0, 2.0], 30.0)):
        turn = Rotation.from_euler("z", heading, degrees=True)
        messages += picture_messages(drone, f"{drone}/{OPTICAL}")
        fixed.append(transform(rows()[0].stamp_ns, "world", f"{drone}/odom", np.array(begin), turn))
        for row in rows(drone):
            at = pose(turn.inv().apply(row.position - begin), turn.inv() * row.turn)
            told = {"header": header(row.stamp_ns, f"{drone}/odom"), "pose": at}
            messages.append((f"/{drone}/cam/pose", POSE, row.stamp_ns, told))
    return messages, fixed


def test_drones_that_count_from_frames_of_their_own_are_brought_into_one(tmp_path: Path) -> None:
    messages, fixed = fleet_in_frames_of_their_own()
    static = ("/tf_static", TF, rows()[0].stamp_ns, {"transforms": fixed})
    found = open_recording(write_bag(tmp_path / "flight", "mcap", [*messages, static]))
    assert_same_frames(found, ("uav1", "uav2"), 1e-9)
    assert not any("nothing in the bag says" in warning for warning in found.warnings)


def test_frames_that_nothing_lays_to_each_other_are_told(tmp_path: Path) -> None:
    """One of the two drones would be 40 m off, with what it sees."""
    messages, _ = fleet_in_frames_of_their_own()
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    (told,) = [warning for warning in found.warnings if "nothing in the bag says" in warning]
    assert "(uav1 in uav1/odom, uav2 in uav2/odom)" in told and "name origin= or fix=" in told
    # Of one of them satellites say where it begins, of the other nothing does.
    latitude, longitude, height = rows()[0].geodetic
    fix = {"header": header(rows()[0].stamp_ns, "gps"), "latitude": latitude, "longitude": longitude}
    fix_message = ("/uav1/fix", "sensor_msgs/msg/NavSatFix", rows()[0].stamp_ns, fix | {"altitude": height})
    found = open_recording(write_bag(tmp_path / "fix", "mcap", [*messages, fix_message]))
    (told,) = [warning for warning in found.warnings if "nothing in the bag says" in warning]
    assert "(uav2 in uav2/odom)" in told and "as those of uav1" in told
    # One origin for both is that of one of them at most; each with its own has it.
    for names, is_told in ((("origin", "origin"), True), (("uav1/origin", "uav2/origin"), False)):
        origins = [(f"/{name}", *fix_message[1:]) for name in dict.fromkeys(names)]
        stated = [
            f"drone={drone},camera=/{drone}/cam/image_raw/compressed,info=/{drone}/cam/camera_info,"
            f"camera_pose=/{drone}/cam/pose,origin=/{name}"
            for drone, name in zip(("uav1", "uav2"), names, strict=True)
        ]
        bag = write_bag(tmp_path / f"told_{is_told}", "mcap", [*messages, *origins])
        warnings = open_recording(bag, topics=stated).warnings
        doubts = [warning for warning in warnings if "nothing in the bag says" in warning]
        assert len(doubts) == is_told and all("uav1 in uav1/odom, uav2 in" in doubt for doubt in doubts)


@pytest.mark.parametrize("bags", [1, 2])
def test_drones_that_each_say_where_on_earth_they_count_from(tmp_path: Path, bags: int) -> None:
    """Two bags, which is how drones record, were refused; in one the second was not turned."""
    ours, begin = mission().georeference, {"uav1": [0.0, 0.0, 0.0], "uav2": [900.0, -700.0, 40.0]}
    assert ours is not None
    recorded = []
    for drone, place in begin.items():
        latitude, longitude, height = (float(one[0]) for one in ours.geodetic_from_local(place))
        own = Georeference(latitude, longitude, height)
        told = picture_messages(drone, OPTICAL)
        fix = {"header": header(rows()[0].stamp_ns, "map"), "latitude": latitude, "longitude": longitude}
        fix |= {"altitude": height}
        told.append((f"/{drone}/origin", "sensor_msgs/msg/NavSatFix", rows()[0].stamp_ns, fix))
        for row in rows(drone):
            # Where the camera is and what lies 1 m along each of its axes, by way of their degrees.
            marks = row.position + np.vstack([np.zeros(3), row.turn.as_matrix().T])
            at = own.local_from_geodetic(*ours.geodetic_from_local(marks))
            seen = pose(at[0], Rotation.from_matrix((at[1:] - at[0]).T))
            fields = {"header": header(row.stamp_ns, "map"), "pose": seen}
            told.append((f"/{drone}/cam/pose", POSE, row.stamp_ns, fields))
        recorded.append(told)
    if bags == 1:
        recorded = [[*recorded[0], *recorded[1]]]
    paths = [write_bag(tmp_path / f"bag{number}", "mcap", told) for number, told in enumerate(recorded)]
    topics = [
        f"drone={drone},camera=/{drone}/cam/image_raw/compressed,info=/{drone}/cam/camera_info,"
        f"camera_pose=/{drone}/cam/pose,heatmap=/{drone}/heatmap,origin=/{drone}/origin"
        for drone in begin
    ]
    found = open_recording(paths[0], topics=topics) if bags == 1 else open_recording(paths)
    assert_same_frames(found, ("uav1", "uav2"), 1e-5)
    assert not any("nothing in the" in warning for warning in found.warnings)


def test_frames_of_bags_that_each_drone_recorded_itself(tmp_path: Path) -> None:
    """In one bag their frames were told, and brought into one; of two bags, which is how drones record, they
    were taken as one without a word, 40 m off."""
    messages, fixed = fleet_in_frames_of_their_own()

    def bags(name: str, frame: str = "", static: bool = False) -> list[Path]:
        found = []
        for drone, one in zip(("uav1", "uav2"), fixed, strict=True):
            own = [
                (
                    topic,
                    kind,
                    stamp,
                    fields | ({"header": header(stamp, frame)} if frame and kind == POSE else {}),
                )
                for topic, kind, stamp, fields in messages
                if topic.startswith(f"/{drone}/")
            ]
            if static:
                told = one | ({"child_frame_id": frame} if frame else {})
                own.append(("/tf_static", TF, rows()[0].stamp_ns, {"transforms": [told]}))
            found.append(write_bag(tmp_path / f"{name}_{drone}", "mcap", own))
        return found

    def doubts(paths: list[Path]) -> list[str]:
        return [one for one in open_recording(paths).warnings if "nothing in the recordings says" in one]

    (told,) = doubts(bags("named"))
    assert "(uav1 in uav1/odom, uav2 in uav2/odom)" in told and "record /tf_static in each bag" in told
    (told,) = doubts(alike := bags("alike", "odom"))
    assert "(uav1 in odom, uav2 in odom)" in told
    assert doubts(bags("common", "world")) == []
    for frame in ("", "odom"):
        found = open_recording(bags(f"laid{frame}", frame, static=True))
        assert_same_frames(found, ("uav1", "uav2"), 1e-9)
        assert not any("nothing in the" in warning for warning in found.warnings)
    assert not any("nothing in the" in warning for warning in open_recording(alike[1]).warnings)
    converted = [convert(open_recording(one), one.with_suffix(".mcap")).path for one in alike]
    (told,) = doubts(converted)
    assert "uav1 in that of ROS 2 bag alike_uav1" in told


UPSIDE_DOWN = Rotation.from_euler("ZYX", [90.0, 0.0, 180.0], degrees=True)
"""An IMU on a body: on its back, its nose to the left."""


@pytest.mark.parametrize(
    ("imu_frame", "mounted", "told"),
    [
        ("base_link", None, ""),
        ("imu_link", UPSIDE_DOWN, "/tf_static"),
        ("imu_link", UPSIDE_DOWN, "/tf"),  # again and again, as the static_transform_publisher of ROS 1 does
        ("imu_link_ned", None, ""),
        ("imu_link_ned", FRD, "/tf_static"),
    ],
)
def test_satellite_positions_and_an_imu(
    tmp_path: Path, imu_frame: str, mounted: Rotation | None, told: str
) -> None:
    """Attitudes are those of the IMU, which tf may say to be fixed to the body otherwise than level; one that
    is north-east-down by its name counts from there (REP 145)."""
    first = rows()[0].stamp_ns
    messages: list[Any] = [*picture_messages(DRONE, OPTICAL), static_mount(first)]
    if mounted is not None:
        for row in rows()[:: 1 if told == "/tf" else len(rows())]:
            fixed = transform(row.stamp_ns, "base_link", imu_frame, np.array([0.1, 0.0, 0.0]), mounted)
            messages.append((told, TF, row.stamp_ns, {"transforms": [fixed]}))
    for number, row in enumerate(rows()):
        turn = row.turn * MOUNT.inv()
        if imu_frame.endswith("ned"):
            turn = NED * turn * FRD
        elif mounted is not None:
            turn = turn * mounted
        attitude = {
            "header": header(row.stamp_ns, imu_frame),
            "orientation": pose(row.position, turn)["orientation"],
        }
        messages.append(("/imu/data", "sensor_msgs/msg/Imu", row.stamp_ns, attitude))
        if number % 5 == 0:
            latitude, longitude, height = row.geodetic
            fix = {"header": header(row.stamp_ns, "gps"), "latitude": latitude, "longitude": longitude}
            messages.append(("/fix", "sensor_msgs/msg/NavSatFix", row.stamp_ns, fix | {"altitude": height}))
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    assert found.georeference is not None and "pose from /fix and /imu/data" in " ".join(found.warnings)
    assert sum("heights of /fix are taken as above the ellipsoid" in told for told in found.warnings) == 1
    anchor = mission().georeference
    assert anchor is not None
    for ours, theirs in zip(found.frames, reference().frames, strict=True):
        place = found.georeference.geodetic_from_local(ours.world_from_camera[None, :3, 3])
        at = anchor.local_from_geodetic(*place)[0]
        # 10 Hz positions of a drone that turns, and the lever arm which is taken as fixed to them.
        assert np.linalg.norm(at - theirs.world_from_camera[:3, 3]) < 0.5
        assert np.allclose(ours.world_from_camera[:3, :3], theirs.world_from_camera[:3, :3], atol=1e-3)


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_rectified_pictures_have_the_intrinsics_of_p(tmp_path: Path, kind: str) -> None:
    """image_proc publishes them beside the camera_info of the raw ones, whose K and D are of the lens."""
    camera = frames()[0].camera
    lens = [camera.fx * 0.8, 0, camera.cx + 9, 0, camera.fy * 0.8, camera.cy - 7, 0, 0, 1]
    rectified = [camera.fx, 0, camera.cx - 0.5, 0, 0, camera.fy, camera.cy - 0.5, 0, 0, 0, 1, 0]
    level = [1.0, 0, 0, 0, 1, 0, 0, 0, 1]
    messages: list[Any] = [*camera_pose_messages()]
    for topic, type_name, stamp, fields in picture_messages(DRONE, OPTICAL):
        if type_name.endswith("CameraInfo"):
            fields = fields | {"k": lens, "d": [-0.3, 0.1, 0.0, 0.0, 0.0], "p": rectified, "r": level}
        messages.append((topic, type_name, stamp, fields))
    distorted = open_recording(
        write_bag(tmp_path / ("raw.bag" if kind == "ros1" else "raw"), kind, messages)
    ).frames[0]
    assert distorted.camera.fx == pytest.approx(0.8 * camera.fx) and distorted.camera.distortion[0] == -0.3
    renamed = [
        (topic.replace("image_raw", "image_rect_color"), type_name, stamp, fields)
        for topic, type_name, stamp, fields in messages
    ]
    found = open_recording(write_bag(tmp_path / ("rect.bag" if kind == "ros1" else "rect"), kind, renamed))
    assert len(found.frames) == len(frames()) and all(one.camera == camera for one in found.frames)


def test_intrinsics_that_change_and_have_stamps_of_their_own_are_no_lack(tmp_path: Path) -> None:
    """The message asked for a CameraInfo topic, which was there."""
    messages: list[Any] = [*camera_pose_messages()]
    for number, (topic, kind, stamp, fields) in enumerate(picture_messages(DRONE, OPTICAL)):
        if kind.endswith("CameraInfo"):
            k = [fields["k"][0] + number, *fields["k"][1:]]
            fields = fields | {"k": k, "header": header(stamp + 1000, OPTICAL)}
        messages.append((topic, kind, stamp, fields))
    with pytest.raises(
        ValueError, match=r"of 'uav1' on /uav1/cam/camera_info change, as of a zoom, and none"
    ):
        open_recording(write_bag(tmp_path / "flight", "mcap", messages))


def test_a_lens_that_is_taken_out_twice_is_told(tmp_path: Path) -> None:
    """A calibration is of the raw pictures, mostly; of rectified ones it puts the edges elsewhere."""
    camera = frames()[0].camera
    numbers = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
    renamed = [
        (topic.replace("image_raw", "image_rect"), *rest)
        for topic, *rest in (*picture_messages(DRONE, OPTICAL), *camera_pose_messages())
    ]
    for name, messages, distortion, told in (
        ("twice", renamed, [-0.3, 0.1, 0.0, 0.0, 0.0], 1),
        ("once", renamed, None, 0),
        ("raw", [*picture_messages(DRONE, OPTICAL), *camera_pose_messages()], [-0.3, 0.1, 0.0, 0.0, 0.0], 0),
    ):
        bag = write_bag(tmp_path / name, "mcap", messages)
        found = open_recording(bag, calibration=Camera.pinhole(*numbers, distortion))
        assert sum("the lens is taken out" in warning for warning in found.warnings) == told


def test_every_picture_with_the_stamp_of_another_is_counted_as_refused(tmp_path: Path) -> None:
    """A camera that stamps in whole seconds: of three pictures one is used, and two are lost, not one."""
    told = [*picture_messages(DRONE, OPTICAL), *camera_pose_messages()]
    pictures = [message for message in told if message[1].endswith("CompressedImage")]
    found = open_recording(write_bag(tmp_path / "flight", "mcap", [*told, *pictures[:2], *pictures[:2]]))
    assert len(found.frames) == len(pictures)
    assert sorted(one.stamp_ns or 0 for one in found.refused) == sorted(
        stamp for _, _, stamp, _ in pictures[:2] * 2
    )
    assert all("repeats an earlier frame" in one.reason for one in found.refused)


def test_an_imu_without_an_attitude_is_not_level(tmp_path: Path) -> None:
    """REP 145: a first covariance of -1 says that there is none, and ROS 2 fills in the identity."""
    messages: list[Any] = [*picture_messages(DRONE, OPTICAL), static_mount(rows()[0].stamp_ns)]
    for row in rows():
        attitude = {
            "header": header(row.stamp_ns, "base_link"),
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            "orientation_covariance": [-1.0] + [0.0] * 8,
        }
        latitude, longitude, height = row.geodetic
        fix = {"header": header(row.stamp_ns, "gps"), "latitude": latitude, "longitude": longitude}
        messages.append(("/imu/data_raw", "sensor_msgs/msg/Imu", row.stamp_ns, attitude))
        messages.append(("/fix", "sensor_msgs/msg/NavSatFix", row.stamp_ns, fix | {"altitude": height}))
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    assert not found.frames and len(found.refused) == len(frames())
    assert any("/imu/data_raw" in warning and "no attitude" in warning for warning in found.warnings)


@pytest.mark.parametrize("of", ["imu", "odometry"])
def test_an_attitude_that_nobody_set_is_told(tmp_path: Path, of: str) -> None:
    """Drivers that know none leave what messages begin with in ROS 2, often without the -1 of REP 145: every
    look was that of a level drone that faces east, and nothing said so."""
    messages: list[Any] = [*picture_messages(DRONE, OPTICAL), static_mount(rows()[0].stamp_ns)]
    unset = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    for row in rows():
        if of == "odometry":
            continue
        latitude, longitude, height = row.geodetic
        fix = {"header": header(row.stamp_ns, "gps"), "latitude": latitude, "longitude": longitude}
        attitude = {"header": header(row.stamp_ns, "base_link"), "orientation": unset}
        messages.append(("/imu/data_raw", "sensor_msgs/msg/Imu", row.stamp_ns, attitude))
        messages.append(("/fix", "sensor_msgs/msg/NavSatFix", row.stamp_ns, fix | {"altitude": height}))
    for topic, kind, stamp, fields in odometry() if of == "odometry" else ():
        told = fields["pose"] | {"pose": fields["pose"]["pose"] | {"orientation": unset}}
        messages.append((topic, kind, stamp, fields | {"pose": told}))
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    topic = "/imu/data_raw" if of == "imu" else f"/{DRONE}/odom"
    said = f"{topic}: all {len(rows())} attitudes are 0, 0, 0, 1 to the last digit"
    assert sum(said in warning for warning in found.warnings) == 1


def test_fixes_beside_local_poses_place_the_local_frame_on_earth(tmp_path: Path) -> None:
    messages = [*picture_messages(DRONE, OPTICAL), *camera_pose_messages()]
    for number, row in enumerate(rows()[::10]):
        latitude, longitude, height = row.geodetic
        height = np.nan if number in (0, 7) else height  # as of a receiver with three satellites
        fix = {"header": header(row.stamp_ns, "gps"), "latitude": latitude, "longitude": longitude}
        messages.append(
            (f"/{DRONE}/fix", "sensor_msgs/msg/NavSatFix", row.stamp_ns, fix | {"altitude": height})
        )
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    assert any("/fix: 2 messages are left out" in warning for warning in found.warnings)
    anchor, ours = mission().georeference, found.georeference
    assert anchor is not None and ours is not None
    assert ours.latitude_deg == pytest.approx(anchor.latitude_deg, abs=1e-7)
    assert ours.longitude_deg == pytest.approx(anchor.longitude_deg, abs=1e-7)
    assert ours.height_m == pytest.approx(anchor.height_m, abs=0.01)
    # Drivers that publish heights above the sea there are many, and zones are tens of metres off then.
    said = f"heights of /{DRONE}/fix are taken as above the ellipsoid (WGS84), as NavSatFix has them"
    assert sum(said in warning for warning in found.warnings) == 1


@pytest.mark.parametrize("nowhere", [(0.0, 0.0, 0.0), (465_000_000.0, 80_000_000.0, 1200.0)])
def test_positions_nowhere_are_none(tmp_path: Path, nowhere: tuple[float, float, float]) -> None:
    """Told before there is a fix, they were the origin of all poses, 5000 km from the map, and no picture of
    the flight could be used."""
    messages: list[Any] = [*picture_messages(DRONE, OPTICAL), *odometry(), static_mount(rows()[0].stamp_ns)]
    for number, row in enumerate(rows()[::5]):
        latitude, longitude, height = nowhere if number < 60 else row.geodetic
        fix = {"header": header(row.stamp_ns, "gps"), "latitude": latitude, "longitude": longitude}
        messages.append(("/fix", "sensor_msgs/msg/NavSatFix", row.stamp_ns, fix | {"altitude": height}))
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    at, there = found.georeference, mission().georeference
    assert at is not None and there is not None
    assert np.abs(there.local_from_geodetic(at.latitude_deg, at.longitude_deg, at.height_m)).max() < 0.01
    assert any("/fix: 60 messages are left out, the first: no position" in one for one in found.warnings)


def test_a_local_world_that_is_not_against_north_is_told(tmp_path: Path) -> None:
    """Visual odometry counts from where the drone looked at first, here 70 degrees left of east."""
    turn = Rotation.from_euler("z", -70.0, degrees=True)
    messages = picture_messages(DRONE, OPTICAL)
    for row in rows():
        at = pose(turn.apply(np.array(row.position)), turn * row.turn)
        told = {"header": header(row.stamp_ns, "odom"), "pose": at}
        messages.append((f"/{DRONE}/cam/pose", POSE, row.stamp_ns, told))
    for row in rows()[::10]:
        latitude, longitude, height = row.geodetic
        fix = {"header": header(row.stamp_ns, "gps"), "latitude": latitude, "longitude": longitude}
        messages.append(
            (f"/{DRONE}/fix", "sensor_msgs/msg/NavSatFix", row.stamp_ns, fix | {"altitude": height})
        )
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    (told_so,) = [warning for warning in found.warnings if "about the vertical" in warning]
    assert "turned by 70 degrees" in told_so and "lie within 0.0 m of them" in told_so


def test_receivers_that_scatter_are_not_taken_for_a_turned_world() -> None:
    """A path of 100 m against north, heights off by more than the places, then a hover."""
    random = np.random.default_rng(3)
    path = np.column_stack([np.linspace(0, 100, 60), np.linspace(0, 30, 60), np.full(60, 20.0)])
    noise = random.normal(size=(60, 3)) * [1.5, 1.5, 8.0]
    assert heading_doubt(path, path + noise) is None
    assert heading_doubt(path[:1].repeat(60, axis=0), path[:1] + noise) is None
    left = Rotation.from_euler("z", 90.0, degrees=True).apply(path)
    doubt = heading_doubt(left, path + noise)
    assert doubt is not None and doubt.startswith("turned by -90 degrees")


def test_poses_of_one_topic_in_two_frames_are_told(tmp_path: Path) -> None:
    """Two nodes publish there: what the second one says was taken as in the frame of the first."""
    poses = camera_pose_messages()
    later = [
        (topic, kind, stamp, fields | {"header": header(stamp, "odom")})
        for topic, kind, stamp, fields in poses[-3:]
    ]
    messages = [*picture_messages(DRONE, OPTICAL), *poses[:-3], *later]
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    (told,) = [warning for warning in found.warnings if "several frames" in warning]
    assert told.startswith("/uav1/cam/pose: ") and "3 name odom: all are taken as in map" in told


@pytest.mark.parametrize("other", ["/uav1/depth/camera_info", "/uav1/right/camera_info"])
def test_the_intrinsics_of_another_camera_are_not_taken(tmp_path: Path, other: str) -> None:
    """Of the camera itself none were recorded. Those of its neighbour have the same size and another lens."""
    messages = [
        (other if topic.endswith("camera_info") else topic, *rest)
        for topic, *rest in [*picture_messages(DRONE, OPTICAL, raw=True), *camera_pose_messages()]
    ]
    bag = write_bag(tmp_path / "flight", "mcap", messages)
    with pytest.raises(ValueError, match="no intrinsics of 'uav1': name a CameraInfo topic as info="):
        open_recording(bag)
    stated = f"camera=/uav1/cam/image_raw,info={other},camera_pose=/uav1/cam/pose"
    assert len(open_recording(bag, topics=stated).frames) == len(frames())


def test_the_pose_beside_a_camera_is_its_own(tmp_path: Path) -> None:
    """Another drone, whose pictures were not recorded, told its own in a fuller message: that was taken."""
    poses = [
        (f"/{DRONE}/pose", POSE, stamp, {"header": header(stamp, "map"), "pose": pose(position, turn)})
        for stamp, position, turn in body()
    ]
    others = odometry("uav2")
    first = rows()[0].stamp_ns
    messages = [*picture_messages(DRONE, OPTICAL), *poses, *others, static_mount(first)]
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    assert_same_frames(found, (DRONE,), 1e-4)


def test_cameras_that_are_given_one_drone_s_poses_though_another_tells_its_own_are_told(
    tmp_path: Path,
) -> None:
    """By names nobody knows whose the cameras are: what the second drone saw was put where the first one
    was, beside a line that listed the topics."""
    messages: list[Any] = [static_mount(rows()[0].stamp_ns)]
    for drone, eye in (("uav1", "eye1"), ("uav2", "eye2")):
        messages += [
            (topic.replace(f"/{drone}/", f"/{eye}/"), *rest)
            for topic, *rest in picture_messages(drone, OPTICAL)
        ]
    of_one = [*messages, *odometry("uav1")]

    def told(name: str, messages: list[Any]) -> list[str]:
        found = open_recording(write_bag(tmp_path / name, "mcap", messages))
        return [warning for warning in found.warnings if "given one topic of poses" in warning]

    assert told("robot", of_one) == [], "two cameras of one robot"
    (said,) = told("fleet", [*of_one, *odometry("uav2")])
    assert said.startswith("eye1 and eye2 are given") and "/uav1/odom, and nobody /uav2/odom" in said
    again = [("/uav1/mavros/odom", *rest) for _, *rest in odometry("uav1")]
    assert told("twice", [*of_one, *again]) == [], "two sources of the same robot"


def test_a_second_camera_of_a_drone_is_not_left_out_in_silence(tmp_path: Path) -> None:
    """One camera is one drone: whoever wants both names them."""
    down = picture_messages(DRONE, OPTICAL)
    front = [
        (topic.replace("/cam/", "/front/"), type_name, stamp, fields)
        for topic, type_name, stamp, fields in down
        if not topic.endswith("heatmap")
    ]
    found = open_recording(write_bag(tmp_path / "two", "mcap", [*down, *front, *camera_pose_messages()]))
    (told,) = [warning for warning in found.warnings if "left out" in warning]
    assert "/uav1/front/image_raw/compressed" in told and "--topics" in told
    assert "/uav1/cam/image_raw/compressed" not in told
    alone = open_recording(write_bag(tmp_path / "one", "mcap", [*down, *camera_pose_messages()]))
    assert not any("left out" in warning for warning in alone.warnings)


def test_heatmaps_of_a_drone_whose_pictures_were_not_recorded_are_its_own(tmp_path: Path) -> None:
    """A drone beside it, which has pictures alone, was given them: its crowd stood under the other drone."""
    seeing = [one for one in picture_messages("uav1", OPTICAL) if not one[0].endswith("heatmap")]
    blind = [one for one in picture_messages("uav2", OPTICAL) if "image_raw" not in one[0]]
    assert {one[0] for one in blind} == {"/uav2/heatmap", "/uav2/cam/camera_info"}
    poses = [*camera_pose_messages("uav1"), *camera_pose_messages("uav2")]
    found = open_recording(write_bag(tmp_path / "flight", "mcap", [*seeing, *blind, *poses]))
    assert_same_frames(found, ("uav1", "uav2"), 1e-4, with_heatmaps=("uav2",))
    assert not any("left out" in warning for warning in found.warnings)


def test_heatmaps_with_stamps_of_their_own_cost_no_picture_and_are_told(tmp_path: Path) -> None:
    """A detector that stamps what it makes with the moment of making: taken one topic behind the other, all
    but one picture were refused, as of a clock that runs ahead."""
    messages: list[Any] = []
    for topic, kind, stamp_ns, fields in picture_messages(DRONE, OPTICAL):
        if topic.endswith("heatmap"):
            stamp_ns += 80_000_000
            fields = fields | {"header": header(stamp_ns, OPTICAL)}
        messages.append((topic, kind, stamp_ns, fields))
    found = open_recording(write_bag(tmp_path / "flight", "mcap", [*messages, *camera_pose_messages()]))
    pictures = [one.stamp_ns for one in frames()]
    assert not found.refused
    assert [one.stamp_ns for one in found.frames if one.pixels.image is not None] == pictures
    assert [one.stamp_ns for one in found.frames if one.pixels.heatmap is not None] == [
        stamp_ns + 80_000_000 for stamp_ns in pictures
    ]
    (told,) = [one for one in found.warnings if "has the stamp of a picture" in one]
    assert told.startswith("uav1: none of the 6 heatmaps of /uav1/heatmap has the stamp of a picture of ")


def test_heatmaps_that_may_be_of_either_drone_are_nobodys_and_told(tmp_path: Path) -> None:
    messages: list[Any] = []
    for drone in ("uav1", "uav2"):
        messages += [
            (topic.replace("/uav1/heatmap", "/detector/heatmap"), *rest)
            for topic, *rest in picture_messages(drone, OPTICAL)
            if topic != "/uav2/heatmap"
        ]
        messages += camera_pose_messages(drone)
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    assert all(frame.pixels.heatmap is None for frame in found.frames)
    (told,) = [warning for warning in found.warnings if "left out" in warning]
    assert told.startswith("/detector/heatmap: left out")


def test_a_bag_without_a_camera_lists_what_is_there(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "flight", "sqlite3", camera_pose_messages(topic="/mavros/local_position/pose"))
    with pytest.raises(
        ValueError, match=r"--topics .*/mavros/local_position/pose \(geometry_msgs/msg/PoseSt"
    ):
        open_recording(bag)
    with pytest.raises(ValueError, match=r"no topic /cam in the bag; it has /mavros"):
        open_recording(bag, topics="camera=/cam")
    with pytest.raises(ValueError, match=r"camera needs sensor_msgs/msg/CompressedImage or"):
        open_recording(bag, topics="camera=/mavros/local_position/pose")
    with pytest.raises(ValueError, match=r"no role 'kamera'"):
        open_recording(bag, topics="kamera=/cam")
    # The last one was taken, and of the first nothing was said.
    with pytest.raises(ValueError, match=r"pose is given twice, a drone has one"):
        open_recording(bag, topics="pose=/other,pose=/mavros/local_position/pose")


def test_a_bag_whose_recorder_was_killed_has_no_description(tmp_path: Path) -> None:
    messages = [*picture_messages(DRONE, OPTICAL), *camera_pose_messages()]
    for kind in ("sqlite3", "mcap"):
        bag = write_bag(tmp_path / kind, kind, messages)
        (bag / "metadata.yaml").unlink()
        (store,) = bag.iterdir()
        store.rename(bag / f"{kind}_0{store.suffix}")
        assert len(open_recording(bag).frames) == len(frames())
    # Mission files in a folder are missions of their own, not parts of one.
    shutil.copy(store.with_name("mcap_0.mcap"), tmp_path / "other.mcap")
    with pytest.raises(ValueError, match="holds no recording"):
        open_recording(tmp_path)


def test_what_a_killed_recorder_left_beside_its_bag_is_not_left_out(tmp_path: Path) -> None:
    """SQLite keeps what was written last in a file of its own until it moves it into the bag."""
    bag = write_bag(
        tmp_path / "flight", "sqlite3", [*picture_messages(DRONE, OPTICAL), *camera_pose_messages()]
    )
    (name,) = (path.name for path in bag.glob("*.db3"))
    with closing(sqlite3.connect(bag / name)) as recorder:
        recorder.execute("PRAGMA journal_mode=WAL")
        half = "timestamp > (SELECT (min(timestamp) + max(timestamp)) / 2 FROM messages)"
        late = recorder.execute(f"SELECT * FROM messages WHERE {half}").fetchall()
        recorder.execute(f"DELETE FROM messages WHERE {half}")
        recorder.commit()
        recorder.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        recorder.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", late)
        recorder.commit()
        killed = shutil.copytree(bag, tmp_path / "killed")
    for source in (killed, killed / name):
        with pytest.raises(ValueError, match=rf"{name}-wal lies beside it.*sqlite3 \S*{name} '") as refused:
            open_recording(source)
    command = shlex.split(str(refused.value))
    with closing(sqlite3.connect(command[command.index("sqlite3") + 1])) as store:
        store.executescript(command[command.index("sqlite3") + 2])
    assert len(open_recording(killed).frames) == len(frames())


def test_a_part_that_the_description_of_a_bag_does_not_know_is_not_left_out(tmp_path: Path) -> None:
    """As where the recorder was cut off in a later part than the one that it last described."""
    messages = [*picture_messages(DRONE, OPTICAL), *camera_pose_messages()]
    bag = write_bag(tmp_path / "flight", "sqlite3", messages)
    (part,) = bag.glob("*.db3")
    shutil.copy(part, bag / "flight_1.db3")
    with pytest.raises(ValueError, match=r"flight_1.db3 is not in its metadata.yaml.*ros2 bag reindex"):
        open_recording(bag)
    assert len(open_recording(part).frames) == len(frames())


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_damage_is_one_line_and_never_a_traceback(tmp_path: Path, kind: str) -> None:
    messages = [*picture_messages(DRONE, OPTICAL)[:6], *camera_pose_messages()[:120]]
    bag = write_bag(tmp_path / ("flight.bag" if kind == "ros1" else "flight"), kind, messages)
    files = [bag] if bag.is_file() else sorted(bag.iterdir())
    random = np.random.default_rng(17)
    refused = used = 0
    for number in range(24):
        for file in files:
            whole = file.read_bytes()
            damaged = bytearray(whole)
            if number % 2:
                damaged = damaged[: int(random.integers(len(whole)))]
            else:
                for at in random.integers(len(whole), size=8):
                    damaged[at] = int(random.integers(256))
            file.write_bytes(bytes(damaged))
            try:
                recording = open_recording(bag)
                for frame in recording.frames:
                    frame.image()
                used += 1
            except ValueError as error:
                assert str(error)
                refused += 1
            file.write_bytes(whole)
    assert refused and used
    shutil.rmtree(bag, ignore_errors=True)


def test_a_compressed_bayer_mosaic_is_no_picture() -> None:
    """image_transport packs it as it is, as grey; a detector was shown its noise."""
    jpeg = mission().frames[0].encoded_image()

    def told(form: str) -> bytes:
        return encoded_picture(SimpleNamespace(format=form, data=jpeg), packed=True)

    for form in ("bayer_rggb8; jpeg compressed ", "bayer_gbrg8; png compressed", "bayer_rggb8"):
        with pytest.raises(ValueError, match=r"'bayer_.* is the mosaic of a colour sensor.*image_color"):
            told(form)
    for form in ("jpeg", "rgb8; jpeg compressed bgr8", "bayer_rggb8; jpeg compressed bgr8", "mono8"):
        assert told(form) == jpeg


def test_each_drone_of_a_fleet_may_have_transforms_of_its_own(tmp_path: Path) -> None:
    """As ROS 2 has several robots: frames are called alike, and /uav1/tf and /uav2/tf keep them apart. Read
    as one tree, each drone was in turn where it was and where the other one was."""
    drones = ("uav1", "uav2")
    messages: list[Any] = []
    for drone in drones:
        tree = [(f"/{drone}{topic}", *rest) for topic, *rest in moving_tree(drone)]
        messages += [*picture_messages(drone, OPTICAL), *tree]
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    assert_same_frames(found, drones, 1e-4)
    # Of one drone alone, as its user names it.
    topics = [warning for warning in found.warnings if "taken by types and names: uav2" in warning]
    stated = topics[0].partition("uav2: ")[2].partition(";")[0]
    alone = open_recording(tmp_path / "flight", topics=f"drone=uav2,{stated}")
    assert_same_frames(alone, ("uav2",), 1e-4)


def test_fixed_transforms_of_each_drone_beside_one_common_tf(tmp_path: Path) -> None:
    """The one that is nearest by name tells no way of the drone: /tf does."""
    static = moving_tree()[-1]
    moving = [*picture_messages(DRONE, OPTICAL), *moving_tree()[:-1]]
    found = open_recording(
        write_bag(tmp_path / "flight", "mcap", [*moving, (f"/{DRONE}/tf_static", *static[1:])])
    )
    assert_same_frames(found, (DRONE,), 1e-4)
    # Of a robot that is called otherwise than its camera, beside others that all share.
    lidar = (
        "/tf_static",
        TF,
        static[2],
        {"transforms": [transform(static[2], "gimbal", "lidar", np.zeros(3), MOUNT)]},
    )
    named = [*moving, lidar, ("/robot/tf_static", *static[1:])]
    assert_same_frames(open_recording(write_bag(tmp_path / "named", "mcap", named)), (DRONE,), 1e-4)


def test_fixed_transforms_above_the_odometry_of_each_robot(tmp_path: Path) -> None:
    """Whose cameras publish in namespaces of their own: nobody knew which mount was whose."""
    drones = ("uav1", "uav2")
    messages: list[Any] = []
    topics = []
    for drone in drones:
        eye = f"eye{drone[-1]}"
        pictures = [
            (topic.replace(f"/{drone}/", f"/{eye}/"), *rest)
            for topic, *rest in picture_messages(drone, OPTICAL)
        ]
        static = (f"/{drone}/tf_static", *static_mount(rows(drone)[0].stamp_ns)[1:])
        messages += [*pictures, *odometry(drone), static]
        camera = f"camera=/{eye}/cam/image_raw/compressed,info=/{eye}/cam/camera_info,heatmap=/{eye}/heatmap"
        topics.append(f"drone={drone},{camera},pose=/{drone}/odom")
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages), topics=topics)
    assert_same_frames(found, drones, 1e-4)


def test_frames_of_their_own_that_are_called_alike(tmp_path: Path) -> None:
    """Every robot calls the place where it was switched on `odom`."""
    messages, fixed = fleet_in_frames_of_their_own()
    alike = [
        (topic, kind, stamp, fields | {"header": header(stamp, "odom")}) if kind == POSE else one
        for one in messages
        for topic, kind, stamp, fields in [one]
    ]
    found = open_recording(write_bag(tmp_path / "flight", "mcap", alike))
    (told,) = [warning for warning in found.warnings if "nothing in the bag says" in warning]
    assert "(uav1 in odom of /uav1/cam/pose, uav2 in odom of /uav2/cam/pose)" in told
    statics = [
        (f"/{drone}/tf_static", TF, rows()[0].stamp_ns, {"transforms": [one | {"child_frame_id": "odom"}]})
        for drone, one in zip(("uav1", "uav2"), fixed, strict=True)
    ]
    found = open_recording(write_bag(tmp_path / "laid", "mcap", [*alike, *statics]))
    assert_same_frames(found, ("uav1", "uav2"), 1e-9)
    assert not any("nothing in the bag says" in warning for warning in found.warnings)


@pytest.mark.parametrize(
    ("topic", "told"),
    [
        ("mavros/local_position/pose", True),
        ("mavros/odometry/in", True),  # as PX4 tells it, which is taken by itself: the shortest name
        ("mavros/global_position/local", True),
        ("cam/pose", False),
        ("slam/odometry/inertial", False),
    ],
)
def test_the_map_of_an_autopilot_is_its_own(tmp_path: Path, topic: str, told: bool) -> None:
    """MAVROS calls the place where each autopilot was switched on `map`; of others, a map is that of all."""
    messages: list[Any] = []
    chosen = []
    for drone in ("uav1", "uav2"):
        messages += [
            *picture_messages(drone, OPTICAL),
            *camera_pose_messages(drone, topic=f"/{drone}/{topic}"),
        ]
        chosen.append(
            f"drone={drone},camera=/{drone}/cam/image_raw/compressed,info=/{drone}/cam/camera_info,"
            f"camera_pose=/{drone}/{topic}"
        )
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages), topics=chosen)
    assert any("nothing in the bag says" in warning for warning in found.warnings) == told


def stamped_otherwise(messages: list[Any], apart_s: float) -> list[Any]:
    """The same messages, recorded when they were, with their stamps by another clock."""
    return [
        (topic, kind, stamp, fields | {"header": header(stamp + round(apart_s * 1e9), "cam_optical")})
        for topic, kind, stamp, fields in messages
    ]


@pytest.mark.parametrize(
    ("told_by", "apart_s", "told"),
    [("pose", 18.0, "18.0 s ahead of"), ("pose", -1.5, "1.5 s behind"), ("tf", -1.5, "1.5 s behind")],
)
def test_a_camera_on_a_clock_of_its_own_is_told(
    tmp_path: Path, told_by: str, apart_s: float, told: str
) -> None:
    """Satellites count 18 s ahead of UTC. Every picture had the pose of another moment, and nothing was
    said."""
    poses = camera_pose_messages() if told_by == "pose" else moving_tree()
    pictures = stamped_otherwise(picture_messages(DRONE, OPTICAL), apart_s)
    found = open_recording(write_bag(tmp_path / "flight", "sqlite3", [*pictures, *poses]))
    (said,) = [warning for warning in found.warnings if "two clocks" in warning]
    assert f"of /uav1/cam/image_raw/compressed are {told} those of /" in said
    assert f"time_s is {-apart_s:.2f}" in said


def test_pictures_that_the_alignment_so_told_puts_right(tmp_path: Path) -> None:
    pictures = stamped_otherwise(picture_messages(DRONE, OPTICAL), -1.5)
    bag = write_bag(tmp_path / "flight", "mcap", [*pictures, *camera_pose_messages()])
    drones = {DRONE: {"time_s": 1.5}}
    (tmp_path / "a.json").write_text(json.dumps({"kind": "crowdfence alignment", "drones": drones}))
    righted = {frame.stamp_ns: frame for frame in open_recording(bag, alignment=tmp_path / "a.json").frames}
    for frame in reference().frames[2:]:
        ours = righted[frame.stamp_ns - 1_500_000_000].world_from_camera
        assert np.allclose(ours, frame.world_from_camera, atol=1e-9)


@pytest.mark.parametrize(
    ("drones", "apart_s", "told"),
    [
        (
            ("uav1", "uav2", "uav3"),
            18.0,
            "18.0 s ahead of those of uav2: what uav1 saw counts as so much newer",
        ),
        (("uav1", "uav2"), -300.0, "300.0 s ahead of those of uav1: what uav2 saw counts as so much newer"),
        (("uav1", "uav2"), 0.5, ""),
    ],
)
def test_a_drone_on_a_clock_of_its_own_is_told(
    tmp_path: Path, drones: tuple[str, ...], apart_s: float, told: str
) -> None:
    """The first of them. An empty look of its clock's future opened crowds that others saw later, and nothing
    was said; live that is an alarm."""
    messages: list[Any] = []
    for drone in drones:
        own = [*picture_messages(drone, OPTICAL), *camera_pose_messages(drone)]
        messages += stamped_otherwise(own, apart_s if drone == "uav1" else 0.0)
    found = open_recording(write_bag(tmp_path / "flight", "mcap", messages))
    said = [warning for warning in found.warnings if "by when they were recorded" in warning]
    assert len(said) == bool(told) and all(told in one for one in said)


def test_pictures_that_are_long_on_their_way_are_of_no_other_clock() -> None:
    poses_s, pictures_s = np.arange(0, 60, 0.02), np.arange(3, 50, 0.5)
    poses = {drone: arrivals(poses_s + 0.1, poses_s) for drone in ("a", "b")}
    pictures = {"a": arrivals(pictures_s + 0.2, pictures_s), "b": arrivals(pictures_s + 3.2, pictures_s)}
    assert list(drones_apart(pictures, poses)) == []
    together = dict.fromkeys(("a", "b"), poses["a"])  # all by /tf
    assert list(drones_apart(pictures, together)) == [("b", "a", pytest.approx(3.0, abs=0.02))]
    assert list(drones_apart({}, {})) == []


def arrivals(arrived_s: np.ndarray, stamps_s: np.ndarray) -> Arrivals:
    return Arrivals(*((np.round(times * 1e9)).astype(int).tolist() for times in (arrived_s, stamps_s)))


def test_what_no_clock_of_its_own_is() -> None:
    poses_s, pictures_s = np.arange(0, 60, 0.02), np.arange(3, 50, 0.5)
    poses = arrivals(poses_s + 0.01, poses_s)
    assert behind_s(arrivals(pictures_s + 0.6, pictures_s), poses) is None  # packed and sent
    apart_s = behind_s(arrivals(pictures_s + 4.6, pictures_s), poses)
    assert apart_s == pytest.approx(4.59, abs=0.02)
    # A flight of last year that was played at half its speed while another program made poses of it.
    replayed = arrivals(2 * pictures_s + 1e8, pictures_s)
    assert behind_s(replayed, arrivals(2 * poses_s + 1e8, poses_s)) is None
    # Written at once, or without times: arrivals say nothing.
    assert behind_s(arrivals(pictures_s / 1e6, pictures_s), arrivals(poses_s / 1e6, poses_s)) is None
    assert behind_s(arrivals(0 * pictures_s, pictures_s), poses) is None
    assert behind_s(arrivals(pictures_s[:0], pictures_s[:0]), poses) is None


def test_pictures_that_name_the_link_of_their_camera(tmp_path: Path) -> None:
    """Simulators do: its x is forward, and taken for the camera's own frame it looks at the sky."""
    first = rows()[0].stamp_ns
    link = Rotation.from_euler("y", DOWN_DEG, degrees=True)
    optical_in_link = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    assert np.allclose((link * optical_in_link).as_matrix(), MOUNT.as_matrix())
    fixed = [
        transform(first, "base_link", "camera_link", MOUNT_POSITION, link),
        transform(first, "camera_link", "camera_optical_frame", np.zeros(3), optical_in_link),
    ]
    messages = [*picture_messages(DRONE, "camera_link"), *odometry()]
    both = [*messages, ("/tf_static", TF, first, {"transforms": fixed})]
    found = open_recording(write_bag(tmp_path / "both", "mcap", both))
    assert_same_frames(found, (DRONE,), 1e-4)
    assert any("they name camera_link, which carries it" in warning for warning in found.warnings)
    alone = [*messages, ("/tf_static", TF, first, {"transforms": fixed[:1]})]
    found = open_recording(write_bag(tmp_path / "alone", "mcap", alone))
    assert any("camera_link, which is taken as the camera's optical" in told for told in found.warnings)
    by_hand = open_recording(tmp_path / "alone", mount=f"body:{-DOWN_DEG}")
    assert not any("camera_link" in warning for warning in by_hand.warnings)
