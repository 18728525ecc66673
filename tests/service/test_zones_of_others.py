"""Zones of others, which may be thousands and are always the same, are told to whoever lacks them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import shapely
from starlette.websockets import WebSocketDisconnect

from crowdfence import Client
from crowdfence.service.static_zones_held import StaticZonesHeld
from crowdfence.zones import Zone
from support.on_the_network import on_the_network
from support.small_service import asked, message, running, settle, views

HOSPITAL, SCHOOL = (
    Zone.of_no_look(name, shapely.box(east, 1, east + 8, 9), "static", "given")
    for name, east in (("HOSP", 1.0), ("SCHOOL", 30.0))
)
DRAWN = {"polygon": [[50, 50], [55, 50], [55, 55]], "reason": "ambulance"}
Ask = Callable[..., dict[str, Any]]


def ids(told: dict[str, Any]) -> list[str]:
    return [zone["id"] for zone in told["zones"]]


def fly(service: Any, instants: int) -> None:
    for one in views(instants):
        service.live.intake.give_view(message(one))
    settle(service)


def test_who_names_the_version_that_it_has_gets_the_rest(tmp_path: Path) -> None:
    with running(tmp_path, static_zones=[HOSPITAL, SCHOOL]) as service, asked(service) as http:

        def zones(**query: Any) -> dict[str, Any]:
            answer = http.get("/api/v1/zones", params=query)
            assert answer.status_code == 200
            told: dict[str, Any] = answer.json()
            return told

        fly(service, 6)
        whole = zones()
        assert ids(whole)[-2:] == ["HOSP", "SCHOOL"] and not whole["static_left_out"]
        version = whole["static_version"]
        rest = zones(without_static=version)
        assert rest == {**whole, "static_left_out": True, "zones": whole["zones"][:-2]}
        assert zones(without_static="*") == rest
        assert zones(without_static="of another file") == whole, "never fewer than who asks knows"

        drawn = http.post("/api/v1/zones", json=DRAWN).json()
        rest = zones(without_static=version)
        assert rest["static_version"] == version, "what an operator draws is told as it is drawn"
        assert ids(rest)[-1] == drawn["id"] and rest["zones"][-1] == drawn and drawn["kind"] == "operator"
        assert http.get("/api/v1/zones", params={"without_static": "x" * 21}).status_code == 422


def test_a_version_is_of_the_zones_and_of_no_process(tmp_path: Path) -> None:
    versions = []
    for given in ([HOSPITAL, SCHOOL], [HOSPITAL, SCHOOL], [SCHOOL], []):
        with running(tmp_path, static_zones=given) as service, asked(service) as http:
            fly(service, 6)
            told = http.get("/api/v1/zones").json()
            versions.append(told["static_version"])
            # A moment from before, which other zones of others may have held for.
            then = http.get("/api/v1/zones", params={"at": told["stamp_ns"], "without_static": "*"}).json()
            assert then["static_version"] == told["static_version"]
    assert versions[0] == versions[1] and len(set(versions)) == 3 and versions[3] is None


def test_where_there_are_none_nothing_is_left_out(tmp_path: Path) -> None:
    with running(tmp_path) as service, asked(service) as http:
        fly(service, 9)
        told = http.get("/api/v1/zones", params={"without_static": "*"}).json()
        assert (told["static_version"], told["static_left_out"]) == (None, False) and ids(told)


def test_steps_have_all_zones_unless_a_listener_says_otherwise(tmp_path: Path) -> None:
    with running(tmp_path, static_zones=[HOSPITAL, SCHOOL]) as service, asked(service) as http:
        fly(service, 6)
        whole = http.get("/api/v1/zones").json()
        with (
            http.websocket_connect("/api/v1/stream") as one,
            http.websocket_connect("/api/v1/stream?without_static=*") as other,
        ):
            heard, left_out = (
                next(told for _ in range(20) if (told := socket.receive_json())["type"] == "step")["zones"]
                for socket in (one, other)
            )
            assert heard == whole
            assert left_out == {**whole, "static_left_out": True, "zones": whole["zones"][:-2]}
            # Of the next step, too, everybody hears its own kind.
            service.mission.look_again(service.mission.newest.stamp_ns + 10**9)
            for socket, kind in ((one, False), (other, True)):
                step = next(told for _ in range(20) if (told := socket.receive_json())["type"] == "step")
                assert step["zones"]["static_left_out"] == kind
                assert ("SCHOOL" in ids(step["zones"])) == (not kind)


def test_a_listener_that_names_a_version_is_told_what_it_can_name(tmp_path: Path) -> None:
    """One who was given all zones for it would be none the wiser; one who was given none would fly."""
    with running(tmp_path) as service, asked(service) as http:
        with pytest.raises(WebSocketDisconnect) as refused:
            http.websocket_connect("/api/v1/stream?without_static=abc").__enter__()
        assert refused.value.code == 1008


def test_steps_of_the_python_client_have_all_zones(tmp_path: Path) -> None:
    with (
        running(tmp_path, static_zones=[HOSPITAL, SCHOOL]) as service,
        on_the_network(service) as address,
        Client(f"http://{address}") as client,
    ):
        fly(service, 6)
        messages = client.stream()
        step = next(told for told in messages if told["type"] == "step")
        assert step["zones"] == client.zones()
        assert ids(step["zones"])[-2:] == ["HOSP", "SCHOOL"]
        service.mission.look_again(service.mission.newest.stamp_ns + 10**9)
        again = next(told for told in messages if told["type"] == "step")
        assert again["zones"] == client.zones() and again["stamp_ns"] != step["stamp_ns"]
        messages.close()


def test_zones_of_another_version_are_not_put_to_a_step() -> None:
    held = StaticZonesHeld()
    crowd, ours, theirs = (
        {"id": name, "kind": kind} for name, kind in (("Z1", "crowd"), ("O1", "operator"), ("H", "static"))
    )
    left_out = {"static_version": "a", "static_left_out": True, "zones": [crowd]}
    assert held.whole(left_out) is None
    whole = {"static_version": "a", "static_left_out": False, "zones": [crowd, ours, theirs]}
    assert held.whole(whole) == whole
    assert held.whole({**left_out, "zones": []}) == {**whole, "zones": [theirs]}
    assert held.whole({**left_out, "static_version": "b"}) is None
    # As builds answer that know nothing of versions.
    assert held.whole({"zones": [crowd]}) == {"zones": [crowd]}
