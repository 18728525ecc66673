"""Views that are wrong anywhere: each is refused in one line or is a view, and the service goes on."""

import json
import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from crowdfence.service.app import make_app
from support.small_service import message, running, settle, view

NUMBERS = (0, -1, 1.5, 1 << 63, 1e300, 5e-324)
VALUES: tuple[Any, ...] = (None, True, "x", "", "\x00", "\u202e", [], {}, [[]], *NUMBERS)
WORDS = ("NaN", "-Infinity", "1e999", "9" * 400, "[" * 5000)
"""No JSON, or more than a number holds."""


def places_in(told: Any, above: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = told.items() if isinstance(told, dict) else enumerate(told) if isinstance(told, list) else ()
    return [above, *(place for name, value in inner for place in places_in(value, (*above, name)))]


def changed(told: Any, place: tuple[Any, ...], value: Any) -> Any:
    if not place:
        return value
    copy = dict(told) if isinstance(told, dict) else list(told)
    copy[place[0]] = changed(copy[place[0]], place[1:], value)
    return copy


def wrong(body: bytes, chance: random.Random) -> bytes:
    """A view with something else in one place, or cut off."""
    told = json.loads(body)
    place = chance.choice(places_in(told))
    if chance.random() < 0.3:
        return json.dumps(changed(told, place, "HERE")).replace('"HERE"', chance.choice(WORDS)).encode()
    if chance.random() < 0.1:
        return body[: chance.randrange(len(body))]
    return json.dumps(changed(told, place, chance.choice(VALUES))).encode()


def test_a_view_that_is_wrong_somewhere_is_refused_in_one_line(tmp_path: Path) -> None:
    chance = random.Random(7)
    with running(tmp_path) as service:
        http = TestClient(make_app(service), base_url="http://localhost", raise_server_exceptions=False)
        for number in range(150):
            body = wrong(message(view("uav1", number // 8)), chance)
            answer = http.post("/api/v1/views", content=body)
            assert answer.status_code in (200, 202, 409, 422), (body[:300], answer.text)
            if answer.status_code in (409, 422):
                (detail,) = answer.json().values()
                assert isinstance(detail, str) and 0 < len(detail) < 400 and detail.isprintable(), detail
        settle(service)
        assert service.live is not None and service.live.applying.works
        assert not [one.text for one in service.alerts.all() if "could not be applied" in one.text]


@pytest.mark.parametrize(
    "turn",
    [
        np.diag([1.001, -1.001, -1.001]),
        np.diag([-1.0, -1.0, -1.0]),
        np.diag([1.0, 1.0, -1.0]),
        np.zeros((3, 3)),
        np.array([[1.0, 0.05, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]),
        np.full((3, 3), 1e200),
    ],
    ids=["scaled", "turned inside out", "mirrored", "nothing", "sheared", "huge"],
)
def test_a_pose_that_turns_nothing_rigidly_is_refused(tmp_path: Path, turn: np.ndarray) -> None:
    told = json.loads(message(view("uav1", 0)))
    pose = np.array(told["world_from_camera"])
    pose[:3, :3] = turn
    with running(tmp_path) as service:
        http = TestClient(make_app(service), base_url="http://localhost", raise_server_exceptions=False)
        for wanted in (pose, pose.T, np.full((4, 4), math.nan)):
            body = json.dumps({**told, "world_from_camera": wanted.tolist()})
            answer = http.post("/api/v1/views", content=body)
            assert answer.status_code == 422 and "\n" not in answer.json()["detail"]
        assert not service.store.rows("SELECT 1 FROM journal")


def test_a_camera_that_is_nowhere_on_earth_is_refused(tmp_path: Path) -> None:
    """It was taken, and its place became any number where it was looked up on the map."""
    told = json.loads(message(view("uav1", 0)))
    with running(tmp_path) as service:
        http = TestClient(make_app(service), base_url="http://localhost", raise_server_exceptions=False)
        for axis in range(3):
            told["world_from_camera"][axis][3] = -1e300
            answer = http.post("/api/v1/views", content=json.dumps(told))
            assert answer.status_code == 422 and "1e+300 m from the origin" in answer.json()["detail"]
            told["world_from_camera"][axis][3] = 9e7
        assert http.post("/api/v1/views", content=json.dumps(told)).status_code == 202
