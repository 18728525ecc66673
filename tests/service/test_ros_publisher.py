"""What the publisher of ROS does to those who share the mission with it."""

from dataclasses import replace
from pathlib import Path
from threading import Thread
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from crowdfence import surface_grid
from crowdfence.exports.ros2.topics import BELIEF, CLOSED, OTHERS, ZONES
from crowdfence.service.access import User
from crowdfence.service.clock import Clock
from crowdfence.service.ros import publisher
from crowdfence.service.ros.publisher import RosPublisher
from crowdfence.sources.mission import ros2_messages
from crowdfence.zones import Zone
from support.small_service import SETTINGS, START_NS, message, running, sharp, views


def test_views_go_into_the_map_while_grids_are_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a large map they take half a second, every few seconds."""
    build, was_free, topics = surface_grid._build, list[bool](), list[str]()
    with running(tmp_path) as service:
        assert service.live is not None
        for one in views(3):
            service.live.intake.give_view(message(one))
        service.live.finish()

        def try_lock() -> None:
            was_free.append(service.mission.lock.acquire(timeout=5.0))
            if was_free[-1]:
                service.mission.lock.release()

        def looked_at(*given: object) -> object:
            other = Thread(target=try_lock)
            other.start()
            other.join()
            return build(*given)  # type: ignore[arg-type]

        monkeypatch.setattr(surface_grid, "_build", looked_at)
        RosPublisher(service.mission, lambda topic, kind, body: topics.append(topic))._publish()
    assert was_free == [True]
    assert topics == ["/crowdfence/closed", "/crowdfence/belief", "/crowdfence/zones"]


def test_before_the_first_view_what_others_drew_is_published(tmp_path: Path) -> None:
    """Nothing was, while HTTP told of it: the fleet took off into the zones of others."""
    heard: dict[str, Any] = {}

    def take(topic: str, kind: str, body: bytes) -> None:
        heard[topic] = ros2_messages.decode(kind, body)

    given = Zone.of_no_look("hospital", shapely.box(10.0, 10.0, 20.0, 20.0), "static", "given")
    clock = Clock("system", system=lambda: START_NS, steady=lambda: START_NS)
    how: dict[str, Any] = {"clock": clock, "settings": replace(SETTINGS, clock="system")}
    with running(tmp_path, static_zones=[given], **how) as service:
        RosPublisher(service.mission, take)._publish()
    labels = [marker.text for marker in heard[OTHERS].markers if marker.text]
    assert len(labels) == 1 and labels[0].startswith("hospital (static)")
    assert {ros2_messages.time_ns(one.header.stamp) for one in heard[OTHERS].markers} == {START_NS}
    assert not any(marker.text for marker in heard[ZONES].markers)
    assert heard[CLOSED].data.count(100) == 100 and set(heard[CLOSED].data) == {-1, 100}
    assert set(heard[BELIEF].data) == {-1}


def test_zones_of_others_are_repeated_for_who_comes_later_and_not_at_every_instant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Thousands of a national file took a second each time; what an operator draws cannot wait."""
    heard: list[tuple[str, list[str]]] = []
    now_s = 1000.0
    monkeypatch.setattr(publisher, "time", SimpleNamespace(monotonic=lambda: now_s))

    def take(topic: str, kind: str, body: bytes) -> None:
        if topic in (ZONES, OTHERS):
            markers = ros2_messages.decode(kind, body).markers
            heard.append((topic, [one.text.split(" ")[0] for one in markers if one.text]))

    given = Zone.of_no_look("hospital", shapely.box(10.0, 10.0, 20.0, 20.0), "static", "given")
    with running(tmp_path, static_zones=[given]) as service:
        fleet = RosPublisher(service.mission, take)
        fleet._publish()
        corners = [[50.0, 50.0], [55.0, 50.0], [55.0, 55.0], [50.0, 50.0]]
        name = service.decide(User("ana", "operator"), "add", "", "ambulance", rings=[[corners]])
        for passed_s in (1.0, 4.9, 5.1):
            now_s = 1000.0 + passed_s
            fleet._publish()
    ours = (ZONES, [name])
    assert heard == [(ZONES, []), (OTHERS, ["hospital"]), ours, ours, ours, (OTHERS, ["hospital"])]


def test_ground_that_nobody_looks_at_is_not_known_to_be_empty_for_ever(tmp_path: Path) -> None:
    """The fleet is silent, and who plans on the grid does not look at its stamp."""
    now_ns = START_NS
    clock = Clock("system", system=lambda: now_ns, steady=lambda: now_ns)
    grids: dict[str, list[Any]] = {CLOSED: [], BELIEF: [], ZONES: []}
    with running(tmp_path, clock=clock, settings=replace(SETTINGS, clock="system")) as service:
        assert service.live is not None
        for number, one in enumerate(views(10)):
            now_ns = one.stamp_ns
            service.live.intake.give_view(message(sharp(one, blind=number % 3 == 2)))
        service.live.finish()

        def take(topic: str, kind: str, body: bytes) -> None:
            grids[topic].append(ros2_messages.decode(kind, body))

        for passed_s in (0, 31):
            now_ns = views(10)[-1].stamp_ns + passed_s * 1_000_000_000
            RosPublisher(service.mission, take)._publish()
    free = [(np.array(one.data) == 0).sum() for one in grids[CLOSED]]
    closed = [(np.array(one.data) == 100).sum() for one in grids[CLOSED]]
    assert free[0] > 100 and free[1] == 0
    assert closed[0] > 20 and closed[1] > 20, "what is closed stays closed"
    assert [ros2_messages.time_ns(one.header.stamp) for one in grids[CLOSED]][1] == now_ns
    assert all(value in (-1, *range(1, 101)) for value in grids[BELIEF][1].data)
