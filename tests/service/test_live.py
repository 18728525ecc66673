"""What live views meet: late ones, wrong clocks, floods, full disks, detectors that fail."""

import base64
import io
import json
import shutil
import sqlite3
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Barrier, Event, Thread
from time import monotonic, sleep
from urllib.parse import quote

import numpy as np
import pytest
from httpx import Response
from PIL import Image

from crowdfence import Camera, CrowdMap, View, project
from crowdfence.config import PaperConfig
from crowdfence.service.clock import Clock
from crowdfence.service.gate import Refused
from crowdfence.service.guard import Rate
from crowdfence.service.inputs import Inputs
from crowdfence.service.journal import Record
from crowdfence.service.live import Live
from crowdfence.service.service import Service
from crowdfence.service.store import FILE
from crowdfence.service.ticker import Ticker
from crowdfence.service.view_message import CameraMessage, HeatmapMessage, ViewMessage
from crowdfence.service.watch import Watch
from support.small_service import (
    CAMERA,
    CONFIG,
    DRONES,
    SECOND_NS,
    SETTINGS,
    START_NS,
    asked,
    message,
    plain,
    pose,
    running,
    settle,
    stamp_ns,
    view,
    views,
)

FINE_CAMERA = Camera.pinhole(160, 120, 120.0, 120.0, 80.0, 60.0)
FLEET_OF_TWO = replace(CONFIG, method=PaperConfig(fleet_size=2))


def live_of(service: Service) -> Live:
    assert service.live is not None
    return service.live


def at(drone: str, stamp_ns: int) -> bytes:
    """A view of this stamp."""
    one = view("uav1", 3)
    return message(View(drone, stamp_ns, one.camera, one.world_from_camera, one.heatmap))


class Now:
    """Clocks that a test sets."""

    def __init__(self, now_ns: int) -> None:
        self.system_ns = self.steady_ns = now_ns

    def clock(self) -> Clock:
        return Clock("system", system=lambda: self.system_ns, steady=lambda: self.steady_ns)

    def pass_s(self, seconds: float) -> None:
        self.system_ns += round(seconds * SECOND_NS)
        self.steady_ns += round(seconds * SECOND_NS)


def test_a_view_twice_is_one_view(tmp_path: Path) -> None:
    with running(tmp_path) as service, asked(service) as http:
        first = http.post("/api/v1/views", content=at("uav1", START_NS))
        again = http.post("/api/v1/views", content=at("uav1", START_NS))
        assert (first.status_code, again.status_code) == (202, 200)
        assert again.json() == {"accepted": first.json()["accepted"], "duplicate": True}
        settle(service)
        live_of(service).finish()
        assert service.mission.loop.crowd_map.instant_count == 1


def test_a_late_view_counts_with_its_age(tmp_path: Path) -> None:
    """It comes 2 s after newer ones: in the map it is a look of its own stamp, and it is counted."""
    with running(tmp_path) as service:
        live = live_of(service)
        live.intake.give_view(at("uav1", START_NS + 2 * SECOND_NS))
        live.intake.give_view(at("uav1", START_NS + 3 * SECOND_NS))
        settle(service)
        moved = view("uav3", 0)
        live.intake.give_view(message(View("uav3", START_NS, CAMERA, moved.world_from_camera, moved.heatmap)))
        settle(service)
        crowd_map = service.mission.loop.crowd_map
        seen = project(moved, plain(), max_range_m=80.0).voxel_ids
        looks = crowd_map.last_seen_ns(seen)
        assert (looks == START_NS).any() and set(looks.tolist()) <= {START_NS, START_NS + 2 * SECOND_NS}
        assert live.heard.late == {"uav3": 1}


def test_a_wrong_clock_is_refused_and_told_and_the_others_go_on(tmp_path: Path) -> None:
    now = Now(START_NS)
    with running(tmp_path, clock=now.clock()) as service, asked(service) as http:
        assert http.post("/api/v1/views", content=at("uav1", START_NS)).status_code == 202
        for off_s, words in ((-3600, "3600.0 s behind the clock"), (60, "60.0 s ahead of the clock")):
            answer = http.post("/api/v1/views", content=at("uav2", START_NS + off_s * SECOND_NS))
            assert answer.status_code == 422 and words in answer.json()["detail"]
        (alert,) = [one for one in service.alerts.all() if one.kind == "clock"]
        assert (alert.level, alert.drone, alert.cleared_ns) == ("alarm", "uav2", None)
        now.pass_s(11.0)
        assert http.post("/api/v1/views", content=at("uav2", now.system_ns)).status_code == 202
        assert service.alerts.active("clock", "uav2") is None


def test_a_clock_at_the_bound_is_one_alarm(tmp_path: Path) -> None:
    """A clock that drifts is at it for half an hour: of ten views a second every other one is refused, and a
    thousand alarms would push out those that nobody has looked at yet."""
    now = Now(START_NS)
    with running(tmp_path, clock=now.clock()) as service:
        intake = live_of(service).intake

        def clocks() -> list[tuple[bool, bool]]:
            """Newest first: still active, acknowledged."""
            found = [one for one in service.alerts.all() if one.kind == "clock"]
            return [(one.cleared_ns is None, one.acknowledged_by is not None) for one in found]

        def fly(seconds: float, *ahead_s: float) -> None:
            for number in range(round(10 * seconds)):
                now.pass_s(0.1)
                stamp = now.system_ns + round(ahead_s[number % len(ahead_s)] * SECOND_NS)
                with suppress(Refused):
                    intake.give_view(at("uav1", stamp))

        fly(6.0, 1.95, 2.05)
        assert clocks() == [(True, False)]
        alarm = service.alerts.active("clock", "uav1")
        assert alarm is not None
        service.alerts.acknowledge(alarm.id, "ops", now.system_ns)
        fly(6.0, 1.95, 2.05)
        assert clocks() == [(True, True)], "who has seen it is not called again"
        fly(9.0, 1.9)
        assert clocks() == [(True, True)]
        fly(2.0, 1.9)
        assert clocks() == [(False, True)]
        fly(1.0, 2.05)
        assert clocks() == [(True, False), (False, True)], "another time is another alarm"


def test_views_that_can_be_used_by_turns_are_one_warning(tmp_path: Path) -> None:
    """A detector that keeps up with every other picture, a link that damages them."""
    with running(tmp_path, settings=replace(SETTINGS, max_delay_ms=0.0)) as service:
        live, take_in = live_of(service), service.mission.loop.step

        def failing(*what):
            raise MemoryError("no room")

        for number in range(20):
            service.mission.loop.step = take_in if number % 2 else failing  # type: ignore[method-assign]
            live.intake.give_view(message(view("uav1", number)))
            live.finish()
        (told,) = [one for one in service.alerts.all() if one.kind == "refused_views"]
        assert told.cleared_ns is None and live.heard.refused == {"uav1": 10}


NOW_S = START_NS // SECOND_NS


@pytest.mark.parametrize(
    ("per_second", "period_s", "unit", "apart_ms"),
    [
        (10**6, 0.2, "microseconds", "0.2"),
        (10**6, 3.0, "microseconds", "3"),
        (10**3, 10.0, "milliseconds", "0.01"),
        (1, 2000.0, "seconds", "0.002"),
    ],
)
def test_stamps_in_another_unit_are_refused_on_the_clock_of_the_views(
    tmp_path: Path, per_second: int, period_s: float, unit: str, apart_ms: str
) -> None:
    """Else its time would run a thousand times too slowly, and what was seen once would stay open."""
    stamps = [NOW_S * per_second + round(k * period_s * per_second) for k in range(60)]
    with running(tmp_path) as service, asked(service) as http:
        answers = [http.post("/api/v1/views", content=at("uav1", stamp)) for stamp in stamps]
        assert [answer.status_code for answer in answers] == [202] + [422] * 59, "one alone tells nothing"
        said = f"the stamps of uav1 look like {unit}, not nanoseconds: "
        for answer in answers[1:]:
            told = answer.json()["detail"]
            assert told.startswith(said) and f" {apart_ms} ms apart" in told
            assert told.endswith(f"multiply them by {10**9 // per_second}")
        (alert,) = [one for one in service.alerts.all() if one.kind == "clock"]
        assert (alert.level, alert.drone, alert.cleared_ns) == ("alarm", "uav1", None)
        assert unit in alert.text


def test_a_slow_camera_in_microseconds_is_taken_and_doubted(tmp_path: Path) -> None:
    """Every 10 s: as far apart as frames of a fast camera, by a clock that would run since 20 days."""
    with running(tmp_path) as service:
        for k in range(9):
            live_of(service).intake.give_view(at("uav1", NOW_S * 10**6 + k * 10**7))
        (alert,) = [one for one in service.alerts.all() if one.kind == "clock"]
        assert alert.cleared_ns is None and "20 days into 1970; if they are microseconds" in alert.text


@pytest.mark.parametrize("start_s", [0.0, 1.5, 1500.0, float(NOW_S)])
def test_fast_cameras_bursts_and_doubles_are_no_other_unit(tmp_path: Path, start_s: float) -> None:
    """On clocks of simulations, whose stamps pass through the numbers of the other units."""
    first = round(start_s * SECOND_NS)
    frames = [first + round(k / 240 * SECOND_NS) for k in range(24)]
    burst = [first + SECOND_NS + k * 200_000_000 for k in (0, 3, 1, 2, 4)]
    with running(tmp_path) as service, asked(service) as http:
        for stamp in (*frames, *burst):
            assert http.post("/api/v1/views", content=at("uav1", stamp)).status_code == 202
            assert http.post("/api/v1/views", content=at("uav1", stamp)).status_code == 200
        assert not [one for one in service.alerts.all() if one.kind == "clock"]


@pytest.mark.parametrize(
    ("stamp", "hint"),
    [
        (NOW_S, "looks like seconds since 1970: stamps are nanoseconds, multiply by 1000000000"),
        (NOW_S * 10**3, "looks like milliseconds since 1970: stamps are nanoseconds, multiply by 1000000"),
        (NOW_S * 10**6, "looks like microseconds since 1970: stamps are nanoseconds, multiply by 1000"),
        (START_NS - 3600 * SECOND_NS, "at most 60 s are taken"),
        (NOW_S * 10**5, "at most 60 s are taken"),
    ],
)
@pytest.mark.parametrize("kind", ["system", "views"])
def test_a_stamp_that_is_far_off_says_which_unit_it_looks_like(
    tmp_path: Path, stamp: int, hint: str, kind: str
) -> None:
    clock = Now(START_NS).clock() if kind == "system" else Clock("views")
    with running(tmp_path, clock=clock) as service:
        live_of(service).intake.give_view(at("uav1", START_NS))
        settle(service)
        with pytest.raises(Refused, match=f"{hint}$"):
            live_of(service).intake.give_view(at("uav2", stamp))
        (alert,) = [one for one in service.alerts.all() if one.kind == "clock"]
        assert alert.text.endswith(hint)


@pytest.mark.parametrize(
    ("off_ns", "words"),
    [
        (2_049_000_000, "is 2.05 s ahead of the clock of the service; at most 2 s are taken"),
        (2_000_000_001, "is 2.000000001 s ahead of the clock of the service; at most 2 s are taken"),
        (2_100_000_000, "is 2.1 s ahead of the clock of the service; at most 2 s are taken"),
        (-60_004_000_000, "is 60.004 s behind the clock of the service; at most 60 s are taken"),
    ],
)
def test_what_is_just_beyond_what_is_taken_is_told_as_more(tmp_path: Path, off_ns: int, words: str) -> None:
    with running(tmp_path, clock=Now(START_NS).clock()) as service, pytest.raises(Refused, match=words):
        live_of(service).intake.give_view(at("uav1", START_NS + off_ns))


@pytest.mark.parametrize("restarted", [False, True])
def test_a_stamp_that_moves_the_clock_of_the_views_is_told_of_the_drone_that_gave_it(
    tmp_path: Path, restarted: bool
) -> None:
    """One stamp of uav3, 50 minutes ahead: the alarm named uav1 and uav2, whose clocks are right."""
    ahead_ns = START_NS + 3000 * SECOND_NS
    with running(tmp_path) as service:
        for drone, stamp in (("uav1", START_NS), ("uav2", START_NS + SECOND_NS), ("uav3", ahead_ns)):
            live_of(service).intake.give_view(at(drone, stamp))
            settle(service)
        if not restarted:
            _uav3_is_told(service)
    if restarted:
        with running(tmp_path) as service:
            _uav3_is_told(service)


def _uav3_is_told(service: Service) -> None:
    stamp = START_NS + 10 * SECOND_NS
    for drone, of in (("uav1", "of uav3"), ("uav2", "of uav3"), ("uav3", "its own")):
        words = (
            f"{drone} is 2990.0 s behind the clock of the service, which is the newest stamp, {of}; at most"
        )
        with pytest.raises(Refused, match=words):
            live_of(service).intake.give_view(at(drone, stamp))
    (alert,) = [one for one in service.alerts.all() if one.kind == "clock"]
    assert (alert.drone, alert.level) == ("uav3", "alarm")
    assert "uav3 stamps 2999.0 s later than any other drone" in alert.text


def test_on_the_clock_of_the_views_a_drone_behind_all_others_is_told_itself(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        for drone in ("uav1", "uav2"):
            live_of(service).intake.give_view(at(drone, START_NS + 3000 * SECOND_NS))
        settle(service)
        with pytest.raises(
            Refused, match="uav3 is 3000.0 s behind the clock .* the newest stamp, of uav[12];"
        ):
            live_of(service).intake.give_view(at("uav3", START_NS))
        (alert,) = [one for one in service.alerts.all() if one.kind == "clock"]
        assert alert.drone == "uav3"


def test_a_fleet_that_was_away_for_days_is_taken_again(tmp_path: Path) -> None:
    now = Now(START_NS)
    with running(tmp_path, clock=now.clock()) as service:
        live = live_of(service)
        live.intake.give_view(at("uav1", START_NS))
        now.pass_s(3 * 86_400.0)
        returned_ns = START_NS + 3 * 86_400 * SECOND_NS
        live.intake.give_view(at("uav1", returned_ns))
        live.finish()
        assert service.mission.loop.crowd_map.span_ns == (START_NS, returned_ns)
        assert service.alerts.active("refused_views") is None


@pytest.mark.parametrize("first", ["views", "observations"])
def test_a_view_and_an_observation_of_one_drone_and_stamp_are_one_look(tmp_path: Path, first: str) -> None:
    one = view("uav1", 0)
    bodies = {
        "views": message(one),
        "observations": project(one, plain(), max_range_m=80.0).to_bytes(),
    }
    second = ({*bodies} - {first}).pop()
    with running(tmp_path) as service, asked(service) as http:
        assert http.post(f"/api/v1/{first}", content=bodies[first]).status_code == 202
        answer = http.post(f"/api/v1/{second}", content=bodies[second])
        said = f"uav1 gave its {first[:-1]} of {one.stamp_ns} before; that one counts"
        assert (answer.status_code, answer.json()["detail"]) == (409, said)
        live_of(service).finish()
        assert service.mission.loop.crowd_map.instant_count == 1


def test_a_jump_of_the_machines_clock_moves_nothing_and_is_told(tmp_path: Path) -> None:
    now = Now(START_NS)
    clock = now.clock()
    now.pass_s(5.0)
    assert clock.now_ns() == START_NS + 5 * SECOND_NS and clock.jumped_ns() == 0
    now.system_ns -= 3600 * SECOND_NS
    assert clock.now_ns() == START_NS + 5 * SECOND_NS and clock.jumped_ns() == -3600 * SECOND_NS


def test_a_flood_from_one_drone_stops_only_that_drone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The map is held up: ten views of the flood wait, the rest is told to come again, others still enter."""
    tight = replace(SETTINGS, waiting_per_drone=10)
    with running(tmp_path, settings=tight) as service, asked(service) as http:
        goes_on, gathering = Event(), live_of(service).applying.gathering
        push = gathering.push

        def held_up(arrival):
            goes_on.wait(60.0)
            return push(arrival)

        monkeypatch.setattr(gathering, "push", held_up)
        answers = [http.post("/api/v1/views", content=at("uav1", START_NS + number)) for number in range(12)]
        other = http.post("/api/v1/views", content=at("uav2", START_NS))
        goes_on.set()
        assert [answer.status_code for answer in answers] == [202] * 10 + [429] * 2
        assert answers[-1].headers["retry-after"] == "1"
        assert other.status_code == 202
        told = [one for one in service.alerts.all() if one.kind == "refused_views"]
        assert [(one.level, one.drone) for one in told] == [("warning", "uav1")]
        assert told[0].text.startswith("views of uav1 are refused: 10 of them wait to be taken in")
        settle(service)
        assert http.post("/api/v1/views", content=at("uav1", START_NS + 99)).status_code == 202


def test_a_map_that_is_behind_has_room_for_one_view_of_each_drone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """16 views of each drone waited before a slow detector: its zones were 24 s old, and stayed so."""
    monkeypatch.setattr("crowdfence.service.gate._MORE_ROOM_EVERY_S", 600.0)
    settings = replace(SETTINGS, turn_within_s=0.3)
    with running(tmp_path, settings=settings, clock=Now(START_NS).clock()) as service:
        live = live_of(service)
        goes_on, push = Event(), live.applying.gathering.push

        def held_up(arrival):
            goes_on.wait(60.0)
            return push(arrival)

        def give(drone: str, number: int) -> int:
            try:
                return live.intake.give_view(at(drone, START_NS + number)).seq
            except Refused as refused:
                assert refused.again_s > 0.0
                return refused.status

        monkeypatch.setattr(live.applying.gathering, "push", held_up)
        assert [give("uav1", number) for number in range(4)] == [1, 2, 3, 4], "it is not behind yet"
        sleep(0.5)
        assert [give("uav1", 4), give("uav2", 0), give("uav2", 1), give("uav3", 0)] == [429, 5, 429, 6]
        goes_on.set()
        settle(service)
        goes_on.clear()
        assert [give("uav1", 5), give("uav1", 6)] == [7, 429], "as many as before would be too many again"
        goes_on.set()
        settle(service)
        monkeypatch.setattr("crowdfence.service.gate._MORE_ROOM_EVERY_S", 0.0)
        goes_on.clear()
        assert [give("uav1", number) for number in range(6, 9)] == [8, 9, 10]
        goes_on.set()


def test_views_that_nobody_can_use_are_told_to_the_operator(tmp_path: Path) -> None:
    """They were answered with 422 alone: who gives views and looks at no answer lost them without a word."""
    with running(tmp_path) as service, asked(service) as http:

        def given(body: bytes, path: str = "views") -> tuple[int, list[tuple[str | None, str]]]:
            answer = http.post(f"/api/v1/{path}", content=body)
            told = [one for one in service.alerts.all() if one.kind == "refused_views"]
            for one in told:
                service.alerts.clear("refused_views", START_NS + 10**12, drone=one.drone)
            return answer.status_code, [(one.drone, one.text) for one in told if one.cleared_ns is None]

        def wrong(drone: str) -> bytes:
            body = json.loads(at(drone, START_NS))
            body["heatmap"].update(rows=1, columns=1, encoding="u8", data=base64.b64encode(b"ab").decode())
            return json.dumps(body).encode()

        lost = "cannot be used, and is lost:"
        size = f"{lost} 1 x 1 values of u8 are 1 bytes, not 2"
        assert given(wrong("uav9")) == (422, [("(unknown)", f"a view of uav9 {size}")])
        assert service.alerts.all()[0].raised_ns == START_NS, (
            "the clock is that of the views, and tells no time yet"
        )
        assert given(at("uav1", START_NS))[0] == 202
        assert given(wrong("uav1")) == (422, [("uav1", f"a view of uav1 {size}")])
        code, [(drone, text)] = given(b'{"drone": "uav1"}')
        assert (code, drone) == (422, "(unknown)")
        assert text.startswith(f"what was given as a view {lost} stamp_ns: ")
        code, [(drone, text)] = given(b"no observation", "observations")
        assert (code, drone) == (422, "(unknown)") and text.startswith(f"what was given as a view {lost}")
        code, [(drone, text)] = given(at(" uav1", START_NS))
        assert (code, drone) == (422, "(unknown)") and "begins or ends with a space" in text
        assert given(at("uav1", START_NS)) == (200, []), "twice is once"
        assert live_of(service).heard.refused == {"(unknown)": 4, "uav1": 1}


def test_more_views_a_second_than_agreed_are_told_to_come_again(tmp_path: Path) -> None:
    slow = replace(SETTINGS, views_per_s=2.0)
    with running(tmp_path, settings=slow) as service, asked(service) as http:
        codes = [
            http.post("/api/v1/views", content=at("uav1", START_NS + number)).status_code
            for number in range(7)
        ]
        assert codes[:4] == [202] * 4 and 429 in codes[4:]
        assert http.post("/api/v1/views", content=at("uav2", START_NS)).status_code == 202


def test_whose_views_are_too_many_is_told_until_ten_seconds_without(tmp_path: Path) -> None:
    """Who does not give them again loses crowd that they show; the clock is that of the views."""
    slow = replace(SETTINGS, views_per_s=2.0)
    with running(tmp_path, settings=slow) as service:
        live = live_of(service)

        def told() -> list[tuple[str | None, bool, bool]]:
            """Newest first: drone, still active, acknowledged."""
            found = [one for one in service.alerts.all() if one.kind == "refused_views"]
            return [(one.drone, one.cleared_ns is None, one.acknowledged_by is not None) for one in found]

        def flood(begin_s: float) -> None:
            with pytest.raises(Refused, match="more than 2 views a second"):
                for number in range(20):
                    live.intake.give_view(at("uav1", START_NS + round((begin_s + number / 100) * SECOND_NS)))

        flood(0.0)
        assert told() == [("uav1", True, False)]
        (alert,) = service.alerts.all()
        assert alert.text.startswith("views of uav1 are refused: it sends more than 2 views a second")
        service.alerts.acknowledge(alert.id, "ops", 1)
        flood(1.0)
        live.finish()
        assert told() == [("uav1", True, True)], "it goes on"
        live.intake._gate._rate = Rate(1000.0)
        for after_s in (9.0, 13.0):
            live.intake.give_view(at("uav1", START_NS + round(after_s * SECOND_NS)))
            live.finish()
            assert told() == [("uav1", after_s < 10.0, True)]


def test_a_full_disk_refuses_views_tells_it_and_goes_on_when_there_is_room(tmp_path: Path) -> None:
    with running(tmp_path) as service, asked(service) as http:
        for one in views(8):
            assert http.post("/api/v1/views", content=message(one)).status_code == 202
        settle(service)
        before = service.mission.newest

        def limit(pages: int):
            return lambda connection: connection.execute(f"PRAGMA max_page_count = {pages}")

        service.store.submit(limit(1)).result()  # not one page more than there are
        for number in range(400):
            answer = http.post("/api/v1/views", content=at("uav1", START_NS + 2 * SECOND_NS + number))
            if answer.status_code != 202:
                break
        assert answer.status_code == 507 and "full" in answer.json()["detail"]
        service.store.submit(lambda connection: None).result()  # the next write that fits changes nothing
        assert http.get("/healthz").status_code == 503 and "full" in str(service.store_trouble)
        assert http.get("/api/v1/zones").json()["zones"] and before is not None
        service.store.submit(limit(1 << 30)).result()
        assert http.post("/api/v1/views", content=at("uav1", START_NS + 3 * SECOND_NS)).status_code == 202
        settle(service)
        assert http.get("/healthz").status_code == 200


@pytest.mark.parametrize("taken", [".", FILE, f"{FILE}-wal"])
def test_views_are_refused_while_their_file_is_moved_away(tmp_path: Path, taken: str) -> None:
    """SQLite goes on writing into the file without a name: all would be acknowledged, none found again."""
    folder, aside = tmp_path / "data", tmp_path / "aside"
    stamps = [START_NS + round(number * 0.2 * SECOND_NS) for number in range(20)]
    with running(folder) as service, asked(service) as http:
        watch = Watch(service)

        def give(stamp_ns: int) -> Response:
            return http.post("/api/v1/views", content=at("uav1", stamp_ns))

        assert give(stamps[0]).status_code == 202
        (folder / taken).rename(aside)
        answer = give(stamps[1])
        assert answer.status_code == 507 and "moved away" in answer.json()["detail"]
        assert http.get("/healthz").status_code == 503 and http.get("/metrics").status_code == 200
        watch.look()
        assert ("disk", None) in {(one.kind, one.cleared_ns) for one in service.alerts.all()}
        if taken == FILE:
            shutil.copy(aside, folder / taken)  # another file of the same name
            assert give(stamps[2]).status_code == 507
        aside.rename(folder / taken)
        for stamp_ns in stamps[3:]:  # together more than what was refused
            assert give(stamp_ns).status_code == 202
        settle(service)
        assert http.get("/healthz").status_code == 200
        watch.look()
        assert service.alerts.active("disk") is None
    with running(folder) as service:
        assert live_of(service).heard.last_view_ns["uav1"] == stamps[-1]


def test_a_file_that_is_removed_while_nobody_writes_is_told(tmp_path: Path) -> None:
    with running(tmp_path / "data") as service:
        shutil.rmtree(tmp_path / "data")
        watch = Watch(service)
        watch.look()
        service.store.note(lambda connection: None)
        with pytest.raises(sqlite3.OperationalError, match="moved away"):
            service.store.flush()
        watch.look()
        assert "moved away" in service.alerts.active("disk").text


def test_alerts_that_a_full_disk_did_not_take_are_kept_once_there_is_room(tmp_path: Path) -> None:
    """Else nobody hears of them after a restart: a crowd that was lost, say, while views were refused."""

    def limit(pages: int):
        return lambda connection: connection.execute(f"PRAGMA max_page_count = {pages}")

    with running(tmp_path) as service:
        store, alerts = service.store, service.alerts
        before = alerts.raise_("clock", "alarm", "uav1 is ahead", START_NS, drone="uav1")
        store.submit(limit(1)).result()
        long = "50 % of the crowd met no ground " * 1000
        raised = [alerts.raise_("lost_crowd", "alarm", long, START_NS, drone=drone) for drone in DRONES]
        alerts.clear("lost_crowd", START_NS + 5, drone="uav2")
        store.flush()
        assert store.rows("SELECT id FROM alerts") == [(before.id,)] and "full" in str(service.store_trouble)
        store.submit(limit(1 << 30), size=100_000).result()  # stands for a view as large as that
        store.flush()
        assert service.store_trouble is None
    with running(tmp_path) as service:
        kept = {one.id: (one.text, one.cleared_ns) for one in service.alerts.all()}
        for one in raised:
            assert kept[one.id] == (long, START_NS + 5 if one.drone == "uav2" else None)


def picture() -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.full((12, 16, 3), 200, np.uint8)).save(file, format="PNG")
    return file.getvalue()


def image_message(stamp_ns: int, image: bytes) -> bytes:
    told = ViewMessage(
        drone="uav1",
        stamp_ns=stamp_ns,
        camera=CameraMessage.of(CAMERA),
        world_from_camera=pose("uav1", 0.0).tolist(),
        image=base64.b64encode(image).decode(),
    )
    return told.model_dump_json().encode()


def test_pictures_go_to_the_detector_which_holds_up_nobody(tmp_path: Path) -> None:
    """While the detector thinks, views are accepted and everything can be read."""
    may_answer = Event()

    def detector(frame):
        assert frame.image().shape == (12, 16, 3)
        may_answer.wait(20.0)
        return np.full((3, 4), 1.0, np.float32)

    with running(tmp_path, detector=detector) as service, asked(service) as http:
        for number in range(10):
            body = image_message(START_NS + number * 200_000_000, picture())
            assert http.post("/api/v1/views", content=body).status_code == 202
        elsewhere = message(view("uav3", 10))
        assert http.post("/api/v1/views", content=elsewhere).status_code == 202
        assert http.get("/api/v1/drones").status_code == 200
        assert service.mission.newest is None
        may_answer.set()
        settle(service)
        live_of(service).finish()
        zones = http.get("/api/v1/zones").json()["zones"]
        # All of the picture is crowd: 18 m up, f = 12, 16 x 12 pixels are 24 x 18 m.
        assert 20 * 15 <= sum(zone["crowd_m2"] for zone in zones) <= 26 * 20
        assert http.get("/api/v1/drones/uav1/picture").content == picture()
        grey = Image.open(io.BytesIO(http.get("/api/v1/drones/uav1/heatmap").content))
        assert np.array(grey).tolist() == [[255] * 4] * 3


def test_drones_may_be_called_as_their_namespaces_and_not_so_that_alarms_read_otherwise(
    tmp_path: Path,
) -> None:
    """Nor so that two look alike."""

    def called(name: str) -> bytes:
        one = view("uav1", 0)
        return message(View(name, one.stamp_ns, one.camera, one.world_from_camera, one.heatmap))

    with running(tmp_path) as service, asked(service) as http:
        odd = {"\u202e": "202E", "\x00": "0000", "\n": "000A", "\u2066": "2066", "\u2028": "2028"}
        invisible = {"\u200b": "200B", "\u2060": "2060", "\ufeff": "FEFF", "\xad": "00AD", "\xa0": "00A0"}
        refused = {f"uav{one}1": f"the character U+{told}," for one, told in {**odd, **invisible}.items()}
        for name, character in {**refused, "uav1 ": "'uav1 ' begins or ends with a space"}.items():
            answer = http.post("/api/v1/views", content=called(name))
            assert answer.status_code == 422 and character in answer.json()["detail"]
        for name in (".", "..", "fleet/../uav1", "./uav1"):  # addresses lose them
            answer = http.post("/api/v1/views", content=called(name))
            assert answer.status_code == 422 and f"name {name!r} has the part '." in answer.json()["detail"]
        names = ("/fleet/uav1", "dröne ü&?#", "طائرة", "...", "uav..1", ".uav1")
        for name in names:
            assert http.post("/api/v1/views", content=called(name)).status_code == 202
        live_of(service).finish()
        settle(service)
        assert set(service.mission.drones) == set(names)
        for name in names:
            answer = http.get(f"/api/v1/drones/{quote(name, safe='')}/heatmap")
            assert answer.status_code == 200 and answer.headers["content-type"] == "image/png"


def test_a_detector_that_fails_refuses_its_frame_and_nothing_else(tmp_path: Path) -> None:
    def detector(frame):
        raise ValueError("no graphics card")

    with running(tmp_path, detector=detector) as service:
        live = live_of(service)
        live.intake.give_view(image_message(START_NS, picture()))
        live.intake.give_view(at("uav2", START_NS + 1))
        settle(service)
        live.finish()
        assert live.heard.refused == {"uav1": 1}
        assert service.mission.loop.crowd_map.drones == ["uav2"]
        (alert,) = [one for one in service.alerts.all() if one.kind == "refused_views"]
        assert "no graphics card" in alert.text


def test_pictures_without_a_detector_are_refused(tmp_path: Path) -> None:
    with running(tmp_path) as service, pytest.raises(Refused, match="no detector"):
        live_of(service).intake.give_view(image_message(START_NS, picture()))


def changed(**what: object) -> bytes:
    return json.dumps(json.loads(at("uav1", START_NS)) | what).encode()


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"", "JSON"),
        (b"{}", "drone"),
        (changed(drone=""), "drone"),
        (changed(stamp_ns=-1), "stamp_ns"),
        (changed(world_from_camera=[[0.0] * 4] * 4), "pose is not rigid"),
        (changed(world_from_camera=np.diag([1.0, -1.0, 1.0, 1.0]).tolist()), "pose is not rigid"),
        (changed(heatmap=None), "either a heatmap or an image"),
        (changed(heatmap={"encoding": "u8", "rows": 2, "columns": 2, "data": "AAAA"}), "4 bytes, not 3"),
        (changed(heatmap={"encoding": "u8", "rows": 1, "columns": 1, "data": "?"}), "base64"),
        (changed(heatmap={"encoding": "png", "data": "AAAA"}), "PNG"),
        (changed(surprise=1), "surprise"),
    ],
)
def test_what_is_no_view_is_refused_with_its_reason(tmp_path: Path, body: bytes, words: str) -> None:
    with running(tmp_path) as service, asked(service) as http:
        answer = http.post("/api/v1/views", content=body)
        assert answer.status_code == 422 and words in answer.json()["detail"]
        assert service.store.rows("SELECT COUNT(*) FROM journal") == [(0,)]


def test_heatmaps_keep_every_digit() -> None:
    values = np.random.default_rng(3).uniform(0, 1, (5, 7)).astype(np.float32)
    assert np.array_equal(HeatmapMessage.of(values).heatmap(), values)
    grey = (values * 255).astype(np.uint8)
    assert np.array_equal(HeatmapMessage.of(grey).heatmap(), grey)


def test_observations_of_another_terrain_are_refused(tmp_path: Path) -> None:
    from crowdfence import Terrain

    other = Terrain.from_height_map(np.zeros((9, 9)), cell_size_m=1.0)
    crowd_map = CrowdMap(other, CONFIG.method.fusion_method(other, 1))
    (seen,) = crowd_map.integrate([view("uav1", 0)], START_NS).observations
    with running(tmp_path) as service, pytest.raises(Refused, match="of terrain"):
        live_of(service).intake.give_observation(seen.to_bytes())


def test_an_instant_that_no_view_completes_is_completed_by_the_clock(tmp_path: Path) -> None:
    now = Now(START_NS)
    with running(tmp_path, clock=now.clock()) as service:
        live_of(service).intake.give_view(at("uav1", START_NS))
        settle(service)
        assert service.mission.newest is None
        now.pass_s(0.7)  # 0.5 s of delay and 0.06 s of tolerance are over
        for _ in range(200):
            if service.mission.newest is not None:
                break
            Event().wait(0.05)
        assert service.mission.newest is not None and service.mission.newest.stamp_ns == START_NS


def test_the_writer_answers_after_the_commit_and_alone(tmp_path: Path) -> None:
    """One write that breaks a rule takes nothing with it."""
    with running(tmp_path) as service:
        store = service.store

        def insert(name: str):
            return lambda connection: connection.execute("INSERT INTO about VALUES (?, '')", (name,))

        futures = [store.submit(insert(name)) for name in ("a", "b", "a", "c")]
        futures[0].result(), futures[1].result(), futures[3].result()
        assert isinstance(futures[2].exception(), sqlite3.IntegrityError)
        assert store.rows("SELECT COUNT(*) FROM about WHERE name IN ('a', 'b', 'c')") == [(3,)]


def test_a_record_that_cannot_be_applied_stops_nothing_also_after_a_restart(tmp_path: Path) -> None:
    flown = views(6)
    with running(tmp_path) as service:
        live = live_of(service)
        live.intake.give_view(message(flown[0]))
        poison = "INSERT INTO journal VALUES (?, 'operator', '', 0, 0, ?, ?)"
        record = Record(2, "operator", "", 0, 0, b"{}")
        service.store.submit(
            lambda connection: connection.execute(poison, (2, record.checksum, record.body))
        ).result()
    with running(tmp_path) as service:
        live = live_of(service)
        for one in flown[1:]:
            live.intake.give_view(message(one))
        settle(service)
        assert live.applying.works and service.mission.loop.crowd_map.instant_count > 0
        assert any("record 2 (operator)" in alert.text for alert in service.alerts.all())


def test_more_drones_than_the_method_takes_lose_nobody_elses_views(tmp_path: Path) -> None:
    """Three drones begin at the same moment in a fleet of two: one is refused, the others are taken."""
    for folder in ("a", "b", "c"):
        with running(tmp_path / folder, config=FLEET_OF_TWO) as service:
            live, together, refused = live_of(service), Barrier(3), []

            def give(drone: str, live=live, together=together, refused=refused) -> None:
                for number in range(4):
                    together.wait()
                    try:
                        live.intake.give_view(message(view(drone, number)))
                    except Refused as error:
                        refused.append((drone, str(error)))

            threads = [Thread(target=give, args=(drone,)) for drone in DRONES]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            live.finish()
            assert service.mission.loop.crowd_map.instant_count == 4
            assert len({drone for drone, _ in refused}) == 1 and len(refused) == 4
            assert "this fleet has 2 at most" in refused[0][1]


def test_the_place_of_a_drone_whose_view_was_not_kept_is_free_again(tmp_path: Path) -> None:
    with running(tmp_path, config=FLEET_OF_TWO, inputs=Inputs()) as service:
        live = live_of(service)
        without_pose = json.loads(message(view("uav3", 0)))
        del without_pose["world_from_camera"]
        with pytest.raises(Refused):
            live.intake.give_view(json.dumps(without_pose).encode())
        for drone in ("uav1", "uav2"):
            assert not live.intake.give_view(message(view(drone, 0))).duplicate


def test_a_view_that_cannot_be_used_does_not_take_its_instant_with_it(tmp_path: Path) -> None:
    """Views of three drones are in the journal of a fleet of two, as an older build kept them."""
    with running(tmp_path, config=FLEET_OF_TWO) as service:
        live = live_of(service)
        live.intake._gate._most_drones = 3
        for drone in DRONES:
            live.intake.give_view(message(view(drone, 0)))
        live.finish()
        crowd_map = service.mission.loop.crowd_map
        assert crowd_map.instant_count == 1 and set(crowd_map.drones) == {"uav1", "uav2"}
        assert live.heard.refused == {"uav3": 1}
        (alert,) = [one for one in service.alerts.all() if one.kind == "refused_views"]
        assert alert.drone == "uav3" and "fleet_size is 2" in alert.text


def test_an_instant_that_fails_takes_none_of_the_others_with_it(tmp_path: Path) -> None:
    """Two instants are completed by one view, and the first cannot be taken in by a mistake of ours."""
    with running(tmp_path) as service:
        live, take_in = live_of(service), service.mission.loop.step
        tries = []

        def once_failing(*what):
            tries.append(what)
            if len(tries) == 1:
                raise MemoryError("once")
            return take_in(*what)

        service.mission.loop.step = once_failing  # type: ignore[method-assign]
        for one in views(2):
            live.intake.give_view(message(one))
        live.intake.give_view(message(view("uav1", 30)))
        settle(service)
        assert service.mission.loop.crowd_map.instant_count == 1
        assert live.heard.refused == dict.fromkeys(DRONES, 1)
        told = [alert for alert in service.alerts.all() if alert.kind == "refused_views"]
        assert {alert.drone for alert in told} == set(DRONES) and "MemoryError once" in told[0].text
        live.finish()
        assert service.mission.loop.crowd_map.instant_count == 2
        assert not live.applying.gathering.is_due(stamp_ns("uav1", 1000)), "nothing waits for good"
        assert live.applying.gathering.first_waiting(10**9) == 10**9, "nothing pins the journal"


@pytest.mark.parametrize("method", [CONFIG.method, PaperConfig(fleet_size=3)], ids=["evidence", "paper"])
@pytest.mark.parametrize("start_s", [0, 1500, 1_760_000_000])
def test_a_late_view_is_taken_in_on_every_clock(tmp_path: Path, start_s: int, method) -> None:
    """Also on that of a simulation, whose stamps can look like milliseconds."""
    start_ns = start_s * SECOND_NS
    with running(tmp_path, config=replace(CONFIG, method=method)) as service:
        live = live_of(service)
        for number in range(10):
            live.intake.give_view(at("uav1", start_ns + number * 200_000_000))
        for number in range(3):
            live.intake.give_view(at("uav2", start_ns + number * 100_000_000))
        live.intake.give_view(at("uav1", start_ns + 2 * SECOND_NS))
        live.finish()
        assert live.heard.late == {"uav2": 3} and not live.heard.refused
        assert service.mission.loop.crowd_map.instant_count == 14
        assert "uav2" in service.mission.loop.crowd_map.drones


def test_a_drone_whose_views_are_lost_again_is_told_again(tmp_path: Path) -> None:
    """Whether somebody acknowledged the loss before, or good views came between."""
    with running(tmp_path, settings=replace(SETTINGS, max_delay_ms=0.0)) as service:
        live, take_in, alerts = live_of(service), service.mission.loop.step, service.alerts

        def failing(*what):
            raise MemoryError("no room")

        def give(number: int, *, fails: bool) -> None:
            service.mission.loop.step = failing if fails else take_in  # type: ignore[method-assign]
            live.intake.give_view(message(view("uav1", number)))
            live.finish()

        def told() -> list[tuple[bool, bool]]:
            """Newest first: still active, acknowledged."""
            found = [one for one in alerts.all() if one.kind == "refused_views"]
            return [(one.cleared_ns is None, one.acknowledged_by is not None) for one in found]

        give(0, fails=True)
        give(10, fails=True)
        assert told() == [(True, False)], "once is enough while nobody has looked"
        alerts.acknowledge(alerts.all()[0].id, "ops", 1)
        give(20, fails=True)
        assert told() == [(True, False), (False, True)]
        give(69, fails=False)
        assert told() == [(True, False), (False, True)], "9.8 s"
        give(71, fails=False)
        assert told() == [(False, False), (False, True)]
        give(80, fails=True)
        assert told() == [(True, False), (False, False), (False, True)]


def test_ground_that_no_drone_looks_at_any_more_is_closed_in_silence(tmp_path: Path) -> None:
    """All drones fall silent: what was seen empty is stale soon. A service that begins anew says the same."""
    now = Now(START_NS)
    zones = replace(CONFIG.zones, close_unseen=True, stale_after_s=2.0)
    how = {
        "config": replace(CONFIG, zones=zones),
        "settings": replace(SETTINGS, clock="system", snapshot_every=1000),
    }
    empty = np.zeros((12, 16), np.float32)

    def unseen_m2(service: Service) -> float:
        assert service.mission.newest is not None
        return service.mission.newest.zones.unseen[0].polygon.area

    def closed_again(service: Service) -> bool:
        give_up_s = monotonic() + 20.0
        while unseen_m2(service) < 60.0 * 60.0 and monotonic() < give_up_s:
            sleep(0.02)
        return unseen_m2(service) == 60.0 * 60.0

    with running(tmp_path / "one", clock=now.clock(), **how) as service:
        live = live_of(service)
        for number in range(4):
            stamp = START_NS + number * 100_000_000
            one = View("uav1", stamp, FINE_CAMERA, pose("uav1", 0.0), empty)
            live.intake.give_view(message(one))
        live.finish()
        assert unseen_m2(service) < 60.0 * 60.0, "something was seen empty"
        now.pass_s(1.5)
        sleep(0.5)
        settle(service)
        assert unseen_m2(service) < 60.0 * 60.0, "and is not stale yet"
        now.pass_s(2.0)
        assert closed_again(service)
        settle(service)
        assert not live.heard.refused
        shutil.copytree(tmp_path / "one", tmp_path / "two")
        state = live.applying.to_bytes()
        later = View("uav1", now.system_ns, FINE_CAMERA, pose("uav1", 0.0), empty)
        live.intake.give_view(message(later))
        live.finish()
        assert unseen_m2(service) < 60.0 * 60.0, "a look opens it again"
        assert not live.heard.refused and not live.heard.late
    with running(tmp_path / "two", clock=now.clock(), **how) as service:
        assert live_of(service).applying.to_bytes() == state


def test_what_the_clock_completes_goes_on_after_a_mistake(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, failed, asked_again = Now(START_NS), Event(), Event()

    def fail(ticker: Ticker, now_ns: int) -> bool:
        failed.set()
        raise MemoryError

    with running(tmp_path, clock=now.clock(), settings=replace(SETTINGS, clock="system")):
        with monkeypatch.context() as failing:
            failing.setattr(Ticker, "_has_nothing_new", fail)
            now.pass_s(60.0)
            assert failed.wait(20.0)
        monkeypatch.setattr(Ticker, "_has_nothing_new", lambda ticker, now_ns: asked_again.set())
        now.pass_s(60.0)
        assert asked_again.wait(20.0)


def test_a_write_that_fails_by_a_mistake_of_ours_fails_alone(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        store = service.store
        insert = "INSERT INTO about VALUES (?, '')"
        bad = store.submit(lambda connection: connection.execute(insert, ("\ud800",)))
        good = store.submit(lambda connection: connection.execute(insert, ("a",)))
        assert isinstance(bad.exception(timeout=10), UnicodeEncodeError)
        good.result(timeout=10)
        assert service.store_trouble is None and service.works


def test_room_that_is_freed_in_the_file_can_be_given_back(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        assert service.store.rows("PRAGMA auto_vacuum") == [(2,)], "incremental"


def test_another_view_of_the_same_stamp_is_refused(tmp_path: Path) -> None:
    """It is not told that it is there already, which only what came first is."""
    with running(tmp_path) as service, asked(service) as http:
        one = view("uav1", 0)
        empty = View("uav1", one.stamp_ns, one.camera, one.world_from_camera, np.zeros((12, 16), np.float32))
        assert http.post("/api/v1/views", content=message(empty)).status_code == 202
        other = http.post("/api/v1/views", content=message(one))
        assert other.status_code == 409 and "another view" in other.json()["detail"]
        spaced = json.dumps(json.loads(message(empty)), indent=1)
        again = http.post("/api/v1/views", content=spaced)
        assert again.status_code == 200 and again.json()["duplicate"], "the same in other words"


def test_a_first_stamp_that_is_absurd_does_not_set_the_clock_of_the_views(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        with pytest.raises(Refused, match="clock is wrong"):
            live_of(service).intake.give_view(at("uav1", 2**63 - 1))
        assert not live_of(service).intake.give_view(at("uav2", START_NS)).duplicate


def test_records_are_applied_in_the_order_of_the_journal_however_slow_their_givers_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread of the first view is held up between its commit and whatever it does next."""
    with running(tmp_path) as service:
        live, journal, applied = live_of(service), live_of(service).intake._journal, []
        append, apply_ = journal.append, live.applying._apply

        def slowly(record: Record, *how, **more):
            future = append(record, *how, **more)
            if record.drone == "uav1":
                future.result()
                live.intake.give_view(message(view("uav2", 0)))
            return future

        def noted(record: Record) -> None:
            applied.append(record.seq)
            apply_(record)

        monkeypatch.setattr(journal, "append", slowly)
        monkeypatch.setattr(live.applying, "_apply", noted)
        live.intake.give_view(message(view("uav1", 0)))
        settle(service)
        assert applied == [1, 2]


def test_the_last_views_of_a_simulation_need_no_others_to_follow(tmp_path: Path) -> None:
    """Three drones at one instant, and nothing after it: the clock of the views stands still."""
    with running(tmp_path, settings=replace(SETTINGS, quiet_s=0.2)) as service:
        live = live_of(service)
        for drone in DRONES:
            live.intake.give_view(at(drone, START_NS))
        until_s = monotonic() + 60.0
        while service.mission.loop.crowd_map.instant_count == 0 and monotonic() < until_s:
            sleep(0.02)
        assert service.mission.loop.crowd_map.instant_count == 1
        # Time goes on where the simulation does.
        live.intake.give_view(at(DRONES[0], START_NS + SECOND_NS))
        live.finish()
        assert service.mission.loop.crowd_map.instant_count == 2 and not live.heard.late
        service.store.flush()
        stamps = [stamp for (stamp,) in service.store.rows("SELECT stamp_ns FROM moments ORDER BY number")]
        assert stamps == [START_NS, START_NS + SECOND_NS]


def test_views_wait_for_others_while_views_come(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        live = live_of(service)
        live.intake.give_view(at(DRONES[0], START_NS))
        live.applying.settled(30.0)
        sleep(0.5)
        assert service.mission.loop.crowd_map.instant_count == 0
