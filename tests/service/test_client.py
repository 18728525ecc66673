"""`Client` before it has spoken to a service, and when it hears nothing of it any more."""

import json
import math
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import Any

import httpx
import numpy as np
import pytest
from websockets.sync.server import ServerConnection, serve

from crowdfence import Camera, Client, View
from crowdfence.service import client
from crowdfence.service.client import ServiceError
from crowdfence.service.view_message import ViewMessage


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


def test_what_a_detector_was_not_shown_is_not_given_as_empty(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[dict[str, Any]] = []
    monkeypatch.setattr(Client, "_give", lambda _, path, body, kind: given.append(json.loads(body)) or 1)
    camera, pose = Camera.pinhole(64, 48, 50.0, 50.0, 32.0, 24.0), np.diag([1.0, -1.0, -1.0, 1.0])
    values = np.linspace(0.0, 1.0, 12 * 16, dtype=np.float32).reshape(12, 16)
    view = View("uav1", 5, camera, pose, np.ma.array(values, mask=values > 0.5))
    with Client() as client:
        client.give(view)
        client.give(View("uav1", 6, camera, pose, values))
    assert "looked_at" not in {name for name, value in given[1]["heatmap"].items() if value is not None}
    again = ViewMessage.model_validate(given[0]).view()
    assert np.array_equal(again.heatmap, view.heatmap)
    assert again.looked_at is not None and np.array_equal(again.looked_at, values <= 0.5)
    given[0]["heatmap"]["looked_at"] = "AAEB"
    with pytest.raises(ValueError, match="looked_at of 12 x 16 cells has 3 bytes"):
        ViewMessage.model_validate(given[0]).view()


@contextmanager
def saying_hello(then: Callable[[ServerConnection], object]) -> Iterator[str]:
    """The address of something that says hello to a listener, and what it does then."""

    def listened(connection: ServerConnection) -> None:
        connection.send('{"type": "hello"}')
        then(connection)

    with serve(listened, "127.0.0.1", 0) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.socket.getsockname()[1]}"
        server.shutdown()


def test_a_stream_that_breaks_is_no_mission_that_ended() -> None:
    """The messages just ended, as at the end of the service, and a planner flew on by the last of them."""
    with saying_hello(lambda connection: connection.socket.close()) as url:
        messages = Client(url).stream()
        assert next(messages) == {"type": "hello"}
        with pytest.raises(httpx.TransportError, match=f"the line to {url} broke"):
            next(messages)


def test_a_stream_that_goes_silent_breaks(monkeypatch: pytest.MonkeyPatch) -> None:
    """A line that is cut on its way says nothing of it, and not every version of websockets asks."""
    monkeypatch.setattr(client, "_SILENT_S", 0.2)
    over = Event()
    with saying_hello(lambda connection: over.wait(60.0)) as url:
        messages = Client(url).stream()
        assert next(messages) == {"type": "hello"}
        with pytest.raises(httpx.TransportError, match=f"{url} said nothing for 0.2 s"):
            next(messages)
        over.set()


def test_who_takes_long_for_a_step_gets_the_newest_next_and_every_alert() -> None:
    """Steps waited in the buffers of both ends: who took a second for each was half a minute behind after
    half a minute, by zones that looked as new as ever."""
    taken, over = Event(), Event()

    def tell(connection: ServerConnection) -> None:
        taken.wait(60.0)
        for number in range(3000):
            connection.send(
                json.dumps({"type": "step", "number": number, "zones": {"zones": [], "x": "x" * 2000}})
            )
            if number % 1000 == 0:
                connection.send(json.dumps({"type": "alert", "number": number}))
        over.wait(60.0)

    with saying_hello(tell) as url:
        messages = Client(url).stream()
        next(messages)
        taken.set()
        found: list[tuple[str, int]] = []
        while ("step", 2999) not in found and len(found) < 20:
            time.sleep(0.3)
            message = next(messages)
            found.append((message["type"], message["number"]))
        assert [one for one in found if one[0] == "alert"] == [("alert", 0), ("alert", 1000), ("alert", 2000)]
        assert found[-1] == ("step", 2999), found
        messages.close()  # type: ignore[attr-defined]
        over.set()


def test_a_step_from_before_the_line_broke_is_not_given_after_it() -> None:
    def tell(connection: ServerConnection) -> None:
        connection.send('{"type": "alert"}')
        connection.send('{"type": "step"}')
        connection.socket.shutdown(socket.SHUT_RDWR)  # closed alone it lasts until who reads it is done

    with saying_hello(tell) as url:
        messages = Client(url).stream()
        assert next(messages) == {"type": "hello"}
        time.sleep(0.5)
        assert next(messages) == {"type": "alert"}
        with pytest.raises(httpx.TransportError, match="broke"):
            next(messages)


def test_a_stream_ends_when_the_service_does_and_says_so_when_it_is_full() -> None:
    with saying_hello(lambda connection: connection.close(1012, "service restart")) as url:
        assert list(Client(url).stream()) == [{"type": "hello"}]
    with saying_hello(lambda connection: connection.close(1013, "too many listeners")) as url:
        messages = Client(url).stream()
        next(messages)
        with pytest.raises(ServiceError, match="too many listeners"):
            next(messages)
