"""Views without poses: the poses come from an autopilot, played by pymavlink over loopback."""

import hashlib
import socket
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation
from starlette.testclient import TestClient

from crowdfence.config import EvidenceConfig, GroupingConfig, ProjectionConfig, RunConfig, ZoneConfig
from crowdfence.service import mavlink_link
from crowdfence.service.boot_clock import BootClock
from crowdfence.service.clock import Clock
from crowdfence.service.inputs import Inputs
from crowdfence.service.mavlink_link import TelemetryAddress
from crowdfence.service.opening import live
from crowdfence.service.service import Service
from crowdfence.service.telemetry import Telemetry, TelemetryOptions
from crowdfence.service.view_message import CameraMessage, HeatmapMessage, ViewMessage
from crowdfence.service.watch import Watch
from crowdfence.sources.camera_mount import CameraMount
from crowdfence.sources.geographic_track import HeightOptions
from support.foreign_recordings import Row, frames, ground, mission, rows
from support.small_service import SETTINGS, asked

BOOT_MS = 60_000
"""The autopilot's own time at the first row."""
GEOID_M = 48.0
SECOND_NS = 1_000_000_000
CONFIG = RunConfig(
    EvidenceConfig(), ProjectionConfig(max_range_m=300.0), GroupingConfig(), ZoneConfig(min_area_m2=3.0)
)


def boot_ms(row: Row) -> int:
    return BOOT_MS + (row.stamp_ns - rows()[0].stamp_ns) // 1_000_000


def boot_stamp_ns() -> int:
    """When the autopilot started."""
    return rows()[0].stamp_ns - BOOT_MS * 1_000_000


def position(row: Row) -> Any:
    latitude, longitude, height = row.geodetic
    above = row.position[2] - rows()[0].position[2]
    place = [
        round(latitude * 1e7),
        round(longitude * 1e7),
        round((height - GEOID_M) * 1e3),
        round(above * 1e3),
    ]
    return mavlink.MAVLink_global_position_int_message(boot_ms(row), *place, 0, 0, 0, 65535)


def gimbal(row: Row) -> Any:
    """The camera's attitude against the Earth."""
    x, y, z, w = row.forward_right_down_ned.as_quat()
    return mavlink.MAVLink_gimbal_device_attitude_status_message(
        0, 0, boot_ms(row), 16 | 64, [w, x, y, z], 0.0, 0.0, 0.0, 0
    )


def attitude(row: Row) -> Any:
    """The drone's own, level and heading as the camera does."""
    yaw = np.radians(row.yaw_pitch_roll_deg[0])
    turn = [np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]
    return mavlink.MAVLink_attitude_quaternion_message(boot_ms(row), *turn, 0.0, 0.0, 0.0)


def system_time(row: Row) -> Any:
    return mavlink.MAVLink_system_time_message(row.stamp_ns // 1000, boot_ms(row))


def home(row: Row) -> Any:
    latitude, longitude, _ = row.geodetic
    place = [round(latitude * 1e7), round(longitude * 1e7), 0]
    return mavlink.MAVLink_home_position_message(*place, 0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0)


class Vehicle:
    """A sender that is not ours."""

    def __init__(self, port: int, system: int = 1, phrase: str | None = None) -> None:
        self.link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=system)
        if phrase is not None:
            self.link.setup_signing(hashlib.sha256(phrase.encode()).digest())

    def say(self, messages: Sequence[Any]) -> None:
        for number, message in enumerate(messages):
            self.link.mav.send(message)
            if number % 20 == 19:
                time.sleep(0.01)  # loopback drops what the receiver has no room for


def view(number: int) -> ViewMessage:
    """A recorded frame without its pose."""
    frame = frames()[number]
    return ViewMessage(
        drone="uav1",
        stamp_ns=frame.stamp_ns,
        camera=CameraMessage.of(frame.camera),
        heatmap=HeatmapMessage.of(np.zeros((12, 16), np.uint8)),
    )


def port_of() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class Now:
    """A clock that a test sets."""

    def __init__(self, now_ns: int) -> None:
        self.ns = now_ns

    def clock(self) -> Clock:
        return Clock("system", system=lambda: self.ns, steady=lambda: self.ns)


@contextmanager
def listening(
    folder: Path, now: Now, port: int, options: TelemetryOptions, *, wait_s: float = 5.0, **how: Any
) -> Iterator[tuple[Service, TestClient]]:
    inputs = Inputs(mavlink=[TelemetryAddress("uav1", "127.0.0.1", port)], telemetry=options, **how)
    told = replace(SETTINGS, clock="system", pose_wait_s=wait_s)
    place = mission().georeference
    with (
        live(
            folder,
            ground(),
            CONFIG,
            name="alps",
            georeference=place,
            clock=now.clock(),
            settings=told,
            inputs=inputs,
        ) as service,
        asked(service) as http,
    ):
        yield service, http


SEA = TelemetryOptions(heights=HeightOptions("sea", GEOID_M))


def give(http: TestClient, message: ViewMessage) -> Any:
    return http.post("/api/v1/views", content=message.model_dump_json(exclude_none=True).encode())


def test_the_pose_of_a_view_is_that_of_the_recorded_camera(tmp_path: Path) -> None:
    """Positions at 10 Hz, the gimbal at 50 Hz, the time of day from SYSTEM_TIME."""
    now, port = Now(rows()[-1].stamp_ns), port_of()
    with listening(tmp_path, now, port, SEA) as (service, http):
        messages = [position(rows()[0]), system_time(rows()[0])]
        for number, row in enumerate(rows()):
            messages += [gimbal(row), *([position(row)] if number % 5 == 0 else [])]
        Vehicle(port).say(messages)
        for number, frame in enumerate(frames()):
            answer = give(http, view(number))
            assert answer.status_code == 202, answer.text
            found = kept_pose(service, frame.stamp_ns)
            apart_m = np.linalg.norm(found[:3, 3] - frame.world_from_camera[:3, 3])
            assert apart_m < 0.1  # 1e-7 degrees, millimetres, straight lines over 0.1 s
            turned = found[:3, :3].T @ frame.world_from_camera[:3, :3]
            assert np.degrees(np.arccos(min((np.trace(turned) - 1) / 2, 1.0))) < 0.1


def sent_by(component: int, message: Any, *, later_ms: int = 0) -> Any:
    """As it comes from a component of the drone whose clock began so much later than the autopilot's."""
    message._header.srcComponent = component
    if not hasattr(message, "time_boot_ms"):
        return message
    message.time_boot_ms = (message.time_boot_ms - later_ms) % 2**32
    return message


@pytest.mark.parametrize("later_ms", [0, 3_000, 59_000, -600_000, -1_760_000_000_000])
def test_a_gimbal_and_a_companion_with_clocks_of_their_own(later_ms: int) -> None:
    """The gimbal, component 154, is told by its own clock; so is the time of day of a companion computer,
    191, whose attitude is that of its own board. Messages are 40 ms on their way."""
    feed = Telemetry("uav1", ground(), mission().georeference, SEA)
    for number, row in enumerate(rows()):
        now_ns = row.stamp_ns + 40_000_000
        feed.heard(sent_by(154, gimbal(row), later_ms=later_ms), now_ns)
        feed.heard(sent_by(191, system_time(row), later_ms=later_ms - 7_000), now_ns)
        feed.heard(sent_by(191, attitude(rows()[-1]), later_ms=later_ms - 7_000), now_ns)
        if number % 5 == 0:
            feed.heard(sent_by(1, position(row)), now_ns)
            feed.heard(sent_by(1, system_time(row)), now_ns)
    for frame in frames()[1:]:
        pose, true = feed.pose_at(frame.stamp_ns), frame.world_from_camera
        assert np.linalg.norm(pose[:3, 3] - true[:3, 3]) < 0.1
        assert np.degrees(Rotation.from_matrix(true[:3, :3].T @ pose[:3, :3]).magnitude()) < 0.1


def test_an_autopilot_that_counts_from_1970_is_laid_by_when_it_speaks_and_that_is_said_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """It hears no satellites yet; its views were refused as gaps in the poses, without the cause."""
    feed = Telemetry("uav1", ground(), mission().georeference, SEA)
    for row in rows():
        for message in (
            position(row),
            gimbal(row),
            mavlink.MAVLink_system_time_message(boot_ms(row) * 1000, boot_ms(row)),
        ):
            feed.heard(message, row.stamp_ns + 1_000_000)
    for frame in frames()[1:]:
        pose, true = feed.pose_at(frame.stamp_ns), frame.world_from_camera
        assert np.linalg.norm(pose[:3, 3] - true[:3, 3]) < 0.1
    (said,) = [record.getMessage() for record in caplog.records]
    after_s = boot_ms(rows()[0]) / 1e3
    assert said.startswith(
        f"the autopilot of uav1 does not know the time of day: its SYSTEM_TIME is {after_s:.0f} s after 1970"
    )


def test_a_gimbal_that_counts_from_the_heading_has_no_pose_while_nobody_tells_the_heading() -> None:
    """Headings were bridged over two seconds and more, in which a drone turns round; positions and attitudes
    of cameras are over one."""
    feed = Telemetry("uav1", ground(), mission().georeference, SEA)
    silent = frames()[3].stamp_ns

    def from_heading(row: Row) -> Any:
        half = np.radians(row.yaw_pitch_roll_deg[1]) / 2
        turn = [np.cos(half), 0.0, np.sin(half), 0.0]
        return mavlink.MAVLink_gimbal_device_attitude_status_message(
            0, 0, boot_ms(row), 32, turn, 0.0, 0.0, 0.0, 0
        )

    feed.heard(position(rows()[0]), rows()[0].stamp_ns)
    feed.heard(from_heading(rows()[0]), rows()[0].stamp_ns)
    assert feed.newest_ns is None and feed.lacks == "no ATTITUDE_QUATERNION"
    for row in rows():
        feed.heard(position(row), row.stamp_ns)
        feed.heard(from_heading(row), row.stamp_ns)
        if abs(row.stamp_ns - silent) > 0.8e9:
            feed.heard(attitude(row), row.stamp_ns)
    for number in (1, 5):
        pose, true = feed.pose_at(frames()[number].stamp_ns), frames()[number].world_from_camera
        assert np.degrees(Rotation.from_matrix(true[:3, :3].T @ pose[:3, :3]).magnitude()) < 1.0
    with pytest.raises(ValueError, match="ATTITUDE_QUATERNION has a gap of 1.6"):
        feed.pose_at(silent)


@pytest.mark.parametrize(("mount", "told"), [("level", True), ("north", False)])
def test_attitudes_of_a_drone_that_nobody_set_are_told_of(mount: Any, told: bool) -> None:
    """ATTITUDE of zeros, as of a program that fills in positions alone: a camera that --mount hangs on the
    drone looked north in the whole flight."""
    feed = Telemetry("uav1", ground(), mission().georeference, replace(SEA, mount=CameraMount(mount, -60.0)))
    for row in rows():
        feed.heard(position(row), row.stamp_ns)
        feed.heard(mavlink.MAVLink_attitude_message(boot_ms(row), 0, 0, 0, 0, 0, 0), row.stamp_ns)
    feed.pose_at(frames()[1].stamp_ns)
    assert (feed.doubt is not None) == told
    if told:
        assert "attitudes of uav1 are level and due north to the last digit" in (feed.doubt or "")


@pytest.mark.parametrize(("off_deg", "told"), [(0.0, False), (25.0, True)])
def test_a_mount_that_is_not_what_the_gimbal_tells_is_told_of(off_deg: float, told: bool) -> None:
    """--mount of another flight: a run of the log says that the recorded attitudes are not used, and by how
    much they differ; live nothing was said."""
    half = np.radians(-60.0) / 2
    feed = Telemetry(
        "uav1", ground(), mission().georeference, replace(SEA, mount=CameraMount("level", -60.0 + off_deg))
    )
    for row in rows():
        down_60 = mavlink.MAVLink_gimbal_device_attitude_status_message(
            0, 0, boot_ms(row), 32, [np.cos(half), 0.0, np.sin(half), 0.0], 0.0, 0.0, 0.0, 0
        )
        for message in (position(row), down_60, attitude(row), system_time(row)):
            feed.heard(message, row.stamp_ns)
    feed.pose_at(frames()[2].stamp_ns)
    assert (feed.doubt is not None) == told, feed.doubt
    if told:
        said = "--mount is used instead, of kind level, 25 degrees from that"
        assert said in (feed.doubt or "")


def test_of_two_gimbals_the_attitudes_of_one_are_taken_also_while_it_is_silent_and_that_is_told() -> None:
    """The first looks where the pictures do, the second straight up. Where the first was silent for some
    seconds, views got the attitude of the second, and nothing was said."""
    feed = Telemetry("uav1", ground(), mission().georeference, SEA)

    def up(row: Row) -> Any:
        half = np.sqrt(0.5)
        turn = [half, 0.0, half, 0.0]
        return mavlink.MAVLink_gimbal_device_attitude_status_message(
            0, 0, boot_ms(row) + 5, 16 | 64, turn, 0.0, 0.0, 0.0, 0
        )

    silent = frames()[3].stamp_ns
    for row in rows():
        feed.heard(sent_by(1, position(row)), row.stamp_ns)
        feed.heard(sent_by(171, up(row)), row.stamp_ns + 5_000_000)
        if abs(row.stamp_ns - silent) > 0.8e9:
            feed.heard(sent_by(154, gimbal(row)), row.stamp_ns)
    for number in (1, 5):
        pose, true = feed.pose_at(frames()[number].stamp_ns), frames()[number].world_from_camera
        assert np.degrees(Rotation.from_matrix(true[:3, :3].T @ pose[:3, :3]).magnitude()) < 0.1
    with pytest.raises(ValueError, match="GIMBAL_DEVICE_ATTITUDE_STATUS has a gap of 1.6"):
        feed.pose_at(silent)
    said = (
        "attitudes of several gimbals are told: component 154, device 0 is taken, not component 171, device 0"
    )
    assert feed.doubt is not None and said in feed.doubt
    mounted = Telemetry(
        "uav1", ground(), mission().georeference, replace(SEA, mount=CameraMount("level", -60.0))
    )
    for row in rows()[:50]:
        for message in (position(row), gimbal(row), sent_by(171, up(row))):
            mounted.heard(message, row.stamp_ns)
    assert mounted.doubt is None, "with --mount no gimbal counts"


def test_positions_of_two_components_of_a_drone_are_told_of_as_in_a_log() -> None:
    """A companion computer that was heard first told where the drone is, and the autopilot's own positions
    were left out without a word."""
    feed = Telemetry("uav1", ground(), mission().georeference, SEA)
    for component, doubted in ((191, False), (191, False), (1, True)):
        feed.heard(sent_by(component, position(rows()[0])), rows()[0].stamp_ns)
        assert (feed.doubt is not None) == doubted
    assert (
        feed.doubt is not None and "components 191 and 1 of uav1 tell positions: those of 191" in feed.doubt
    )


def fix(kind: int, receiver: Any = mavlink.MAVLink_gps_raw_int_message, more: tuple[int, ...] = ()) -> Any:
    return receiver(0, kind, 0, 0, 0, 65535, 65535, 0, 65535, 255, *more)


def test_positions_without_satellites_are_told_of_as_in_a_log() -> None:
    """Jammed, an autopilot goes on by its own motion: what was seen was put hundreds of metres away, and only
    a run of the log said so."""
    feed = Telemetry("uav1", ground(), mission().georeference, SEA)
    row = rows()[0]
    feed.heard(position(row), row.stamp_ns)
    assert feed.doubt is None, "autopilots need not tell of their receivers"
    feed.heard(fix(3), row.stamp_ns)
    assert feed.doubt is None
    feed.heard(fix(2), row.stamp_ns)
    assert feed.doubt is not None and "positions of uav1 are by dead reckoning" in feed.doubt
    feed.heard(sent_by(191, fix(3)), row.stamp_ns)
    assert feed.doubt is not None, "a companion's receiver is not what the autopilot flies by"
    feed.heard(fix(4, mavlink.MAVLink_gps2_raw_message, (0, 0)), row.stamp_ns)
    assert feed.doubt is None


def test_only_the_autopilot_answers_for_its_time(tmp_path: Path) -> None:
    """Every component that hears TIMESYNC answers with a clock of its own."""
    feed = Telemetry("uav1", ground(), mission().georeference, SEA)
    row = rows()[0]
    feed.heard(sent_by(1, position(row)), row.stamp_ns + 40_000_000)
    for component, boot_ns in ((191, 5 * SECOND_NS), (1, boot_ms(row) * 1_000_000)):
        feed.answered(row.stamp_ns, boot_ns, row.stamp_ns + 2_000_000, component)
    assert feed.clock.offset_ns == pytest.approx(boot_stamp_ns(), abs=2_000_000)


def test_two_drones_of_one_system_id_are_not_mixed(tmp_path: Path) -> None:
    """Autopilots come as system 1. The second one is 200 m further up, and was started a moment later."""

    def of_second(row: Row) -> list[Any]:
        up = np.array([0.0, 0.0, 200.0])
        other = replace(row, position=row.position + up, stamp_ns=row.stamp_ns + 7_000_000)
        return [position(other), gimbal(other)]

    now, port = Now(rows()[-1].stamp_ns), port_of()
    with listening(tmp_path, now, port, SEA) as (service, http):
        first, second = Vehicle(port), Vehicle(port)
        first.say([position(rows()[0]), system_time(rows()[0])])
        until(lambda: service.live.poses.feeds["uav1"].clock.offset_ns is not None)  # type: ignore[union-attr]
        for row in rows():
            first.say([position(row), gimbal(row)])
            second.say(of_second(row))
        for number in (0, 2, 4):
            assert give(http, view(number)).status_code == 202
            found = kept_pose(service, frames()[number].stamp_ns)
            assert np.linalg.norm(found[:3, 3] - frames()[number].world_from_camera[:3, 3]) < 0.1


def test_two_drones_of_one_system_id_that_both_go_on_are_an_alarm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """When the first fell silent the poses of the second were taken for its own, and only the log had said
    that there are two."""
    monkeypatch.setattr(mavlink_link, "_HANDOVER_S", 0.3)
    now, port = Now(rows()[-1].stamp_ns), port_of()
    with listening(tmp_path, now, port, SEA) as (service, _):
        first, again, second = Vehicle(port), Vehicle(port), Vehicle(port)
        feed, flown = service.live.poses.feeds["uav1"], iter(rows())  # type: ignore[union-attr]

        def both(other: Vehicle, seconds: float) -> None:
            end_s = time.monotonic() + seconds
            while time.monotonic() < end_s:
                row = next(flown)
                first.say([position(row)])
                other.say([position(row)])
                time.sleep(0.05)

        both(again, 0.2)  # its router was started anew, and speaks from another port
        assert feed.doubt is None
        both(second, 1.2)
        assert feed.doubt is not None and "two senders speak as system 1 at the port of uav1" in feed.doubt
        Watch(service).look()
        assert active(service) == {"uav1"}


def test_an_alarm_that_was_acknowledged_hides_no_other_trouble_of_the_poses(tmp_path: Path) -> None:
    """Two ways of one drone, acknowledged as the text says: when its telemetry ended nobody was told."""
    now, port = Now(rows()[0].stamp_ns), port_of()
    with listening(tmp_path, now, port, SEA) as (service, _):
        feed, watch = service.live.poses.feeds["uav1"], Watch(service)  # type: ignore[union-attr]
        assert isinstance(feed, Telemetry)
        Vehicle(port).say([position(rows()[0]), gimbal(rows()[0]), system_time(rows()[0])])
        until(lambda: feed.newest_ns is not None)
        feed.confused = "two senders speak as system 1"
        watch.look()
        first = service.alerts.active("pose_gap", "uav1")
        assert first is not None and first.text == feed.confused
        service.alerts.acknowledge(first.id, "ana", now.ns)
        watch.look()
        assert service.alerts.active("pose_gap", "uav1").id == first.id  # type: ignore[union-attr]
        now.ns += 3 * SECOND_NS
        for _ in range(2):
            watch.look()
            second = service.alerts.active("pose_gap", "uav1")
            assert second is not None and second.acknowledged_by is None
            assert second.text.startswith("no pose of uav1 for more than 2 s")
        assert [one.kind for one in service.alerts.all()].count("pose_gap") == 2


def test_an_alarm_that_nobody_acknowledged_tells_the_trouble_of_now(tmp_path: Path) -> None:
    """Raised before its drone was switched on, it went on to say that nothing comes while something wrong
    did."""
    now, port = Now(rows()[0].stamp_ns), port_of()
    with listening(tmp_path, now, port, SEA) as (service, _):
        feed, watch = service.live.poses.feeds["uav1"], Watch(service)  # type: ignore[union-attr]
        assert isinstance(feed, Telemetry)
        now.ns += 3 * SECOND_NS
        watch.look()
        silent = service.alerts.active("pose_gap", "uav1")
        assert silent is not None and "no pose of uav1 for more than 2 s, none, " in silent.text
        row = next(row for row in rows() if row.stamp_ns > now.ns - SECOND_NS)
        feed.confused = "two senders speak as system 1"
        for message in (position(row), gimbal(row), system_time(row)):
            message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
            feed.heard(message, now.ns)
        watch.look()
        told = service.alerts.active("pose_gap", "uav1")
        assert told is not None and (told.id, told.text) == (silent.id, feed.confused)
        assert [one.kind for one in service.alerts.all()].count("pose_gap") == 1


def test_another_autopilot_at_the_port_of_a_drone_without_a_system_id_is_an_alarm(tmp_path: Path) -> None:
    """As behind a router that forwards a whole fleet: whoever spoke first told the poses of uav1, though it
    was uav2, and nobody said so."""
    now, port = Now(rows()[0].stamp_ns), port_of()
    with listening(tmp_path, now, port, SEA) as (service, _):
        watch, feed = Watch(service), service.live.poses.feeds["uav1"]  # type: ignore[union-attr]
        Vehicle(port, system=2).say([position(rows()[0]), gimbal(rows()[0]), system_time(rows()[0])])
        until(lambda: feed.newest_ns is not None)
        watch.look()
        assert not active(service)
        Vehicle(port, system=1).say([position(rows()[0]), gimbal(rows()[0])])
        until(lambda: feed.doubt is not None)
        watch.look()
        alert = service.alerts.active("pose_gap", "uav1")
        assert alert is not None and "system ids 2 and 1 speak at the port of uav1" in alert.text
        assert f"--mavlink uav1=udp:ADDRESS:{port}:2, or :1" in alert.text


@pytest.mark.parametrize("systems", [(None, None), (1, None), (1, 1)])
def test_drones_that_nothing_tells_apart_on_one_port_are_refused(
    tmp_path: Path, systems: tuple[int | None, int | None]
) -> None:
    inputs = Inputs(
        mavlink=[TelemetryAddress(f"uav{n}", "127.0.0.1", 1, one) for n, one in enumerate(systems)]
    )
    with pytest.raises(ValueError, match="uav0 and uav1 share the port .*system id"):
        inputs.feeds(ground(), mission().georeference)


def test_one_message_that_cannot_be_taken_does_not_end_all_poses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, port = Now(rows()[-1].stamp_ns), port_of()
    with listening(tmp_path, now, port, SEA) as (service, _):
        vehicle, taken = Vehicle(port), []

        def failing(*message: Any) -> None:
            taken.append(message)
            raise OverflowError

        with monkeypatch.context() as broken:
            broken.setattr(Telemetry, "heard", failing)
            vehicle.say([position(rows()[0])])
            until(lambda: taken)
        vehicle.say([position(rows()[0]), system_time(rows()[0]), gimbal(rows()[0])])
        until(lambda: newest_ns(service) > 0)


@pytest.mark.parametrize("every", [1, 10])
def test_a_pause_of_attitudes_is_bridged_only_where_they_come_so_seldom(every: int) -> None:
    """At 50 Hz one of 0.6 s may hide a turn, and a log of the flight refuses it; at 5 Hz half of that is
    usual, and one of 0.2 s is none."""
    telemetry = Telemetry("uav1", ground(), mission().georeference, SEA)
    flown = rows()[:101]
    for number, row in enumerate(flown):
        messages = [position(row)] if number % 10 == 0 else []
        if number % every == 0 and not (every == 1 and 40 < number < 70):
            messages.append(gimbal(row))
        for message in messages:
            message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
            telemetry.heard(message, row.stamp_ns)
    if every == 1:
        with pytest.raises(ValueError, match=r"gap of 0\.6\d0 s there"):
            telemetry.pose_at(flown[55].stamp_ns)
    else:
        found = telemetry.pose_at(flown[55].stamp_ns)
        assert np.allclose(found[:3, 3], flown[55].position, atol=0.1)
    telemetry.pose_at(flown[80].stamp_ns)


def test_what_each_row_is_off_by_itself_is_taken_out_of_its_neighbours() -> None:
    """Rows of half a metre's and half a degree's noise, as far as they have come when the view does."""
    dice = np.random.default_rng(4)
    noisy = [
        replace(
            row,
            position=row.position + 0.5 * dice.standard_normal(3),
            turn=row.turn * Rotation.from_rotvec(np.radians(0.5) * dice.standard_normal(3)),
        )
        for row in rows()
    ]
    anchor = mission().georeference
    feeds = [
        Telemetry("uav1", ground(), anchor, replace(SEA, noise=noise))
        for noise in (None, (0.5, 0.5), "estimate")
    ]
    errors: list[list[tuple[float, float]]] = [[] for _ in feeds]
    came = 0
    for frame in frames():
        for row in noisy[came:]:
            if row.stamp_ns > frame.stamp_ns + SECOND_NS // 10:
                break
            for feed in feeds:
                for message in (position(row), gimbal(row), *([system_time(row)] if came == 0 else [])):
                    feed.heard(message, row.stamp_ns)
            came += 1
        for feed, found in zip(feeds, errors, strict=True):
            pose, true = feed.pose_at(frame.stamp_ns), frame.world_from_camera
            turned = Rotation.from_matrix(true[:3, :3].T @ pose[:3, :3]).magnitude()
            found.append((float(np.linalg.norm(pose[:3, 3] - true[:3, 3])), float(np.degrees(turned))))
    raw, given, estimated = (np.sqrt(np.mean(np.square(one), axis=0)) for one in errors)
    # Three axes of the given noise; where a view lies between two rows, their mean has less of it.
    assert 0.5 < raw[0] < 1.0 and 0.5 < raw[1] < 1.0
    assert (given < 0.6 * raw).all() and (estimated < 0.6 * raw).all(), (raw, given, estimated)


def test_a_mount_stands_in_for_a_gimbal_and_the_map_for_heights_above_the_take_off(tmp_path: Path) -> None:
    """The drone took off where the first row is: its height there is the ground's, so that the camera lies
    as far below its place as the first row is above the ground."""
    row = rows()[0]
    pitch_deg = float(row.yaw_pitch_roll_deg[1])
    mount = TelemetryOptions(mount=CameraMount("level", pitch_deg))
    now, port = Now(rows()[-1].stamp_ns), port_of()
    with listening(tmp_path, now, port, mount) as (service, http):
        messages = [position(row), system_time(row), home(row)]
        messages += [make(one) for one in rows()[::2] for make in (position, attitude)]
        Vehicle(port).say(messages)
        frame = frames()[0]
        assert give(http, view(0)).status_code == 202
        found = kept_pose(service, frame.stamp_ns)
        ground_m = float(service.raster.height_at(row.position[None, :2])[0])
        lifted = frame.world_from_camera[:3, 3] - [0.0, 0.0, row.position[2] - ground_m]
        assert np.abs(found[:2, 3] - lifted[:2]).max() < 0.1
        assert abs(found[2, 3] - lifted[2]) < 1.0  # the raster is a cell's highest ground
        assert abs(np.degrees(np.arcsin(found[2, 2])) - pitch_deg) < 0.01


def test_heights_from_a_home_that_was_not_told_put_no_camera_anywhere() -> None:
    """Home was set anew on other ground and the word of it was lost: until it was asked for again cameras
    hung too high or too low by as much as the one home lies above the other, and nothing was said."""
    options = TelemetryOptions(mount=CameraMount("level", -60.0))
    feed = Telemetry("uav1", ground(), mission().georeference, options)

    def told_home(row: Row, altitude_m: float) -> Any:
        message = home(row)
        message.altitude = round(altitude_m * 1e3)
        return message

    def told(part: Sequence[Row], home_m: float) -> None:
        for row in part:
            place = position(row)
            place.relative_alt = round(place.alt - home_m * 1e3)
            for message in (place, attitude(row), system_time(row)):
                feed.heard(message, row.stamp_ns)

    first_m = position(rows()[0]).alt / 1e3
    feed.heard(told_home(rows()[0], first_m), rows()[0].stamp_ns)
    told(rows()[:200], first_m)
    assert feed.knows_home
    before = feed.pose_at(rows()[190].stamp_ns)
    told(rows()[200:], first_m + 12.0)
    assert not feed.knows_home, "so it is asked for"
    words = "home {:.0f} m above the sea, and the one that it told last .* lies at {:.0f} m"
    with pytest.raises(ValueError, match=words.format(first_m + 12.0, first_m)):
        feed.pose_at(rows()[-10].stamp_ns)
    feed.heard(told_home(rows()[0], first_m + 12.0), rows()[-1].stamp_ns)
    assert feed.knows_home
    assert feed.pose_at(rows()[-10].stamp_ns)[2, 3] < before[2, 3]
    with pytest.raises(ValueError, match=words.format(first_m, first_m + 12.0)):
        feed.pose_at(rows()[20].stamp_ns)


def test_a_take_off_that_is_stated_for_a_drone_that_took_off_elsewhere_is_told_of() -> None:
    """--take-off counts for all drones: a fleet on a slope hung too high or too low by as much as one
    take-off lies above the other, and only a run of the log said so. 0.001 degrees of longitude: 77 m."""
    row = rows()[0]
    latitude, longitude, _ = row.geodetic
    for east, told in ((0.0, False), (0.001, True)):
        stated = HeightOptions(take_off=(latitude, longitude + east))
        options = TelemetryOptions(mount=CameraMount("level", -60.0), heights=stated)
        feed = Telemetry("uav1", ground(), mission().georeference, options)
        feed.heard(home(row), row.stamp_ns)
        for one in rows()[:150]:
            for message in (position(one), attitude(one), system_time(one)):
                feed.heard(message, one.stamp_ns)
        feed.pose_at(frames()[1].stamp_ns)
        assert (feed.doubt is not None) == told
        if told:
            assert "uav1: the stated take-off lies 77 m from the home that is recorded" in (feed.doubt or "")


def test_views_without_telemetry_wait_and_are_refused_with_the_reason(tmp_path: Path) -> None:
    now, port = Now(frames()[0].stamp_ns), port_of()
    with listening(tmp_path, now, port, SEA, wait_s=0.05) as (service, http):
        early = give(http, view(0))
        assert early.status_code == 503
        lacks = "no GLOBAL_POSITION_INT and no GIMBAL_DEVICE_ATTITUDE_STATUS"
        assert f"no pose has come yet, {lacks}" in early.json()["detail"]
        assert early.headers["Retry-After"] == "1"
        stranger = give(http, view(0).model_copy(update={"drone": "uav7"}))
        assert stranger.status_code == 422 and "world_from_camera" in stranger.json()["detail"]
        # A gap of 3 s around the view.
        stamp_ns, now.ns = frames()[3].stamp_ns, rows()[-1].stamp_ns
        kept = [row for row in rows() if abs(row.stamp_ns - stamp_ns) > 1.5e9]
        messages = [position(rows()[0]), system_time(rows()[0])]
        messages += [make(row) for row in kept for make in (position, gimbal)]
        Vehicle(port).say(messages)
        until(lambda: newest_ns(service) > stamp_ns + SECOND_NS)
        answer = give(http, view(3))
        assert answer.status_code == 422 and "a gap of 3.0" in answer.json()["detail"], answer.text
        watch = Watch(service)
        watch.look()
        assert active(service) == {"uav1"}

        def text() -> str:
            """The service looks too, and may have met the silence before the telemetry came."""
            gap = service.alerts.active("pose_gap", "uav1")
            return "" if gap is None else gap.text

        until(lambda: "a gap of 3.0" in text() and "see that its autopilot" in text())
        # Nothing of it is in the map, and no place in the queue is taken for good.
        assert service.live is not None and service.live.applying.waiting == 0
        assert sum(service.live.heard.refused.values()) == 3 and not service.live.heard.accepted


def test_stale_telemetry_is_an_alarm_that_is_shown_published_and_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    now, port = Now(rows()[0].stamp_ns), port_of()
    with listening(tmp_path, now, port, SEA) as (service, http):
        watch = Watch(service)
        watch.look()
        assert not active(service)
        now.ns += 3 * SECOND_NS  # nothing ever came
        watch.look()
        assert active(service) == {"uav1"}
        never = service.alerts.active("pose_gap", "uav1")
        assert never is not None and "none, no GLOBAL_POSITION_INT" in never.text
        assert "--mavlink" in never.text and "--mount" in never.text  # what to do
        vehicle = Vehicle(port)
        vehicle.say([position(rows()[0]), system_time(rows()[0])])
        last = next(row for row in rows() if row.stamp_ns >= now.ns)
        flown = [row for row in rows() if row.stamp_ns <= last.stamp_ns]
        vehicle.say([make(row) for row in flown for make in (position, gimbal)])
        until(lambda: abs(newest_ns(service) - last.stamp_ns) < 2_000_000)
        watch.look()
        assert not active(service)
        now.ns += 3 * SECOND_NS
        with http.websocket_connect("/api/v1/stream") as socket_:
            assert socket_.receive_json()["type"] == "hello"
            watch.look()
            told = next(one for _ in range(2) if (one := socket_.receive_json())["type"] != "step")
        alert = told["alert"]
        assert (told["type"], alert["kind"], alert["level"]) == ("alert", "pose_gap", "alarm")
        assert alert["drone"] == "uav1" and "zones stay" in alert["text"]
        shown = [one for one in http.get("/api/v1/alerts").json()["alerts"] if one["kind"] == "pose_gap"]
        assert [one["cleared_ns"] is None for one in shown] == [True, False]
        assert 'crowdfence_alerts_active{kind="pose_gap",level="alarm"} 1.0' in http.get("/metrics").text
        logged = [one for one in caplog.records if getattr(one, "kind", "") == "pose_gap"]
        assert len(logged) == 2 and all(one.levelname == "ERROR" for one in logged)


@pytest.mark.parametrize(
    ("ahead_s", "alarmed", "taken"), [(0.3, False, True), (1.5, True, True), (18.0, True, False)]
)
def test_poses_that_are_stamped_ahead_of_the_clock_are_told_of(
    tmp_path: Path, ahead_s: float, alarmed: bool, taken: bool
) -> None:
    """An autopilot that does not answer TIMESYNC and counts by satellites, 18 s ahead of UTC: each view got
    the pose of 18 s before, and nothing was said."""
    now, port = Now(frames()[4].stamp_ns), port_of()
    flown = [row for row in rows() if row.stamp_ns <= now.ns]
    with listening(tmp_path, now, port, SEA, wait_s=0.05) as (service, http):
        ahead = mavlink.MAVLink_system_time_message(
            (flown[0].stamp_ns + round(ahead_s * SECOND_NS)) // 1000, boot_ms(flown[0])
        )
        messages = [position(flown[0]), ahead]
        Vehicle(port).say([*messages, *(make(row) for row in flown for make in (position, gimbal))])
        until(lambda: newest_ns(service) > flown[-1].stamp_ns + (ahead_s - 0.005) * SECOND_NS)
        # The service looks by itself too, maybe between two poses, and a text stays as it was raised.
        service.alerts.clear("pose_gap", now.ns, drone="uav1")
        Watch(service).look()
        alert = service.alerts.active("pose_gap", "uav1")
        assert (alert is not None) == alarmed
        if alert is not None:
            off_s = ahead_s + (flown[-1].stamp_ns - now.ns) / 1e9
            assert f"the newest is {off_s:.1f} s ahead of the clock of the service" in alert.text
        answer = give(http, view(4))
        assert answer.status_code == (202 if taken else 422), answer.text


def test_the_autopilot_is_asked_for_the_time_and_for_its_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its answer to TIMESYNC sets the time, although it thinks that it is 1970. Home, from which heights
    count, is another one where it takes off again; it was asked for once in a day."""
    monkeypatch.setattr(mavlink_link, "_HOME_AGAIN_S", 2.0)
    now, port = Now(rows()[200].stamp_ns), port_of()
    with listening(tmp_path, now, port, SEA) as (service, _):
        vehicle = Vehicle(port)
        vehicle.say([position(rows()[200]), gimbal(rows()[200])])
        asked_for = vehicle.link.recv_match(type="TIMESYNC", blocking=True, timeout=20)
        assert asked_for is not None and asked_for.tc1 == 0
        # 7 s after its start by its own clock, whatever the day.
        vehicle.link.mav.timesync_send(7 * SECOND_NS, asked_for.ts1)
        feed = service.live.poses.feeds["uav1"]  # type: ignore[union-attr]
        assert isinstance(feed, Telemetry)
        until(lambda: feed.clock.source == "timesync")
        assert feed.clock.offset_ns == now.ns - 7 * SECOND_NS  # the test's clock stands still
        request = vehicle.link.recv_match(type="COMMAND_LONG", blocking=True, timeout=20)
        assert (request.command, request.param1) == (512, 242)
        vehicle.say([home(rows()[0])])
        until(lambda: feed.knows_home)
        while vehicle.link.recv_match(type="COMMAND_LONG", blocking=False) is not None:
            pass
        again = vehicle.link.recv_match(type="COMMAND_LONG", blocking=True, timeout=20)
        assert again is not None and again.param1 == 242


@pytest.mark.parametrize(("phrase", "taken"), [("kept secret", True), ("guessed", False), (None, False)])
def test_with_a_key_only_signed_telemetry_counts(tmp_path: Path, phrase: str | None, taken: bool) -> None:
    now, port = Now(rows()[0].stamp_ns), port_of()
    with listening(tmp_path, now, port, SEA, mavlink_key="kept secret") as (service, _):
        Vehicle(port, phrase=phrase).say([position(rows()[0]), gimbal(rows()[0])])
        feed = service.live.poses.feeds["uav1"]  # type: ignore[union-attr]
        if taken:
            until(lambda: feed.newest_ns is not None)
        else:
            time.sleep(0.3)
            assert feed.newest_ns is None


def test_other_machines_tell_no_poses_without_a_key() -> None:
    for host in ("0.0.0.0", "192.168.1.4", "::"):
        with pytest.raises(ValueError, match="mavlink-key"):
            TelemetryAddress("uav1", host, 14550).check(has_key=False)
        TelemetryAddress("uav1", host, 14550).check(has_key=True)
    TelemetryAddress("uav1", "127.0.0.1", 14550).check(has_key=False)


def test_a_file_without_a_pass_phrase_is_no_key() -> None:
    """Anybody signs with the hash of nothing, and a port of other machines was opened for it."""
    for phrase in ("", " \n"):
        with pytest.raises(ValueError, match="mavlink-key holds no pass phrase"):
            Inputs(mavlink=[TelemetryAddress("uav1", "0.0.0.0", 14550)], mavlink_key=phrase)


def test_addresses_are_read_and_wrong_ones_refused() -> None:
    assert TelemetryAddress.parse("uav1=udp:127.0.0.1:14550") == TelemetryAddress("uav1", "127.0.0.1", 14550)
    assert TelemetryAddress.parse("a=udp:127.0.0.1:14550:7").system == 7
    wrong = ("udp:127.0.0.1:1", "a=tcp:127.0.0.1:1", "a=udp:here:1", "a=udp:127.0.0.1")
    for text in (*wrong, "a=udp:127.0.0.1:1:0"):
        with pytest.raises(ValueError, match="such as uav1=udp"):
            TelemetryAddress.parse(text)


def test_a_mission_without_a_place_on_earth_takes_no_telemetry() -> None:
    with pytest.raises(ValueError, match="--origin"):
        Telemetry("uav1", ground(), None, SEA)


# --- whose clock ---


@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow])
@given(
    start_ns=st.integers(10**18, 2 * 10**18),
    ways_ns=st.lists(st.tuples(st.integers(0, 10**8), st.integers(0, 10**8)), min_size=1, max_size=24),
)
def test_timesync_is_no_further_off_than_half_the_shortest_way(
    start_ns: int, ways_ns: list[tuple[int, int]]
) -> None:
    clock = BootClock()
    for number, (there, back) in enumerate(ways_ns):
        sent_ns = start_ns + (number + 1) * SECOND_NS
        clock.answered(sent_ns, sent_ns + there - start_ns, sent_ns + there + back)
    assert clock.source == "timesync" and clock.offset_ns is not None
    recent = ways_ns[-16:]
    assert abs(clock.offset_ns - start_ns) <= min(there + back for there, back in recent) / 2 + 1


def test_the_better_source_of_time_counts() -> None:
    clock = BootClock()
    assert clock.offset_ns is None
    for boot, late_ns in ((1000, 80_000_000), (1100, 30_000_000), (1200, 200_000_000)):
        clock.arrived(boot, 5 * SECOND_NS + boot * 1_000_000 + late_ns)
    assert (clock.source, clock.offset_ns) == ("arrival", 5 * SECOND_NS + 30_000_000)
    century = 10**18, 4 * 10**18  # 2001 to 2096
    for no_time in (0, 1_300_000_000, century[0] - 1, century[1], 2**64 - 1):  # no satellites yet
        assert clock.told(no_time, 1300) is False
        assert clock.source == "arrival"
    for time_of_day in (century[1] - 1, century[0]):
        assert clock.told(time_of_day, 1300) is True
        assert (clock.source, clock.offset_ns) == ("system_time", time_of_day - 1_300_000_000)
    clock.answered(10 * SECOND_NS, 4 * SECOND_NS, 10 * SECOND_NS + 2_000_000)
    assert (clock.source, clock.offset_ns) == ("timesync", 6 * SECOND_NS + 1_000_000)
    clock.answered(10 * SECOND_NS, 4 * SECOND_NS, 12 * SECOND_NS)  # two seconds on its way: says nothing
    assert clock.offset_ns == 6 * SECOND_NS + 1_000_000
    assert clock.arrived(1250, 11 * SECOND_NS) is False
    clock.arrived(90_000, 100 * SECOND_NS)
    assert clock.arrived(200, 101 * SECOND_NS)  # the autopilot started anew
    assert (clock.source, clock.offset_ns) == ("arrival", 101 * SECOND_NS - 200_000_000)


def kept_pose(service: Service, stamp_ns: int) -> np.ndarray:
    """As it is on disk, so that a restart needs no telemetry."""
    ((body,),) = service.store.rows(
        "SELECT body FROM journal WHERE kind = 'view' AND stamp_ns = ?", (stamp_ns,)
    )
    return np.array(ViewMessage.model_validate_json(body).world_from_camera)


def newest_ns(service: Service) -> int:
    assert service.live is not None
    return service.live.poses.feeds["uav1"].newest_ns or 0


def active(service: Service) -> set[str | None]:
    return {one.drone for one in service.alerts.all() if one.kind == "pose_gap" and one.cleared_ns is None}


def until(true: Any) -> None:
    for _ in range(2000):
        if true():
            return
        time.sleep(0.01)
    raise TimeoutError("it never became true")
