"""Zones of a live service in a vehicle's fence: as they come, and while the service is away."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from crowdfence import Client
from crowdfence.fence_sync import ServiceZones, ZoneSource, service_zones
from crowdfence.service.access import Access, add_token
from support.fence_zones import HERE
from support.on_the_network import on_the_network
from support.small_service import running, views
from support.vehicle_emulator import EmulatedVehicle, UdpVehicle


class Answers:
    """A service that answers what a test says, and remembers who asked."""

    def __init__(self) -> None:
        self.status, self.body = 200, b"{}"
        self.asked: list[tuple[str, str | None]] = []
        answers = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                answers.asked.append((self.path, self.headers["Authorization"]))
                self.send_response(answers.status)
                self.send_header("content-length", str(len(answers.body)))
                self.end_headers()
                self.wfile.write(answers.body)

            def log_message(self, *_: object) -> None:
                pass

        self.server = HTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> Iterator[Answers]:
    monkeypatch.setattr(service_zones, "EVERY_S", 0.02)
    served = Answers()
    thread = Thread(target=served.server.serve_forever, daemon=True)
    thread.start()
    yield served
    served.server.shutdown()
    thread.join()
    served.server.server_close()


def soon(found: Any, within_s: float = 20.0) -> None:
    """Until it is so."""
    end_s = time.monotonic() + within_s
    while not found():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_what_changes_is_noticed_and_what_fails_and_comes_back(answers: Answers) -> None:
    zones = ServiceZones(f"{answers.url}/", token="secret")
    answers.body = b"first"
    assert zones.read() == b"first"
    assert answers.asked == [("/api/v1/export?format=geojson", "Bearer secret")]
    assert not zones.has_changed()
    soon(lambda: len(answers.asked) > 3)
    assert not zones.has_changed()
    answers.body = b"second"
    soon(zones.has_changed)
    assert zones.read() == b"second" and not zones.has_changed()
    answers.status, answers.body = 503, b'{"detail": "the disk is full"}'
    soon(zones.has_changed)
    with pytest.raises(ConnectionError, match=r"http://127\.0\.0\.1:\d+: the disk is full \(503\)$"):
        zones.read()
    answers.status, answers.body = 200, b"second"
    soon(lambda: zones.has_changed() and isinstance(zones._newest, bytes))  # the same, and an alarm ends
    assert zones.read() == b"second" and not zones.has_changed()
    zones.close()
    asked = len(answers.asked)
    time.sleep(0.1)
    assert len(answers.asked) == asked


@pytest.mark.parametrize(
    ("status", "body", "said"),
    [
        (401, b'{"detail": "no token"}', "no token (401); give --token"),
        (404, b"<html>", "Not Found (404)"),
        (422, b'{"detail": [1]}', "Unprocessable Entity (422)"),
    ],
)
def test_a_refusal_is_told_in_its_words(answers: Answers, status: int, body: bytes, said: str) -> None:
    answers.status, answers.body = status, body
    with pytest.raises(ConnectionError) as refused:
        ServiceZones(answers.url).read()
    assert str(refused.value) == f"{answers.url}: {said}"


def test_what_is_no_service_is_told(answers: Answers, tmp_path: Path) -> None:
    with pytest.raises(ConnectionError, match=r"^http://127\.0\.0\.1:9: no answer: Connection refused$"):
        ServiceZones("http://127.0.0.1:9").read()
    with pytest.raises(ValueError, match="it must begin with http:// or https://"):
        ServiceZones("127.0.0.1:8080")
    with pytest.raises(OSError):
        ServiceZones(answers.url, ca=tmp_path / "none.pem")
    answers.body = b"<html>"
    with pytest.raises(ValueError, match=rf"{answers.url}: Expecting value"):
        ZoneSource(ServiceZones(answers.url)).read()
    # A mission without a place on Earth has zones in local metres.
    answers.body = b'{"type": "FeatureCollection", "crs": null, "features": []}'
    with pytest.raises(ValueError, match="local metres"):
        ZoneSource(ServiceZones(answers.url)).read()


def watching(url: str, served: UdpVehicle, folder: Path, **more: str) -> subprocess.Popen[str]:
    link = ["--link", f"udpout:127.0.0.1:{served.port}", "--system", "1", "--timeout-s", "20"]
    eager = ["--opening-s", "0", "--interval-s", "0", "--duration-s", "200", "--json"]
    return subprocess.Popen(
        [sys.executable, "-m", "crowdfence", "fence", "watch", url, *link, *eager, "--state", str(folder)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "NO_COLOR": "1", **more},
    )


def events_until(process: subprocess.Popen[str], wanted: str) -> list[dict[str, Any]]:
    assert process.stdout is not None
    events = []
    for line in process.stdout:
        events.append(json.loads(line))
        if events[-1]["event"] == wanted:
            return events
    raise AssertionError((wanted, events))


def test_a_vehicle_follows_a_live_service_and_keeps_its_fence_while_that_is_away(tmp_path: Path) -> None:
    """The real service and the real command line. The vehicle hovers at (0, 0), 20 m beside the crowd."""
    tokens = tmp_path / "tokens.json"
    viewer = add_token(tokens, "fence", "viewer")
    drone = add_token(tokens, "uav1", "drone")
    operator = add_token(tokens, "ana", "operator")
    with (
        UdpVehicle(EmulatedVehicle(parameters={"GF_ACTION": 2, "GF_PREDICT": 1})) as served,
        running(tmp_path / "data", georeference=HERE, access=Access.of(tokens)) as service,
        ExitStack() as stack,
    ):
        address = stack.enter_context(on_the_network(service))
        process = watching(f"http://{address}", served, tmp_path / "state", CROWDFENCE_TOKEN=viewer)
        try:
            events_until(process, "unchanged")  # nobody has seen a crowd yet
            with Client(f"http://{address}", token=drone) as client:
                for view in views(6):
                    client.give(view)
            events_until(process, "written")
            closed = len(served.vehicle.items)
            assert closed >= 4
            stack.close()
            (away,) = events_until(process, "zones_unreadable")[-1:]
            assert away["level"] == "alarm" and f"http://{address}: no answer" in away["text"]
            assert away["text"].endswith("the last fence stays") and len(served.vehicle.items) == closed
            stack.enter_context(on_the_network(service, port=int(address.rpartition(":")[2])))
            with Client(f"http://{address}", token=operator) as client:
                client.add_zone([(-40.0, -40.0), (-30.0, -40.0), (-30.0, -30.0)], "an ambulance")
            events_until(process, "written")
            assert len(served.vehicle.items) > closed
            process.send_signal(signal.SIGINT)
            assert process.wait(60) == 0  # no alarm stands any more
        finally:
            process.kill()
            process.wait()
