"""The clock of the machine was ahead and is set right: what was stamped by it lies in the future."""

from pathlib import Path

import pytest

from crowdfence import View
from crowdfence.iso_time import iso_utc
from crowdfence.service.clock import Clock
from crowdfence.service.service import Service
from crowdfence.service.store import StoreError
from crowdfence.service.watch import Watch
from support.small_service import CAMERA, SECOND_NS, START_NS, asked, message, running, settle, view, views


class Now:
    def __init__(self, ahead_s: float = 0.0) -> None:
        self.ns = START_NS + round(ahead_s * SECOND_NS)

    def clock(self) -> Clock:
        return Clock("system", system=lambda: self.ns, steady=lambda: self.ns)


def ahead(one: View, seconds: float) -> View:
    stamp_ns = one.stamp_ns + round(seconds * SECOND_NS)
    return View(one.drone, stamp_ns, CAMERA, one.world_from_camera, one.heatmap)


def flown(service: Service, now: Now, *, ahead_s: float = 0.0, first: int = 0, last: int = 9) -> None:
    """Views that are `ahead_s` ahead of the service's clock, at their own pace."""
    assert service.live is not None
    for one in views(last)[3 * first :]:
        now.ns = max(now.ns, one.stamp_ns)
        service.live.intake.give_view(message(ahead(one, ahead_s)))
    settle(service)


@pytest.mark.parametrize("how", ["views", "observer"])
def test_a_state_from_the_future_is_refused_until_time_has_caught_up(tmp_path: Path, how: str) -> None:
    fast = Now(600.0)
    with running(tmp_path, clock=fast.clock()) as service:
        assert service.live is not None
        if how == "views":
            for one in views(9):
                service.live.intake.give_view(message(ahead(one, 600.0)))
        else:
            with asked(service) as http:
                corners = [[1, 1], [4, 1], [4, 4]]
                http.post("/api/v1/zones", json={"polygon": corners, "reason": "stage"})
        settle(service)
        newest_ns = service.live.newest_ns
    now = Now()
    with pytest.raises(StoreError) as refused, running(tmp_path, clock=now.clock()):
        pass
    for told in (iso_utc(newest_ns), iso_utc(now.ns), "set the clock", "--data"):
        assert told in str(refused.value)
    now.ns = newest_ns - SECOND_NS
    with running(tmp_path, clock=now.clock()) as service:
        assert service.mission.newest.zones.closed, "as far ahead as views may be, and nothing is lost"


def test_a_simulation_goes_on_whatever_the_machine_says(tmp_path: Path) -> None:
    for _ in range(2):
        with running(tmp_path) as service:  # by the clock of the views
            assert service.live is not None
            service.live.intake.give_view(message(ahead(view("uav1", 0), 86_400.0 * 365 * 50)))
            settle(service)


def test_a_dismissal_ends_by_the_clock_however_far_ahead_views_are(tmp_path: Path) -> None:
    now = Now()
    with running(tmp_path, clock=now.clock()) as service, asked(service) as http:
        flown(service, now, ahead_s=1.9)
        newest_ns = service.mission.newest.stamp_ns
        assert newest_ns > now.ns
        told = http.post("/api/v1/zones/Z1/dismiss", json={"reason": "film crew"}).json()
        assert int(told["dismissed"]["until_ns"]) == now.ns + 60 * SECOND_NS
        now.ns += 59 * SECOND_NS
        service.mission.publish(now.ns + SECOND_NS + SECOND_NS // 2)
        assert '"Z1"' not in http.get("/api/v1/export").text, "no sooner for a stamp that is ahead"
        now.ns += SECOND_NS
        Watch(service).look()
        assert '"Z1"' in http.get("/api/v1/export").text


def test_dismissals_of_a_clock_that_was_ahead_end_with_it(tmp_path: Path) -> None:
    """The drones' clocks were right, so that no look is of the future."""
    now = Now(30.0)
    with running(tmp_path, clock=now.clock()) as service, asked(service) as http:
        flown(service, now)
        http.post("/api/v1/zones/Z1/dismiss", json={"reason": "film crew"})
        flown(service, now, first=9, last=12)
        assert service.live is not None
        service.live.finish()
        assert service.mission.newest.marks["Z1"]["dismissed"]
    now.ns = views(12)[-1].stamp_ns + SECOND_NS
    with running(tmp_path, clock=now.clock()) as service, asked(service) as http:
        assert not service.mission.newest.marks.get("Z1", {}).get("dismissed")
        assert '"Z1"' in http.get("/api/v1/export").text
        assert told_to_leave(service) == ["zone Z1 is closed again: it is no longer dismissed"]


def told_to_leave(service: Service) -> list[str]:
    return [one.text for one in service.alerts.all() if (one.kind, one.level) == ("new_zone", "warning")]


def test_a_dismissal_that_ends_while_the_service_is_away_is_told(tmp_path: Path) -> None:
    """Whoever was let through flies there still."""
    now = Now()
    with running(tmp_path, clock=now.clock()) as service, asked(service) as http:
        flown(service, now)
        http.post("/api/v1/zones/Z1/dismiss", json={"reason": "film crew"})
    now.ns += 70 * SECOND_NS
    with running(tmp_path, clock=now.clock()) as service:
        Watch(service).look()
        assert told_to_leave(service) == ["zone Z1 is closed again: it is no longer dismissed"]


def test_who_asks_for_now_gets_what_a_drone_that_is_ahead_saw(tmp_path: Path) -> None:
    now = Now()
    with running(tmp_path, clock=now.clock()) as service, asked(service) as http:
        flown(service, now, ahead_s=1.9)

        def at(stamp_ns: int) -> str:
            return http.get("/api/v1/zones", params={"at": stamp_ns}).json()["stamp_ns"]

        service.store.flush()
        newest_ns = service.mission.newest.stamp_ns
        assert newest_ns > now.ns
        assert at(now.ns) == at(now.ns - SECOND_NS // 10) == str(newest_ns)
        before = [int(one["stamp_ns"]) for one in service.mission.timeline.points()][-2]
        assert now.ns < before and at(before) == str(before), "a stamp that was told is that moment's"


def test_a_drone_that_was_last_seen_in_the_future_is_not_there_now(tmp_path: Path) -> None:
    now = Now()
    with running(tmp_path, clock=now.clock()) as service, asked(service) as http:
        flown(service, now)
        now.ns -= 600 * SECOND_NS
        for drone in http.get("/api/v1/drones").json()["drones"]:
            assert (drone["status"], drone["age_s"]) == ("stale", None)
        Watch(service).look()
        silent = {one.drone for one in service.alerts.all() if one.kind == "drone_silent"}
        assert silent == {"uav1", "uav2", "uav3"}


def test_a_clock_that_is_set_back_says_when_the_service_starts_again(tmp_path: Path) -> None:
    now, set_back_ns = Now(), 0
    clock = Clock("system", system=lambda: now.ns + set_back_ns, steady=lambda: now.ns)
    with running(tmp_path, clock=clock) as service:
        set_back_ns = -600 * SECOND_NS
        Watch(service).look()
        (alert,) = [one for one in service.alerts.all() if one.kind == "clock"]
        assert "-600.0 s" in alert.text and "once that clock has passed" in alert.text
