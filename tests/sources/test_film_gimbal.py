"""What a gimbal says of its yaw: from north, or from the drone's heading."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

from crowdfence.sources.film.boots import Boot
from crowdfence.sources.film.gimbal_turns import gimbal_turns
from crowdfence.sources.film.merged_rows import Turns, merged
from crowdfence.sources.film.tlog import KINDS, log_of_boots, read_tlog
from crowdfence.sources.film.ulog import read_ulog
from support.flight_logs import tlog

EAST = [np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)]
"""A turn of 90 degrees about down: whoever looked north looks east."""
DOWN_45 = [np.cos(np.pi / 8), 0.0, -np.sin(np.pi / 8), 0.0]
"""45 degrees below the horizon, straight ahead."""
LOCK, VEHICLE, EARTH = 16, 32, 64
OTHERS = 4 | 8
"""ROLL_LOCK and PITCH_LOCK, which say nothing about yaw."""
TIMES = np.arange(5) / 4


def looks_towards_deg(quaternions: np.ndarray) -> float:
    """Where x, forward, of the first attitude points, clockwise from north."""
    w, x, y, z = quaternions[0]
    return float(np.degrees(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))))


# What the message's text says of the yaw: 0 from the heading, which is east here, or from north.
@pytest.mark.parametrize(
    ("flags", "towards_deg"),
    [
        (0, 90),
        (LOCK, 0),
        (VEHICLE, 90),
        (VEHICLE | LOCK, 90),
        (EARTH, 0),
        (EARTH | LOCK, 0),
        (VEHICLE | EARTH, None),
        (VEHICLE | EARTH | LOCK, None),
    ],
)
def test_flags_say_where_yaw_counts_from(flags: int, towards_deg: float | None) -> None:
    body = Turns.of(TIMES, [EAST] * 5)
    remarks: list[str] = []
    found = gimbal_turns(TIMES, [DOWN_45] * 5, [flags | OTHERS] * 5, body, remarks)
    if towards_deg is None:
        assert found is None and "5 of 5 rows of the gimbal are left out" in remarks[0]
        assert str(flags | OTHERS) in remarks[0]
    else:
        assert found is not None and not remarks
        assert looks_towards_deg(found.quaternions) == pytest.approx(towards_deg, abs=1e-6)


def test_a_contradictory_row_is_left_out_and_the_others_stay() -> None:
    body = Turns.of(TIMES, [EAST] * 5)
    remarks: list[str] = []
    found = gimbal_turns(TIMES, [DOWN_45] * 5, [64, 64, 96, 32, 64], body, remarks)
    assert found is not None and found.time_s.tolist() == [0, 0.25, 0.75, 1] and len(remarks) == 1


def test_a_yaw_from_the_heading_needs_the_heading() -> None:
    assert gimbal_turns(TIMES, [DOWN_45] * 5, [VEHICLE] * 5, None, []) is None
    assert gimbal_turns(TIMES, [DOWN_45] * 5, [EARTH] * 5, None, []) is not None


@pytest.mark.parametrize("flags", [EARTH, VEHICLE])
def test_a_gimbal_that_never_says_where_it_points_is_not_level(flags: int) -> None:
    """As of subtitles and photographs: a camera that looked down was taken for one that looks ahead."""
    body, remarks = Turns.of(TIMES, [EAST] * 5), list[str]()
    assert gimbal_turns(TIMES, [[1.0, 0.0, 0.0, 0.0]] * 5, [flags] * 5, body, remarks) is None
    assert remarks and "all 5 rows of the gimbal are level and straight ahead to the last digit" in remarks[0]
    once_level = [[1.0, 0.0, 0.0, 0.0], *[DOWN_45] * 4]
    assert gimbal_turns(TIMES, once_level, [flags] * 5, body, []) is not None


LOCKED_TO_THE_VEHICLE = OTHERS | LOCK | VEHICLE
"""60, as gimbals that hold their yaw report themselves."""


def test_a_telemetry_log_of_a_locked_gimbal_in_the_vehicle_frame(tmp_path: Path) -> None:
    arrived = []
    for number in range(10):
        boot_ms = 5000 + number * 100
        messages = (
            mavlink.MAVLink_global_position_int_message(
                boot_ms, 465000000, 80000000, 530000, 30000, 0, 0, 0, 0
            ),
            mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, np.pi / 2, 0.0, 0.0, 0.0),
            mavlink.MAVLink_gimbal_device_attitude_status_message(
                0, 0, boot_ms, LOCKED_TO_THE_VEHICLE, DOWN_45, 0.0, 0.0, 0.0, 0
            ),
        )
        arrived.append((1_760_000_000_000_000 + number * 100_000, messages))
    (tmp_path / "a.tlog").write_bytes(tlog(arrived))
    camera = read_tlog(tmp_path / "a.tlog").camera_ned
    assert camera is not None and looks_towards_deg(camera) == pytest.approx(90, abs=1e-4)


def test_of_two_gimbals_one_is_taken(tmp_path: Path) -> None:
    """One looks down to the east, the other ahead to the west: half way between no camera ever looked."""
    down_east = Rotation.from_euler("ZY", [90.0, -90.0], degrees=True).as_quat()[[3, 0, 1, 2]]
    west = [np.cos(np.pi / 4), 0.0, 0.0, -np.sin(np.pi / 4)]
    arrived = []
    for number in range(10):
        boot_ms = 5000 + number * 100
        place = [465000000, 80000000, 530000, 30000]
        told = [mavlink.MAVLink_global_position_int_message(boot_ms, *place, 0, 0, 0, 0)]
        for device, (look, later_ms) in enumerate([(down_east, 0), (west, 50)], start=1):
            if number or device == 1:  # the first tells once more
                status = [0, 0, boot_ms + later_ms, EARTH | LOCK, look, 0.0, 0.0, 0.0, 0, 0.0, 0.0, device]
                told.append(mavlink.MAVLink_gimbal_device_attitude_status_message(*status))
        arrived.append((1_760_000_000_000_000 + number * 100_000, told))
    (tmp_path / "a.tlog").write_bytes(tlog(arrived))
    log = read_tlog(tmp_path / "a.tlog")
    assert log.camera_ned is not None
    assert np.allclose(np.abs(log.camera_ned @ down_east), 1.0, atol=1e-6)
    assert log.remarks == [
        "attitudes of several gimbals are told: component 1, device 1 is taken, not component 1, device 2"
    ]


@pytest.mark.parametrize("instances", [True, False])
def test_of_two_gimbals_of_a_px4_log_one_is_taken_and_told(tmp_path: Path, instances: bool) -> None:
    """In two instances of the topic, or in turn in one of them. The first looks down to the east, the other
    ahead to the west."""
    down_east = Rotation.from_euler("ZY", [90.0, -90.0], degrees=True).as_quat()[[3, 0, 1, 2]]
    west = [np.cos(np.pi / 4), 0.0, 0.0, -np.sin(np.pi / 4)]
    gimbal = "gimbal_device_attitude_status"
    formats = {
        "vehicle_global_position": "double lat;double lon;float alt;",
        gimbal: "float[4] q;uint16_t device_flags;uint8_t gimbal_device_id;",
    }
    parts = [(b"F", f"{name}:uint64_t timestamp;{fields}".encode()) for name, fields in formats.items()]
    for instance, number, name in [(0, 0, "vehicle_global_position"), (0, 1, gimbal), (1, 2, gimbal)]:
        parts.append((b"A", struct.pack("<BH", instance, number) + name.encode()))
    for step in range(10):
        parts.append((b"D", struct.pack("<HQddf", 0, step * 100_000, 46.5, 8.0, 530.0)))
        for device, (look, later_us) in enumerate([(down_east, 0), (west, 50_000)]):
            topic, told = (1 + device, 0) if instances else (1, 1 + device)
            row = (topic, step * 100_000 + later_us, *look, EARTH | LOCK, told)
            parts.append((b"D", struct.pack("<HQ4fHB", *row)))
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    data += b"".join(struct.pack("<HB", len(body), kind[0]) + body for kind, body in parts)
    (tmp_path / "a.ulg").write_bytes(data)
    log = read_ulog(tmp_path / "a.ulg")
    assert log.camera_ned is not None
    assert np.allclose(np.abs(log.camera_ned @ down_east), 1.0, atol=1e-6)
    taken, other = ("instance 0, device 0", "instance 1, device 0")
    if not instances:
        taken, other = ("instance 0, device 1", "instance 0, device 2")
    assert f"attitudes of several gimbals are told: {taken} is taken, not {other}" in log.remarks


def test_a_flight_over_the_date_line_stays_there() -> None:
    """Fiji: 0.0001 degrees west of it and east of it; half way is on it and not on Greenwich's meridian."""
    body = Turns.of(np.arange(0.0, 1.01, 0.1), [EAST] * 11)
    log = merged(
        {
            "time_s": [0.0, 1.0],
            "latitude": [-17.0, -17.0],
            "longitude": [179.9999, -179.9999],
            "sea": [50, 50],
        },
        {"sea": "sea"},
        body,
        body,
        start_ns=None,
        take_off=None,
        remarks=[],
    )
    off_line = np.abs((log.longitude_deg % 360.0) - 180.0)
    assert (
        len(off_line) == 11 and off_line.max() <= 0.0001 + 1e-9 and np.abs(log.longitude_deg).max() <= 180.0
    )


def turning_flight(path: Path, gimbal_ms: Callable[[float], float], *, attitude_of_payload: bool) -> Path:
    """20 s of a drone that looks along its heading, which turns by 30 degrees a second. Its gimbal is a
    component of its own (154, on the same system), whose clock says `gimbal_ms`; messages take 40 ms."""
    autopilot = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    payload = mavlink.MAVLink(None, srcSystem=1, srcComponent=154)
    data = bytearray()
    for number in range(200):
        boot_s, yaw = 60.0 + number / 10, np.radians(30.0 * number / 10)
        look = [np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]
        told = [
            (
                autopilot,
                mavlink.MAVLink_global_position_int_message(
                    round(boot_s * 1e3), 465000000, 80000000, 530000, 30000, 0, 0, 0, 0
                ),
            ),
            (
                payload,
                mavlink.MAVLink_gimbal_device_attitude_status_message(
                    0, 0, round(gimbal_ms(boot_s)) % 2**32, LOCK | EARTH, look, 0.0, 0.0, 0.0, 0
                ),
            ),
            (
                payload if attitude_of_payload else autopilot,
                mavlink.MAVLink_attitude_message(round(boot_s * 1e3), 0.0, 0.0, float(yaw), 0.0, 0.0, 0.0),
            ),
        ]
        arrived_us = 1_760_000_000_000_000 + number * 100_000 + 40_000
        for sender, message in told:
            data += struct.pack(">Q", arrived_us) + message.pack(sender)
    path.write_bytes(bytes(data))
    return path


@pytest.mark.parametrize(
    "gimbal_ms",
    [
        lambda boot_s: boot_s * 1e3,
        lambda boot_s: boot_s * 1e3 - 3_000,
        lambda boot_s: boot_s * 1e3 + 600_000,
        lambda boot_s: 1.76e12 + boot_s * 1e3,
        lambda boot_s: (boot_s - 55.0 if boot_s < 70.0 else boot_s - 69.0) * 1e3,
    ],
    ids=["the same", "started later", "started before", "time of day", "starts anew in flight"],
)
def test_a_gimbal_with_a_clock_of_its_own_turns_when_it_did(
    tmp_path: Path, gimbal_ms: Callable[[float], float]
) -> None:
    log = read_tlog(turning_flight(tmp_path / "a.tlog", gimbal_ms, attitude_of_payload=False))
    assert log.camera_ned is not None and len(log.time_s) > 190
    for time_s, row in zip(log.time_s, log.camera_ned, strict=True):
        off_deg = looks_towards_deg(row[None]) - 30.0 * time_s
        assert abs((off_deg + 180.0) % 360.0 - 180.0) < 1.0
    own_clock = gimbal_ms(60.0) != 60_000.0
    assert any("component 154 counts time on a clock of its own" in one for one in log.remarks) is own_clock


def test_attitudes_of_a_payload_are_not_those_of_the_drone(tmp_path: Path) -> None:
    log = read_tlog(turning_flight(tmp_path / "a.tlog", lambda s: s * 1e3, attitude_of_payload=True))
    assert log.body_ned is None
    assert any("200 ATTITUDE of component 154 are left out" in remark for remark in log.remarks)


@pytest.mark.parametrize("told", [True, False])
def test_a_mount_that_does_not_tell_its_yaw_from_north_looks_nowhere(tmp_path: Path, told: bool) -> None:
    """`yaw_absolute` is a later extension: who sends no such field sends 0, and looks east all the same."""
    arrived = []
    for number in range(10):
        boot_ms = 5000 + number * 100
        messages = (
            mavlink.MAVLink_global_position_int_message(
                boot_ms, 465000000, 80000000, 530000, 30000, 0, 0, 0, 0
            ),
            mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, np.pi / 2, 0.0, 0.0, 0.0),
            mavlink.MAVLink_mount_orientation_message(boot_ms, 0.0, -45.0, 0.0, 90.0 if told else 0.0),
        )
        arrived.append((1_700_000_000_000_000 + number * 100_000, messages))
    path = tmp_path / "flight.tlog"
    path.write_bytes(tlog(arrived))
    log = read_tlog(path)
    if told:
        assert log.camera_ned is not None and not log.remarks
        assert looks_towards_deg(log.camera_ned) == pytest.approx(90.0, abs=1e-3)
    else:
        assert log.camera_ned is None
        assert any("yaw_absolute is 0 in all 10 MOUNT_ORIENTATION" in remark for remark in log.remarks)


@pytest.mark.parametrize("every_s", [0.1, 1.0])
def test_a_turn_that_nobody_told_is_not_made_up(tmp_path: Path, every_s: float) -> None:
    """20 s of a gimbal that looks along the heading of a drone, which turns from north to east from 10.1 s to
    11.1 s. Its ATTITUDE comes every 0.1 s and is lost for 2 s around that, or comes every second."""
    arrived = []
    for number in range(200):
        time_s = number / 10
        boot_ms, yaw = 5000 + number * 100, np.radians(90.0) * np.clip(time_s - 10.1, 0.0, 1.0)
        messages = [
            mavlink.MAVLink_global_position_int_message(
                boot_ms, 465000000, 80000000, 530000, 30000, 0, 0, 0, 0
            ),
            mavlink.MAVLink_gimbal_device_attitude_status_message(
                0, 0, boot_ms, VEHICLE, [1.0, 0.0, 0.0, 1e-6], 0.0, 0.0, 0.0, 0
            ),
        ]
        lost = 9.15 < time_s < 11.15 if every_s < 1 else number % 10 > 0
        if not lost:
            messages.append(mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, float(yaw), 0.0, 0.0, 0.0))
        arrived.append((1_700_000_000_000_000 + number * 100_000, messages))
    path = tmp_path / "flight.tlog"
    path.write_bytes(tlog(arrived))
    log = read_tlog(path)
    assert log.camera_ned is not None
    told = np.isfinite(log.camera_ned).all(axis=1)
    seen_s, seen = log.time_s[told], log.camera_ned[told]
    if every_s < 1:
        assert len(seen) > 170 and not np.any((seen_s > 9.15) & (seen_s < 11.15)) and not log.remarks
        assert all(
            abs(looks_towards_deg(row[None]) - (0.0 if time_s < 10 else 90.0)) < 0.1
            for time_s, row in zip(seen_s, seen, strict=True)
        )
    else:  # the usual pause is bridged, and told: 60 / 8 degrees
        assert len(seen) > 180
        (said,) = log.remarks
        assert "come every 1.0 s" in said and "up to 8 degrees elsewhere" in said


def test_a_px4_log_of_a_locked_gimbal_in_the_vehicle_frame(tmp_path: Path) -> None:
    topics = {
        "vehicle_global_position": "double lat;double lon;float alt;",
        "vehicle_attitude": "float[4] q;",
        "gimbal_device_attitude_status": "float[4] q;uint16_t device_flags;",
    }
    bodies = [(b"F", f"{name}:uint64_t timestamp;{fields}".encode()) for name, fields in topics.items()]
    bodies += [(b"A", struct.pack("<BH", 0, number) + name.encode()) for number, name in enumerate(topics)]
    for number in range(10):
        stamp_us = number * 100_000
        bodies.append((b"D", struct.pack("<HQddf", 0, stamp_us, 46.5, 8.0, 530.0)))
        bodies.append((b"D", struct.pack("<HQ4f", 1, stamp_us, *EAST)))
        bodies.append((b"D", struct.pack("<HQ4fH", 2, stamp_us, *DOWN_45, LOCKED_TO_THE_VEHICLE)))
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    data += b"".join(struct.pack("<HB", len(body), kind[0]) + body for kind, body in bodies)
    (tmp_path / "a.ulg").write_bytes(data)
    camera = read_ulog(tmp_path / "a.ulg").camera_ned
    assert camera is not None and looks_towards_deg(camera) == pytest.approx(90, abs=1e-4)


@pytest.mark.parametrize(("yaw", "told"), [(0.0, True), (1e-4, False)])
def test_attitudes_of_a_drone_that_nobody_set_are_told_of(yaw: float, told: bool) -> None:
    """ATTITUDE of zeros: a camera that --mount hangs on the drone looked north in the whole flight."""
    places = [
        mavlink.MAVLink_global_position_int_message(
            1000 * n, 465_000_000, 80_000_000, 500_000, 20_000, 0, 0, 0, 0
        )
        for n in range(5)
    ]
    turns = [mavlink.MAVLink_attitude_message(1000 * n, 0.0, 0.0, yaw, 0.0, 0.0, 0.0) for n in range(5)]
    messages = dict.fromkeys(KINDS, ()) | {"GLOBAL_POSITION_INT": places, "ATTITUDE": turns}
    said = log_of_boots([Boot(messages, 0.0)], None, []).remarks
    assert [one.startswith("all 5 attitudes of the drone are level and due north") for one in said] == (
        [True] if told else []
    )
