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
import shapely

from crowdfence import Client, Georeference
from crowdfence.fence_sync import PlacedZones, ServiceZones, ZoneSource, service_zones
from crowdfence.service.access import Access, add_token
from support.fence_zones import HERE
from support.on_the_network import on_the_network
from support.small_service import running, views
from support.vehicle_emulator import EmulatedVehicle, UdpVehicle
from support.watch_events import events_of


class Answers:
    """A service that answers what a test says, and remembers who asked."""

    def __init__(self) -> None:
        self.status, self.broken = 200, b""
        self.zones = [crowd("Z1", 10.0), others("CTR", 500.0)]
        self.stamp_ns = 7_000
        self.run: str | None = None
        """Of the process; builds of before tell none beside the zones."""
        self.first_stamp_ns: str | None = "5000"
        self.anchor: dict[str, float] | None = {"latitude_deg": 47.0, "longitude_deg": 8.0, "height_m": 500.0}
        self.asked: list[tuple[str, str | None]] = []
        answers = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                answers.asked.append((self.path, self.headers["Authorization"]))
                body = answers.broken or json.dumps(answers.told(self.path)).encode()
                self.send_response(answers.status)
                self.send_header("content-length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_: object) -> None:
                pass

        self.server = HTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"

    def told(self, path: str) -> dict[str, Any]:
        if path == "/api/v1/scene":
            return {"anchor": self.anchor, "first_stamp_ns": self.first_stamp_ns, "run": self.run or "a1"}
        version = "v1" if any(zone["id"] == "CTR" for zone in self.zones) else "v0"
        left_out = path == f"/api/v1/zones?without_static={version}"
        zones = [zone for zone in self.zones if zone["kind"] != "static" or not left_out]
        told = {"stamp_ns": str(self.stamp_ns), "static_version": version, "static_left_out": left_out}
        run = {} if self.run is None else {"run": self.run}
        return {**run, **told, "zones": zones}


def crowd(name: str, west_m: float, **changes: Any) -> dict[str, Any]:
    """10 m wide."""
    ring = shapely.get_coordinates(shapely.box(west_m, 0.0, west_m + 10.0, 10.0)).tolist()
    ground = {"lower_m": 1.0, "upper_m": 2.0, "is_known": True}
    told = {"id": name, "kind": "crowd", "reason": "seen", "polygon": [[ring]], "ground": ground}
    return {**told, "valid_until_ns": "9000", "dismissed": None, **changes}


def others(name: str, west_m: float) -> dict[str, Any]:
    return crowd(name, west_m, kind="static", reason="given", valid_until_ns=None)


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


def test_the_zones_are_those_of_the_service_in_its_own_metres(answers: Answers) -> None:
    answers.zones.append(crowd("Z2", 40.0, dismissed={"until_ns": "8000", "by": "ana", "reason": "rescue"}))
    zones = ServiceZones(f"{answers.url}/", token="secret")
    told = zones.read()
    assert told.georeference == Georeference(47.0, 8.0, 500.0) and (told.begun_ns, told.stamp_ns) == (
        5000,
        7000,
    )
    assert [zone.id for zone in told.zones] == ["Z1", "CTR"]  # an operator lets drones pass Z2
    first = told.zones[0]
    assert first.polygon.equals(shapely.box(10.0, 0.0, 20.0, 10.0)) and first.valid_until_ns == 9000
    assert (first.lower_m, first.upper_m) == (1.0, 2.0)
    assert answers.asked == [("/api/v1/scene", "Bearer secret"), ("/api/v1/zones", "Bearer secret")]


def test_what_changes_is_noticed_and_what_fails_and_comes_back(answers: Answers) -> None:
    zones = ServiceZones(answers.url)
    first = zones.read()
    assert not zones.has_changed()
    soon(lambda: len(answers.asked) > 6)
    assert not zones.has_changed()
    answers.zones[0] = crowd("Z1", 11.0)  # as an operator does between two steps
    soon(zones.has_changed)
    moved = zones.read()
    assert moved.zones[0].polygon.bounds[0] == 11.0 and not zones.has_changed()
    assert moved.zones[1] is first.zones[1]  # it came once
    assert [path for path, _ in answers.asked].count("/api/v1/zones") == 1
    answers.stamp_ns += 1  # nothing else: the service is alive
    soon(zones.has_changed)
    assert zones.read().zones == moved.zones
    answers.zones.pop()
    soon(zones.has_changed)
    assert [zone.id for zone in zones.read().zones] == ["Z1"]
    answers.status, answers.broken = 503, b'{"detail": "the disk is full"}'
    soon(zones.has_changed)
    with pytest.raises(ConnectionError, match=r"http://127\.0\.0\.1:\d+: the disk is full \(503\)$"):
        zones.read()
    answers.status, answers.broken = 200, b""
    soon(lambda: zones.has_changed() and isinstance(zones._newest, PlacedZones))  # and an alarm ends
    assert [zone.id for zone in zones.read().zones] == ["Z1"] and not zones.has_changed()
    zones.close()
    asked = len(answers.asked)
    time.sleep(0.1)
    assert len(answers.asked) == asked


def test_the_scene_is_asked_for_once_while_the_service_runs(answers: Answers) -> None:
    """The watches of 48 vehicles behind one address, two requests a second each, were refused with 429."""
    answers.run, answers.first_stamp_ns = "b1", None  # nobody has given a view
    zones = ServiceZones(answers.url)

    def scenes(times: int) -> int:
        answers.asked.clear()
        for _ in range(times):
            zones.read()
        return [path for path, _ in answers.asked].count("/api/v1/scene")

    assert scenes(3) == 3 and zones.read().begun_ns is None
    answers.first_stamp_ns = "5000"
    assert scenes(3) == 1 and scenes(3) == 0 and zones.read().begun_ns == 5000
    answers.run, answers.first_stamp_ns = "b2", "6000"
    answers.anchor = {"latitude_deg": 48.0, "longitude_deg": 8.0, "height_m": 500.0}
    told = zones.read()
    assert told.begun_ns == 6000 and told.georeference == Georeference(48.0, 8.0, 500.0)
    assert scenes(3) == 0
    answers.run = None
    assert scenes(3) == 3, "of builds of before nobody knows whether they were started anew"


def test_a_margin_is_worked_out_once_for_zones_that_stay(answers: Answers) -> None:
    source = ZoneSource(ServiceZones(answers.url), margin_m=20.0)
    crowded, control = source.read().zones
    assert control.polygon.bounds[0] == pytest.approx(480.0, abs=1.0) and control.polygon.bounds[0] <= 480.0
    answers.zones[0] = crowd("Z1", 11.0)
    now, same = source.read().zones
    assert same is control and now.polygon.bounds[0] == pytest.approx(crowded.polygon.bounds[0] + 1.0)


@pytest.mark.parametrize(
    ("status", "body", "said"),
    [
        (401, b'{"detail": "no token"}', "no token (401); give --token"),
        (404, b"<html>", "Not Found (404)"),
        (410, b'{"detail": [1]}', "Gone (410)"),
    ],
)
def test_a_refusal_is_told_in_its_words(answers: Answers, status: int, body: bytes, said: str) -> None:
    answers.status, answers.broken = status, body
    with pytest.raises(ConnectionError) as refused:
        ServiceZones(answers.url).read()
    assert str(refused.value) == f"{answers.url}: {said}"


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (b"<html>", "Expecting value"),
        (b"{}", "no service of crowdfence answers there: 'anchor' is missing"),
        (b"[]", "no service of crowdfence answers there: list indices must be integers"),
    ],
)
def test_an_answer_that_is_none_is_told(answers: Answers, body: bytes, said: str) -> None:
    answers.broken = body
    with pytest.raises(ValueError) as refused:
        ServiceZones(answers.url).read()
    assert str(refused.value).startswith(f"{answers.url}: {said}")


def test_what_is_no_service_is_told(answers: Answers, tmp_path: Path) -> None:
    with pytest.raises(ConnectionError, match=r"^http://127\.0\.0\.1:9: no answer: Connection refused$"):
        ServiceZones("http://127.0.0.1:9").read()
    with pytest.raises(ValueError, match="it must begin with http:// or https://"):
        ServiceZones("127.0.0.1:8080")
    with pytest.raises(OSError):
        ServiceZones(answers.url, ca=tmp_path / "none.pem")
    answers.anchor = None
    with pytest.raises(ValueError, match="the mission has no place on Earth, so its zones cannot be sent"):
        ServiceZones(answers.url).read()


def watching(url: str, served: UdpVehicle, folder: Path, **more: str) -> subprocess.Popen[str]:
    link = ["--link", f"udpout:127.0.0.1:{served.port}", "--system", "1", "--timeout-s", "20"]
    eager = ["--opening-s", "0", "--interval-s", "0", "--duration-s", "200", "--json"]
    return subprocess.Popen(
        [sys.executable, "-m", "crowdfence", "fence", "watch", url, *link, *eager, "--state", str(folder)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "NO_COLOR": "1", **more},
    )


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
            events_of(process, "unchanged")  # nobody has seen a crowd yet
            with Client(f"http://{address}", token=drone) as client:
                for view in views(6):
                    client.give(view)
            events_of(process, "written")
            closed = len(served.vehicle.items)
            assert closed >= 4
            stack.close()
            (away,) = events_of(process, "zones_unreadable")[-1:]
            assert away["level"] == "alarm" and f"http://{address}: no answer" in away["text"]
            assert away["text"].endswith("the last fence stays") and len(served.vehicle.items) == closed
            stack.enter_context(on_the_network(service, port=int(address.rpartition(":")[2])))
            with Client(f"http://{address}", token=operator) as client:
                client.add_zone([(-40.0, -40.0), (-30.0, -40.0), (-30.0, -30.0)], "an ambulance")
            events_of(process, "written")
            assert len(served.vehicle.items) > closed
            process.send_signal(signal.SIGINT)
            assert process.wait(60) == 0  # no alarm stands any more
        finally:
            process.kill()
            process.wait()
