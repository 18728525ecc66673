"""Films with flight logs: DJI subtitles by hand, MAVLink by pymavlink, ULog by its specification."""

from __future__ import annotations

import gc
import re
import struct
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from crowdfence import Camera, Terrain, open_recording
from crowdfence.pipeline import read_map
from crowdfence.sources.camera_mount import CameraMount
from crowdfence.sources.convert import convert
from crowdfence.sources.film.flight_log import FlightLog
from crowdfence.sources.film.picture_reader import FilmPictures
from crowdfence.sources.film.subtitles import read_subtitles
from crowdfence.sources.film.tlog import read_tlog
from crowdfence.sources.film.ulog import read_ulog
from crowdfence.sources.geographic_track import HeightOptions, local_track
from crowdfence.sources.ground_contact import on_ground
from crowdfence.sources.mission.layout import OF_THE_SOURCE
from crowdfence.sources.recording import Recording
from support.flight_logs import tlog, ulog
from support.foreign_recordings import (
    Dialect,
    Row,
    beyond,
    closed,
    frames,
    ground,
    mini,
    mission,
    reference,
    rows,
    rtk,
    write_dem,
    write_film,
    write_subtitles,
    write_ulog,
)
from support.small_videos import (
    delayed,
    picture,
    side_by_side,
    turn,
    with_creation_time,
    write_grey_film,
    write_video,
)


def home() -> tuple[float, float]:
    return rows()[0].geodetic[:2]


def test_a_film_whose_subtitles_come_seldom_is_converted_whole(tmp_path: Path) -> None:
    """Twice a second: further apart than the poses of other recordings may be."""
    film, start_ns = write_film(tmp_path / "DJI_0001.MP4")
    write_subtitles(tmp_path / "DJI_0001.SRT", start_ns, every=25)
    seldom = open_recording(film, take_off=home())
    found = on_ground(seldom, read_map(seldom, write_dem(tmp_path / "dem.tif")).terrain)
    assert len(found.frames) > 5 and not found.refused
    convert(found, tmp_path / "a.mcap", map_inside=False)
    again = open_recording(tmp_path / "a.mcap")
    convert(again, tmp_path / "b.mcap", map_inside=False)
    for one in (again, open_recording(tmp_path / "b.mcap")):
        assert [frame.stamp_ns for frame in one.frames] == [frame.stamp_ns for frame in found.frames]
        assert not one.refused
        # What is doubtful about the film stays so: its focal length is an estimate.
        told = [warning.removeprefix(OF_THE_SOURCE) for warning in one.warnings]
        assert sorted(told) == sorted(found.warnings) and any("within about 10 %" in text for text in told)
        for was, frame in zip(found.frames, one.frames, strict=True):
            np.testing.assert_allclose(frame.world_from_camera, was.world_from_camera, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("name", "is_told"), [("DJI_20260101120000_0001_T", True), ("DJI_0001_W", False)])
def test_a_thermal_film_is_told_by_its_name(tmp_path: Path, name: str, is_told: bool) -> None:
    film, start_ns = write_film(tmp_path / f"{name}.MP4")
    write_subtitles(tmp_path / f"{name}.SRT", start_ns)
    told = [warning for warning in open_recording(film, take_off=home()).warnings if "thermal" in warning]
    assert len(told) == is_told


def test_a_film_of_two_lenses_tells_that_one_is_left_out(tmp_path: Path) -> None:
    film, start_ns = write_film(tmp_path / "one.mp4")
    both = side_by_side([film, film], tmp_path / "DJI_0001.MP4")
    write_subtitles(tmp_path / "DJI_0001.SRT", start_ns)
    told = [one for one in open_recording(both, take_off=home()).warnings if "holds 2 films" in one]
    assert len(told) == 1 and "only the first is looked at" in told[0]


@pytest.mark.parametrize("dialect", [mini, rtk])
def test_a_film_with_subtitles_gives_the_zones_of_the_mission(tmp_path: Path, dialect: Dialect) -> None:
    film, start_ns = write_film(tmp_path / "DJI_0001.MP4")
    write_subtitles(tmp_path / "DJI_0001.SRT", start_ns, dialect)
    dem = write_dem(tmp_path / "dem.tif")
    options = {} if dialect is mini else {"calibration": frames()[0].camera}
    found = open_recording(film, frames_per_s=np.inf, take_off=home(), **options)
    with pytest.raises(ValueError, match="count from the ground .* --terrain"):
        convert(found, tmp_path / "early.mcap")
    terrain = read_map(found, dem).terrain
    settled = on_ground(found, terrain)
    assert "put on the map's ground" in settled.warnings[-1] and not settled.ground_contacts
    anchor, local = mission().georeference, settled.georeference
    assert anchor is not None and local is not None
    # The film begins with a black frame half a second before the first picture.
    assert len(settled.frames) == len(frames()) + 1
    for ours, theirs in zip(settled.frames[1:], frames(), strict=True):
        since_first = theirs.stamp_ns - frames()[0].stamp_ns
        assert abs(ours.stamp_ns - settled.frames[1].stamp_ns - since_first) < 2e6
        at = anchor.local_from_geodetic(*local.geodetic_from_local(ours.world_from_camera[None, :3, 3]))[0]
        # Six digits of a degree are 0.11 m, the map is of a metre, the ground at the start slopes.
        assert np.linalg.norm(at[:2] - theirs.world_from_camera[:2, 3]) < 0.2
        assert abs(at[2] - theirs.world_from_camera[2, 3]) < 0.5
        # Tenths of a degree in three angles.
        turned = ours.world_from_camera[:3, :3].T @ theirs.world_from_camera[:3, :3]
        assert np.degrees(np.arccos((np.trace(turned) - 1) / 2)) < 0.2
        assert ours.camera.fx == pytest.approx(theirs.camera.fx, rel=1e-3)
        picture = ours.image().astype(float)
        assert np.abs(picture - theirs.image()).mean() < 6
    if dialect is mini:
        pictures = replace(settled, frames=settled.frames[1:])
        zones, expected = closed(pictures, terrain), closed(reference())
        assert beyond(zones, expected, 1.0) < 0.05


def test_a_film_with_poses_that_is_stored_turned_is_refused(tmp_path: Path) -> None:
    """Whether the logged attitude means the stored frames or the shown ones, nobody can know."""
    film, start_ns = write_film(tmp_path / "DJI_0001.MP4")
    write_subtitles(tmp_path / "DJI_0001.SRT", start_ns, mini)
    for clockwise_deg in (90, 180, 270):
        turn(film, clockwise_deg)
        with pytest.raises(ValueError, match=r"DJI_0001.MP4 is stored turned .*without the flag") as error:
            open_recording(film)
        assert f"says {clockwise_deg} degrees clockwise" in str(error.value)
    turn(film, 0, mirrored=True)
    with pytest.raises(ValueError, match=r"DJI_0001.MP4 is shown upside down from how it is stored"):
        open_recording(film)


def test_pixels_of_a_film_that_are_not_square_need_a_calibration_of_them(tmp_path: Path) -> None:
    """4:3: fy is 4/3 of fx, and the one focal length that subtitles tell is neither."""
    film, start_ns = write_film(tmp_path / "DJI_0001.MP4", pixel_aspect="4:3")
    write_subtitles(tmp_path / "DJI_0001.SRT", start_ns, mini)
    with pytest.raises(ValueError, match=r"DJI_0001.MP4 has pixels 1.333 times as wide as high.*--calibrat"):
        open_recording(film)
    width, height = FilmPictures(film).size
    for fy, told in ((400.0, False), (300.0, True)):
        calibration = Camera.pinhole(width, height, 300.0, fy, width / 2, height / 2)
        found = open_recording(film, calibration=calibration)
        assert found.frames[0].camera.fy == fy
        assert any("people look squeezed" in warning for warning in found.warnings)
        assert any("fy / fx is 1.000" in warning for warning in found.warnings) == told
    # Rounding to whole pixels, as scaling by ffmpeg leaves it, is no squeezing.
    film, start_ns = write_film(tmp_path / "DJI_0002.MP4", pixel_aspect="240:241")
    write_subtitles(tmp_path / "DJI_0002.SRT", start_ns, mini)
    assert not any("pixels" in warning for warning in open_recording(film).warnings)


@pytest.mark.parametrize(
    ("after_s", "told"),
    [
        (0.3, None),
        (1.5, "go on for 1.5 s after the film has ended: if its beginning was cut off"),
        (-0.3, None),
        (-1.5, "end 1.5 s before the film: if that was slowed down"),
    ],
)
def test_a_film_that_is_not_as_long_as_its_subtitles_is_told(
    tmp_path: Path, after_s: float, told: str | None
) -> None:
    """They are those of the whole film as it was filmed, and nothing else says what became of it."""
    film, start_ns = write_film(tmp_path / "DJI_0001.MP4")
    of_film = write_subtitles(tmp_path / "DJI_0001.SRT", start_ns, mini)
    blocks = of_film.read_text(encoding="utf-8-sig").split("\n\n")
    end_s = FilmPictures(film).times_s[-1] + after_s
    times = [one for one in blocks if one.strip() and begin_s(one) < end_s]
    last = re.sub(r"00:00:\S+ -->", f"00:00:{end_s:06.3f} -->", times[-1])
    of_film.write_text("\n\n".join([*times, last]) + "\n\n")
    said = [one for one in open_recording(film).warnings if "of another moment" in one]
    assert len(said) == (told is not None) and all(told is not None and told in one for one in said)
    known = open_recording(film, clock_offset_s=0.5)
    assert not [one for one in known.warnings if "of another moment" in one]


def test_a_film_that_lost_its_end_says_so(tmp_path: Path) -> None:
    """As on a card that was pulled out; where a log goes on for hours, nothing else tells it."""
    film, start_ns = write_film(tmp_path / "a.mkv")
    write_subtitles(tmp_path / "a.srt", start_ns, mini)
    assert not any("declares" in warning for warning in open_recording(film).warnings)
    film.write_bytes(film.read_bytes()[: film.stat().st_size // 2])
    found = open_recording(film)
    (said,) = (warning for warning in found.warnings if "declares" in warning)
    end_s = FilmPictures(film).times_s[-1]
    assert f"a: the file ends at {end_s:.3f} s, although it declares 5." in said
    assert not any("of another moment" in warning for warning in found.warnings)  # why is known


def begin_s(block: str) -> float:
    arrow = re.search(r"00:00:(\d\d)[,.](\d{3}) -->", block)
    assert arrow is not None
    return int(arrow[1]) + int(arrow[2]) / 1000


@pytest.mark.parametrize(("speed", "told"), [(1.0, False), (0.25, True), (10.0, True)])
def test_slow_motion_is_told_by_its_time_of_day(tmp_path: Path, speed: float, told: bool) -> None:
    blocks = [
        f"{n}\n00:00:{n:02},000 --> 00:00:{n:02},500\n2026-01-01 12:{int(n * speed) // 60:02}:"
        f"{int(n * speed) % 60:02}\nGPS(46.500000,8.000000,0.0M) BAROMETER:30.0M\n"
        for n in range(40)
    ]
    path = tmp_path / "a.SRT"
    path.write_text("\n".join(blocks))
    remarks = [one for one in read_subtitles(path).remarks if "times as fast as the film" in one]
    assert bool(remarks) == told


def test_frames_can_be_asked_for_in_any_order(tmp_path: Path) -> None:
    film, start_ns = write_film(tmp_path / "a.mp4")
    write_subtitles(tmp_path / "a.srt", start_ns, mini)
    found = open_recording(film, frames_per_s=np.inf).frames
    forwards = [frame.encoded_image() for frame in found]
    assert [frame.encoded_image() for frame in reversed(found)] == forwards[::-1]
    assert len(open_recording(film, frames_per_s=0.5).frames) == 3  # 5.5 s: at 0, then 2 s apart at least


def test_frames_that_are_coded_out_of_order_are_found_too(tmp_path: Path) -> None:
    film = FilmPictures(write_grey_film(tmp_path / "a.mp4", "mpeg4", 10, frames=40))
    assert np.allclose(film.times_s, np.arange(40) / 10)
    for number in (0, 1, 2, 17, 16, 39, 30, 31, 5):
        pixels = np.frombuffer(film.ppm(number), np.uint8)[-64 * 48 * 3 :]
        assert abs(pixels.mean() - 6 * number) < 3


def test_frames_that_a_film_hides_are_none(tmp_path: Path) -> None:
    """The beginning was cut off at 0.3 s, between key frames: frames 0 to 2 are there to decode others."""
    film = FilmPictures(delayed(write_video(tmp_path / "a.mp4", 12), tmp_path / "cut.mp4", -0.3))
    assert film.times_s == pytest.approx([0.1 * number for number in range(9)])
    for number in (0, 1, 2, 8, 4, 0):
        pixels = np.frombuffer(film.ppm(number), np.uint8)[-64 * 48 * 3 :].reshape(48, 64, 3)
        assert np.abs(pixels.astype(int) - picture(number + 3)).mean() < 8


def test_the_first_frames_of_a_transport_stream_are_found(tmp_path: Path) -> None:
    """As a recorded video link writes it; seeking passes its first key frame."""
    film = FilmPictures(write_grey_film(tmp_path / "a.ts", "mpeg2video", 25, frames=40))
    for number in (0, 1, 5, 11, 12, 39, 3):
        pixels = np.frombuffer(film.ppm(number), np.uint8)[-64 * 48 * 3 :]
        assert abs(pixels.mean() - 6 * number) < 4


def test_two_films_are_a_fleet_and_the_command_takes_them(tmp_path: Path) -> None:
    films = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        film, start_ns = write_film(tmp_path / name / "DJI_0001.MP4")
        write_subtitles(tmp_path / name / "DJI_0001.SRT", start_ns, mini)
        films.append(film)
    fleet = open_recording(films)
    assert fleet.drones == ("a_DJI_0001", "b_DJI_0001")
    assert set(fleet.ground_contacts) == set(fleet.drones)
    a, b = (fleet.frames_of(drone) for drone in fleet.drones)
    assert np.allclose([f.world_from_camera for f in a], [f.world_from_camera for f in b])
    assert all(len(instant.frames) == 2 for instant in fleet.instants())


def test_films_are_not_laid_on_the_subtitles_of_one_nor_on_one_moment_of_a_log(tmp_path: Path) -> None:
    """As of a flight that its camera split: the second was placed where the first was taken."""
    films = []
    for name in ("DJI_0001", "DJI_0002"):
        film, start_ns = write_film(tmp_path / f"{name}.MP4")
        of_film = write_subtitles(tmp_path / f"{name}.SRT", start_ns, mini)
        films.append(film)
    with pytest.raises(ValueError, match=r"DJI_0002.SRT is of one film, and 2 are named: each takes the"):
        open_recording(films, telemetry=of_film)
    log, zero_ns = write_ulog(tmp_path / "flight.ulg")
    options = {"telemetry": log, "calibration": frames()[0].camera}
    with pytest.raises(
        ValueError, match=r"of 2 films in one log, --clock-offset says when one began.*ffmpeg"
    ):
        open_recording(films, clock_offset_s=(start_ns - zero_ns) / 1e9, **options)


# --- logs that run on a clock of their own ---


def write_tlog(path: Path) -> tuple[Path, int]:
    """A MAVLink log by pymavlink: (path, stamp of its first position); heights above sea and start."""
    flown = rows()
    start = flown[0].position[2]
    told = []
    for row in flown:
        boot_ms = 60_000 + (row.stamp_ns - flown[0].stamp_ns) // 1_000_000
        latitude, longitude, height = row.geodetic
        yaw, pitch, roll = row.yaw_pitch_roll_deg
        above = row.position[2] - start
        place = [
            round(latitude * 1e7),
            round(longitude * 1e7),
            round(height * 1e3 - 48_000),
            round(above * 1e3),
        ]
        messages = [
            mavlink.MAVLink_global_position_int_message(boot_ms, *place, 0, 0, 0, 65535),
            mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, np.radians(yaw), 0.0, 0.0, 0.0),
            mavlink.MAVLink_mount_orientation_message(boot_ms, roll, pitch, 0.0, yaw),
        ]
        told.append((row.stamp_ns // 1000, messages))
    path.write_bytes(tlog(told))
    return path, flown[0].stamp_ns


@pytest.mark.parametrize("kind", ["ulg", "tlog"])
def test_a_film_with_the_log_of_an_autopilot(tmp_path: Path, kind: str) -> None:
    film, start_ns = write_film(tmp_path / "flight.mp4")
    _, zero_ns = (write_ulog if kind == "ulg" else write_tlog)(tmp_path / f"flight.{kind}")
    camera = frames()[0].camera
    with pytest.raises(
        ValueError, match="does not know when the film began, and its motion cannot tell: .*--clock-offset"
    ):
        open_recording(film, calibration=camera)
    options = {"calibration": camera, "frames_per_s": np.inf}
    if kind == "tlog":
        options |= {"heights": "sea", "geoid_m": 48.0}
    found = open_recording(film, clock_offset_s=(start_ns - zero_ns) / 1e9, **options)
    anchor, local = mission().georeference, found.georeference
    assert anchor is not None and local is not None and not found.refused
    for ours, theirs in zip(found.frames[1:], frames(), strict=True):
        assert abs(ours.stamp_ns - theirs.stamp_ns) < 2e6
        at = anchor.local_from_geodetic(*local.geodetic_from_local(ours.world_from_camera[None, :3, 3]))[0]
        # Positions of 10 Hz, laid on attitudes of 50 Hz; MAVLink rounds to 1e-7 degrees and ms.
        assert np.linalg.norm(at - theirs.world_from_camera[:3, 3]) < 0.1
        turned = ours.world_from_camera[:3, :3].T @ theirs.world_from_camera[:3, :3]
        assert np.degrees(np.arccos(min((np.trace(turned) - 1) / 2, 1))) < 0.1
    assert (
        beyond(closed(replace(found, frames=found.frames[1:]), ground_under(found)), closed(reference()), 1.0)
        < 0.05
    )


def turning_flight(folder: Path, swing_deg: float) -> tuple[Path, float]:
    """12 s of film of a wall of noise by a camera that yaws and pitches, 3.4 s into a ULog of 20 s: (film,
    when it begins on the log's clock)."""
    begin_s, focal_px, zero_us = 3.4, 200.0, 0

    def angles(t: float) -> tuple[float, float]:
        return swing_deg * np.sin(0.9 * t + np.sin(0.37 * t)), swing_deg / 3 * np.sin(1.7 * t + 1)

    wall = np.kron(np.random.default_rng(17).integers(0, 255, (60, 80)), np.ones((8, 8))).astype(np.uint8)
    film = folder / "turning.mp4"
    with av.open(str(film), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = 160, 120, "yuv420p", 4_000_000
        for number in range(120):
            yaw, pitch = np.radians(angles(begin_s + number / 10))
            # The view wanders right and up over the wall.
            x, y = round(240 + focal_px * yaw), round(180 - focal_px * pitch)
            grey = np.repeat(wall[y : y + 120, x : x + 160, None], 3, axis=2)
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(grey), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    topics = {
        "vehicle_global_position": "double lat;double lon;float alt;",
        "gimbal_device_attitude_status": "float[4] q;uint16_t device_flags;",
    }
    records = []
    for number in range(1000):
        stamp_us = number * 20_000
        yaw, pitch = angles(stamp_us / 1e6)
        w, x, y, z = Rotation.from_euler("ZYX", [yaw, pitch, 0], degrees=True).as_quat()[[3, 0, 1, 2]]
        records.append(struct.pack("<HQ4fH", 1, stamp_us, w, x, y, z, 16))
        if number % 10 == 0:
            records.append(struct.pack("<HQddf", 0, stamp_us, 46.5, 8.0, 30.0))
    (folder / "turning.ulg").write_bytes(ulog(zero_us, topics, records))
    return film, begin_s


def test_the_beginning_of_a_film_is_found_by_how_it_turns(tmp_path: Path) -> None:
    film, begin_s = turning_flight(tmp_path, 20.0)
    camera = Camera.pinhole(160, 120, 200.0, 200.0, 80.0, 60.0)
    found = open_recording(film, calibration=camera, geoid_m=0.0)
    said = re.search(r"begins ([\d.]+) s after the log, give or take ([\d.]+) s", " ".join(found.warnings))
    assert said is not None
    offset_s, error_s = map(float, said.groups())
    assert abs(offset_s - begin_s) <= error_s <= 0.1


@pytest.mark.parametrize("created", [None, "2026-05-04T10:00:00.000000Z"])
def test_films_of_logs_without_a_time_of_day_begin_together(tmp_path: Path, created: str | None) -> None:
    """Their logs began 2 and 5 s before them (--clock-offset): the first frames are of one moment, that of
    creation_time where they tell one."""
    starts = []
    for name, offset_s in (("a", 2.0), ("b", 5.0)):
        (tmp_path / name).mkdir()
        film, _ = turning_flight(tmp_path / name, 20.0)
        if created is not None:
            film = with_creation_time(film, film.with_name("told.mp4"), created)
        options = {"calibration": Camera.pinhole(160, 120, 200.0, 200.0, 80.0, 60.0), "geoid_m": 0.0}
        found = open_recording(
            film, telemetry=film.parent / "turning.ulg", clock_offset_s=offset_s, **options
        )
        assert not found.refused and min(track.stamps_ns[0] for track in found.tracks().values()) >= 0
        starts.append(found.frames[0].stamp_ns)
    assert abs(starts[0] - starts[1]) < 1_000_000
    if created is not None:
        assert abs(starts[0] - 1_777_888_800_000_000_000) < 1_000_000  # date -u -d "2026-05-04 10:00" +%s


def test_a_film_that_hardly_turns_is_not_guessed(tmp_path: Path) -> None:
    film, _ = turning_flight(tmp_path, 0.2)
    camera = Camera.pinhole(160, 120, 200.0, 200.0, 80.0, 60.0)
    with pytest.raises(ValueError, match=r"its motion cannot tell: the camera turns by 0.\d deg/s only"):
        open_recording(film, calibration=camera, geoid_m=0.0)


def ground_under(found: Recording) -> Terrain:
    """The mission's map in the frame of another recording: the anchors' planes are parallel within
    0.01 degrees here, so it is moved."""
    anchor, local = mission().georeference, found.georeference
    assert anchor is not None and local is not None
    offset = local.local_from_geodetic(anchor.latitude_deg, anchor.longitude_deg, anchor.height_m)[0]
    return ground(offset)


def test_a_log_without_a_gimbal_needs_a_mount(tmp_path: Path) -> None:
    film, start_ns = write_film(tmp_path / "flight.mp4")
    _, zero_ns = write_ulog(tmp_path / "flight.ulg", gimbal=False)
    options = {"calibration": frames()[0].camera, "clock_offset_s": (start_ns - zero_ns) / 1e9}
    with pytest.raises(
        ValueError, match=r"attitude of the camera is not logged \(the drone's is there\).*--mount"
    ):
        open_recording(film, **options)
    level = open_recording(film, mount="level:-60", **options).frames[1].world_from_camera[:3, 2]
    assert level[2] == pytest.approx(-np.sin(np.radians(60)), abs=1e-6)
    fixed = open_recording(film, mount="body:-60", **options).frames[1].world_from_camera[:3, 2]
    assert fixed[2] != pytest.approx(-np.sin(np.radians(60)), abs=1e-3)  # the body pitches by 3 degrees


def test_the_time_of_day_is_known_from_the_first_fix_on(tmp_path: Path) -> None:
    """Two thirds of the log were flown before, when the receiver counted from 1970."""
    rows_of_it = len(rows())
    path, zero_ns = write_ulog(tmp_path / "late.ulg", first_fix=rows_of_it * 2 // 3)
    assert read_ulog(path).start_ns == zero_ns // 1000 * 1000
    path, _ = write_ulog(tmp_path / "never.ulg", first_fix=rows_of_it)
    assert read_ulog(path).start_ns is None


def test_a_mount_that_overrules_the_angles_of_subtitles_is_told(tmp_path: Path) -> None:
    block = "{0}\n00:00:0{0},000 --> 00:00:0{0},500\n[latitude: 46.5] [longitude: 8.0] [rel_alt: 9.0] "
    angles = "[gb_yaw: 90.0 gb_pitch: -45.0 gb_roll: 0.0]\n\n"
    log = read_subtitles(srt(tmp_path, "".join(block.format(n) + angles for n in (1, 2, 3))))
    assert "45 degrees from that" in log.overruled(CameraMount.parse("north:-90,90"))
    assert not log.overruled(CameraMount.parse("north:-45,90")) and not log.overruled(None)


@pytest.mark.parametrize("apart_m", [0.0, 48.0])
def test_one_height_told_for_two_is_told(tmp_path: Path, apart_m: float) -> None:
    """Of a receiver without a geoid PX4 logs its height above the sea twice, and it was taken as above the
    ellipsoid without a word: 48 m too low in the Alps."""
    topics = {
        "vehicle_global_position": "double lat;double lon;float alt;float alt_ellipsoid;",
        "vehicle_attitude": "float[4] q;",
    }
    records = []
    for number in range(20):
        at = number * 100_000
        records.append(struct.pack("<HQddff", 0, at, 46.5, 8.0, 500.0, 500.0 + apart_m))
        records.append(struct.pack("<HQ4f", 1, at, 1.0, 0.0, 0.0, 0.0))
    path = tmp_path / "a.ulg"
    path.write_bytes(ulog(0, topics, records))
    told = [remark for remark in read_ulog(path).remarks if "say --heights sea" in remark]
    assert bool(told) == (apart_m == 0.0)


def test_positions_that_px4_does_not_believe_in_are_left_out(tmp_path: Path) -> None:
    """10 s at 10 Hz: not valid up to 2 s, as before a first fix; from 8 s on by dead reckoning."""
    topics = {
        "vehicle_global_position": "double lat;double lon;float alt;bool lat_lon_valid;bool alt_valid;"
        "bool dead_reckoning;",
        "vehicle_attitude": "float[4] q;",
    }
    records = []
    for number in range(100):
        at = number * 100_000
        valid, adrift = number >= 20, number >= 80
        latitude = 46.5 if valid else 46.6  # 11 km north
        told = struct.pack("<HQddf???", 0, at, latitude, 8.0, 500.0, valid, True, adrift)
        records += [told, struct.pack("<HQ4f", 1, at, 1.0, 0.0, 0.0, 1e-4)]
    path = tmp_path / "a.ulg"
    path.write_bytes(ulog(0, topics, records))
    log = read_ulog(path)
    assert log.time_s[0] == pytest.approx(2.0) and np.allclose(log.latitude_deg, 46.5)
    assert log.remarks == [
        "20 of 100 positions are left out: the log calls them not valid",
        "20 of 100 positions are by dead reckoning, without satellites: they drift, and what was seen then "
        "may be put elsewhere",
    ]


@pytest.mark.parametrize("kind", ["ulg", "tlog"])
def test_a_log_that_was_read_is_closed(tmp_path: Path, kind: str) -> None:
    path, _ = (write_ulog if kind == "ulg" else write_tlog)(tmp_path / f"flight.{kind}")
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResourceWarning)
        (read_ulog if kind == "ulg" else read_tlog)(path)
        gc.collect()
    assert path not in {Path(one).resolve() for one in Path("/proc/self/fd").iterdir()}


@pytest.mark.parametrize("kind", ["ulg", "tlog"])
def test_damaged_logs_are_one_line(tmp_path: Path, kind: str) -> None:
    path, _ = (write_ulog if kind == "ulg" else write_tlog)(tmp_path / f"x.{kind}")
    read: Callable[[Path], FlightLog] = read_ulog if kind == "ulg" else read_tlog
    whole = path.read_bytes()[:20_000]
    random = np.random.default_rng(17)
    refused = 0
    for number in range(16):
        damaged = bytearray(whole[: int(random.integers(len(whole)))] if number % 2 else whole)
        for at in random.integers(max(len(damaged), 1), size=10) if number % 3 else []:
            damaged[at : at + 1] = bytes([int(random.integers(256))])
        path.write_bytes(bytes(damaged))
        try:
            assert len(read(path).time_s)
        except ValueError as error:
            assert str(error) and "\n" not in str(error)
            refused += 1
    path.write_bytes(b"")
    with pytest.raises(ValueError, match="is no ULog|holds no positions"):
        read(path)


# --- dialects ---


def srt(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "x.SRT"
    path.write_bytes(text.encode())
    return path


def test_angles_that_are_0_throughout_say_nothing(tmp_path: Path) -> None:
    """A camera may look north along the ground for a moment, but not all the time to its last digit."""

    def block(number: int, yaw: float) -> str:
        return (
            f"{number}\n00:00:{number:02},000 --> 00:00:{number:02},033\n[latitude: 46.5] [longitude: 8.0] "
            f"[rel_alt: 30.0 abs_alt: 530.0] [gb_yaw: {yaw} gb_pitch: 0.0 gb_roll: 0.0]\n\n"
        )

    assert read_subtitles(srt(tmp_path, "".join(block(n, 0.0) for n in range(9)))).camera_ned is None
    moving = read_subtitles(srt(tmp_path, "".join(block(n, n / 10) for n in range(9)))).camera_ned
    assert moving is not None and np.allclose(moving[0], [1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(("every", "used"), [(1, False), (40, True)])
def test_angles_beyond_any_are_in_another_unit(tmp_path: Path, every: int, used: bool) -> None:
    """In tenths of degrees 45 down is -450; a block that is damaged may say anything."""

    def block(number: int) -> str:
        pitch = -450.0 if number % every == 0 else -45.0
        return (
            f"{number}\n00:00:{number:02},000 --> 00:00:{number:02},033\n[latitude: 46.5] [longitude: 8.0] "
            f"[rel_alt: 30.0 abs_alt: 530.0] [gb_yaw: 90.0 gb_pitch: {pitch} gb_roll: 0.0]\n\n"
        )

    log = read_subtitles(srt(tmp_path, "".join(block(n) for n in range(1, 60))))
    if used:
        assert np.flatnonzero(np.isnan(log.attitudes(None)).any(axis=1)).tolist() == [39]
        return
    with pytest.raises(
        ValueError, match=r"logged in another unit than degrees \(yaw, pitch, roll 90, -450, 0\)"
    ):
        log.attitudes(None)
    assert len(log.attitudes(CameraMount.parse("north:-90"))) == 59


def test_a_home_that_is_not_set_is_none(tmp_path: Path) -> None:
    """It is written as 0, 0, in the Gulf of Guinea, and heights would count from its ground."""
    block = "{0}\n00:00:0{0},000 --> 00:00:0{0},900\nHOME({1}) \nGPS(8.001,46.501,19) BAROMETER:20.1\n\n"
    log = read_subtitles(srt(tmp_path, block.format(1, "0.0,0.0") + block.format(2, "8.0,46.5")))
    assert log.take_off == (46.5, 8.0)
    assert read_subtitles(srt(tmp_path, block.format(1, "0.0,0.0"))).take_off is None


def test_heights_above_the_sea_are_doubted_also_where_there_are_no_others(tmp_path: Path) -> None:
    def sea(number: int, time_s: float, row: Row, place: tuple[float, float, float]) -> str:
        return re.sub(r"rel_alt: \S+ ", "", mini(number, time_s, row, place))

    film, start_ns = write_film(tmp_path / "a.mp4")
    write_subtitles(tmp_path / "a.srt", start_ns, sea)
    found = open_recording(film, geoid_m=48.0)
    assert any("heights are those above the sea" in warning for warning in found.warnings)
    assert any("air pressure" in warning for warning in found.warnings)


def test_numbers_with_a_decimal_comma_are_none(tmp_path: Path) -> None:
    """Cut at the comma, a place would be up to 100 km off, a height up to a metre."""
    block = (
        "1\n00:00:01,000 --> 00:00:02,000\n[latitude: 46{0}5] [longitude: 8.25] "
        "[rel_alt: 27{0}9 abs_alt: 530.0] [dzoom_ratio: 10000, delta:0]\n\n"
    )
    log = read_subtitles(srt(tmp_path, block.format(".")))
    assert (log.latitude_deg[0], log.heights_m["take-off"][0]) == (46.5, 27.9)
    with pytest.raises(ValueError, match="holds no position"):
        read_subtitles(srt(tmp_path, block.format(",")))


def test_matrice_writes_latitude_first_and_no_attitude(tmp_path: Path) -> None:
    text = (
        "1\n00:00:00,000 --> 00:00:01,000\n2022.06.21 16:06:17\nGPS(36.6146,-6.1120,0.0M) BAROMETER:0.3M\n\n"
    )
    text = text.replace("\n", "\r\n")
    log = read_subtitles(srt(tmp_path, text))
    assert (log.latitude_deg[0], log.longitude_deg[0], log.heights_m["take-off"][0]) == (36.6146, -6.112, 0.3)
    assert log.start_ns == 1655827577 * 10**9  # 2022-06-21 16:06:17 UTC
    assert any("steps of 11.1 m" in remark for remark in log.remarks)
    with pytest.raises(ValueError, match=r"a guess would put crowds anywhere: .*--mount"):
        log.attitudes(None)


def test_positions_with_corrections_are_positions(tmp_path: Path) -> None:
    """A Phantom 4 RTK calls them RTK, while it has corrections, and GPS again when it has lost them."""
    block = (
        "{0}\n00:00:0{0},000 --> 00:00:0{0},900\nF/6.3, SS 60, ISO 100, EV 0, "
        "{1} (120.083799, 30.213635, 28), HOME (120.084146, 30.214243, 103.55m), D 75.36m, H 76.19m, "
        "H.S 0.30m/s, V.S 0.00m/s, F.PRY (-5.3°, 2.1°, 28.3°), G.PRY (-40.0°, 0.0°, 28.2°)\n\n"
    )
    log = read_subtitles(srt(tmp_path, block.format(1, "GPS") + block.format(2, "RTK")))
    assert log.latitude_deg.tolist() == [30.213635] * 2 and log.longitude_deg.tolist() == [120.083799] * 2
    assert log.heights_m["take-off"].tolist() == [76.19] * 2 and log.take_off == (30.214243, 120.084146)


def test_an_older_mavic_writes_longitude_first(tmp_path: Path) -> None:
    text = (
        "1\n00:00:01,000 --> 00:00:02,000\nHOME(-58.4563,-34.7386) 2017.07.03 10:15:03\n"
        "GPS(-58.4563,-34.7383,19) BAROMETER:20.1\nISO:100\n\n"
    )
    log = read_subtitles(srt(tmp_path, text + "2\n00:00:02,000 --> 00:00:03,000\nHOME(-58.45"))
    assert (log.latitude_deg[0], log.longitude_deg[0]) == (-34.7383, -58.4563)
    assert log.take_off == (-34.7386, -58.4563) and log.heights_m["take-off"][0] == 20.1
    assert any("1 of 2 blocks have no time or no position" in remark for remark in log.remarks)


@pytest.mark.parametrize(("take_off", "told"), [((46.5, 8.0), False), ((46.5, 8.01), True), (None, False)])
def test_a_stated_take_off_far_from_the_recorded_home_is_told(
    tmp_path: Path, take_off: tuple[float, float] | None, told: bool
) -> None:
    """Of a fleet it would be that of all drones, whose grounds may lie otherwise."""
    block = "1\n00:00:01,000 --> 00:00:02,000\nHOME(8.0,46.5) \nGPS(8.001,46.501,19) BAROMETER:20.1\n\n"
    poses = read_subtitles(srt(tmp_path, block)).poses(CameraMount.parse("north:-90"))
    remarks = local_track(poses, HeightOptions(take_off=take_off), None).remarks
    # 0.01 degrees of longitude are 111.3 km * cos(46.5) / 100 = 767 m.
    said = [one for one in remarks if "the stated take-off lies" in one]
    assert len(said) == told and all("76" in one for one in said)


@pytest.mark.parametrize(
    ("height_m", "take_off", "told"),
    [(1.2, (46.5, 8.01), True), (1.2, (46.5, 8.0), False), (40.0, (46.5, 8.01), False)],
)
def test_a_stated_take_off_far_from_where_the_drone_stood_is_told(
    tmp_path: Path, height_m: float, take_off: tuple[float, float], told: bool
) -> None:
    """The one of another drone of the fleet: the ground there was taken for this one's."""
    told_by_it = f"[latitude: 46.500000] [longitude: 8.000000] [rel_alt: {height_m}]"
    block = f"1\n00:00:01,000 --> 00:00:02,000\n{told_by_it}\n\n"
    poses = read_subtitles(srt(tmp_path, block)).poses(CameraMount.parse("north:-90"))
    remarks = local_track(poses, HeightOptions(take_off=take_off), None).remarks
    said = [one for one in remarks if "the stated take-off lies" in one]
    assert len(said) == told and all(
        "from the first position, 1.2 m above the take-off" in one for one in said
    )


@pytest.mark.parametrize(
    ("longitude", "lowest_m", "told"), [(8.0001, -38.4, True), (8.0001, -4.0, False), (8.001, -38.4, False)]
)
def test_a_home_that_was_set_in_the_air_is_told(
    tmp_path: Path, longitude: float, lowest_m: float, told: bool
) -> None:
    """Heights counted from there, and were taken for those above the ground below it. 0.0001 degrees of
    longitude are 7.7 m here; far from its home a drone may fly down a valley."""
    block = "{0}\n00:00:0{0},000 --> 00:00:0{0},900\nHOME(8.0,46.5) \nGPS({1},46.5,19) BAROMETER:{2}\n\n"
    text = block.format(1, 8.002, 3.0) + block.format(2, longitude, lowest_m)
    poses = read_subtitles(srt(tmp_path, text)).poses(CameraMount.parse("north:-90"))
    said = [one for one in local_track(poses, HeightOptions(), None).remarks if "set in the air" in one]
    assert len(said) == told and all("it flew 38 m below its take-off right at it" in one for one in said)


def test_a_mavic_2_writes_no_arrows_and_misspells(tmp_path: Path) -> None:
    text = "".join(
        f"{n}\n2017.08.05 14:11:5{n},393,525\n[latitude : -20.2533] [longtitude : 149.0251] [iso : 100]\n\n"
        for n in (1, 2, 3)
    )
    log = read_subtitles(srt(tmp_path, text))
    assert log.time_s.tolist() == [0.0, 1.0, 2.0] and not log.heights_m
    assert log.longitude_deg.tolist() == [149.0251] * 3


def test_a_mavic_air_2_counts_focal_lengths_in_tenths(tmp_path: Path) -> None:
    text = (
        '1\n00:00:00,000 --> 00:00:00,016\n<font size="36">SrtCnt : 1, DiffTime : 16ms\n'
        "2022-05-01 15:01:58,531,716\n[focal_len : 240] [latitude: 41.420684] [longitude: 2.162162] "
        "[altitude: 27.300000] </font>\n"
    )
    log = read_subtitles(srt(tmp_path, text))
    assert log.focal_35mm is not None and log.focal_35mm.tolist() == [24.0]
    assert log.heights_m["take-off"][0] == 27.3
    assert any("does not say from where it counts" in remark for remark in log.remarks)


@cache
def six_blocks() -> bytes:
    place = 46.5, 8.0, 12.0
    return "".join(f(n, n / 10, rows()[n], place) for n in range(1, 4) for f in (mini, rtk)).encode()


@pytest.mark.parametrize(
    "told",
    [
        "[latitude: 46.5] [longitude: 8.0] [rel_alt: {} abs_alt: 1250.0]",
        "[latitude: 46.5] [longitude: 8.0] [altitude: {}]",
        "GPS (8.0, 46.5, 15), D 24.1m, H {}, H.S 0.00m/s",
        "GPS(8.0,46.5,19) BAROMETER:{}",
    ],
)
@pytest.mark.parametrize(
    ("height", "height_m"),
    [("164.0", 164.0), ("164.0m", 164.0), ("164.0ft", 49.9872), ("164.0 FT", 49.9872), ("164 feet", 49.9872)],
)
def test_heights_in_feet_are_not_taken_for_metres(
    tmp_path: Path, told: str, height: str, height_m: float
) -> None:
    """Three times too high, a camera put everything three times as far from the middle of its view."""
    block = "{0}\n00:00:0{0},000 --> 00:00:0{0},900\n" + told.format(height) + "\n\n"
    log = read_subtitles(srt(tmp_path, "".join(block.format(number) for number in (1, 2, 3))))
    np.testing.assert_allclose(log.heights_m["take-off"], height_m, rtol=1e-9)


@given(st.data())
@settings(max_examples=60)
def test_damaged_subtitles_are_one_line(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    whole = six_blocks()
    cut = whole[: data.draw(st.integers(0, len(whole)))]
    noise = data.draw(
        st.lists(st.tuples(st.integers(0, max(len(cut) - 1, 0)), st.integers(0, 255)), max_size=20)
    )
    damaged = bytearray(cut)
    for at, value in noise if damaged else []:
        damaged[at] = value
    path = tmp_path_factory.mktemp("srt") / "x.SRT"
    path.write_bytes(bytes(damaged))
    try:
        log = read_subtitles(path)
    except ValueError as error:
        assert "holds no position" in str(error)
    else:
        assert np.all(np.abs(log.latitude_deg) <= 90) and len(log.time_s) <= 6


# --- what is missing is said ---


def test_what_is_missing_is_said_with_the_way_out(tmp_path: Path) -> None:
    film, start_ns = write_film(tmp_path / "a.mp4")
    with pytest.raises(ValueError, match=r"no flight log beside it \(a.SRT, .ulg or .tlog\)"):
        open_recording(film)
    log = write_subtitles(tmp_path / "a.SRT", start_ns, rtk)
    with pytest.raises(ValueError, match=r"how wide its camera sees.*--calibration"):
        open_recording(film)
    with pytest.raises(ValueError, match=r"it is the log of a film, which is named instead: .*a.mp4"):
        open_recording(log)
    with pytest.raises(ValueError, match=r"no heights above sea are recorded: there are take-off"):
        open_recording(film, calibration=frames()[0].camera, heights="sea")
    # As a Mavic 2 writes it: no --heights can help.
    log.write_text("1\n2017.08.05 14:11:51,393,525\n[latitude : -20.2533] [longtitude : 149.0251]\n\n")
    with pytest.raises(ValueError, match=r"no heights, without which .*poses\.csv"):
        open_recording(film, calibration=frames()[0].camera, mount="north:-90,0")
    write_subtitles(tmp_path / "a.SRT", start_ns, mini)
    with pytest.raises(ValueError, match=r"need the geoid.*--geoid-m.*--heights take-off"):
        open_recording(film, heights="sea")
    above_sea = open_recording(film, heights="sea", geoid_m=50.0)
    assert above_sea.georeference is not None and not above_sea.ground_contacts
    with pytest.raises(ValueError, match="is no AirSim recording: crowd_colors does not apply"):
        open_recording(film, crowd_colors=[(1, 2, 3)])


@pytest.mark.parametrize("geoid_m", [np.nan, np.inf, -111.0, 91.0])
def test_a_geoid_that_lies_so_nowhere_is_refused(geoid_m: float) -> None:
    with pytest.raises(ValueError, match=r"geoid_m is .*; it must be in \[-110, 90\]"):
        HeightOptions("sea", geoid_m)


@pytest.mark.parametrize("place", [(np.nan, np.nan), (91.0, 0.0), (0.0, -180.5), (1e300, 0.0)])
def test_a_take_off_that_is_nowhere_is_refused(place: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match=r"take_off is .*; a latitude is in \[-90, 90\] and a longitude"):
        HeightOptions("take-off", take_off=place)


@pytest.mark.parametrize(
    ("angles", "message"),
    [
        ("body:nan", r"the pitch of a mount is nan; it must be in \[-90, 90\] degrees"),
        ("level:-91", "the pitch of a mount is -91"),
        ("level:-1e300", r"the pitch of a mount is -1e\+300"),
        ("north:-90,361", r"the yaw of a mount is 361; it must be in \[-360, 360\]"),
        ("body:-90,0,181", r"the roll of a mount is 181; it must be in \[-180, 180\]"),
    ],
)
def test_a_camera_that_hangs_so_nowhere_is_refused(angles: str, message: str) -> None:
    """The sine of 1e300 is a number too: such a camera looked anywhere, without a word."""
    with pytest.raises(ValueError, match=message):
        CameraMount.parse(angles)
