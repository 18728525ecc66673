"""Data that stops opens nothing, and somebody is told."""

import base64
import io
import json
import shutil
import sqlite3
import time
import zlib
from collections import namedtuple
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from PIL import Image
from shapely import box

from crowdfence import Camera, View, project
from crowdfence.config import EvidenceConfig, RunConfig
from crowdfence.service import intake, watch
from crowdfence.service.clock import Clock
from crowdfence.service.packing import packed, unpacked
from crowdfence.service.service import Service
from crowdfence.service.store import FILE
from crowdfence.service.view_message import ViewMessage
from crowdfence.service.watch import Watch
from crowdfence.sources.recording import Frame
from crowdfence.zones import AltitudeBand, Zone
from support.small_service import (
    CAMERA,
    CONFIG,
    SECOND_NS,
    SETTINGS,
    START_NS,
    asked,
    message,
    plain,
    running,
    settle,
    view,
    views,
)
from support.small_zones import DrawnZones


class Now:
    def __init__(self) -> None:
        self.ns = START_NS
        self.jump_ns = 0

    def clock(self) -> Clock:
        return Clock("system", system=lambda: self.ns + self.jump_ns, steady=lambda: self.ns)


def active(service: Service, kind: str) -> set[tuple[str | None, str | None]]:
    return {
        (alert.drone, alert.zone)
        for alert in service.alerts.all()
        if alert.kind == kind and alert.cleared_ns is None
    }


def test_a_drone_whose_clock_is_behind_is_not_sought_on_its_link(tmp_path: Path) -> None:
    """Its views came, stamped half a minute ago, and the alarm said that none did."""
    now = Now()
    with running(tmp_path, clock=now.clock()) as service:
        watch = Watch(service)
        assert service.live is not None
        now.ns = START_NS + 30 * SECOND_NS
        for _ in range(4):
            now.ns += SECOND_NS
            for drone, behind_s in (("uav1", 0), ("uav2", 30)):
                one = view(drone, 3)
                stamp_ns = now.ns - behind_s * SECOND_NS
                given = View(drone, stamp_ns, one.camera, one.world_from_camera, one.heatmap)
                service.live.intake.give_view(message(given))
            settle(service)
            watch.look()
        alert = service.alerts.active("drone_silent", "uav2")
        assert alert is not None and "one came in that time, 30.0 s after its stamp: the clock" in alert.text
        assert active(service, "drone_silent") == {("uav2", None)}
        now.ns += 6 * SECOND_NS
        watch.look()
        alert = service.alerts.active("drone_silent", "uav1")
        assert alert is not None and "one came" not in alert.text


def test_a_drone_that_falls_silent_is_not_said_to_have_a_wrong_clock(tmp_path: Path) -> None:
    """Its last view came half a second after its stamp, as views do: just after five seconds it is a view
    that came within the last five."""
    now = Now()
    with running(tmp_path, clock=now.clock()) as service:
        watch = Watch(service)
        assert service.live is not None
        one = view("uav1", 3)
        now.ns = one.stamp_ns + SECOND_NS // 2
        service.live.intake.give_view(message(one))
        settle(service)
        now.ns += round(4.8 * SECOND_NS)
        watch.look()
        alert = service.alerts.active("drone_silent", "uav1")
        assert alert is not None and "no view from uav1 for more than 5 s" in alert.text
        assert "clock" not in alert.text and "one came" not in alert.text


def test_silence_is_an_alarm_and_opens_nothing(tmp_path: Path) -> None:
    now = Now()
    with running(tmp_path, clock=now.clock(), drones=("uav1", "uav2", "uav3")) as service:
        watch = Watch(service)
        assert service.live is not None
        for one in views(10):
            now.ns = one.stamp_ns
            service.live.intake.give_view(message(one))
        settle(service)
        watch.look()
        assert active(service, "drone_silent") == set()
        closed = {zone.id: zone.polygon.area for zone in service.mission.newest.zones.closed}
        assert closed
        now.ns += 5 * SECOND_NS
        service.live.intake.give_view(message(view("uav2", 36)))
        now.ns += SECOND_NS
        watch.look()
        assert active(service, "drone_silent") == {("uav1", None), ("uav3", None)}
        # An hour later, with many looks of the clock: all that was closed is closed.
        for _ in range(5):
            now.ns += 720 * SECOND_NS
            watch.look()
            watch.tidy()
        settle(service)
        after = {zone.id: zone.polygon.area for zone in service.mission.newest.zones.closed}
        assert after.keys() >= closed.keys()
        assert all(after[name] >= closed[name] - 1e-6 for name in closed)
        assert active(service, "drone_silent") == {("uav1", None), ("uav2", None), ("uav3", None)}
        with asked(service) as http:
            told = http.get("/api/v1/drones").json()["drones"]
            assert {drone["status"] for drone in told} == {"stale"}


def test_a_drone_that_was_silent_before_a_restart_is_missed_after_it(tmp_path: Path) -> None:
    now = Now()
    with running(tmp_path, clock=now.clock()) as service:
        assert service.live is not None
        for one in views(6):
            now.ns = one.stamp_ns
            service.live.intake.give_view(message(one))
        settle(service)
    now.ns += 30 * SECOND_NS
    with running(tmp_path, clock=now.clock()) as service:
        Watch(service).look()
        assert active(service, "drone_silent") == {("uav1", None), ("uav2", None), ("uav3", None)}


@pytest.mark.parametrize(
    ("east_m", "is_told"),
    [
        (lambda number: 10.0 + 40.0 * (number % 2), True),  # two drones by turns
        (lambda number: 10.0 + 20.0 * (number % 2), False),  # poses that tremble
        (lambda number: 10.0 + 40.0 * (number >= 6), False),  # a position that was reset
        (lambda number: 10.0 + 40.0 * (number == 6), False),  # one wrong fix
        (lambda number: 5.0 * number, False),  # 25 m/s
    ],
)
def test_two_drones_of_one_name_are_an_alarm(
    tmp_path: Path, east_m: Callable[[int], float], is_told: bool
) -> None:
    """Nobody would hear when one of them falls silent."""
    with running(tmp_path) as service:
        watch = Watch(service)
        for number in range(14):
            service.live.intake.give_view(crowd_at("uav1", number, (east_m(number), 30.0, 18.0)))
        service.live.finish()
        watch.look()
        assert active(service, "drone_doubled") == ({("uav1", None)} if is_told else set())
        if is_told:
            (alert,) = [one for one in service.alerts.all() if one.kind == "drone_doubled"]
            assert alert.text.startswith("views of uav1 come from two places 40 m apart by turns")
            for number in range(14, 40):
                service.live.intake.give_view(crowd_at("uav1", number, (30.0, 30.0, 18.0)))
            service.live.finish()
            watch.look()
            assert active(service, "drone_doubled") == set()


def turning_at(number: int, *, reverse: bool, camera: Camera = CAMERA) -> bytes:
    """A camera that looks down by 55 degrees and turns by 10 degrees a second, five views a second."""
    heading, down = np.radians(40.0 + 2.0 * number), np.radians(55.0)
    ahead = np.array([np.sin(heading), np.cos(heading), 0.0])
    right = np.array([np.cos(heading), -np.sin(heading), 0.0])
    forward = np.cos(down) * ahead - np.sin(down) * np.array([0.0, 0.0, 1.0])
    turn = np.column_stack([right, np.cross(forward, right), forward])
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = turn.T if reverse else turn
    world_from_camera[:3, 3] = (30.0, 30.0, 18.0)
    heatmap = np.zeros((12, 16), np.float32)
    return message(View("uav1", START_NS + number * SECOND_NS // 5, camera, world_from_camera, heatmap))


def test_attitudes_the_other_way_round_are_told_until_they_are_set_right(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        watch = Watch(service)

        def fly(numbers: range, *, reverse: bool) -> set[tuple[str | None, str | None]]:
            for number in numbers:
                service.live.intake.give_view(turning_at(number, reverse=reverse))
            service.live.finish()
            watch.look()
            return active(service, "reversed_attitudes")

        assert fly(range(20), reverse=True) == {("uav1", None)}
        (alert,) = [one for one in service.alerts.all() if one.kind == "reversed_attitudes"]
        # asin(cos 55 sin 40) and asin(cos 55 sin 78)
        assert alert.text.startswith(
            "uav1: by its attitudes the camera leans to the side by 22 to 34 degrees"
        )
        assert fly(range(20, 60), reverse=False) == set()


def test_a_lens_that_no_camera_has_is_told(tmp_path: Path) -> None:
    shifted = Camera.pinhole(CAMERA.width, CAMERA.height, CAMERA.fx, CAMERA.fy, 0.8 * CAMERA.width, CAMERA.cy)
    with running(tmp_path) as service:
        watch = Watch(service)
        for number, camera in enumerate((shifted, CAMERA)):
            service.live.intake.give_view(turning_at(number, reverse=False, camera=camera))
            service.live.finish()
            watch.look()
            assert active(service, "doubtful_lens") == ({("uav1", None)} if camera is shifted else set())
        (alert,) = [one for one in service.alerts.all() if one.kind == "doubtful_lens"]
        assert alert.text.startswith("uav1: the principal point (12.8, ")


def observed(drone: str, number: int) -> bytes:
    """What a companion computer gives."""
    return project(view(drone, number), plain(), max_range_m=80.0).to_bytes()


@pytest.mark.parametrize("ends", ["at its end", "by a crash", "on a snapshot of before"])
def test_a_companion_that_falls_silent_is_an_alarm_also_after_a_restart(tmp_path: Path, ends: str) -> None:
    now = Now()
    (tmp_path / "crashed").mkdir()
    with running(tmp_path / "data", clock=now.clock()) as service:
        watch = Watch(service)
        for number in range(6):
            now.ns = view("uav2", number).stamp_ns
            service.live.intake.give_view(message(view("uav1", number)))
            service.live.intake.give_observation(observed("uav2", number))
        settle(service)
        watch.look()
        assert active(service, "drone_silent") == set()
        now.ns += 4 * SECOND_NS
        service.live.intake.give_view(message(view("uav1", 26)))
        now.ns += 2 * SECOND_NS
        watch.look()
        assert active(service, "drone_silent") == {("uav2", None)}
        (alert,) = [one for one in service.alerts.all() if one.kind == "drone_silent"]
        assert (alert.level, alert.text.split(" for ")[0]) == ("alarm", "no view from uav2")
        service.live.intake.give_observation(observed("uav2", 31))
        watch.look()
        assert active(service, "drone_silent") == set()
        settle(service)
        for name in (FILE, f"{FILE}-wal"):  # as a power failure would leave it
            (tmp_path / "crashed" / name).write_bytes((tmp_path / "data" / name).read_bytes())
        service.live.finish()  # nothing waits in the snapshot at the end
    if ends == "on a snapshot of before":
        with sqlite3.connect(tmp_path / "data" / FILE) as connection:
            for seq, body in connection.execute("SELECT seq, body FROM snapshots").fetchall():
                told, mission = unpacked(body)
                of_before = {key: value for key, value in json.loads(told).items() if key != "last_view_ns"}
                body = packed(json.dumps(of_before).encode(), mission)
                connection.execute(
                    "UPDATE snapshots SET body = ?, checksum = ? WHERE seq = ?", (body, zlib.crc32(body), seq)
                )
    now.ns += 30 * SECOND_NS
    with running(tmp_path / ("crashed" if ends == "by a crash" else "data"), clock=now.clock()) as service:
        watch = Watch(service)
        watch.look()
        if ends == "on a snapshot of before":  # that knows who looked, and not when: it has its time to come
            assert active(service, "drone_silent") == {("uav1", None)}
            now.ns += 6 * SECOND_NS
            watch.look()
        assert active(service, "drone_silent") == {("uav1", None), ("uav2", None)}


def test_a_drone_that_is_expected_and_never_comes_is_an_alarm(tmp_path: Path) -> None:
    now = Now()
    with running(tmp_path, clock=now.clock(), drones=("uav1", "uav9")) as service:
        watch = Watch(service)
        now.ns += 4 * SECOND_NS
        watch.look()
        assert active(service, "drone_silent") == set(), "it has its time to come"
        now.ns += 2 * SECOND_NS
        watch.look()
        assert active(service, "drone_silent") == {("uav1", None), ("uav9", None)}
        (alert,) = [one for one in service.alerts.all() if one.drone == "uav9"]
        assert alert.level == "alarm"
        assert alert.text.startswith("no view from uav9 since the start of the service")
        service.live.intake.give_view(message(view("uav1", 25)))
        watch.look()
        assert active(service, "drone_silent") == {("uav9", None)}


def test_with_the_clock_of_the_views_drones_are_expected_from_the_first_view_on(tmp_path: Path) -> None:
    with running(tmp_path, drones=("uav1", "uav9")) as service:
        watch = Watch(service)
        watch.look()
        service.live.intake.give_view(message(view("uav1", 0)))
        settle(service)
        watch.look()
        assert active(service, "drone_silent") == set()
        service.live.intake.give_view(message(view("uav1", 30)))
        settle(service)
        watch.look()
        assert active(service, "drone_silent") == {("uav9", None)}


def test_a_drone_in_a_zone_is_an_alarm_and_one_near_it_a_warning(tmp_path: Path) -> None:
    near = replace(SETTINGS, near_m=6.0)
    with running(tmp_path, settings=near) as service, asked(service) as http:
        watch = Watch(service)
        assert service.live is not None
        service.live.intake.give_view(message(view("uav1", 0)))  # at (14, 20)
        service.live.intake.give_view(message(view("uav1", 10)))
        settle(service)
        at = view("uav1", 0).world_from_camera[:2, 3]
        corners = [[x, y] for x, y in ((at[0] + 4, 0.0), (40.0, 0.0), (40.0, 40.0), (at[0] + 4, 40.0))]
        zone = http.post("/api/v1/zones", json={"polygon": corners, "reason": "stage"}).json()["id"]
        where = service.fleet.last("uav1").world_from_camera[:2, 3]
        assert 0.0 <= corners[0][0] - where[0] <= 6.0
        watch.look()
        assert active(service, "drone_near_zone") == {("uav1", zone)} and not active(service, "drone_in_zone")
        around = [[x, y] for x, y in ((0.0, 0.0), (30.0, 0.0), (30.0, 40.0), (0.0, 40.0))]
        inside = http.post("/api/v1/zones", json={"polygon": around, "reason": "stage"}).json()["id"]
        watch.look()
        assert active(service, "drone_in_zone") == {("uav1", inside)}
        assert not active(service, "drone_near_zone")
        http.post(f"/api/v1/zones/{inside}/dismiss", json={"reason": "wrong"})
        watch.look()
        assert not active(service, "drone_in_zone")


def test_a_zone_that_somebody_acknowledged_hides_no_other_one(tmp_path: Path) -> None:
    """Who may fly in a control zone has acknowledged it once, and hears of every crowd in it all the same."""
    (crowd,) = DrawnZones((1, 1)).drawn("#")
    control = replace(crowd, id="CTR", kind="static", reason="given", polygon=box(-500, -500, 500, 500))
    near = replace(SETTINGS, near_m=6.0)
    with running(tmp_path, settings=near, static_zones=[control]) as service, asked(service) as http:
        looking = Watch(service)
        service.live.intake.give_view(message(view("uav1", 0)))
        service.live.intake.give_view(message(view("uav1", 10)))
        settle(service)
        east, north = service.fleet.last("uav1").world_from_camera[:2, 3]

        def close(west: float, width: float) -> str:
            corners = [
                [west, north - 3],
                [west + width, north - 3],
                [west + width, north + 3],
                [west, north + 3],
            ]
            return str(http.post("/api/v1/zones", json={"polygon": corners, "reason": "stage"}).json()["id"])

        def acknowledge(kind: str, zone: str) -> None:
            service.alerts.acknowledge(service.alerts.active(kind, "uav1", zone).id, "ann", START_NS)
            looking.look()

        looking.look()
        assert active(service, "drone_in_zone") == {("uav1", "CTR")}
        acknowledge("drone_in_zone", "CTR")
        beside = close(east + 4.0, 9.0)
        looking.look()
        assert active(service, "drone_near_zone") == {("uav1", beside)}
        first, second = close(east - 2.0, 5.0), close(east - 1.0, 3.0)
        looking.look()
        assert active(service, "drone_in_zone") == {("uav1", "CTR"), ("uav1", first)}, "one at a time"
        assert not active(service, "drone_near_zone"), "until the worse one was seen"
        acknowledge("drone_in_zone", first)
        assert active(service, "drone_in_zone") == {("uav1", "CTR"), ("uav1", first), ("uav1", second)}
        http.post(f"/api/v1/zones/{first}/dismiss", json={"reason": "wrong"})
        looking.look()
        assert active(service, "drone_in_zone") == {("uav1", "CTR"), ("uav1", second)}


def test_a_drone_whose_pictures_show_nothing_still_is_where_its_pose_says(tmp_path: Path) -> None:
    """A covered lens: its views are refused, and it flies into a zone all the same."""

    def picture(tone: int) -> str:
        texture = np.random.default_rng(1).integers(0, 256, (12, 16, 3), dtype=np.uint8)
        file = io.BytesIO()
        Image.fromarray(texture if tone < 0 else np.full_like(texture, tone)).save(file, format="PNG")
        return base64.b64encode(file.getvalue()).decode()

    def told(number: int, tone: int) -> bytes:
        of_heatmap = ViewMessage.model_validate_json(message(view("uav1", number)))
        as_picture = of_heatmap.model_copy(update={"heatmap": None, "image": picture(tone)})
        return as_picture.model_dump_json().encode()

    def nobody(frame: Frame) -> np.ndarray:
        return np.zeros((3, 4), np.float32)

    with running(tmp_path, detector=nobody) as service, asked(service) as http:
        looking = Watch(service)
        assert service.live is not None
        service.live.intake.give_view(told(0, -1))
        service.live.finish()
        east, north, _ = view("uav1", 40).world_from_camera[:3, 3]
        corners = [[east + x, north + y] for x, y in ((-3.0, -3.0), (3.0, -3.0), (3.0, 3.0), (-3.0, 3.0))]
        zone = http.post("/api/v1/zones", json={"polygon": corners, "reason": "stage"}).json()["id"]
        looking.look()
        assert not active(service, "drone_in_zone")
        service.live.intake.give_view(told(40, 0))
        service.live.finish()
        looking.look()
        assert service.live.heard.refused["uav1"] == 1
        assert active(service, "drone_in_zone") == {("uav1", zone)}
        # What it saw last is still what it saw last.
        (drone,) = (one for one in http.get("/api/v1/drones").json()["drones"] if one["drone"] == "uav1")
        assert drone["stamp_ns"] == str(view("uav1", 0).stamp_ns)


def test_a_zone_bounded_above_the_ellipsoid_counts_at_every_height(tmp_path: Path) -> None:
    """Where the ground lies 90 m below the ellipsoid a zone up to 5 m above it reaches 95 m up."""
    (crowd,) = DrawnZones((1, 1)).drawn("#")
    around = box(0.0, 0.0, 40.0, 40.0)
    alarms = {}
    for datum in ("AGL", "WGS84", "AMSL"):
        band = AltitudeBand(-100.0, 5.0, datum)
        zone = replace(crowd, id="CTR", kind="static", reason="given", polygon=around, band=band)
        with running(tmp_path / datum, static_zones=[zone]) as service:
            assert service.live is not None
            service.live.intake.give_view(message(view("uav1", 0)))
            service.live.intake.give_view(message(view("uav1", 10)))
            settle(service)
            east, north, up = service.fleet.last("uav1").world_from_camera[:3, 3]
            assert up - service.raster.height_at(np.array([[east, north]]))[0] > 5.0
            Watch(service).look()
            alarms[datum] = active(service, "drone_in_zone")
    assert alarms == {"AGL": set(), "WGS84": {("uav1", "CTR")}, "AMSL": {("uav1", "CTR")}}


def test_alerts_are_acknowledged_by_name_and_published(tmp_path: Path) -> None:
    with running(tmp_path) as service, asked(service) as http:
        told = []
        service.alerts.on_change = lambda alert: told.append(
            (alert.id, alert.acknowledged_by, alert.cleared_ns)
        )
        raised = service.alerts.raise_("drone_silent", "alarm", "no view", START_NS, drone="uav1")
        assert service.alerts.raise_("drone_silent", "alarm", "no view", START_NS, drone="uav1") == raised
        answer = http.post(f"/api/v1/alerts/{raised.id}/acknowledge").json()
        assert answer["acknowledged_by"] == "local"
        service.alerts.clear("drone_silent", START_NS + 1, drone="uav1")
        assert told == [
            (raised.id, None, None),
            (raised.id, "local", None),
            (raised.id, "local", START_NS + 1),
        ]
        assert http.post("/api/v1/alerts/A77/acknowledge").status_code == 404


def test_on_a_full_disk_nothing_is_acknowledged_and_the_answer_says_why(tmp_path: Path) -> None:
    """Who saw it could not be written down."""
    with running(tmp_path) as service, asked(service) as http:

        def limit(pages: int):
            return lambda connection: connection.execute(f"PRAGMA max_page_count = {pages}")

        raised = service.alerts.raise_("disk", "alarm", "x" * 6000, START_NS)
        service.store.submit(limit(1)).result()  # not one page more than there are
        answer = http.post(f"/api/v1/alerts/{raised.id}/acknowledge")
        assert answer.status_code == 507 and "full" in answer.json()["detail"]
        assert service.alerts.active("disk").acknowledged_by is None
        service.store.submit(limit(1 << 30)).result()
        assert http.post(f"/api/v1/alerts/{raised.id}/acknowledge").json()["acknowledged_by"] == "local"
        (entry,) = http.get("/api/v1/audit").json()["entries"]
        assert entry["action"] == "acknowledge"


def test_a_clock_that_was_set_is_an_alarm(tmp_path: Path) -> None:
    now = Now()
    with running(tmp_path, clock=now.clock()) as service:
        watch = Watch(service)
        watch.look()
        assert not active(service, "clock")
        now.jump_ns = 3 * SECOND_NS
        watch.look()
        (alert,) = [one for one in service.alerts.all() if one.kind == "clock"]
        assert "+3.0 s" in alert.text


def crowd_at(drone: str, number: int, eye: tuple[float, float, float], value: float = 0.95) -> bytes:
    """A view straight down with a crowd in its middle, five a second."""
    world_from_camera = np.diag([1.0, -1.0, -1.0, 1.0])
    world_from_camera[:3, 3] = eye
    heatmap = np.zeros((12, 16), np.float32)
    heatmap[5:7, 7:9] = value
    return message(
        View(drone, START_NS + number * SECOND_NS // 5, CAMERA, world_from_camera, heatmap),
    )


def test_crowd_that_meets_no_ground_is_an_alarm_also_after_a_long_good_flight(tmp_path: Path) -> None:
    eyes = {
        "good": (30.0, 30.0, 18.0),
        "high": (30.0, 30.0, 118.0),  # ground ends at 80 m
        "rim": (90.0, 30.0, 18.0),
        "down": (30.0, 30.0, -18.0),  # heights count downwards
    }

    def fly(service: Service, instants: range, lost: bool) -> None:
        for number in instants:
            for drone, eye in eyes.items():
                service.live.intake.give_view(crowd_at(drone, number, eye if lost else eyes["good"]))
        settle(service)

    with running(tmp_path) as service, asked(service) as http:
        watch = Watch(service)
        fly(service, range(600), lost=False)
        watch.look()
        assert not active(service, "lost_crowd")
        fly(service, range(600, 604), lost=True)
        watch.look()
        assert active(service, "lost_crowd") == {("high", None), ("rim", None), ("down", None)}
        texts = {one.drone: one.text for one in service.alerts.all() if one.kind == "lost_crowd"}
        assert "of the crowd it shows is not on the map" in texts["high"]
        assert "raise --max-range-m" in texts["high"] and "lies beside the map" in texts["rim"]
        assert "the camera is below the map's ground" in texts["down"]
        assert {one.level for one in service.alerts.all() if one.kind == "lost_crowd"} == {"alarm"}
        metrics = http.get("/metrics").text
        assert 'crowdfence_crowd_mass_total{drone="good",fate="off_map"} 0.0' in metrics
        off_map = 'crowdfence_crowd_mass_total{drone="rim",fate="off_map"} '
        (lost,) = [line for line in metrics.splitlines() if line.startswith(off_map)]
        assert float(lost.removeprefix(off_map)) > 0.0
    with running(tmp_path) as service:
        watch = Watch(service)
        watch.look()
        assert len(active(service, "lost_crowd")) == 3, "a restart mends nothing"
        fly(service, range(604, 610), lost=True)
        watch.look()
        assert len(active(service, "lost_crowd")) == 3
        fly(service, range(610, 670), lost=False)
        watch.look()
        assert not active(service, "lost_crowd")


def test_a_drone_whose_views_show_no_ground_is_told_of_and_one_that_looks_up_for_a_moment_is_not(
    tmp_path: Path,
) -> None:
    """It is not silent, nothing of it is refused, and it shows no crowd that could be lost."""
    above, beside = (30.0, 30.0, 18.0), (300.0, 30.0, 18.0)

    def fly(service: Service, instants: range, eyes: dict[str, tuple[float, float, float]]) -> None:
        for number in instants:
            for drone, eye in eyes.items():
                service.live.intake.give_view(crowd_at(drone, number, eye, 0.0))
        service.live.finish()
        Watch(service).look()

    with running(tmp_path) as service:
        fly(service, range(40), {"past": beside, "away": above})
        assert not active(service, "no_ground"), "8 s are not long enough to tell"
        fly(service, range(40, 60), {"past": beside, "away": beside})
        assert active(service, "no_ground") == {("past", None)}
        (alert,) = [one for one in service.alerts.all() if one.kind == "no_ground"]
        assert "no view of past of the last 10 s shows ground of the map within 80 m" in alert.text
        assert alert.level == "warning"
        fly(service, range(60, 100), {"past": beside, "away": beside})
        assert active(service, "no_ground") == {("past", None), ("away", None)}
    with running(tmp_path) as service:
        fly(service, range(100, 110), {"past": beside})
        assert len(active(service, "no_ground")) == 2, "a restart mends nothing"
        fly(service, range(110, 111), {"past": above})
        assert active(service, "no_ground") == {("away", None)}


@pytest.mark.parametrize(
    ("config", "is_told"),
    [
        (CONFIG, False),
        (replace(CONFIG, zones=replace(CONFIG.zones, threshold=1.0)), True),
        (replace(CONFIG, method=EvidenceConfig(doubt=1e300)), True),
        (replace(CONFIG, zones=replace(CONFIG.zones, threshold=1.0, close_unseen=True)), False),
        (replace(CONFIG, zones=replace(CONFIG.zones, min_area_m2=1e9)), False),
    ],
)
def test_crowd_that_no_setting_lets_become_one_is_an_alarm(
    tmp_path: Path, config: RunConfig, is_told: bool
) -> None:
    """Nothing is closed, and the map looks like that of empty ground. Not where the ground is closed all the
    same, nor where the crowd is too small for a zone, which is told by its area."""
    with running(tmp_path, config=config) as service:
        watch = Watch(service)
        for number in range(15):  # 2.8 s
            service.live.intake.give_view(crowd_at("uav1", number, (30.0, 30.0, 18.0)))
        settle(service)
        watch.look()
        assert not active(service, "unheeded_crowd"), "it may still become one"
        for number in range(15, 20):
            service.live.intake.give_view(crowd_at("uav1", number, (30.0, 30.0, 18.0)))
        service.live.finish()
        watch.look()
        assert active(service, "unheeded_crowd") == ({(None, None)} if is_told else set())
        if not is_told:
            return
        (alert,) = [one for one in service.alerts.all() if one.kind == "unheeded_crowd"]
        # The middle 2 x 2 pixels of 1.5 m on the ground each.
        assert "every look of uav1 shows crowd on 9 m" in alert.text, alert.text
        assert "around 30 m east and 30 m north" in alert.text
        assert f"none of it reaches P >= {service.mission.threshold:.3g}" in alert.text
        assert alert.level == "alarm"
    with running(tmp_path, config=config) as service:
        watch = Watch(service)
        watch.look()
        assert active(service, "unheeded_crowd"), "a restart mends nothing"
        for number in range(21, 40):
            service.live.intake.give_view(crowd_at("uav1", number, (30.0, 30.0, 18.0), 0.0))
        service.live.finish()
        watch.look()
        assert not active(service, "unheeded_crowd"), "a look shows none there"


def test_a_restart_does_not_take_back_crowd_for_which_nothing_is_closed(tmp_path: Path) -> None:
    """Three seconds of looks at other ground did."""
    config = replace(CONFIG, zones=replace(CONFIG.zones, threshold=1.0))
    with running(tmp_path, config=config) as service:
        for number in range(20):
            service.live.intake.give_view(crowd_at("uav1", number, (30.0, 30.0, 18.0)))
        service.live.finish()
        Watch(service).look()
        assert active(service, "unheeded_crowd")
    with running(tmp_path, config=config) as service:
        for number in range(21, 45):
            service.live.intake.give_view(crowd_at("uav2", number, (12.0, 10.0, 18.0), 0.0))
        service.live.finish()
        Watch(service).look()
        assert active(service, "unheeded_crowd"), "nobody looked there"
        for number in range(45, 48):
            service.live.intake.give_view(crowd_at("uav2", number, (30.0, 30.0, 18.0), 0.0))
        service.live.finish()
        Watch(service).look()
        assert not active(service, "unheeded_crowd"), "a look shows none there"


def test_false_alarms_that_do_not_last_are_no_unheeded_crowd(tmp_path: Path) -> None:
    """At each look somewhere, and at one place at every other look."""
    config = replace(CONFIG, zones=replace(CONFIG.zones, threshold=1.0))
    random = np.random.default_rng(5)
    world_from_camera = np.diag([1.0, -1.0, -1.0, 1.0])
    world_from_camera[:3, 3] = (30.0, 30.0, 18.0)
    with running(tmp_path, config=config) as service:
        watch = Watch(service)
        for number in range(60):
            heatmap = np.zeros((12, 16), np.float32)
            heatmap[random.integers(12), random.integers(16)] = 0.95
            heatmap[6, 8] = 0.95 * (number % 2)
            stamp_ns = START_NS + number * SECOND_NS // 5
            service.live.intake.give_view(message(View("uav1", stamp_ns, CAMERA, world_from_camera, heatmap)))
            if number % 10 == 9:
                settle(service)
                watch.look()
        assert not [one for one in service.alerts.all() if one.kind == "unheeded_crowd"]


def beside_the_map(number: int, columns: int) -> bytes:
    """A view full of crowd, of whose 16 columns so many look past the eastern rim; 1.5 m of ground each."""
    world_from_camera = np.diag([1.0, -1.0, -1.0, 1.0])
    world_from_camera[:3, 3] = (48.0 + 1.5 * columns, 30.0, 18.0)
    crowd = np.full((12, 16), 0.95, np.float32)
    return message(View("uav1", START_NS + number * SECOND_NS // 5, CAMERA, world_from_camera, crowd))


def test_lost_crowd_that_somebody_acknowledged_is_told_again_once_it_has_doubled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, "_EVERY_S", 3600.0)  # it looks when the test does
    flown = 0

    def lose(service: Service, columns: int) -> list[tuple[str, str, bool]]:
        """11 s of it, shares are of 10 s; the alarms that are not over: id, share, acknowledged."""
        nonlocal flown
        for number in range(flown, flown + 55):
            service.live.intake.give_view(beside_the_map(number, columns))
        flown += 55
        settle(service)
        Watch(service).look()
        return [
            (one.id, one.text.split()[1], one.acknowledged_by is not None)
            for one in service.alerts.all()
            if one.kind == "lost_crowd" and one.cleared_ns is None
        ]

    with running(tmp_path) as service:
        [(first, share, _)] = lose(service, 2)
        assert share == "12.5%"  # 2 / 16
        service.alerts.acknowledge(first, "ann", START_NS)
        assert lose(service, 2) == [(first, "12.5%", True)]
        assert lose(service, 3) == [(first, "12.5%", True)], "18.75 % is not twice as much"
    with running(tmp_path) as service:
        [(second, share, seen)] = lose(service, 5)
        assert (second != first, share, seen) == (True, "31.2%", False)
        assert service.alerts.named(first).cleared_ns is not None, "one alarm, not two, for one drone"
        assert lose(service, 11) == [(second, "68.8%", False)], "nobody saw the smaller share yet"
        service.alerts.acknowledge(second, "ann", START_NS)
        assert lose(service, 12) == [(second, "68.8%", True)]


def test_a_video_that_stands_still_while_its_drone_flies_is_an_alarm(tmp_path: Path) -> None:
    """Two metres from one view to the next, and the picture of before."""

    def given(service: Service, numbers: range, seed: int | None) -> set[tuple[str | None, str | None]]:
        assert service.live is not None
        for number in numbers:
            one = view("uav1", number)
            if seed is not None:
                frozen = np.random.default_rng(seed).uniform(0.0, 0.4, (12, 16)).astype(np.float32)
                one = View(one.drone, one.stamp_ns, CAMERA, one.world_from_camera, frozen)
            service.live.intake.give_view(message(one))
        service.live.finish()
        Watch(service).look()
        return active(service, "detector_stale")

    with running(tmp_path) as service:
        assert not given(service, range(0, 20, 5), None)
        assert not given(service, range(20, 35, 5), 1)
        assert given(service, range(35, 40, 5), 1) == {("uav1", None)}
        (alert,) = [one for one in service.alerts.all() if one.kind == "detector_stale"]
        assert alert.level == "alarm" and "its video stands still, its views are refused" in alert.text
        assert service.live is not None and service.live.heard.refused["uav1"] == 3
    with running(tmp_path) as service:
        assert given(service, range(40, 45, 5), 1) == {("uav1", None)}, "a restart mends nothing"
        assert service.live is not None and service.live.heard.refused["uav1"] == 1
        assert not given(service, range(45, 50, 5), None)


def test_a_detector_that_does_not_answer_is_an_alarm_and_holds_up_no_reader(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, "_DETECTOR_STALE_S", 0.0)
    monkeypatch.setattr(intake, "_DECIDED_WITHIN_S", 0.1)
    asked_for, may_answer = Event(), Event()

    def detector(frame):
        asked_for.set()
        may_answer.wait(60.0)
        return np.zeros((3, 4), np.float32)

    file = io.BytesIO()
    Image.fromarray(np.full((12, 16, 3), 200, np.uint8)).save(file, format="PNG")
    with running(tmp_path, detector=detector) as service, asked(service) as http:
        assert service.live is not None
        for number in range(10):
            one = view("uav1", number)
            told = ViewMessage.model_validate_json(message(one)).model_copy(
                update={"heatmap": None, "image": base64.b64encode(file.getvalue()).decode()}
            )
            service.live.intake.give_view(told.model_dump_json().encode())
        assert asked_for.wait(60.0)
        looking = Watch(service)
        looking.look()
        assert active(service, "detector_stale") == {(None, None)}
        for _ in range(20):  # while the map waits for the first picture
            assert service.mission.lock.acquire(timeout=5.0)
            service.mission.lock.release()
            time.sleep(0.01)
        # What an operator does comes after the pictures, and is not lost.
        around = [[0.0, 0.0], [30.0, 0.0], [30.0, 40.0]]
        answer = http.post("/api/v1/zones", json={"polygon": around, "reason": "stage"})
        assert answer.status_code == 503 and "will be done" in answer.json()["detail"]
        may_answer.set()
        settle(service)
        ended = time.monotonic() + 60.0
        # The watch of the service itself may just be saying what it saw before.
        while active(service, "detector_stale"):
            assert time.monotonic() < ended
            looking.look()
            time.sleep(0.01)
        assert [zone["kind"] for zone in http.get("/api/v1/zones").json()["zones"]] == ["operator"]


def test_a_map_that_cannot_keep_up_with_the_views_is_an_alarm(tmp_path: Path) -> None:
    """Each view is acknowledged at once, and none is refused."""
    with running(tmp_path, settings=replace(SETTINGS, silent_after_s=0.4)) as service:
        assert service.live is not None
        watch, flown = Watch(service), views(6)
        with service.mission.lock:  # the map takes nothing in
            for one in flown:
                service.live.intake.give_view(message(one))
            watch.look()
            assert not active(service, "map_behind")
            time.sleep(0.6)
            watch.look()
            (alert,) = [one for one in service.alerts.all() if one.kind == "map_behind"]
            assert alert.level == "alarm" and "wait for 1 s" in alert.text
            time.sleep(1.2)
            watch.look()
            assert "wait for 2 s" in service.alerts.active("map_behind").text, "it became worse"
        settle(service)
        assert service.live.applying.behind_s == 0.0, "the last ones wait for company, not for their turn"


def test_a_disk_that_fills_up_is_an_alarm_before_it_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = 10**12
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(0, 0, free))
    with running(tmp_path) as service:
        looking = Watch(service)
        looking.look()
        assert not active(service, "disk")
        free = 150_000_000
        looking.look()
        (alert,) = [one for one in service.alerts.all() if one.kind == "disk"]
        assert alert.level == "alarm" and "150 MB" in alert.text
        service.alerts.acknowledge(alert.id, "ann", START_NS)
        service.store_trouble = "database or disk is full"
        looking.look()
        full = service.alerts.active("disk")
        assert full.acknowledged_by is None, "that views are refused is not what somebody acknowledged"
        assert full.text == "nothing can be written, views are refused: database or disk is full"
        service.store_trouble = None
        free = 10**12
        looking.look()
        assert not active(service, "disk")


def test_pictures_and_history_stay_within_their_room(tmp_path: Path) -> None:
    small = replace(SETTINGS, keep_media_mb=0.02, keep_s=2.0)
    with running(tmp_path, settings=small) as service:
        assert service.live is not None
        for one in views(40):
            service.live.intake.give_view(message(one))
        settle(service)
        for number in range(50):
            service.media.keep("picture", "uav1", START_NS + 7 * SECOND_NS + number, bytes(1000))
        Watch(service).tidy()
        service.store.flush()
        ((size,),) = service.store.rows("SELECT SUM(LENGTH(body)) FROM media")
        assert 0 < size <= 20_000
        newest = service.mission.newest
        assert newest is not None
        ((oldest,),) = service.store.rows("SELECT MIN(stamp_ns) FROM moments WHERE NOT whole")
        assert oldest is None or oldest > START_NS
        # What is left can still be read.
        assert service.mission.timeline.at(newest.stamp_ns).number == newest.number


def test_a_mission_began_when_it_did_also_once_its_beginning_is_forgotten(tmp_path: Path) -> None:
    """`fence watch` tells another mission by it, which was an alarm each minute from the second day on."""
    small = replace(SETTINGS, keep_media_mb=0.02, keep_s=2.0)
    began = []
    flown = views(140)
    for part in (flown[:240], flown[240:]):  # with a restart in between
        with running(tmp_path, settings=small) as service, asked(service) as http:
            assert service.live is not None
            for one in part:
                service.live.intake.give_view(message(one))
            settle(service)
            began.append(http.get("/api/v1/scene").json()["first_stamp_ns"])
            Watch(service).tidy()
            service.store.flush()
            ((first,),) = service.store.rows("SELECT MIN(number) FROM moments")
            assert first > 1, "the beginning is forgotten"
            began.append(http.get("/api/v1/scene").json()["first_stamp_ns"])
    assert began == [began[0]] * 4 and int(began[0]) < START_NS + SECOND_NS


def test_the_history_of_thousands_of_zones_stays_within_its_room(tmp_path: Path) -> None:
    """A hundred kilobytes an instant: of 2000 zones of others it filled the disk within hours."""
    theirs = [
        Zone.of_no_look(f"S{number}", box(number, 0, number + 1, 1), "static", "given")
        for number in range(200)
    ]
    with running(tmp_path, static_zones=theirs, settings=replace(SETTINGS, keep_media_mb=0.06)) as service:
        assert service.live is not None
        for one in views(130):
            service.live.intake.give_view(message(one))
        settle(service)

        def kept() -> tuple[int, int]:
            sizes = "SELECT COUNT(*), SUM(LENGTH(line) + LENGTH(marks) + LENGTH(figures)) FROM moments"
            return service.store.rows(sizes)[0]

        count, size = kept()
        assert size > 150_000
        Watch(service).tidy()
        service.store.flush()
        fewer, size = kept()
        # The room, and as far as to the one before that has all outlines, which the others are read from:
        # 50 moments of 1 kB and the 200 outlines of 60 bytes.
        assert 50 <= fewer < count and size <= 60_000 + 62_000
        newest = service.mission.newest
        assert newest is not None
        assert len(service.mission.timeline.at(newest.stamp_ns).zones.static) == 200


def test_alerts_that_are_over_are_forgotten_with_the_rest_of_the_history(tmp_path: Path) -> None:
    small = replace(SETTINGS, keep_s=10.0)
    with running(tmp_path, settings=small) as service:
        assert service.live is not None
        service.live.intake.give_view(message(view("uav1", 0)))
        settle(service)
        for number in range(5):
            service.alerts.raise_("new_zone", "info", "over", START_NS + number, zone=f"Z{number}")
            service.alerts.clear("new_zone", START_NS + number + 1, zone=f"Z{number}")
        service.alerts.raise_("drone_silent", "alarm", "not over", START_NS, drone="uav9")
        service.alerts.raise_("new_zone", "info", "the newest", START_NS + 9, zone="Z9")
        service.live.intake.give_view(message(view("uav1", 300)))  # a minute later
        settle(service)
        Watch(service).tidy()
        service.store.flush()
        kept = [json.loads(body)["text"] for (body,) in service.store.rows("SELECT body FROM alerts")]
        assert sorted(kept) == ["not over", "the newest"]
    with running(tmp_path, settings=small) as service:
        assert service.alerts.raise_("disk", "alarm", "next", START_NS).id == "A8"


def test_a_thousand_small_alerts_cover_up_no_alarm(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        alerts = service.alerts
        alarm = alerts.raise_("drone_in_zone", "alarm", "uav1 is in zone Z1", 1, drone="uav1", zone="Z1")
        alerts.clear("drone_in_zone", 2, drone="uav1", zone="Z1")
        for number in range(1500):
            alerts.raise_("new_zone", "info", "appeared", 3 + number, zone=f"Z{number}")
        there = alerts.all()
        assert len(there) == 1000 and [one for one in there if one.id == alarm.id]
        alerts.acknowledge(alarm.id, "ana", 5000)
        alerts.raise_("new_zone", "info", "appeared", 5001, zone="ZZ")
        assert len(alerts.all()) == 1000 and alarm.id not in {one.id for one in alerts.all()}


def test_counts_for_prometheus(tmp_path: Path) -> None:
    with running(tmp_path) as service, asked(service) as http:
        for one in views(6):
            http.post("/api/v1/views", content=message(one))
        http.post("/api/v1/views", content=message(views(1)[0]))  # again
        settle(service)
        text = http.get("/metrics").text
        assert 'crowdfence_views_accepted_total{drone="uav1"} 6.0' in text
        assert "crowdfence_acknowledge_seconds_count 18.0" in text
        assert 'crowdfence_publish_seconds_bucket{le="+Inf"}' in text


def test_the_watch_survives_its_own_mistakes_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, "_EVERY_S", 0.02)

    def until(is_so) -> bool:
        give_up_s = time.monotonic() + 20.0
        while not is_so() and time.monotonic() < give_up_s:
            time.sleep(0.02)
        return is_so()

    with running(tmp_path) as service:
        with monkeypatch.context() as failing:
            failing.setattr(watch.Watch, "look", lambda self: {}["mistake"])
            assert until(lambda: service.alerts.active("watch_failed") is not None)
        assert until(lambda: service.alerts.active("watch_failed") is None), "it goes on"
