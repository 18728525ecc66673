"""What the publisher of ROS does to those who share the mission with it."""

from pathlib import Path
from threading import Thread

import pytest

from crowdfence import surface_grid
from crowdfence.service.ros.publisher import RosPublisher
from support.small_service import message, running, views


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
