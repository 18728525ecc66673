"""What the service tells once no view comes any more: nothing old looks new."""

import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crowdfence import Camera, View, VoxelState
from crowdfence.config import EvidenceConfig
from crowdfence.service import stream
from crowdfence.service.belief import ColumnBeliefs
from crowdfence.service.clock import Clock
from crowdfence.service.service import Service
from support.small_service import (
    CONFIG,
    SECOND_NS,
    SETTINGS,
    START_NS,
    as_client,
    asked,
    message,
    running,
    settle,
    views,
)

INSTANTS = 9
CAMERA = Camera.pinhole(320, 240, 240.0, 240.0, 160.0, 120.0)
"""The field of view of `support.small_service`, in finer pixels: one drone alone is sure of what it sees."""
SLOW_TO_FORGET = replace(CONFIG, method=EvidenceConfig())


class Now:
    def __init__(self) -> None:
        self.ns = START_NS

    def clock(self) -> Clock:
        return Clock("system", system=lambda: self.ns, steady=lambda: self.ns)


def flown(service: Service, now: Now) -> None:
    """Where no crowd is, heatmaps are sure of it."""
    assert service.live is not None
    for one in views(INSTANTS):
        now.ns = one.stamp_ns
        sure = np.where(one.heatmap > 0.5, one.heatmap, 0.0).astype(np.float32)
        service.live.intake.give_view(
            message(View(one.drone, one.stamp_ns, CAMERA, one.world_from_camera, sure))
        )
    service.live.finish()


def states(belief: ColumnBeliefs) -> Counter[str]:
    return Counter(VoxelState(int(state)).name for state in belief.state)


def test_who_listens_after_a_silence_hears_how_old_the_newest_step_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stream, "FRESH_S", 0.05)
    now = Now()
    with running(tmp_path, clock=now.clock()) as service, asked(service) as http:
        flown(service, now)
        for silent_s in (0.0, 28.0, 3600.0):
            now.ns = views(INSTANTS)[-1].stamp_ns + round(silent_s * SECOND_NS)
            time.sleep(0.1)
            with http.websocket_connect("/api/v1/stream") as one:
                told = one.receive_json()
                while told["type"] != "step":
                    told = one.receive_json()
            assert told["lag_s"] == pytest.approx(silent_s, abs=0.5)
            drones = told["drones"]["drones"]
            assert len(drones) == 3
            for drone in drones:
                assert drone["age_s"] == pytest.approx(silent_s, abs=0.5)
                assert drone["status"] == ("ok" if silent_s == 0.0 else "stale")


def test_how_long_no_view_came_is_told_whatever_is_published_meanwhile(tmp_path: Path) -> None:
    now = Now()
    with running(tmp_path, clock=now.clock()) as service:
        flown(service, now)
        told = service.step_json(service.moment(None))
        assert 0.0 <= told["silent_s"] < 30.0
    now.ns += 90 * SECOND_NS
    with running(tmp_path, clock=now.clock()) as service, asked(service) as http:
        corners = [[1, 1], [4, 1], [4, 4]]
        assert http.post("/api/v1/zones", json={"polygon": corners, "reason": "stage"}).status_code == 201
        told = service.step_json(service.moment(None))
        assert told["lag_s"] == 0.0, "an operator did something"
        assert told["silent_s"] == pytest.approx(90.0, abs=1.0), "no drone did"
    with running(tmp_path / "new", clock=now.clock()) as service:
        assert service.step_json(service.moment(None))["silent_s"] is None


def test_empty_ground_turns_stale_while_no_view_comes(tmp_path: Path) -> None:
    now = Now()
    with running(tmp_path, config=SLOW_TO_FORGET, clock=now.clock()) as service, asked(service) as http:
        client = as_client(http)
        flown(service, now)
        fresh = client.belief()
        assert states(fresh)["EMPTY"] > 100 and not states(fresh)["STALE"]
        tag = http.get("/belief").headers["etag"]
        assert http.get("/belief", headers={"if-none-match": tag}).status_code == 304
        now.ns += 5 * SECOND_NS
        assert states(client.belief())["EMPTY"] > 0
        now.ns += 27 * SECOND_NS
        later = client.belief()
        assert later.stamp_ns == now.ns and not states(later)["EMPTY"]
        assert states(later)["STALE"] + states(later)["NOT_CLEARED"] + states(later)["CROWD"] == len(later)
        assert later.age_s[np.isfinite(later.age_s)].min() > 30.0
        assert http.get("/belief", headers={"if-none-match": tag}).status_code == 200


@pytest.mark.skipif(not hasattr(time, "CLOCK_BOOTTIME"), reason="a clock that counts sleep is one of Linux")
def test_what_was_seen_before_the_machine_slept_is_as_old_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A laptop is closed for ten minutes: CLOCK_MONOTONIC stands still, the clock on the wall does not."""
    slept_s, counted = [0.0], time.clock_gettime_ns

    def clock_gettime_ns(which: int) -> int:
        return counted(which) + round(slept_s[0] * SECOND_NS) * (which == time.CLOCK_BOOTTIME)

    monkeypatch.setattr(time, "clock_gettime_ns", clock_gettime_ns)
    begun_ns = counted(time.CLOCK_BOOTTIME)

    def wall_ns() -> int:
        return START_NS + clock_gettime_ns(time.CLOCK_BOOTTIME) - begun_ns

    clock = Clock("system", system=wall_ns)
    with running(tmp_path, config=SLOW_TO_FORGET, clock=clock) as service, asked(service) as http:
        flown(service, Now())
        assert states(as_client(http).belief())["EMPTY"] > 100
        slept_s[0] = 600.0
        assert not states(as_client(http).belief())["EMPTY"]
        assert service.step_json(service.moment(None))["silent_s"] >= 600.0
        late = views(INSTANTS)[-1]
        awake = View(late.drone, wall_ns(), CAMERA, late.world_from_camera, np.zeros((12, 16), np.float32))
        service.live.intake.give_view(message(awake))  # nobody has to start the service again
        assert clock.jumped_ns() == 0


def test_the_history_keeps_the_map_as_it_was_at_its_moments(tmp_path: Path) -> None:
    """Also where somebody asked for it long after, and another view came then."""
    now = Now()
    with running(tmp_path, config=SLOW_TO_FORGET, clock=now.clock()) as service, asked(service) as http:
        client = as_client(http)
        flown(service, now)
        newest_ns = service.mission.newest.stamp_ns
        now.ns += 40 * SECOND_NS
        assert not states(client.belief())["EMPTY"]
        service.mission._next_belief_s = 0.0
        service.mission.keep_belief()
        service.store.flush()
        kept = service.mission.timeline.belief_at(newest_ns)
        assert kept is not None and states(ColumnBeliefs.of(kept[1]))["EMPTY"] > 100


def test_a_map_of_the_past_is_as_old_as_it_was_at_the_stamp_asked_for(tmp_path: Path) -> None:
    """Nobody looked for ten minutes, then somebody did: what was empty before was not known to be in
    between."""
    now = Now()
    with running(tmp_path, config=SLOW_TO_FORGET, clock=now.clock()) as service, asked(service) as http:
        client = as_client(http)
        flown(service, now)
        service.store.flush()
        begun_ns = service.mission.newest.stamp_ns
        now.ns += 600 * SECOND_NS
        late = views(INSTANTS)[-1]
        again = View(late.drone, now.ns, CAMERA, late.world_from_camera, np.zeros((12, 16), np.float32))
        service.live.intake.give_view(message(again))
        service.live.finish()
        then, soon = (client.belief(begun_ns + seconds * SECOND_NS) for seconds in (0, 10))
        gap = client.belief(begun_ns + 300 * SECOND_NS)
    assert states(then)["EMPTY"] == states(soon)["EMPTY"] > 100
    assert not states(gap)["EMPTY"] and states(gap)["STALE"] == states(then)["EMPTY"]
    assert gap.stamp_ns == begun_ns + 300 * SECOND_NS
    known = np.isfinite(then.age_s)
    np.testing.assert_allclose(gap.age_s[known], then.age_s[known] + 300.0, atol=0.11)
    assert np.isinf(gap.age_s[~known]).all() and np.array_equal(gap.west_m, then.west_m)
    assert np.array_equal(gap.state == VoxelState.CROWD, then.state == VoxelState.CROWD)


def test_maps_of_two_missions_are_never_taken_for_each_other(tmp_path: Path) -> None:
    """On the same port, as a page or a cache sees it: both have a first moment."""
    tags = []
    for name in ("one", "another"):
        with running(tmp_path / name, settings=SETTINGS) as service, asked(service) as http:
            assert service.live is not None
            for one in views(1):
                service.live.intake.give_view(message(one))
            settle(service)
            service.live.finish()
            known = {"if-none-match": tags[0]} if tags else {}
            answer = http.get("/api/v1/belief", headers=known)
            assert answer.status_code == 200
            tags.append(answer.headers["etag"])
    assert len(set(tags)) == 2


def test_who_listens_after_a_restart_hears_what_is_closed_before_any_view_comes(tmp_path: Path) -> None:
    now = Now()
    with running(tmp_path, clock=now.clock()) as service:
        flown(service, now)
        before = service.step_json(service.moment(None))
    now.ns += 90 * SECOND_NS
    with running(tmp_path, clock=now.clock()) as service, asked(service) as http:
        with http.websocket_connect("/api/v1/stream") as one:
            assert one.receive_json()["type"] == "hello"
            service.set_mode("live")  # something else to hear, where there is no step
            while (told := one.receive_json())["type"] == "alert":
                continue
        run = {"run": service.mission.run}
        assert told["type"] == "step" and told["zones"] == {**before["zones"], **run}
        assert told["zones"]["zones"] and told["closed_m2"] == before["closed_m2"] > 0.0
        assert told["lag_s"] == pytest.approx(90.0, abs=1.0)
