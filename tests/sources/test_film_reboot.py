"""Telemetry logs that hold more than one start of an autopilot, or more than one drone."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from crowdfence.sources.film.tlog import read_tlog
from crowdfence.sources.rotation import from_yaw_pitch_roll_deg

BEGIN_S = 1_760_000_000
"""When the ground station hears the first position."""

Told = tuple[float, float, float]
"""Arrival, seconds after `BEGIN_S`; the autopilot's own clock, seconds; height above the sea, metres."""


def position(boot_s: float, height_m: float) -> mavlink.MAVLink_message:
    heights_mm = [round(height_m * 1e3), round((height_m - 500) * 1e3)]  # its home lies at 500 m
    place = [round(boot_s * 1e3), 465000000, 80000000, *heights_mm]
    return mavlink.MAVLink_global_position_int_message(*place, 0, 0, 0, 0)


def camera(boot_s: float, yaw_deg: float = 0.01) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_mount_orientation_message(round(boot_s * 1e3), 0.0, -90.0, 0.0, yaw_deg)


def record(arrived_s: float, message: mavlink.MAVLink_message, system: int = 1) -> bytes:
    sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    return struct.pack(">Q", round((BEGIN_S + arrived_s) * 1e6)) + bytes(message.pack(sender))


def log_of(path: Path, told: Sequence[Told]) -> Path:
    path.write_bytes(
        b"".join(
            record(arrived_s, message)
            for arrived_s, boot_s, height_m in told
            for message in (position(boot_s, height_m), camera(boot_s))
        )
    )
    return path


def ticks(count: int) -> list[float]:
    """Seconds, ten a second."""
    return [number / 10 for number in range(count)]


def test_a_boot_lies_where_it_arrived(tmp_path: Path) -> None:
    # 10 s on the bench at 500 m; the battery is changed; from 30 s on another clock that climbs 2 m/s.
    bench = [(t, 5 + t, 500.0) for t in ticks(100)]
    flight = [(30 + t, 5.03 + t, 500 + 2 * t) for t in ticks(200)]
    log = read_tlog(log_of(tmp_path / "a.tlog", [*bench, *flight]))
    assert log.start_ns == BEGIN_S * 10**9
    # The first row behind a pause is never used.
    assert np.allclose(log.time_s, [*ticks(100), *(30 + t for t in ticks(200)[1:])], atol=1e-3)
    assert np.allclose(log.heights_m["sea"][100:], [500 + 2 * t for t in ticks(200)[1:]], atol=1e-3)
    assert log.remarks == [
        "the autopilot started anew: the log holds 2 boots, each laid on the arrival of its first position "
        "(the later ones at 30.0 s); heights above the take-off count from each one's own"
    ]


def test_a_second_start_is_seen_when_the_first_was_short(tmp_path: Path) -> None:
    # The clock falls by 2 s only, from 7 s to 5 s, after a pause of 20 s.
    told = [(t, 5 + t, 500.0) for t in ticks(21)] + [(22 + t, 5 + t, 500.0) for t in ticks(21)]
    log = read_tlog(log_of(tmp_path / "a.tlog", told))
    assert np.allclose(log.time_s, [*ticks(21), *(22 + t for t in ticks(21)[1:])], atol=1e-3)


def test_a_packet_that_was_held_up_is_no_new_start(tmp_path: Path) -> None:
    # The same flight over two links, one of them by satellite, 3 s late.
    direct = [(t, 5 + t, 500.0) for t in ticks(100)]
    late = [(t + 3.02, 5 + t, 500.0) for t in ticks(60)]
    log = read_tlog(log_of(tmp_path / "a.tlog", sorted(direct + late)))
    assert np.allclose(log.time_s, ticks(100), atol=1e-3) and not log.remarks


def test_a_first_packet_that_was_held_up_does_not_lay_the_whole_log_late(tmp_path: Path) -> None:
    """Its link had only just come up, and kept it for 4 s: every picture of the flight got the pose of 4 s
    before, without a word."""
    told = [(max(t, 4.0) if t < 0.05 else t, 5 + t, 500.0) for t in ticks(100)]
    log = read_tlog(log_of(tmp_path / "a.tlog", told))
    assert log.start_ns == BEGIN_S * 10**9 and np.allclose(log.time_s, ticks(100), atol=1e-3)


@pytest.mark.parametrize("set_by_s", [600.0, -600.0, 0.0])
def test_a_clock_that_is_set_in_flight_is_told(tmp_path: Path, set_by_s: float) -> None:
    """The last 4 of 20 s are heard by another clock; the radio delays single packets by 4 s."""
    flight = [
        (t + (set_by_s if t >= 16 else 4.0 * (round(t * 10) % 10 == 7)), 5 + t, 500.0) for t in ticks(200)
    ]
    log = read_tlog(log_of(tmp_path / "a.tlog", flight))
    assert np.allclose(log.time_s, ticks(200), atol=1e-3)
    assert [one[:58] for one in log.remarks] == (
        ["the clock of who wrote the log was set by 600 s in flight: "[:58]] if set_by_s else []
    )


def test_a_new_start_that_nobody_can_place_is_left_out(tmp_path: Path) -> None:
    # The ground station's own clock is put back by 8 s while the battery is changed.
    told = [(t, 50 + t, 500.0) for t in ticks(100)] + [(2 + t, 5 + t, 600.0) for t in ticks(50)]
    log = read_tlog(log_of(tmp_path / "a.tlog", told))
    assert np.allclose(log.heights_m["sea"], 500) and len(log.time_s) == 100
    # 9.9 s is where the first boot ends.
    assert log.remarks == [
        "50 positions after a new start of the autopilot are left out: the clock of who wrote the log fell "
        "too, by 7.9 s"
    ]


def test_attitudes_of_another_system_are_never_those_of_the_drone(tmp_path: Path) -> None:
    """Not even when they come first: a second drone looks west while nobody has told a position."""
    data = b"".join(record(-1 + t, camera(4 + t, 270.0), system=2) for t in ticks(10))
    data += record(0, position(5, 500)) + record(0, camera(5, 90.0))
    data += b"".join(
        record(t, message, system)
        for t in ticks(20)[1:]
        for message, system in (
            (position(5 + t, 500), 1),
            (camera(5 + t, 90.0), 1),
            (camera(5 + t, 270.0), 2),
            (position(5 + t, 900), 2),
        )
    )
    (tmp_path / "a.tlog").write_bytes(data)
    log = read_tlog(tmp_path / "a.tlog")
    assert log.camera_ned is not None
    assert np.allclose(log.time_s, ticks(20), atol=1e-3) and np.allclose(log.heights_m["sea"], 500)
    east = from_yaw_pitch_roll_deg(90.0, -90.0, 0.0)
    assert np.allclose(np.abs(log.camera_ned @ east), 1.0)
    assert log.remarks == ["a.tlog holds the positions of several drones: system 1 is taken, not 2"]


def told(boot_s: float, longitude: int, height_m: float, above_home_m: float) -> list[Any]:
    place = [465000000, longitude, round(height_m * 1e3), round(above_home_m * 1e3)]
    at = mavlink.MAVLink_global_position_int_message(round(boot_s * 1e3), *place, 0, 0, 0, 0)
    return [at, camera(boot_s)]


def home(longitude: int, height_m: float) -> mavlink.MAVLink_message:
    place = [465000000, longitude, round(height_m * 1e3)]
    return mavlink.MAVLink_home_position_message(*place, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)


def test_a_home_that_moves_does_not_move_the_flight_before(tmp_path: Path) -> None:
    """An autopilot sets its home anew when it is armed again: after a landing 600 m further east, on ground
    40 m higher, its heights above the take-off begin at 0 there."""

    west, east = 80000000, 80078300  # 600 m at 46.5 degrees north
    flights = [home(west, 500.0), *(m for t in ticks(50) for m in told(5 + t, west, 530.0, 30.0))]
    flights += [home(east, 540.0), *(m for t in ticks(50) for m in told(10 + t, east, 560.0, 20.0))]
    path = tmp_path / "a.tlog"
    path.write_bytes(b"".join(record(number / 20, message) for number, message in enumerate(flights)))
    log = read_tlog(path)
    assert log.take_off == (46.5, east / 1e7)
    assert np.allclose(log.heights_m["take-off"][:50], -10.0)  # 30 m above the first home, 40 m below
    assert np.allclose(log.heights_m["take-off"][50:], 20.0)
    assert [one for one in log.remarks if "its home moved by 600 m" in one]

    again = [home(west, 500.0), *(m for t in ticks(50) for m in told(5 + t, west, 530.0, 30.0))]
    again += [home(west + 500, 503.0), *(m for t in ticks(50) for m in told(10 + t, west, 523.0, 20.0))]
    path.write_bytes(b"".join(record(number / 20, message) for number, message in enumerate(again)))
    log = read_tlog(path)  # the same place to some metres: every flight counts from its own
    assert np.allclose(log.heights_m["take-off"][:50], 30.0) and not log.remarks
    assert np.allclose(log.heights_m["take-off"][50:], 20.0)

    lost = mavlink.MAVLink_home_position_message(0, 0, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)  # before a fix
    told_late = [lost, *(one for one in flights if one.get_type() != "HOME_POSITION")]
    path.write_bytes(b"".join(record(number / 20, message) for number, message in enumerate(told_late)))
    assert read_tlog(path).take_off is None


@pytest.mark.parametrize("second_is_told", [True, False])
def test_a_home_that_is_set_anew_in_the_air_does_not_lower_the_flight(
    tmp_path: Path, second_is_told: bool
) -> None:
    """It hovers 50 m above the ground at 500 m; half-way its home is set 30 m above that ground, and from
    then on it says 20 m."""
    west = 80000000
    flight = [home(west, 500.0), *(m for t in ticks(50) for m in told(5 + t, west, 550.0, 50.0))]
    flight += [home(west, 530.0)] if second_is_told else []
    flight += [m for t in ticks(50) for m in told(10 + t, west, 550.0, 20.0)]
    path = tmp_path / "a.tlog"
    path.write_bytes(b"".join(record(number / 20, message) for number, message in enumerate(flight)))
    log = read_tlog(path)
    assert len(log.time_s) == 100 and np.allclose(log.heights_m["take-off"], 50.0)
    assert [one for one in log.remarks if "count from 500 to 530 m above the sea" in one]


def test_positions_without_a_fix_are_told(tmp_path: Path) -> None:
    """The autopilot goes on telling a position, which drifts. From 3 s on its receiver has none, from 5 s on
    its second one neither."""
    no_fix, fix = 1, 3
    nothing = [0] * 8
    records = []
    for t in ticks(100):
        first, second = (fix if t < 3 else no_fix), (fix if t < 5 else no_fix)
        receivers = [
            mavlink.MAVLink_gps_raw_int_message(0, first, *nothing),
            mavlink.MAVLink_gps2_raw_message(0, second, *nothing, 0, 0),
        ]
        records += [record(t, one) for one in (*receivers, position(5 + t, 500.0), camera(5 + t))]
        records.append(record(t, mavlink.MAVLink_gps_raw_int_message(0, no_fix, *nothing), system=2))
    path = tmp_path / "a.tlog"
    path.write_bytes(b"".join(records))
    (told,) = (remark for remark in read_tlog(path).remarks if "dead reckoning" in remark)
    assert told.startswith("50 of 100 positions are by dead reckoning")


def test_positions_nowhere_on_earth_do_not_cost_the_flight(tmp_path: Path) -> None:
    # 91 degrees north, and the largest number, which means that a longitude is not known: 2 of 100.
    wrong = {30: (910000000, 80000000), 31: (465000000, 2**31 - 1)}
    path = tmp_path / "a.tlog"
    path.write_bytes(
        b"".join(
            record(5 + t, message)
            for number, t in enumerate(ticks(100))
            for message in (
                mavlink.MAVLink_global_position_int_message(
                    round(t * 1e3), *wrong.get(number, (465000000, 80000000)), 500_000, 0, 0, 0, 0, 0
                ),
                camera(t),
            )
        )
    )
    log = read_tlog(path)
    assert np.allclose(log.latitude_deg, 46.5) and np.allclose(log.longitude_deg, 8.0)
    assert "2 of 100 positions are nowhere on Earth and left out" in log.remarks
