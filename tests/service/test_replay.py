"""A mission through the service is the mission of `crowdfence run`, to the bit."""

import random
from collections.abc import Sequence
from pathlib import Path

import pytest

from crowdfence import CrowdMap, Observation, View, project, run
from crowdfence.pipeline import FrameLoop, Step
from crowdfence.service.opening import replayed
from crowdfence.service.service import Service
from crowdfence.sources.recording import RefusedFrame
from crowdfence.zones.history import history_line
from support.small_service import (
    CONFIG,
    SETTINGS,
    asked,
    message,
    plain,
    recording,
    running,
    settle,
    views,
    wait_for_end,
)


def lines(service: Service, stamps_ns: list[int]) -> list[dict[str, object]]:
    """The zones at every stamp, out of the service's history, every digit."""
    service.store.flush()
    moments = [service.mission.timeline.at(stamp_ns) for stamp_ns in stamps_ns]
    return [history_line(one.stamp_ns, one.zones) for one in moments if one is not None]


def test_a_replay_gives_the_map_and_the_zones_of_a_run() -> None:
    flown = recording(views())
    expected = run(flown, plain(), CONFIG)
    assert len(expected.history.sets[3]) >= 1
    with replayed(flown, plain(), CONFIG, speed=float("inf"), settings=SETTINGS) as service:
        wait_for_end(service)
        assert service.mission.loop.crowd_map.to_bytes() == expected.crowd_map.to_bytes()
        stamps_ns = list(expected.history.stamps_ns)
        told = lines(service, stamps_ns)
    assert told == [
        history_line(stamp_ns, zones)
        for stamp_ns, zones in zip(stamps_ns, expected.history.sets, strict=True)
    ]


def test_a_replay_that_ends_early_says_so_on_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """It read "finished", with the zones of the fourth instant of eight."""
    taken = FrameLoop.step

    def step(loop: FrameLoop, views: Sequence[View], stamp_ns: int, refused: Sequence[RefusedFrame]) -> Step:
        if loop.crowd_map.instant_count == 4:
            raise MemoryError
        return taken(loop, views, stamp_ns, refused)

    monkeypatch.setattr(FrameLoop, "step", step)
    with replayed(recording(views()), plain(), CONFIG, speed=float("inf"), settings=SETTINGS) as service:
        wait_for_end(service)
        alerts = [alert for alert in service.alerts.all() if alert.kind == "refused_views"]
    (alert,) = [alert for alert in alerts if "the replay ended early" in alert.text]
    assert alert.level == "alarm" and alert.cleared_ns is None
    assert alert.text.endswith("it needs more memory than there is")


@pytest.mark.parametrize("late_by", [0, 4])
def test_live_views_in_any_order_within_the_delay_give_the_map_and_the_zones_of_a_run(
    tmp_path: Path, late_by: int
) -> None:
    flown = views()
    expected = run(recording(flown), plain(), CONFIG)
    # Nobody overtakes more than four others: 0.3 s at most, less than the delay of 0.5 s.
    shuffle = random.Random(5)
    order = sorted(range(len(flown)), key=lambda place: place + shuffle.uniform(0, late_by))
    with running(tmp_path / "data") as service:
        with asked(service) as http:
            for place in order:
                answer = http.post("/api/v1/views", content=message(flown[place]))
                assert answer.status_code == 202
        settle(service)
        live = service.live
        assert live is not None
        live.finish()
        assert service.mission.loop.crowd_map.to_bytes() == expected.crowd_map.to_bytes()
        told = lines(service, list(expected.history.stamps_ns))
    assert told == [
        history_line(stamp_ns, zones)
        for stamp_ns, zones in zip(expected.history.stamps_ns, expected.history.sets, strict=True)
    ]


def observation(one: View, crowd_map: CrowdMap) -> Observation:
    return project(
        one,
        crowd_map.terrain,
        max_range_m=crowd_map.max_range_m,
        target_height_m=crowd_map.target_height_m,
        crowd_threshold=crowd_map.method.b_threshold,
    )


def test_observations_of_companions_and_views_mix_to_the_bit(tmp_path: Path) -> None:
    flown = views(8)
    expected = run(recording(flown), plain(), CONFIG)
    with running(tmp_path / "data") as service:
        with asked(service) as http:
            for number, one in enumerate(flown):
                if number % 3 == 1:
                    body = observation(one, service.mission.loop.crowd_map).to_bytes()
                    answer = http.post("/api/v1/observations", content=body)
                else:
                    answer = http.post("/api/v1/views", content=message(one))
                assert answer.status_code == 202, answer.text
        settle(service)
        assert service.live is not None
        service.live.finish()
        assert service.mission.loop.crowd_map.to_bytes() == expected.crowd_map.to_bytes()
        newest = service.mission.newest
    assert newest is not None
    assert history_line(0, newest.zones) == history_line(0, expected.zones)
