"""Recordings and flight logs that are damaged, or lie: frames or one line, soon and in little memory."""

import struct
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

from crowdfence import Camera, open_recording
from crowdfence.sources.alignment_file import read_alignment, write_alignment
from crowdfence.sources.film.subtitles import read_subtitles
from crowdfence.sources.film.tlog import read_tlog
from crowdfence.sources.film.ulog import read_ulog
from crowdfence.sources.lens.calibration_file import read_calibration
from crowdfence.sources.mission.writer import MissionWriter
from crowdfence.sources.pictures.decoding import read_heatmap
from crowdfence.sources.pose_offset import PoseOffset
from support.damaged_files import damaged, outcome
from support.flight_logs import tlog, ulog
from support.foreign_recordings import header, pose, write_bag, write_photograph
from support.small_data_sets import DataSet, write_data_set
from support.small_recordings import EPOCH_NS, flight, write_airsim, write_folder

CAMERA = Camera.pinhole(32, 24, 19.0, 19.5, 16.25, 11.75)


def read_all(path: Path) -> None:
    """Poses and pictures; a frame may be refused for itself."""
    recording = open_recording(path)
    for frame in recording.frames:
        outcome(frame.heatmap)
        outcome(frame.image)


def check(path: Path, cases: int, read: Callable[[], object], least: int) -> None:
    """Damages one file of what `read` reads; at least so many of the cases have to be refused."""
    intact = path.read_bytes()
    assert outcome(read) == ""
    refused = 0
    for data in damaged(intact, cases):
        path.write_bytes(data)
        refused += bool(outcome(read))
    assert refused >= least


def write_mission(path: Path) -> None:
    with MissionWriter(path) as writer:
        writer.add_camera("uav1", CAMERA)
        for number in range(4):
            stamp_ns = EPOCH_NS + number * 50_000_000
            writer.add_pose("uav1", stamp_ns, [number, 0, 10], (1.0, 0.0, 0.0, 0.0))
            if number % 2 == 0:
                writer.add_frame("uav1", stamp_ns, heatmap=np.full((6, 8), number, dtype=np.uint8))


def test_a_damaged_mission_file(tmp_path: Path) -> None:
    write_mission(tmp_path / "a.mcap")
    check(tmp_path / "a.mcap", 150, lambda: read_all(tmp_path / "a.mcap"), 40)


@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite3"])
def test_a_damaged_bag(tmp_path: Path, kind: str) -> None:
    down = Rotation.from_euler("x", 180, degrees=True)
    messages: list = []
    for number in range(6):
        stamp_ns = EPOCH_NS + number * 100_000_000
        placed = {"header": header(stamp_ns, "map"), "pose": pose(np.array([number, 0.0, 20.0]), down)}
        messages.append(("/uav1/cam/pose", "geometry_msgs/msg/PoseStamped", stamp_ns, placed))
        info = {"header": header(stamp_ns, "cam"), "height": 24, "width": 32, "distortion_model": "plumb_bob"}
        info |= {"k": [30.0, 0, 16.0, 0, 30.0, 12.0, 0, 0, 1], "d": [0.0] * 5}
        messages.append(("/uav1/cam/camera_info", "sensor_msgs/msg/CameraInfo", stamp_ns, info))
        rgb = {"height": 24, "width": 32, "encoding": "rgb8", "step": 96, "data": np.zeros(2304, np.uint8)}
        picture = {"header": header(stamp_ns, "cam")} | rgb
        messages.append(("/uav1/cam/image_raw", "sensor_msgs/msg/Image", stamp_ns, picture))
        grey = {"height": 6, "width": 8, "encoding": "mono8", "step": 8, "data": np.full(48, 9, np.uint8)}
        image = {"header": header(stamp_ns, "cam")} | grey
        messages.append(("/uav1/heatmap", "sensor_msgs/msg/Image", stamp_ns, image))
    bag = write_bag(tmp_path / ("a.bag" if kind == "ros1" else "bag"), kind, messages)
    files = [bag] if bag.is_file() else sorted(bag.iterdir())
    assert len(files) == (1 if kind == "ros1" else 2)
    for file in files:
        intact = file.read_bytes()
        of_no_use = kind == "mcap" and file.suffix == ".yaml"
        check(file, 80, lambda: read_all(bag), 0 if of_no_use else 15)
        file.write_bytes(intact)


@pytest.mark.parametrize("name", ["airsim_rec.txt", "settings.json", "telemetry/uav1.csv"])
def test_a_damaged_airsim_folder(tmp_path: Path, name: str) -> None:
    write_airsim(tmp_path / "a", flight(2))
    check(tmp_path / "a" / name, 60, lambda: read_all(tmp_path / "a"), 5)


@pytest.mark.parametrize("name", ["poses.csv", "recording.json"])
def test_a_damaged_folder(tmp_path: Path, name: str) -> None:
    write_folder(tmp_path / "a", flight(2))
    check(tmp_path / "a" / name, 100, lambda: read_all(tmp_path / "a"), 10)


def test_damaged_pictures_of_a_folder(tmp_path: Path) -> None:
    """They cost their frames, not the recording."""
    folder = write_folder(tmp_path / "a", flight(1))
    picture = sorted((folder / "heatmaps").iterdir())[0]
    for data in damaged(picture.read_bytes(), 100):
        picture.write_bytes(data)
        read_all(folder)


SUBTITLE = (
    '{0}\n00:00:{1:02},000 --> 00:00:{1:02},033\n<font size="28">FrameCnt: {0}, DiffTime: 33ms\n'
    "2026-05-01 10:00:{1:02}.000\n[iso: 110] [focal_len: 24.00] [latitude: 46.5{0:03}] [longitude: 8.0] "
    "[rel_alt: 30.000 abs_alt: 1230.000] [gb_yaw: 10.0 gb_pitch: -60.0 gb_roll: 0.0] </font>\n\n"
)


def write_subtitles(path: Path) -> None:
    path.write_text("".join(SUBTITLE.format(number + 1, number) for number in range(8)))


def test_damaged_subtitles(tmp_path: Path) -> None:
    path = tmp_path / "a.SRT"
    write_subtitles(path)
    check(path, 200, lambda: read_subtitles(path), 10)


def test_a_damaged_film(tmp_path: Path) -> None:
    path = tmp_path / "a.MP4"
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("mpeg4", rate=1)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for number in range(6):
            picture = np.full((48, 64, 3), 40 * number, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode(None))
    write_subtitles(tmp_path / "a.SRT")
    intact = path.read_bytes()
    check(path, 60, lambda: read_all(path), 5)
    layer = b"\x00\x00\x01\x20"  # ISO/IEC 14496-2: with it begins what says how large pictures are
    assert intact.count(layer) == 1
    path.write_bytes(intact.replace(layer, b"\x00\x00\x01\xff"))
    assert outcome(lambda: read_all(path)).endswith("does not say how large its pictures are: it is damaged")


def hanging_ulog() -> bytes:
    """Four seconds of a drone that hangs over a place."""
    topics = {
        "vehicle_global_position": "double lat;double lon;float alt;float alt_ellipsoid;",
        "vehicle_attitude": "float[4] q;",
        "vehicle_gps_position": "uint64_t time_utc_usec;",
    }
    records = []
    for number in range(20):
        at_us = 5_000_000 + number * 200_000
        records.append(struct.pack("<HQddff", 0, at_us, 46.5, 8.0, 1200.0, 1250.0))
        records.append(struct.pack("<HQ4f", 1, at_us, 1.0, 0.0, 0.0, 0.0))
        records.append(struct.pack("<HQQ", 2, at_us, EPOCH_NS // 1000 + number * 200_000))
    return ulog(5_000_000, topics, records)


def test_a_damaged_ulog(tmp_path: Path) -> None:
    path = tmp_path / "a.ulg"
    path.write_bytes(hanging_ulog())
    check(path, 300, lambda: read_ulog(path), 30)


def test_a_damaged_tlog(tmp_path: Path) -> None:
    told = []
    for number in range(20):
        boot_ms = 60_000 + number * 200
        place = mavlink.MAVLink_global_position_int_message(
            boot_ms, 465_000_000, 80_000_000, 1_200_000, 30_000, 0, 0, 0, 0
        )
        turned = mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        told.append((EPOCH_NS // 1000 + number * 200_000, [place, turned]))
    path = tmp_path / "a.tlog"
    path.write_bytes(tlog(told))
    check(path, 200, lambda: read_tlog(path), 5)


def test_damaged_photographs(tmp_path: Path) -> None:
    xmp = (
        'drone-dji:GimbalYawDegree="+10.00" drone-dji:GimbalPitchDegree="-60.00" '
        'drone-dji:GimbalRollDegree="+0.00" drone-dji:RelativeAltitude="+30.00"'
    )
    for number in range(2):
        write_photograph(
            tmp_path / f"{number}.JPG",
            np.full((24, 32, 3), 90, np.uint8),
            EPOCH_NS + number * 10**9,
            (46.5 + number * 1e-4, 8.0, 1230.0),
            xmp,
            focal_mm35=24.0,
        )
    picture = tmp_path / "1.JPG"
    for data in damaged(picture.read_bytes(), 200):
        picture.write_bytes(data)
        outcome(lambda: read_all(tmp_path))


@pytest.mark.parametrize("kind", ["intrinsic", "extrinsic", "annotations"])
def test_damaged_files_of_fixed_cameras(tmp_path: Path, kind: str) -> None:
    eyes = [(0.0, -8.0, 6.0), (8.0, 0.0, 6.0)]
    data = DataSet(False, eyes, (2.0, 2.0, 0.0), [[(1.0, 1.0), (2.0, 1.0)]])
    folder = write_data_set(tmp_path / "a", data)
    name = {"intrinsic": "intr_Camera1.xml", "extrinsic": "extr_Camera1.xml", "annotations": "*.json"}[kind]
    (file,) = folder.rglob(name)
    # What is annotated is read with each picture, and refused with it.
    check(file, 200, lambda: read_all(folder), 0 if kind == "annotations" else 10)


CALIBRATION = """\
image_width: 1280
image_height: 720
camera_matrix: {rows: 3, cols: 3, data: [700.5, 0, 639.25, 0, 701.25, 359.75, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.02, 0.001, -0.002, 0.003]}
"""


def test_a_damaged_calibration(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(CALIBRATION)
    check(path, 400, lambda: read_calibration(path), 100)
    text = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    for number in range(1, 12):  # 9 to the power of 12 numbers, if somebody counted them out
        text += f"a{number}: &a{number} [{', '.join([f'*a{number - 1}'] * 9)}]\n"
    path.write_text(text + "image_width: *a11\nimage_height: *a11\ncamera_matrix: {data: *a11}\n")
    assert outcome(lambda: read_calibration(path))


def test_a_damaged_alignment(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    offset = PoseOffset(1.5, -2.0, 0.5, 0.25, (0.5, 1.0, -2.0))
    write_alignment(path, {"uav1": offset, "uav2": offset})
    check(path, 400, lambda: read_alignment(path), 100)


def test_a_damaged_heatmap_of_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.zeros((6, 8), np.float32))
    check(path, 300, lambda: read_heatmap(path, (32, 24)), 100)
