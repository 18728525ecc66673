"""A drone that an operator leaves out is one that does not look: nothing that is closed below it opens."""

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np
import pytest

from crowdfence import View
from crowdfence.service.client import ServiceError
from crowdfence.service.opening import replayed
from crowdfence.service.service import Service
from crowdfence.service.store import FILE
from crowdfence.service.watch import Watch
from support.small_service import (
    CONFIG,
    DRONES,
    SETTINGS,
    as_client,
    asked,
    message,
    plain,
    recording,
    running,
    settle,
    sharp,
    stamp_ns,
    view,
    views,
    wait_for_end,
)


def give(service: Service, flown: Sequence[View]) -> None:
    assert service.live is not None
    for one in flown:
        service.live.intake.give_view(message(one))
    settle(service)


def crowd_map_of(service: Service) -> bytes:
    assert service.live is not None
    service.live.finish()
    return service.mission.loop.crowd_map.to_bytes()


def blind(number: int) -> View:
    """uav2 where uav1 was in the beginning, and it sees nobody."""
    there = view("uav1", 2)
    shown = View("uav2", stamp_ns("uav2", number), there.camera, there.world_from_camera, there.heatmap)
    return sharp(shown, blind=True)


def test_its_looks_are_in_no_map(tmp_path: Path) -> None:
    """As if it had not flown: to the bit, also where it is the last of an instant or alone in one."""
    flown = views(8, ("uav1", "uav2")) + views(4, ("uav3",))
    flown.sort(key=lambda one: one.stamp_ns)
    without = [one for one in flown if one.drone != "uav3"]
    with running(tmp_path / "one", drones=DRONES) as service, asked(service) as http:
        as_client(http).leave_out_drone("uav3", "its lens is covered")
        give(service, flown)
        left_out = crowd_map_of(service)
        assert service.live is not None and service.live.heard.left_out == {"uav3": 4}
        assert "crowdfence_views_left_out_total" in http.get("http://localhost/metrics").text
        assert service.fleet.last("uav3") is not None, "where it is stays known"
    with running(tmp_path / "other", drones=DRONES) as service:
        give(service, without)
        assert crowd_map_of(service) == left_out


@pytest.mark.parametrize("leave_out", [False, True])
def test_a_blind_one_opens_nothing(tmp_path: Path, leave_out: bool) -> None:
    """uav1 shows a crowd and flies off; uav2 looks at it for 5 s and sees nobody."""
    with running(tmp_path, drones=DRONES) as service, asked(service) as http:
        give(service, [sharp(view("uav1", number)) for number in range(5)])
        before = service.mission.newest
        assert before is not None and len(before.zones) >= 1
        if leave_out:
            as_client(http).leave_out_drone("uav2", "its lens is covered")
        give(service, [blind(number) for number in range(5, 30)])
        assert service.live is not None
        service.live.finish()
        newest = service.mission.newest
        assert newest is not None and newest.stamp_ns == stamp_ns("uav2", 29)
        closed_m2, was_m2 = newest.zones.closed_m2, before.zones.closed_m2
        assert closed_m2 >= was_m2 if leave_out else closed_m2 < 0.5 * was_m2, (closed_m2, was_m2)


def test_everybody_is_told_who_did_it_and_why_until_it_is_taken_in(tmp_path: Path) -> None:
    with running(tmp_path, drones=DRONES) as service, asked(service) as http:
        client, watch = as_client(http), Watch(service)
        give(service, views(2))
        client.leave_out_drone("uav2", "rain on its lens")
        told = {one["drone"]: one["left_out"] for one in client.drones()}
        assert told["uav1"] is None and told["uav3"] is None
        assert told["uav2"]["name"] and told["uav2"]["reason"] == "rain on its lens"
        watch.look()
        (alert,) = [one for one in client.alerts() if one["kind"] == "left_out"]
        assert (
            alert["drone"] == "uav2" and alert["level"] == "warning" and "rain on its lens" in alert["text"]
        )
        for again in (client.leave_out_drone, client.take_in_drone):
            with pytest.raises(ServiceError) as refused:
                again("uav2" if again == client.leave_out_drone else "uav1", "once more")
            assert refused.value.status == 409
        with pytest.raises(ServiceError, match=r"no drone uav9; there are: uav1, uav2, uav3") as refused:
            client.leave_out_drone("uav9", "misspelled")
        assert refused.value.status == 404
        client.take_in_drone("uav2", "it was wiped")
        watch.look()
        assert {one["left_out"] for one in client.drones()} == {None}
        assert service.alerts.active("left_out", "uav2") is None
        audit = http.get("/audit").json()["entries"]
        assert [(one["action"], one["drone"], one["zone"], one["reason"]) for one in audit] == [
            ("take_in", "uav2", None, "it was wiped"),
            ("leave_out", "uav2", None, "rain on its lens"),
        ]


def test_one_that_denies_crowd_is_not_told_twice(tmp_path: Path) -> None:
    """Once it is left out, what it sees opens nothing, and that is what is told of it."""
    with running(tmp_path, drones=DRONES) as service, asked(service) as http:
        watch = Watch(service)
        flown = [one for number in range(25) for one in (sharp(view("uav1", number)), blind(number))]
        give(service, flown)
        watch.look()
        assert service.alerts.active("denied_crowd", "uav2") is not None
        as_client(http).leave_out_drone("uav2", "its lens is covered")
        watch.look()
        assert service.alerts.active("denied_crowd", "uav2") is None
        assert service.alerts.active("left_out", "uav2") is not None


@pytest.mark.parametrize("snapshot_every", [1, 1000])
def test_it_stays_left_out_after_a_crash(tmp_path: Path, snapshot_every: int) -> None:

    settings = replace(SETTINGS, snapshot_every=snapshot_every)
    with running(tmp_path / "one", drones=DRONES, settings=settings) as service, asked(service) as http:
        give(service, views(2))
        as_client(http).leave_out_drone("uav2", "its lens is covered")
        give(service, views(4)[6:])
        crashed = tmp_path / "crashed"
        crashed.mkdir()
        for name in (FILE, f"{FILE}-wal"):
            (crashed / name).write_bytes((tmp_path / "one" / name).read_bytes())
        give(service, views(6)[12:])
        whole = crowd_map_of(service)
    with running(crashed, drones=DRONES, settings=settings) as service:
        assert "uav2" in service.mission.left_out
        give(service, views(6)[12:])
        assert crowd_map_of(service) == whole


def test_a_replay_leaves_it_out_too() -> None:
    """From the first instant on, which waits for the operator here."""
    decided = Event()
    flown = recording(views(6))
    first, *others = flown.frames
    read = first.pixels.heatmap

    def waits() -> np.ndarray:
        assert decided.wait(60.0) and read is not None
        return read()

    first = replace(first, pixels=replace(first.pixels, heatmap=waits))
    flown = replace(flown, frames=(first, *others))
    with replayed(flown, plain(), CONFIG, speed=float("inf"), settings=SETTINGS) as service:
        with asked(service) as http:
            as_client(http).leave_out_drone("uav2", "its lens is covered")
            decided.set()
            wait_for_end(service)
        assert service.mission.loop.crowd_map.drones == ["uav1", "uav3"]
        assert service.fleet.last("uav2") is not None


def test_a_folder_of_a_build_that_knew_zones_alone_goes_on(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        give(service, views(2))
    with closing(sqlite3.connect(tmp_path / FILE)) as connection:
        connection.execute("ALTER TABLE audit DROP COLUMN drone")
        connection.execute(
            "INSERT INTO audit (stamp_ns, user, role, action, zone, reason) "
            "VALUES (1, 'ana', 'operator', 'lock', 'Z1', 'because')"
        )
        connection.commit()
    with running(tmp_path) as service, asked(service) as http:
        as_client(http).leave_out_drone("uav1", "its lens is covered")
        newest, before = http.get("/audit").json()["entries"]
        assert (newest["drone"], newest["zone"]) == ("uav1", None)
        assert (before["drone"], before["zone"]) == (None, "Z1")


@pytest.mark.parametrize("value", ["'text'", "x'ff'", "1.5"])
def test_of_a_row_of_the_audit_log_that_is_damaged_the_rest_is_told(tmp_path: Path, value: str) -> None:
    """The whole log was an error 500."""
    with running(tmp_path) as service, asked(service) as http:
        give(service, views(2))
        for action in ("leave-out", "take-in"):
            http.post(f"/api/v1/drones/uav1/{action}", json={"reason": "its lens"})
        service.store.written(
            lambda connection: connection.execute(
                f"UPDATE audit SET stamp_ns = {value}, user = {value} WHERE id = 1"
            )
        )
        newest, damaged = http.get("/api/v1/audit").json()["entries"]
        assert (newest["action"], newest["user"]) == ("take_in", "local") and newest["stamp_ns"]
        assert (damaged["action"], damaged["drone"], damaged["stamp_ns"]) == ("leave_out", "uav1", None)
