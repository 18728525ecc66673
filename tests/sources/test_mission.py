"""The mission file: equal to what it was made from, readable by others, honest about damage."""

import json
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer as PlainWriter
from mcap_ros2.writer import Writer as RosWriter
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from crowdfence import Camera
from crowdfence.georeference import Georeference
from crowdfence.sources import FrameError, open_recording
from crowdfence.sources.convert import convert
from crowdfence.sources.mission import ros2_messages
from crowdfence.sources.mission.camera_info import (
    camera_from_info,
    camera_info_fields,
    is_rectified,
    rectified_camera,
)
from crowdfence.sources.mission.layout import MAGIC, split_topic, topic, topic_prefix
from crowdfence.sources.mission.writer import MissionWriter
from support.small_recordings import EPOCH_NS, HEIGHT, WIDTH, camera_enu, flight, heatmap, write_airsim

MS = 1_000_000
CAMERA = Camera.pinhole(WIDTH, HEIGHT, 19.0, 19.5, 16.25, 11.75)
IDENTITY = (1.0, 0.0, 0.0, 0.0)


@pytest.fixture
def airsim(tmp_path):
    return open_recording(write_airsim(tmp_path / "airsim", flight()), crowd_colors=[(89, 121, 72)])


@pytest.fixture
def mission(tmp_path, airsim):
    convert(airsim, tmp_path / "flight.mcap")
    return tmp_path / "flight.mcap"


def small_mission(path, frames=4, drone="uav1", **options):
    """One drone, 20 Hz poses, 10 Hz frames with a constant heatmap."""
    with MissionWriter(path, **options) as writer:
        writer.add_camera(drone, CAMERA)
        for number in range(2 * frames):
            stamp = EPOCH_NS + number * 50 * MS
            writer.add_pose(drone, stamp, [number, 0, 10], IDENTITY)
            if number % 2 == 0:
                writer.add_frame(drone, stamp, heatmap=np.full((6, 8), number, dtype=np.uint8))
    return path


# --- whole or absent --------------------------------------------------------------------------------------


def test_two_writers_of_one_file_do_not_mix_what_they_write(tmp_path):
    """The first one ended without a word, and its file held pieces of both."""
    path = tmp_path / "flight.mcap"
    with MissionWriter(path) as first:
        first.add_camera("uav1", CAMERA)
        first.add_frame("uav1", EPOCH_NS, heatmap=np.full((6, 8), 7, dtype=np.uint8))
        with pytest.raises(FileExistsError, match=r"flight\.mcap is being written by another command; wait"):
            small_mission(path)
    assert [frame.drone for frame in open_recording(path).frames] == []
    assert [file.name for file in tmp_path.iterdir()] == ["flight.mcap"]
    small_mission(path)
    assert len(open_recording(path).refused) + len(open_recording(path).frames) == 4


def test_an_error_while_writing_leaves_nothing_and_the_name_free(tmp_path):
    path = tmp_path / "flight.mcap"
    with pytest.raises(RuntimeError), MissionWriter(path):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
    small_mission(path)


# --- the same views as the source -------------------------------------------------------------------------


def test_views_are_equal_bit_for_bit(airsim, mission):
    copy = open_recording(mission)
    assert copy.drones == airsim.drones and copy.georeference == airsim.georeference
    assert copy.terrain is not None and airsim.terrain is not None
    assert copy.terrain.read_bytes() == airsim.terrain.read_bytes()
    assert copy.warnings == () and copy.refused == ()
    theirs, ours = list(airsim.instants()), list(copy.instants())
    assert [instant.stamp_ns for instant in ours] == [instant.stamp_ns for instant in theirs] and len(
        ours
    ) == 6
    for before, after in zip(theirs, ours, strict=True):
        for a, b in zip(before.views().views, after.views().views, strict=True):
            assert (a.drone, a.stamp_ns) == (b.drone, b.stamp_ns)
            assert a.world_from_camera.tobytes() == b.world_from_camera.tobytes()
            assert a.heatmap.tobytes() == b.heatmap.tobytes()
            for name in ("width", "height", "fx", "fy", "cx", "cy", "distortion"):
                assert getattr(a.camera, name) == getattr(b.camera, name)


def test_pixels_and_truth_are_equal(airsim, mission):
    for before, after in zip(airsim.frames, open_recording(mission).frames, strict=True):
        assert before.encoded_image() == after.encoded_image()
        np.testing.assert_array_equal(before.image(), after.image())
        np.testing.assert_array_equal(before.regions(), after.regions())
        np.testing.assert_array_equal(before.silhouettes(), after.silhouettes())
        np.testing.assert_array_equal(before.depth_m(), after.depth_m())


def test_converting_twice_changes_nothing(mission, tmp_path):
    again = tmp_path / "again.mcap"
    convert(open_recording(mission), again)
    tracks, copies = open_recording(mission).tracks(), open_recording(again).tracks()
    for drone, track in tracks.items():
        for name in ("stamps_ns", "positions", "quaternions"):
            assert getattr(track, name).tobytes() == getattr(copies[drone], name).tobytes()


def test_a_conversion_tells_what_it_did(airsim, tmp_path):
    first = airsim.frames[0]
    (tmp_path / "airsim" / "heatmaps" / f"heatmap_uav1_{first.stamp_ns}.png").write_bytes(
        b"\x89PNG\r\n\x1a\n cut"
    )
    next((tmp_path / "airsim" / "images").glob("img_uav3_front_center_5_*")).write_bytes(b"")
    calls = []
    done = convert(airsim, tmp_path / "flight.mcap", progress=lambda *counts: calls.append(counts))
    assert done.frames == {"uav1": 5, "uav3": 6, "uav_2": 6} and calls[-1] == (18, 18)
    assert done.size_bytes == (tmp_path / "flight.mcap").stat().st_size
    assert [(refused.drone, refused.stamp_ns) for refused in done.refused] == [("uav1", first.stamp_ns)]
    assert "heatmap cannot be read" in done.refused[0].reason
    assert any("silhouettes cannot be read" in line for line in done.omitted)
    # The mission goes on telling it.
    assert open_recording(tmp_path / "flight.mcap").refused == tuple(done.refused)
    with (tmp_path / "flight.mcap").open("rb") as file:
        (told,) = [r.metadata for r in make_reader(file).iter_metadata() if r.name == "crowdfence.refused"]
    assert [row["drone"] for row in json.loads(told["frames"])] == ["uav1"]


def test_a_failed_conversion_leaves_nothing_behind(airsim, tmp_path):
    def stop(done, total):
        raise RuntimeError("stopped by the caller")

    with pytest.raises(RuntimeError, match="stopped by the caller"):
        convert(airsim, tmp_path / "flight.mcap", progress=stop)
    assert not list(tmp_path.glob("flight*"))


# --- read by others ---------------------------------------------------------------------------------------


def test_rosbags_reads_it(mission, airsim):
    """An independent implementation of MCAP and CDR, with its own definitions of the message types."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    frames = {(frame.drone, frame.stamp_ns): frame for frame in airsim.frames}
    poses = 0
    with AnyReader([mission], default_typestore=store) as reader:
        topics = {
            connection.topic: (connection.msgtype, connection.msgcount) for connection in reader.connections
        }
        for connection, log_time_ns, raw in reader.messages():
            message = store.deserialize_cdr(raw, connection.msgtype)
            if connection.topic == "/tf":
                message = message.transforms[0]
            stamp = message.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == log_time_ns
            drone, _, part = connection.topic[1:].partition("/")
            if part == "camera/pose":
                check_pose(message.pose, drone, log_time_ns)
                assert message.header.frame_id == "map"
                poses += 1
            elif part == "heatmap":
                values = message.data.reshape(message.height, message.step)
                np.testing.assert_array_equal(values, heatmap(drone, log_time_ns))
                assert message.encoding == "mono8" and message.header.frame_id == f"{drone}/camera_optical"
            elif part == "camera/image/compressed":
                assert message.data.tobytes() == frames[drone, log_time_ns].encoded_image()
                assert message.format == "png"
    assert poses == 3 * 55
    assert topics["/tf"] == ("tf2_msgs/msg/TFMessage", 3 * 55)
    for drone in ("uav1", "uav3", "uav_2"):
        assert {
            name.removeprefix(f"/{drone}/"): kind for name, kind in topics.items() if f"/{drone}/" in name
        } == {
            "camera/pose": ("geometry_msgs/msg/PoseStamped", 55),
            "camera/camera_info": ("sensor_msgs/msg/CameraInfo", 6),
            "camera/image/compressed": ("sensor_msgs/msg/CompressedImage", 6),
            "heatmap": ("sensor_msgs/msg/Image", 6),
            "heatmap/camera_info": ("sensor_msgs/msg/CameraInfo", 6),
            "truth/regions": ("sensor_msgs/msg/Image", 6),
            "truth/silhouettes": ("sensor_msgs/msg/Image", 6),
            "truth/depth": ("sensor_msgs/msg/Image", 6),
        }


def check_pose(pose, drone, stamp_ns):
    expected = camera_enu(drone, stamp_ns)
    np.testing.assert_allclose(
        [pose.position.x, pose.position.y, pose.position.z], expected[:3, 3], atol=1e-9
    )
    turn = pose.orientation
    matrix = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    np.testing.assert_allclose(matrix, expected[:3, :3], atol=1e-9)


@pytest.mark.parametrize(
    "message_type", sorted(ros2_messages.DEFINITIONS.keys() - {ros2_messages.GEO_POINT_STAMPED})
)
def test_our_definitions_are_those_of_ros(message_type):
    """RIHS01 is ROS 2's own hash over a type and all types in it."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(ros2_messages.DEFINITIONS[message_type], message_type))
    assert store.hash_rihs01(message_type) == get_typestore(Stores.ROS2_HUMBLE).hash_rihs01(message_type)


def test_the_index_is_there(mission):
    with mission.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
        assert sum(1 for _ in reader.iter_messages(topics=["/uav1/heatmap"])) == 6
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert summary.chunk_indexes and all(chunk.compression == "zstd" for chunk in summary.chunk_indexes)
    assert metadata["crowdfence"]["version"] == "1" and metadata["crowdfence"]["latitude_deg"] == "46.5"


def test_camera_info_counts_pixels_as_opencv_does(mission):
    cv2 = pytest.importorskip("cv2")
    frame = open_recording(mission).frames[0]
    with AnyReader([mission]) as reader:
        wanted = [c for c in reader.connections if c.topic == f"/{frame.drone}/camera/camera_info"]
        connection, _, raw = next(reader.messages(wanted))
        info = reader.deserialize(raw, connection.msgtype)
    points = np.array([[0.1, -0.2, 1.0], [-0.3, 0.25, 2.0], [0.0, 0.0, 5.0]])
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), info.k.reshape(3, 3), info.d)
    np.testing.assert_allclose(theirs[:, 0] + 0.5, frame.camera.project(points), atol=1e-9)


# --- cameras, names, topics -------------------------------------------------------------------------------

focal_lengths, centres = st.floats(1.0, 1e5), st.floats(0.5, 1e5)


@given(focal_lengths, focal_lengths, centres, centres)
def test_intrinsics_survive_bit_for_bit(fx, fy, cx, cy):
    camera = Camera.pinhole(640, 480, fx, fy, cx, cy)
    copy = camera_from_info(decoded_info(camera))
    assert (copy.fx, copy.fy, copy.cx, copy.cy, copy.model) == (fx, fy, cx, cy, "pinhole")


@pytest.mark.parametrize(
    "camera",
    [
        Camera.pinhole(640, 480, 400, 401, 320, 240, [-0.05, 0.01, 0.001, -0.002, 0.003]),
        Camera.fisheye(640, 480, 300, 301, 320, 240, [0.01, -0.002, 0.0003, 0.00004]),
    ],
)
def test_lens_distortion_survives(camera):
    copy = camera_from_info(decoded_info(camera))
    assert (copy.model, list(copy.distortion)) == (camera.model, list(camera.distortion))


def decoded_info(camera, **changes):
    names = {"binning_x": 0, "binning_y": 0, "roi": region(0, 0, 0, 0)}
    return type("Info", (), {**names, **camera_info_fields(camera), **changes})


def region(x, y, width, height):
    return type("Roi", (), {"x_offset": x, "y_offset": y, "width": width, "height": height})


def test_a_region_of_interest_that_is_the_whole_picture_cuts_nothing():
    """As drivers of industrial cameras write it."""
    whole = decoded_info(CAMERA, roi=region(0, 0, CAMERA.width, CAMERA.height))
    assert camera_from_info(whole) == CAMERA


def test_a_rational_polynomial_without_a_denominator_is_plumb_bob():
    lens = [-0.05, 0.01, 0.001, -0.002, 0.003]
    told = decoded_info(CAMERA, distortion_model="rational_polynomial", d=[*lens, 0.0, 0.0, 0.0])
    assert list(camera_from_info(told).distortion) == lens
    plain = decoded_info(CAMERA, distortion_model="rational_polynomial", d=[0.0] * 8)
    assert camera_from_info(plain).model == "pinhole"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"roi": region(0, 8, CAMERA.width, CAMERA.height)}, "binned or cut"),
        ({"roi": region(0, 0, CAMERA.width, CAMERA.height - 8)}, "binned or cut"),
        (
            {"distortion_model": "rational_polynomial", "d": [0.1, 0, 0, 0, 0, 0, 0.02, 0]},
            "8 distortion coefficients: only k1, k2, p1, p2, k3 are supported",
        ),
        ({"binning_x": 2}, "binned or cut"),
        ({"k": [0.0] * 9}, "K in camera_info is all 0, as of a camera that is not calibrated"),
        # It was left out: a pixel 400 px below the middle lay 24 px further left than was measured.
        ({"k": [500, 30, 320, 0, 500, 240, 0, 0, 1]}, "K in camera_info is 500, 30, 320, .* without skew"),
        ({"k": [500, 0, 0, 0, 500, 0, 320, 240, 1]}, "must be fx, 0, cx, 0, fy, cy, 0, 0, 1, in this order"),
    ],
)
def test_unusable_camera_info_names_the_reason(changes, message):
    with pytest.raises(ValueError, match=message):
        camera_from_info(decoded_info(CAMERA, **changes))


@pytest.mark.parametrize(
    ("topic", "rectified"),
    [
        ("/uav1/cam/image_rect", True),
        ("/uav1/cam/image_rect_color/compressed", True),
        ("/camera/infra1/image_rect_raw", True),
        ("/cam/rectified/image", True),
        ("/cam/image_undistorted", True),
        ("/cam/image_undist/compressed", True),
        ("/cam/undisturbed", False),
        ("/uav1/cam/image_raw", False),
        ("/uav1/direct/image", False),
        ("/uav1/rectangle", False),
    ],
)
def test_topics_say_whether_their_pictures_are_rectified(topic, rectified):
    assert is_rectified(topic) is rectified


def test_a_rectified_camera_is_a_pinhole_as_p_says():
    p = [410.0, 0, 329.5, -40.0, 0, 412.0, 229.5, 0, 0, 0, 1, 0]
    lens = {"d": [-0.3, 0.1, 0, 0, 0, 0.01, 0, 0], "distortion_model": "rational_polynomial"}
    camera = rectified_camera(decoded_info(CAMERA, p=p, **lens))
    assert (camera.fx, camera.fy, camera.cx, camera.cy, camera.model) == (410, 412, 330, 230, "pinhole")
    tenth = np.radians(0.1)  # of a pair of cameras: their pictures are turned to lie side by side
    turned = [np.cos(tenth), 0, np.sin(tenth), 0, 1, 0, -np.sin(tenth), 0, np.cos(tenth)]
    assert rectified_camera(decoded_info(CAMERA, p=p, r=turned)).fx == 410
    with pytest.raises(ValueError, match="turned by 0.30 degrees"):
        turned = [np.cos(3 * tenth), 0, np.sin(3 * tenth), 0, 1, 0, -np.sin(3 * tenth), 0, np.cos(3 * tenth)]
        rectified_camera(decoded_info(CAMERA, p=p, r=turned))


def test_a_rectified_camera_without_p_is_the_plain_one_or_none():
    plain = Camera.pinhole(640, 480, 400, 401, 320, 240)
    assert rectified_camera(decoded_info(plain, p=[0.0] * 12, r=[0.0] * 9)) == plain
    with pytest.raises(ValueError, match="P .* is empty"):
        rectified_camera(decoded_info(plain, p=[0.0] * 12, d=[-0.3, 0, 0, 0, 0]))
    with pytest.raises(ValueError, match="binned or cut"):
        rectified_camera(decoded_info(plain, binning_x=2))


def test_a_link_stays_a_link_and_leads_to_the_mission(tmp_path):
    """As for every other file that is replaced; the link was, and its old target stayed."""
    (tmp_path / "disk").mkdir()
    for name in ("latest.mcap", "new.mcap"):
        (tmp_path / name).symlink_to(tmp_path / "disk" / f"of_{name}")
    (tmp_path / "disk" / "of_latest.mcap").write_bytes(b"old")
    for name in ("latest.mcap", "new.mcap"):
        with MissionWriter(tmp_path / name) as writer:
            writer.add_camera("uav1", CAMERA)
            writer.add_pose("uav1", 1, [0, 0, 0], IDENTITY)
        assert (tmp_path / name).is_symlink()
        assert open_recording(tmp_path / "disk" / f"of_{name}").drones == ("uav1",)
    assert len(list((tmp_path / "disk").iterdir())) == 2


def test_drone_names_that_ros_does_not_allow(tmp_path):
    with MissionWriter(tmp_path / "m.mcap") as writer:
        for number, drone in enumerate(["uav-1", "uav.1", "7", "дрон"]):
            writer.add_camera(drone, CAMERA)
            writer.add_pose(drone, number, [number, 0, 0], IDENTITY)
            writer.add_frame(drone, number, heatmap=np.zeros((6, 8), dtype=np.uint8))
    recording = open_recording(tmp_path / "m.mcap")
    assert recording.drones == ("7", "uav-1", "uav.1", "дрон")
    assert [frame.drone for frame in recording.frames] == ["uav-1", "uav.1", "7", "дрон"]
    with AnyReader([tmp_path / "m.mcap"]) as reader:
        names = {c.topic for c in reader.connections if c.topic.endswith("/heatmap")}
    assert {"/uav_1/heatmap", "/uav_1_2/heatmap", "/drone_7/heatmap"} < names
    assert all(name.isascii() for name in names)


def test_topics_and_back():
    assert split_topic(topic("/uav1", "regions")) == ("/uav1", "regions")
    assert split_topic("/tf") is None and split_topic("/uav1/lidar/points") is None
    assert split_topic("/camera/pose") is None
    assert topic_prefix("a b", {"/a_b"}) == "/a_b_2"


# --- the writer -------------------------------------------------------------------------------------------


def test_heatmaps_of_any_kind_come_back(tmp_path):
    kinds = [
        np.linspace(0, 1, 48, dtype=np.float32).reshape(6, 8),
        np.linspace(0, 1, 48).reshape(6, 8),
        np.arange(48, dtype=np.uint8).reshape(6, 8),
        np.asfortranarray(np.arange(48, dtype=">f4").reshape(6, 8) / 64),
    ]
    with MissionWriter(tmp_path / "m.mcap") as writer:
        writer.add_camera("a", CAMERA)
        for number, values in enumerate(kinds):
            writer.add_pose("a", number * 100 * MS, [0, 0, 0], IDENTITY)
            writer.add_frame("a", number * 100 * MS, heatmap=values, regions=np.full((HEIGHT, WIDTH), 300))
    frames = open_recording(tmp_path / "m.mcap").frames
    for frame, values in zip(frames, kinds, strict=True):
        expected = values if values.dtype == np.uint8 else values.astype(np.float32)
        np.testing.assert_array_equal(frame.heatmap(), expected)
        assert frame.heatmap().dtype == (np.uint8 if values.dtype == np.uint8 else np.float32)
        assert frame.regions()[0, 0] == 300


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda w: w.add_frame("b", 1), "no camera of 'b' was added"),
        (
            lambda w: w.add_frame("a", 5, image=b"GIF89a..."),
            "must be JPEG or PNG, got bytes that begin with b'GIF89a",
        ),
        (
            lambda w: w.add_frame("a", 5, heatmap=np.zeros((6, 8), dtype=np.int32)),
            "uint8 or float, got int32",
        ),
        (lambda w: w.add_frame("a", 5, heatmap=np.zeros((0, 8), dtype=np.uint8)), r"got shape \(0, 8\)"),
        (
            lambda w: w.add_frame("a", 5, regions=np.full((2, 2), -1)),
            r"integers in \[0, 65535\], got int64 from -1",
        ),
        (lambda w: w.add_frame("a", -1), "stamp -1 is outside"),
        (lambda w: w.add_pose("a", 2**62, [0, 0, 0], IDENTITY), "is outside"),
        (lambda w: [w.add_frame("a", 7), w.add_frame("a", 7)], "stamp 7 does not come after the last one, 7"),
        (lambda w: [w.add_pose("a", s, [0, 0, 0], IDENTITY) for s in (9, 8)], "stamp 8 does not come after"),
    ],
)
def test_the_writer_refuses_what_no_reader_could_use(tmp_path, act, message):
    with pytest.raises(ValueError, match=message), MissionWriter(tmp_path / "m.mcap") as writer:
        writer.add_camera("a", CAMERA)
        act(writer)
    assert list(tmp_path.iterdir()) == []


def test_the_name_appears_only_when_the_file_is_whole(tmp_path):
    writer = MissionWriter(tmp_path / "m.mcap")
    writer.add_drone("a")
    assert [path.name for path in tmp_path.iterdir()] == ["m.mcap.part"]
    writer.close()
    writer.close()
    assert [path.name for path in tmp_path.iterdir()] == ["m.mcap"]
    assert open_recording(tmp_path / "m.mcap").drones == ("a",)


def test_georeference_and_terrain_come_back(tmp_path):
    where = Georeference(46.123456789012345, -8.000000000000002, 1200.1)
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "dem.tif").write_bytes(b"x")
    path = small_mission(tmp_path / "m.mcap", georeference=where, terrain=tmp_path / "maps" / "dem.tif")
    recording = open_recording(path)
    assert recording.georeference == where
    assert recording.terrain.samefile(tmp_path / "maps" / "dem.tif")
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    path.rename(moved / "m.mcap")
    recording = open_recording(moved / "m.mcap")
    assert recording.terrain is None and "is not there" in recording.warnings[0]


# --- damage -----------------------------------------------------------------------------------------------


def long_mission(path, frames=40):
    """Several chunks: pictures that do not compress fill them."""
    noise = np.random.default_rng(1)
    with MissionWriter(path, georeference=Georeference(46.5, 8.0, 1200.0)) as writer:
        writer.add_camera("uav1", CAMERA)
        for number in range(frames):
            stamp = EPOCH_NS + number * 100 * MS
            writer.add_pose("uav1", stamp, [number, 0, 10], IDENTITY)
            picture = b"\x89PNG\r\n\x1a\n" + noise.bytes(100_000)
            writer.add_frame("uav1", stamp, image=picture, heatmap=np.full((6, 8), number, dtype=np.uint8))
    return path


def test_a_file_cut_in_the_middle_is_read_up_to_the_cut(tmp_path):
    path = long_mission(tmp_path / "m.mcap")
    data = path.read_bytes()
    cut = len(data) * 6 // 10
    with path.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    last = max(
        chunk.message_end_time for chunk in chunks if chunk.chunk_start_offset + chunk.chunk_length <= cut
    )
    path.write_bytes(data[:cut])
    recording = open_recording(path)
    # One frame every 100 ms, up to the end of the last chunk before the cut.
    expected = range(EPOCH_NS, last + 1, 100 * MS)
    assert 1 < len(expected) < 24, "at most 60 % of 40 frames"
    assert [frame.stamp_ns for frame in recording.frames] == list(expected)
    assert f"messages were read up to stamp {last}" in recording.warnings[0]
    assert "bytes lost" in recording.warnings[0]
    found = [instant.views() for instant in recording.instants()]
    seen = [round(view.heatmap[0, 0] * 255) for one in found for view in one.views]
    # Of the last frame the picture may have been saved and the heatmap not: it then says so.
    refused = [refused for one in found for refused in one.refused]
    assert seen == list(range(len(recording.frames) - len(refused))) and len(refused) <= 1
    assert all("has no heatmap" in one.reason for one in refused)
    assert recording.georeference == Georeference(46.5, 8.0, 1200.0)


def test_a_file_without_its_end_loses_nothing_but_says_so(tmp_path):
    path = long_mission(tmp_path / "m.mcap")
    data = path.read_bytes()
    path.write_bytes(data[:-20])
    recording = open_recording(path)
    assert len(recording.frames) == 40
    assert "index at the end of the file is missing" in recording.warnings[0]


def test_a_broken_chunk_costs_its_own_messages(tmp_path):
    path = long_mission(tmp_path / "m.mcap")
    with path.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    data = bytearray(path.read_bytes())
    middle = chunks[1].chunk_start_offset + chunks[1].chunk_length // 2
    data[middle] ^= 0xFF
    path.write_bytes(data)
    recording = open_recording(path)
    assert f"the chunk at byte {chunks[1].chunk_start_offset} cannot be read" in recording.warnings[0]
    lost = {EPOCH_NS + n * 100 * MS for n in range(40)} - {frame.stamp_ns for frame in recording.frames}
    begin, end = chunks[1].message_start_time, chunks[1].message_end_time
    assert lost and all(begin <= stamp <= end for stamp in lost)


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"not a recording at all"])
def test_files_that_are_no_mcap(tmp_path, content):
    (tmp_path / "m.mcap").write_bytes(content)
    with pytest.raises(ValueError, match="is not a recording"):
        open_recording(tmp_path / "m.mcap")


def test_only_the_magic_bytes(tmp_path):
    (tmp_path / "m.mcap").write_bytes(MAGIC)
    with pytest.raises(
        ValueError, match="m.mcap is damaged: the file ends at byte 8 without its closing records"
    ):
        open_recording(tmp_path / "m.mcap")


def test_an_mcap_of_something_else(tmp_path):
    with (tmp_path / "m.mcap").open("wb") as file:
        writer = PlainWriter(file)
        writer.start()
        schema = writer.register_schema("other/msg/Thing", "ros2msg", b"int32 a")
        channel = writer.register_channel("/uav1/heatmap", "cdr", schema)
        writer.add_message(channel, log_time=1, publish_time=1, data=b"\0\1\0\0\5\0\0\0")
        writer.finish()
    with pytest.raises(ValueError, match=r"holds other/msg/Thing, expected sensor_msgs/msg/Image: not read"):
        open_recording(tmp_path / "m.mcap")


def test_a_newer_version_is_refused(tmp_path):
    with (tmp_path / "m.mcap").open("wb") as file:
        writer = PlainWriter(file)
        writer.start()
        writer.add_metadata("crowdfence", {"version": "2"})
        writer.finish()
    with pytest.raises(ValueError, match="version '2', expected 1"):
        open_recording(tmp_path / "m.mcap")


@pytest.mark.parametrize(
    "record",
    [
        struct.pack("<BQ", 6, 2**62),  # a chunk of 4 EiB
        struct.pack("<BQ", 6, 40)
        + struct.pack("<QQQI", 0, 0, 2**50, 0)
        + struct.pack("<I", 0)
        + struct.pack("<Q", 0),
        struct.pack("<BQ", 12, 12) + struct.pack("<I", 2**32 - 1) + b"crowdfen",  # a name of 4 GiB
        struct.pack("<BQ", 5, 4) + b"\1\0\0\0",  # a message shorter than its header
    ],
)
def test_lying_lengths_cost_no_memory(tmp_path, record):
    whole = small_mission(tmp_path / "m.mcap").read_bytes()
    at = len(MAGIC) + 9 + struct.unpack_from("<Q", whole, len(MAGIC) + 1)[0]  # behind the header record
    (tmp_path / "m.mcap").write_bytes(whole[:at] + record + whole[at:])
    try:
        recording = open_recording(tmp_path / "m.mcap")
    except ValueError as error:
        assert "claims 4611686018427387904 bytes" in str(error)
    else:
        assert recording.warnings and len(recording.frames) == 4


@given(st.data())
@settings(max_examples=150)
def test_damaged_bytes_never_crash(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("damaged")
    content = bytearray(small_mission(folder / "m.mcap").read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(8, len(content) - 1))] = data.draw(st.integers(0, 255))
    (folder / "m.mcap").write_bytes(content[: data.draw(st.integers(0, len(content)))])
    try:
        recording = open_recording(folder / "m.mcap")
    except ValueError:
        return
    for instant in recording.instants():
        instant.views()
    assert len(recording.frames) <= 4


def test_a_file_that_shrinks_after_it_was_opened(tmp_path):
    recording = open_recording(small_mission(tmp_path / "m.mcap"))
    (tmp_path / "m.mcap").write_bytes(MAGIC)
    views, refused = next(recording.instants()).views()
    assert views == []
    assert "cut after it was opened" in refused[0].reason


# --- clocks and gaps --------------------------------------------------------------------------------------


HEATMAP = {"height": 6, "width": 8, "encoding": "mono8", "step": 8, "data": bytes(48)}


def bag(path, frame_stamps, pose_stamps, drone="uav1", pixels=HEATMAP):
    """As another recorder would write it: log time is the time of arrival, stamps are the drone's own."""
    with path.open("wb") as file, RosWriter(file) as writer:
        kinds = {name: writer.register_msgdef(name, text) for name, text in ros2_messages.DEFINITIONS.items()}

        def send(suffix, kind, log_time, stamp, **fields):
            message = {"header": ros2_messages.header(stamp, "map"), **fields}
            writer.write_message(f"/{drone}/{suffix}", kinds[kind], message, log_time=log_time)

        send("camera/camera_info", ros2_messages.CAMERA_INFO, 0, 0, **camera_info_fields(CAMERA))
        for arrival, stamp in enumerate(pose_stamps):
            pose = {"position": {"x": 1.0}, "orientation": {"w": 1.0}}
            send("camera/pose", ros2_messages.POSE_STAMPED, arrival, stamp, pose=pose)
        for arrival, stamp in enumerate(frame_stamps):
            send("heatmap", ros2_messages.IMAGE, arrival, stamp, **pixels)
    return path


SECOND = 10**9


def test_a_bag_of_another_recorder(tmp_path):
    recording = open_recording(
        bag(tmp_path / "m.mcap", [SECOND, 2 * SECOND], [0, 3 * SECOND]), max_pose_gap_s=3
    )
    assert len(recording.frames) == 2 and recording.georeference is None
    assert "no crowdfence metadata" in recording.warnings[0]


def test_pixels_of_other_machines(tmp_path):
    """Big-endian values and rows padded to a multiple of 16 bytes are allowed in sensor_msgs/Image."""
    values = np.linspace(0, 1, 18, dtype=np.float32).reshape(6, 3)
    padded = np.zeros((6, 4), dtype=">f4")
    padded[:, :3] = values
    fields = {
        "height": 6,
        "width": 3,
        "encoding": "32FC1",
        "is_bigendian": 1,
        "step": 16,
        "data": padded.tobytes(),
    }
    recording = open_recording(bag(tmp_path / "m.mcap", [SECOND], [SECOND], pixels=fields))
    np.testing.assert_array_equal(recording.frames[0].heatmap(), values)


def test_stamps_that_go_back_repeat_or_jump(tmp_path):
    hours = 3 * 3600 * SECOND
    stamps = [
        SECOND,
        2 * SECOND,
        3 * SECOND,
        3 * SECOND,
        4 * SECOND,
        4 * SECOND + hours,
        2 * SECOND + 5,
        5 * SECOND,
        6 * SECOND,
    ]
    poses = [n * SECOND // 4 for n in range(40)]
    recording = open_recording(bag(tmp_path / "m.mcap", stamps, poses))
    assert [frame.stamp_ns // SECOND for frame in recording.frames] == [1, 2, 3, 4, 5, 6]
    reasons = {refused.stamp_ns: refused.reason for refused in recording.refused}
    assert "repeats an earlier frame" in reasons[3 * SECOND]
    assert "jumps 3.00 h away" in reasons[4 * SECOND + hours]
    assert "goes back 2.000 s behind" in reasons[2 * SECOND + 5]


def test_a_gap_in_the_telemetry(tmp_path):
    poses = [n * SECOND // 10 for n in range(20)] + [4 * SECOND, 4 * SECOND + SECOND // 10]
    path = bag(tmp_path / "m.mcap", [SECOND, 3 * SECOND, 4 * SECOND, 5 * SECOND], poses)
    recording = open_recording(path)
    assert [frame.stamp_ns for frame in recording.frames] == [SECOND, 4 * SECOND]
    gap, late = (refused.reason for refused in recording.refused)
    assert "gap of 2.100 s there (limit max_pose_gap_s = 0.25 s)" in gap
    assert "0.900 s after the last pose" in late
    assert len(open_recording(path, max_pose_gap_s=2.5).frames) == 3


def test_frames_without_camera_or_telemetry(tmp_path):
    with MissionWriter(tmp_path / "m.mcap") as writer:
        writer.add_camera("a", CAMERA)
        writer.add_frame("a", 5, heatmap=np.zeros((6, 8), dtype=np.uint8))
    (refused,) = open_recording(tmp_path / "m.mcap").refused
    assert "no telemetry" in refused.reason


def test_an_image_message_that_claims_too_much(tmp_path):
    path = tmp_path / "m.mcap"
    with path.open("wb") as file, RosWriter(file) as writer:
        kinds = {name: writer.register_msgdef(name, text) for name, text in ros2_messages.DEFINITIONS.items()}
        header = ros2_messages.header(SECOND, "map")
        info = {"header": header, **camera_info_fields(CAMERA)}
        writer.write_message("/a/camera/camera_info", kinds[ros2_messages.CAMERA_INFO], info, log_time=1)
        pose = {"header": header, "pose": {"orientation": {"w": 1.0}}}
        writer.write_message("/a/camera/pose", kinds[ros2_messages.POSE_STAMPED], pose, log_time=1)
        image = {
            "header": header,
            "height": 2**31,
            "width": 2**31,
            "encoding": "mono8",
            "step": 2**31,
            "data": b"12",
        }
        writer.write_message("/a/heatmap", kinds[ros2_messages.IMAGE], image, log_time=1)
    (frame,) = open_recording(path).frames
    with pytest.raises(FrameError, match=r"2147483648x2147483648 mono8 .* needs more than its 2 bytes"):
        frame.heatmap()
