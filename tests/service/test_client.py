"""`Client` before it has spoken to a service."""

import json
import math
from typing import Any

import numpy as np
import pytest

from crowdfence import Camera, Client


@pytest.mark.parametrize("url", ["127.0.0.1:8080", "", "ftp://127.0.0.1", "localhost"])
def test_what_is_no_address_is_refused_at_once(url: str) -> None:
    with pytest.raises(ValueError, match=f"url is '{url}'; it must begin with http:// or https://"):
        Client(url)


@pytest.mark.parametrize("patience_s", [-1.0, math.nan])
def test_patience_is_a_time(patience_s: float) -> None:
    """With NaN a view would be given again for ever."""
    with pytest.raises(ValueError, match=rf"patience_s is {patience_s:g}; it must be at least 0"):
        Client(patience_s=patience_s)


def test_a_picture_whose_pose_the_telemetry_tells_brings_none(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[dict[str, Any]] = []
    monkeypatch.setattr(Client, "_give", lambda _, path, body, kind: given.append(json.loads(body)) or 1)
    camera, pose = Camera.pinhole(64, 48, 50.0, 50.0, 32.0, 24.0), np.diag([1, -1, -1, 1])
    with Client() as client:
        assert client.give_image("uav1", 5, camera, None, b"jpeg") == 1
        client.give_image("uav1", 6, camera, pose, b"jpeg")
    assert [one["world_from_camera"] for one in given] == [None, pose.tolist()]
    assert {one["image"] for one in given} == {"anBlZw=="}  # base64 of jpeg
