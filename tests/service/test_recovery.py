"""After a crash: the state is that of a service that never stopped."""

import json
import random
import shutil
import sqlite3
import zlib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from starlette.testclient import TestClient

from crowdfence import Detector, FrameLoop, Georeference, project
from crowdfence.config import EvidenceConfig
from crowdfence.service.access import User
from crowdfence.service.clock import Clock
from crowdfence.service.gate import Refused
from crowdfence.service.mission import Mission
from crowdfence.service.opening import live
from crowdfence.service.packing import packed, unpacked
from crowdfence.service.service import Service
from crowdfence.service.store import FILE, StoreError
from crowdfence.zones import Zone
from crowdfence.zones.history import history_line
from support.onnx_models import contract, write_map_model
from support.small_service import (
    CONFIG,
    DRONES,
    SETTINGS,
    START_NS,
    asked,
    message,
    picture_message,
    plain,
    running,
    settle,
    sharp,
    view,
    views,
)


def state(service: Service) -> tuple[bytes, bytes]:
    """What all later steps depend on."""
    assert service.live is not None
    return service.live.applying.to_bytes(), service.mission.loop.crowd_map.to_bytes()


def give(service: Service, flown: list) -> None:
    assert service.live is not None
    for one in flown:
        service.live.intake.give_view(message(one))
    settle(service)


def crash(folder: Path, into: Path) -> None:
    """What a power failure would leave: the files as they are on disk while the service still runs."""
    into.mkdir()
    for name in (FILE, f"{FILE}-wal"):
        if (folder / name).exists():
            (into / name).write_bytes((folder / name).read_bytes())


def test_a_snapshot_that_fails_stops_no_view(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes more memory than all else. Views were accepted, and none of them came into the map then."""
    to_bytes, failed = Mission.to_bytes, []

    def without_memory(mission: Mission) -> bytes:
        if mission.loop.crowd_map.instant_count < 4:
            failed.append(mission.loop.crowd_map.instant_count)
            raise MemoryError
        return to_bytes(mission)

    monkeypatch.setattr(Mission, "to_bytes", without_memory)
    flown = views(10)
    with running(tmp_path / "data") as service:
        give(service, flown)
        assert failed and service.works and service.mission.loop.crowd_map.instant_count > 4
        expected = state(service)
    with running(tmp_path / "data") as service:
        assert state(service) == expected


def test_where_drones_were_before_a_restart_is_not_known_and_not_denied(tmp_path: Path) -> None:
    """Positions are of this start: of those before it nobody may say that a drone had not come yet."""

    def standing(service: Service, at: int) -> dict[str, str]:
        with asked(service) as http:
            found = http.get(f"/api/v1/drones?at={at}").json()
        return {one["drone"]: one["status"] for one in found["drones"]}

    flown = [view("uav1", number) for number in range(10)]
    first, last = flown[0].stamp_ns, flown[-1].stamp_ns
    with running(tmp_path / "data") as service:
        give(service, flown)
        assert standing(service, first - 1) == {"uav1": "never"}
        assert standing(service, first) == {"uav1": "ok"}
    with running(tmp_path / "data") as service:
        assert standing(service, first) == {"uav1": "unknown"}
        assert standing(service, last) == {"uav1": "ok"}  # its last view was still waiting


def test_the_files_of_a_running_service_hold_everything_that_it_acknowledged(tmp_path: Path) -> None:
    flown = views(12)
    with running(tmp_path / "one") as service:
        give(service, flown[:20])
        crash(tmp_path / "one", tmp_path / "crashed")
        give(service, flown[20:])
        whole = state(service)
        newest = service.mission.newest
    with running(tmp_path / "crashed") as service:
        give(service, flown[20:])
        assert state(service) == whole
        again = service.mission.newest
    assert newest is not None and again is not None and newest.number == again.number
    assert history_line(0, newest.zones) == history_line(0, again.zones)


@pytest.mark.parametrize("cut", [9, 13, 14])
def test_looks_that_left_far_ground_out_do_so_again(tmp_path: Path, cut: int) -> None:
    """Pictures that wait for others are looked at again after a crash, as they were before."""
    document = contract(sizes={"gsd_m": [0.05, 0.17]})
    detector = Detector(write_map_model(tmp_path / "red.onnx", document), far_every_s=0.25)
    pictures = [picture_message(sharp(one)) for one in views(12)]

    def show(service: Service, shown: list[bytes]) -> None:
        assert service.live is not None
        for one in shown:
            service.live.intake.give_view(one)
        settle(service)

    how = {"detector": detector, "settings": replace(SETTINGS, snapshot_every=5, max_delay_ms=900.0)}
    with running(tmp_path / "one", **how) as service:
        show(service, pictures[:cut])
        assert service.live is not None
        told = service.live.applying.gathering.to_json()
        assert 0 < len(told["near"]) < len(told["waiting"])
        crash(tmp_path / "one", tmp_path / "crashed")
        show(service, pictures[cut:])
        whole = state(service)
    with running(tmp_path / "crashed", **how) as service:
        show(service, pictures[cut:])
        assert state(service) == whole


def test_what_waits_is_taken_in_by_a_service_that_waits_for_less(tmp_path: Path) -> None:
    """It was acknowledged and came into no map, and the clock asked for it for ever."""
    flown = views(12)
    patient = replace(SETTINGS, max_delay_ms=3_600_000.0)
    with running(tmp_path / "one", settings=patient) as service:
        give(service, flown[:24])
        assert service.mission.newest is None, "all of it waits"
    with running(tmp_path / "one") as service, running(tmp_path / "two") as other:
        give(service, flown[24:])
        give(other, flown)
        for one in (service, other):
            assert one.live is not None
            one.live.finish()
            assert one.live.applying.gathering.to_json()["waiting"] == []
        assert service.mission.loop.crowd_map.to_bytes() == other.mission.loop.crowd_map.to_bytes()


def test_the_log_says_what_was_recovered_and_nothing_of_a_new_folder(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "crowdfence.service.applying")
    with running(tmp_path / "one") as service:
        assert "recovered" not in caplog.text
        give(service, views(4))  # of three drones each
        crash(tmp_path / "one", tmp_path / "crashed")
    caplog.clear()
    with running(tmp_path / "crashed"):
        assert "recovered: it is as after record 12 of the journal" in caplog.text


@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32 - 1))
def test_a_loop_goes_on_from_its_bytes_as_if_nothing_had_happened(seed: int) -> None:
    """Zones are created, split, merged and held in this flight; cut anywhere, the rest is the same."""
    cut = random.Random(seed).randrange(1, 20)
    flown = [[view(drone, number) for drone in ("uav1", "uav2", "uav3")] for number in range(20)]
    one = FrameLoop(CONFIG.crowd_map(plain(), 3), CONFIG.zones)
    for number in range(cut):
        one.step(flown[number], flown[number][-1].stamp_ns)
    other = FrameLoop(
        type(one.crowd_map).from_bytes(one.crowd_map.to_bytes(), one.crowd_map.terrain), CONFIG.zones
    )
    other.restore(one.to_bytes())
    for number in range(cut, 20):
        stamp_ns = flown[number][-1].stamp_ns
        first, second = one.step(flown[number], stamp_ns), other.step(flown[number], stamp_ns)
        assert history_line(0, first.zones) == history_line(0, second.zones)
        assert np.array_equal(first.crowd_ids, second.crowd_ids)
    assert one.crowd_map.to_bytes() == other.crowd_map.to_bytes()
    assert one.crowd_mass == other.crowd_mass


def test_operators_and_alerts_survive(tmp_path: Path) -> None:
    with running(tmp_path / "one") as service:
        give(service, views(12))
        with asked(service) as http:
            drawn = {"polygon": [[1, 1], [4, 1], [4, 4]], "reason": "ambulance"}
            added = http.post("/api/v1/zones", json=drawn).json()
            assert http.post("/api/v1/zones/Z1/lock", json={"reason": "stage"}).status_code == 200
        service.alerts.raise_("disk", "alarm", "nearly full", START_NS)
        service.store.flush()
        crash(tmp_path / "one", tmp_path / "crashed")
    with running(tmp_path / "crashed") as service, asked(service) as http:
        zones = {zone["id"]: zone for zone in http.get("/api/v1/zones").json()["zones"]}
        assert zones[added["id"]]["why"] == "local closed it: ambulance"
        assert zones["Z1"]["locked"]
        audit = http.get("/api/v1/audit").json()["entries"]
        assert [(entry["action"], entry["reason"]) for entry in audit] == [
            ("lock", "stage"),
            ("add", "ambulance"),
        ]
        assert any(alert["text"] == "nearly full" for alert in http.get("/api/v1/alerts").json()["alerts"])


@pytest.mark.parametrize("snapshot_every", [7, 1000])
def test_zones_of_others_that_are_new_after_a_crash_did_not_hold_before_it(
    tmp_path: Path, snapshot_every: int
) -> None:
    """What came into the map anew was published anew: of all moments since the last snapshot the history told
    the zones of the new file."""
    hospital, school = (
        Zone.of_no_look(name, shapely.box(east, 1, east + 8, 9), "static", "given")
        for name, east in (("HOSP", 1.0), ("SCHOOL", 30.0))
    )
    how = {"settings": replace(SETTINGS, snapshot_every=snapshot_every)}

    def of_others(service: Service, at_ns: int | None) -> list[str]:
        return [zone.id for zone in service.moment(at_ns).of_others]

    with running(tmp_path / "one", static_zones=[hospital], **how) as service:
        give(service, views(12))
        stamps = [point["stamp_ns"] for point in service.mission.timeline.points()]
        newest = service.mission.newest
        crash(tmp_path / "one", tmp_path / "crashed")
    shutil.copytree(tmp_path / "crashed", tmp_path / "same")
    with running(tmp_path / "crashed", static_zones=[school], **how) as service:
        assert of_others(service, None) == ["SCHOOL"]
        service.store.flush()
        assert len(stamps) > 8
        for stamp_ns in stamps[:-1]:
            assert of_others(service, int(stamp_ns)) == ["HOSP"]
    with running(tmp_path / "same", static_zones=[hospital], **how) as service:
        assert of_others(service, None) == ["HOSP"]
        assert newest is not None and service.mission.newest.number == newest.number


def told_of_zones(service: Service) -> list[tuple[str, str, int, bool]]:
    """The oldest first: which zone, what, when, and whether it is over."""
    alerts = [one for one in service.alerts.all()[::-1] if one.kind == "new_zone"]
    return [(one.zone or "", one.text, one.raised_ns, one.cleared_ns is not None) for one in alerts]


def test_zones_of_records_that_were_not_in_the_map_yet_are_told(tmp_path: Path) -> None:
    """Of views that were acknowledged, and came into the map at the next start, nobody heard."""
    kept = {"settings": replace(SETTINGS, snapshot_every=1000)}
    with running(tmp_path / "one", **kept) as service:
        give(service, views(15))
        expected = told_of_zones(service)
        crash(tmp_path / "one", tmp_path / "crashed")
    assert expected
    shutil.copytree(tmp_path / "crashed", tmp_path / "untold")
    damage(tmp_path / "untold", "DELETE FROM alerts")
    for folder in ("untold", "crashed"):  # and what was told is not told twice
        with running(tmp_path / folder, **kept) as service:
            assert told_of_zones(service) == expected


def test_a_dismissal_that_ends_in_records_that_were_not_in_the_map_yet_is_told_once(tmp_path: Path) -> None:
    """Whoever was let through flies there still."""
    now = [START_NS]
    how = {
        "clock": Clock("system", system=lambda: now[0], steady=lambda: now[0]),
        "settings": replace(SETTINGS, snapshot_every=1000),
    }

    def fly(service: Service, first: int, last: int) -> None:
        for one in views(last)[3 * first :]:
            now[0] = max(now[0], one.stamp_ns)
            give(service, [one])

    def closed_again(service: Service) -> list[str]:
        return [one.text for one in service.alerts.all() if (one.kind, one.level) == ("new_zone", "warning")]

    with running(tmp_path / "one", **how) as service:
        fly(service, 0, 9)
        service.decide(User("ana", "operator"), "dismiss", "Z1", "film crew")
        now[0] += 61 * 1_000_000_000
        fly(service, 320, 330)
        service.store.flush()
        assert closed_again(service) == ["zone Z1 is closed again: it is no longer dismissed"]
        crash(tmp_path / "one", tmp_path / "crashed")
    shutil.copytree(tmp_path / "crashed", tmp_path / "untold")
    damage(tmp_path / "untold", "DELETE FROM alerts")
    for folder in ("untold", "crashed"):
        with running(tmp_path / folder, **how) as service:
            assert closed_again(service) == ["zone Z1 is closed again: it is no longer dismissed"]


Given = tuple[str, Any]
"""What is done, and with what."""


def eventful(seed: int) -> list[Given]:
    """A flight with views that are late, doubled, lost or projected on board, and operators in between."""
    chance = random.Random(seed)
    late = [(one.stamp_ns + chance.choice([0, 0, 0, 500_000_000, 2_000_000_000]), one) for one in views(14)]
    done: list[Given] = []
    for _, one in sorted(late, key=lambda pair: (pair[0], pair[1].drone)):
        kind = chance.choice(["view"] * 8 + ["observation", "lost"])
        done += [(kind, one)] * chance.choice([1, 1, 1, 2])
        if chance.random() < 0.3:
            operator = ["add", "lock", "unlock", "dismiss", "leave-out", "take-in"]
            done.append((chance.choice(operator), chance.randrange(100)))
    return done


def do(service: Service, http: TestClient, given: Given) -> object:
    """What the service answers."""
    assert service.live is not None
    kind, what = given
    intake, crowd_map = service.live.intake, service.mission.loop.crowd_map
    with suppress(Refused):
        if kind == "view":
            intake.give_view(message(what))
        elif kind == "observation":
            intake.give_observation(project(what, crowd_map.terrain, max_range_m=80.0).to_bytes())
    settle(service)
    if kind in ("view", "observation", "lost"):
        return None
    reason = {"reason": f"because of {what}"}
    if kind == "add":
        corners = [[what % 50, 5], [what % 50 + 5, 5], [what % 50, 9]]
        return http.post("/api/v1/zones", json={"polygon": corners, **reason}).status_code
    if kind in ("leave-out", "take-in"):
        name = f"drones/{DRONES[what % 3]}"
    else:
        zones = http.get("/api/v1/zones").json()["zones"]
        name = f"zones/{zones[what % len(zones)]['id'] if zones else 'Z1'}"
    return http.post(f"/api/v1/{name}/{kind}", json=reason).status_code


@pytest.mark.parametrize("seed", [3, 5, 6])
def test_a_flight_with_operators_goes_on_after_a_crash_as_if_nothing_had_happened(
    tmp_path: Path, seed: int
) -> None:
    flight = eventful(seed)
    cut = random.Random(seed).randrange(len(flight) // 2, len(flight))
    with running(tmp_path / "one") as service, asked(service) as http:
        answers = [do(service, http, one) for one in flight[:cut]]
        crash(tmp_path / "one", tmp_path / "crashed")
        answers += [do(service, http, one) for one in flight[cut:]]
        whole, newest = state(service), service.mission.newest
    assert {200, 201, 204} <= set(answers), "operators did something of each kind"
    with running(tmp_path / "crashed") as service, asked(service) as http:
        assert [do(service, http, one) for one in flight[cut:]] == answers[cut:]
        assert state(service) == whole
        again = service.mission.newest
    assert newest is not None and again is not None
    assert (newest.number, newest.marks) == (again.number, again.marks)
    assert history_line(0, newest.zones) == history_line(0, again.zones)


def damage(folder: Path, statement: str) -> None:
    with sqlite3.connect(folder / FILE) as connection:
        connection.execute(statement)


def test_a_damaged_tail_is_put_aside_and_told(tmp_path: Path) -> None:
    flown = views(4)
    with running(tmp_path / "data", settings=_no_snapshots()) as service:
        give(service, flown)
        crash(tmp_path / "data", tmp_path / "crashed")
    damage(tmp_path / "crashed", "UPDATE journal SET body = x'00' WHERE seq = 9")
    with running(tmp_path / "sound", settings=_no_snapshots()) as service:
        give(service, flown[:8])
        expected = state(service)
    with running(tmp_path / "crashed", settings=_no_snapshots()) as service:
        assert state(service) == expected
        (alert,) = [alert for alert in service.alerts.all() if alert.kind == "records_damaged"]
        assert alert.level == "alarm" and alert.text.startswith("4 records") and alert.is_open
        assert service.store.rows("SELECT COUNT(*) FROM damaged") == [(4,)]
        give(service, flown[8:])  # they were lost, so they are no duplicates
        assert service.live is not None and sum(service.live.heard.accepted.values()) == 4


def test_commits_behind_a_flipped_bit_of_the_log_are_told(tmp_path: Path) -> None:
    """SQLite takes it for the end of its log. Acknowledged views and closed ground were gone."""
    flown = views(6)
    with running(tmp_path / "data", settings=_no_snapshots()) as service, asked(service) as http:
        give(service, flown[:6])
        crash(tmp_path / "data", tmp_path / "before")
        for one in flown[6:]:
            give(service, [one])
        drawn = {"polygon": [[50, 50], [55, 50], [55, 55]], "reason": "ambulance"}
        assert http.post("/api/v1/zones", json=drawn).status_code == 201
        crash(tmp_path / "data", tmp_path / "crashed")
    log = tmp_path / "crashed" / f"{FILE}-wal"
    sound = (tmp_path / "before" / log.name).read_bytes()
    damaged = bytearray(log.read_bytes())
    assert damaged.startswith(sound)  # nothing has begun the log anew
    damaged[len(sound) + 24 + 100] ^= 1  # the first page behind
    log.write_bytes(damaged)
    with running(tmp_path / "crashed", settings=_no_snapshots()) as service:
        assert service.store.rows("SELECT COUNT(*) FROM journal WHERE kind = 'view'") == [(6,)]
        (alert,) = [alert for alert in service.alerts.all() if alert.kind == "records_damaged"]
        count, text = alert.text.split(maxsplit=1)
        assert int(count) >= 13 and alert.level == "alarm"  # a commit for each at least
        assert text.startswith(f"commits at the end of {FILE}-wal cannot be read and are left out")
        service.store.flush()  # the alarm, with which the log begins anew
        crash(tmp_path / "crashed", tmp_path / "again")
    with running(tmp_path / "again", settings=_no_snapshots()) as service:  # no longer in the log
        assert service.store.lost_commits == 0


def test_what_operators_closed_behind_a_damaged_record_stays_closed(tmp_path: Path) -> None:
    """One view that could not be read opened the ground that an operator had closed after it."""
    flown = views(10)
    with running(tmp_path / "data", settings=_no_snapshots()) as service, asked(service) as http:
        give(service, flown)
        drawn = {"polygon": [[50, 50], [55, 50], [55, 55]], "reason": "ambulance"}
        added = http.post("/api/v1/zones", json=drawn).json()["id"]
        assert http.post("/api/v1/zones/Z1/lock", json={"reason": "stage"}).status_code == 200
        assert http.post("/api/v1/zones/Z1/unlock", json={"reason": "over"}).status_code == 200
        assert http.post("/api/v1/zones/Z1/lock", json={"reason": "again"}).status_code == 200
        assert http.post("/api/v1/drones/uav2/leave-out", json={"reason": "covered"}).status_code == 204
        crash(tmp_path / "data", tmp_path / "crashed")
    damage(tmp_path / "crashed", "UPDATE journal SET body = x'00' WHERE seq = 30")
    with running(tmp_path / "crashed", settings=_no_snapshots()) as service, asked(service) as http:
        (alert,) = [alert for alert in service.alerts.all() if alert.kind == "records_damaged"]
        assert alert.text.startswith("6 records at the end of the journal are damaged and put aside")
        # The second lock of a zone that is locked already is the same again.
        assert "5 of them tell what operators did, of which 4 that close are done again" in alert.text
        zones = {zone["id"]: zone for zone in http.get("/api/v1/zones").json()["zones"]}
        assert zones[added]["why"] == "local closed it: ambulance" and zones["Z1"]["locked"]
        assert [one.reason for one in service.mission.left_out] == ["covered"]
        settle(service)
        crash(tmp_path / "crashed", tmp_path / "again")
        expected = state(service)
    with running(tmp_path / "again", settings=_no_snapshots()) as service:
        assert state(service) == expected and not service.store.rows("SELECT 1 FROM journal WHERE seq > 33")


@pytest.mark.parametrize("where", ["body = 'text'", "drone = CAST(x'ff' AS TEXT)", "checksum = 'x'"])
def test_a_record_that_is_damaged_in_any_field_is_put_aside(tmp_path: Path, where: str) -> None:
    """A text in place of bytes, or no text at all, ended the start with an error of Python's or SQLite's."""
    with running(tmp_path / "data", settings=_no_snapshots()) as service:
        give(service, views(4)[:8])
        expected = state(service)
        give(service, views(4)[8:])
        crash(tmp_path / "data", tmp_path / "crashed")
    damage(tmp_path / "crashed", f"UPDATE journal SET {where} WHERE seq = 9")
    with running(tmp_path / "crashed", settings=_no_snapshots()) as service:
        assert state(service) == expected
        (alert,) = [alert for alert in service.alerts.all() if alert.kind == "records_damaged"]
        assert alert.text.startswith("4 records")


@pytest.mark.parametrize(
    "body", ["'{'", "'[]'", "x'00'", "CAST(x'7bff' AS TEXT)", "replace(body, '\"level\"', '\"levil\"')"]
)
def test_an_alert_that_is_damaged_stops_nothing_and_is_told(tmp_path: Path, body: str) -> None:
    """One damaged byte in an old alert, and the service did not start any more."""
    with running(tmp_path / "data") as service:
        give(service, views(3))
        service.alerts.raise_("disk", "alarm", "nearly full", START_NS)
        service.alerts.raise_("clock", "alarm", "clock of uav1", START_NS, drone="uav1")
        service.store.flush()
        crash(tmp_path / "data", tmp_path / "crashed")
        expected = state(service)
    damage(tmp_path / "crashed", f"UPDATE alerts SET body = {body} WHERE body LIKE '%nearly full%'")
    with running(tmp_path / "crashed") as service:
        assert state(service) == expected
        told = [alert.text for alert in service.alerts.all()]
        assert told[0] == "1 alerts of before are damaged, and what they told is not known"
        assert "clock of uav1" in told and "nearly full" not in told


def test_damaged_records_are_told_each_time_also_while_the_disk_is_nearly_full(tmp_path: Path) -> None:
    """Whatever was told before and is not over, and whether somebody has looked or not."""
    with running(tmp_path / "0", settings=_no_snapshots()) as service:
        give(service, views(4))
        service.alerts.raise_("disk", "alarm", "only 90 MB are free for the journal", START_NS)
        service.store.flush()
        crash(tmp_path / "0", tmp_path / "1")
    told = []
    for start, (lost, first) in enumerate(((4, 9), (2, 7)), 1):
        folder = tmp_path / str(start)
        damage(folder, f"UPDATE journal SET body = x'00' WHERE seq = {first}")
        with running(folder, settings=_no_snapshots()) as service, asked(service) as http:
            told.insert(0, f"{lost} records at the end of the journal are damaged")
            alerts = http.get("/api/v1/alerts").json()["alerts"]
            texts = [alert["text"].split(" and put")[0] for alert in alerts if alert["kind"] != "disk"]
            assert texts == told
            service.store.flush()
            crash(folder, tmp_path / str(start + 1))


def test_a_damaged_snapshot_falls_back_on_the_one_before(tmp_path: Path) -> None:
    flown = views(9)
    with running(tmp_path / "data") as service:
        give(service, flown)
        service.store.flush()
        assert service.store.rows("SELECT COUNT(*) FROM snapshots") == [(2,)]
        crash(tmp_path / "data", tmp_path / "crashed")
        expected = state(service)
    damage(
        tmp_path / "crashed",
        "UPDATE snapshots SET body = zeroblob(50) WHERE seq = (SELECT MAX(seq) FROM snapshots)",
    )
    with running(tmp_path / "crashed") as service:
        assert state(service) == expected


def flown_for_long(folder: Path) -> None:
    """Two snapshots, and of the journal what they need and the last seconds."""
    quick = type(SETTINGS)(**{**_fields(SETTINGS), "max_age_s": 1.0})
    with running(folder, settings=quick) as service:
        give(service, views(60))
        service.store.flush()
        ((first,),) = service.store.rows("SELECT MIN(seq) FROM journal")
        assert first > 1


@pytest.mark.parametrize(
    "damaging",
    [
        "UPDATE snapshots SET body = zeroblob(50)",
        "UPDATE snapshots SET seq = seq + 1000, body = x'00', checksum = 3523407757",
        "UPDATE snapshots SET body = 'text'",
        "UPDATE snapshots SET seq = seq - 1",
        "DELETE FROM snapshots",
        "DELETE FROM journal WHERE seq < (SELECT MAX(seq) FROM journal);"
        "DELETE FROM snapshots WHERE seq >= (SELECT MAX(seq) - 1 FROM journal)",
    ],
    ids=["checksums", "another build", "no bytes", "of other places", "none", "records between are gone"],
)
def test_without_a_snapshot_that_fits_the_journal_the_service_does_not_begin_anew(
    tmp_path: Path, damaging: str
) -> None:
    """It would open all that was closed."""
    flown_for_long(tmp_path)
    with sqlite3.connect(tmp_path / FILE) as connection:
        connection.executescript(damaging)
        kept = connection.execute("SELECT seq, body FROM journal").fetchall()
    words = "move the folder away to begin anew, or restore a copy"
    with pytest.raises(StoreError, match=words) as told, running(tmp_path):
        pass
    assert str(tmp_path / FILE) in str(told.value)
    with sqlite3.connect(tmp_path / FILE) as connection:
        assert connection.execute("SELECT seq, body FROM journal").fetchall() == kept, "nothing was touched"


def test_a_record_that_is_missing_in_the_middle_is_no_journal(tmp_path: Path) -> None:
    """Only the first one behind the snapshot was looked for: the map went on without what was gone."""
    with running(tmp_path / "data", settings=_no_snapshots()) as service:
        give(service, views(4))
        crash(tmp_path / "data", tmp_path / "crashed")
    damage(tmp_path / "crashed", "DELETE FROM journal WHERE seq IN (6, 7)")
    with (
        pytest.raises(StoreError, match="records 6 to 7 are gone"),
        running(tmp_path / "crashed", settings=_no_snapshots()),
    ):
        pass


def test_each_damaged_snapshot_is_in_the_log(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    flown_for_long(tmp_path)
    damage(tmp_path, "UPDATE snapshots SET body = zeroblob(50)")
    with pytest.raises(StoreError), running(tmp_path):
        pass
    assert [record.getMessage() for record in caplog.records if "damaged" in record.getMessage()] == [
        "snapshot 180 is damaged: its checksum does not fit",
        "snapshot 175 is damaged: its checksum does not fit",
    ]


def test_a_snapshot_that_fails_half_way_leaves_nothing_of_it_behind(tmp_path: Path) -> None:
    """What an operator did since the one before is done once."""
    with running(tmp_path / "data") as service, asked(service) as http:
        give(service, views(2))
        drawn = {"polygon": [[1, 1], [4, 1], [4, 4]], "reason": "ambulance"}
        assert http.post("/api/v1/zones", json=drawn).status_code == 201
        give(service, views(5)[6:])
        service.store.flush()
        crash(tmp_path / "data", tmp_path / "crashed")
        expected, zones = state(service), http.get("/api/v1/zones").json()["zones"]
    with sqlite3.connect(tmp_path / "crashed" / FILE) as connection:
        seq, body = connection.execute("SELECT seq, body FROM snapshots ORDER BY seq DESC").fetchone()
        told, mission = unpacked(body)
        body = packed(json.dumps({**json.loads(told), "cameras": {"uav1": [0]}}).encode(), mission)
        connection.execute(
            "UPDATE snapshots SET body = ?, checksum = ? WHERE seq = ?", (body, zlib.crc32(body), seq)
        )
        assert connection.execute("SELECT COUNT(*) FROM snapshots").fetchone() == (2,)
    with running(tmp_path / "crashed") as service, asked(service) as http:
        assert state(service) == expected
        assert [zone["id"] for zone in http.get("/api/v1/zones").json()["zones"]] == [
            zone["id"] for zone in zones
        ]


@pytest.mark.parametrize("places", ["given again", "left empty, as by older builds"])
def test_after_a_damaged_tail_the_journal_goes_on(tmp_path: Path, places: str) -> None:
    flown = views(5)
    with running(tmp_path / "data", settings=_no_snapshots()) as service:
        give(service, flown[:8])  # its end leaves a snapshot
    with running(tmp_path / "data", settings=_no_snapshots()) as service:
        give(service, flown[8:12])
        crash(tmp_path / "data", tmp_path / "crashed")
    damage(tmp_path / "crashed", "UPDATE journal SET body = x'00' WHERE seq = 9")
    with running(tmp_path / "crashed", settings=_no_snapshots()) as service:
        give(service, flown[12:])
        _, expected = state(service)
        crash(tmp_path / "crashed", tmp_path / "again")
    if places != "given again":
        damage(tmp_path / "again", "UPDATE journal SET seq = seq + 1000 WHERE seq > 8")
        damage(tmp_path / "again", "UPDATE journal SET seq = seq - 996 WHERE seq > 8")
    with running(tmp_path / "again", settings=_no_snapshots()) as service:
        assert state(service)[1] == expected


def test_bytes_at_the_end_of_the_log_that_no_commit_finished_change_nothing(tmp_path: Path) -> None:
    flown = views(4)
    with running(tmp_path / "data", settings=_no_snapshots()) as service:
        give(service, flown)
        expected = state(service)
        crash(tmp_path / "data", tmp_path / "crashed")
    log = tmp_path / "crashed" / f"{FILE}-wal"
    log.write_bytes(log.read_bytes() + random.Random(1).randbytes(5000))
    with running(tmp_path / "crashed", settings=_no_snapshots()) as service:
        assert state(service) == expected


def test_a_file_that_is_no_store_is_refused(tmp_path: Path) -> None:
    (tmp_path / FILE).write_bytes(b"crowd" * 1000)
    with pytest.raises(StoreError, match="file is not a database"), running(tmp_path):
        pass


def test_a_folder_of_another_mission_is_refused(tmp_path: Path) -> None:
    with running(tmp_path):
        pass
    other = replace(CONFIG, method=EvidenceConfig(memory_s=4.0), zones=replace(CONFIG.zones, min_area_m2=9.0))
    differs = r"another configuration \(memory_s 3.0, now 4.0; min_area_m2 3.0, now 9.0\): start it with the"
    with pytest.raises(StoreError, match=differs), live(tmp_path, plain(), other, name="x"):
        pass


def test_a_folder_of_an_older_build_goes_on(tmp_path: Path) -> None:
    """It did not know `from_below`, which nobody sets: no option led past "from_below null, now null"."""
    flown = views(6)
    with running(tmp_path) as service:
        give(service, flown)
        before = state(service)
    with sqlite3.connect(tmp_path / FILE) as file:
        (text,) = file.execute("SELECT value FROM about WHERE name = 'configuration'").fetchone()
        known = json.loads(text)
        assert known.pop("from_below") is None
        changed = (json.dumps(known, sort_keys=True),)
        file.execute("UPDATE about SET value = ? WHERE name = 'configuration'", changed)
    file.close()
    with running(tmp_path) as service:
        assert state(service) == before
    other = replace(CONFIG, method=replace(CONFIG.method, from_below="against"))
    differs = r"another configuration \(from_below null, now \"against\"\): start it with the same"
    with pytest.raises(StoreError, match=differs), live(tmp_path, plain(), other, name="x"):
        pass


def test_a_folder_of_another_origin_is_refused(tmp_path: Path) -> None:
    """Zones are kept in local metres: they would all move."""
    here, there = Georeference(46.5, 8.0, 1200.0), Georeference(46.6, 8.0, 1200.0)
    with running(tmp_path / "here", georeference=here):
        pass
    for other in (there, Georeference(46.5, 8.0, 1201.0), None):
        with (
            pytest.raises(StoreError, match=r"another origin.*: start it with the same to go on, or name"),
            running(tmp_path / "here", georeference=other),
        ):
            pass
    # One that was computed again may differ in its last digit.
    with running(tmp_path / "here", georeference=Georeference(46.5 + 1e-14, 8.0, 1200.0)):
        pass
    with running(tmp_path / "nowhere"):
        pass
    with pytest.raises(StoreError, match="another origin"), running(tmp_path / "nowhere", georeference=here):
        pass


def test_a_folder_of_before_takes_the_origin_of_its_next_start(tmp_path: Path) -> None:
    here, there = Georeference(46.5, 8.0, 1200.0), Georeference(46.6, 8.0, 1200.0)
    with running(tmp_path, georeference=here):
        pass
    damage(tmp_path, "DELETE FROM about WHERE name = 'origin'")
    with running(tmp_path, georeference=there):
        pass
    with pytest.raises(StoreError, match="another origin"), running(tmp_path, georeference=here):
        pass


def test_two_services_do_not_share_a_folder(tmp_path: Path) -> None:
    with running(tmp_path), pytest.raises(StoreError, match="in use"), running(tmp_path):
        pass


def test_what_the_state_no_longer_needs_is_removed(tmp_path: Path) -> None:
    """Journal and snapshots stay as small as the time in which a view may come twice."""
    quick = type(SETTINGS)(**{**_fields(SETTINGS), "max_age_s": 1.0})
    with running(tmp_path, settings=quick) as service:
        give(service, views(60))
        service.store.flush()
        ((count, oldest),) = service.store.rows("SELECT COUNT(*), MIN(stamp_ns) FROM journal")
        assert oldest > START_NS + 8 * 10**9  # of 12 s, 2 s are kept, and what the older snapshot needs
        assert count < 60
        assert service.store.rows("SELECT COUNT(*) FROM snapshots") == [(2,)]


def _fields(one: object) -> dict:
    return {name: getattr(one, name) for name in one.__slots__}


def _no_snapshots() -> object:
    return type(SETTINGS)(**{**_fields(SETTINGS), "snapshot_every": 10_000})


def test_the_journal_reads_as_it_was_given(tmp_path: Path) -> None:
    one = views(1)[0]
    with running(tmp_path, settings=_no_snapshots()) as service:
        give(service, [one])
        ((body,),) = service.store.rows("SELECT body FROM journal")
    assert json.loads(body)["stamp_ns"] == one.stamp_ns
