"""What listeners hear, and that nobody waits for those who do not listen."""

import asyncio
import json
import resource
import socket
import time
from pathlib import Path

import pytest
import uvicorn
from websockets.sync.client import connect

from crowdfence import Client
from crowdfence.service import server, stream
from crowdfence.service.server import listen
from support.on_the_network import on_the_network
from support.own_loop import run_apart
from support.served import serving
from support.small_service import asked, message, running, settle, views


def test_a_listener_hears_who_it_is_then_steps_alerts_and_modes(tmp_path: Path) -> None:
    with (
        running(tmp_path) as service,
        asked(service) as http,
        http.websocket_connect("/api/v1/stream") as one,
    ):
        hello = one.receive_json()
        assert (hello["type"], hello["scene"]["name"], hello["scene"]["mode"]) == ("hello", "plain", "live")
        for view in views(9):
            assert http.post("/api/v1/views", content=message(view)).status_code == 202
        settle(service)
        service.set_mode("finished")
        newest, kinds = None, set()
        # Each kind keeps its own order; which comes first is no promise.
        last = service.mission.newest.number
        while newest is None or newest["belief_version"] < last or not kinds >= {"alert", "mode"}:
            told = one.receive_json()
            kinds.add(told["type"])
            newest = told if told["type"] == "step" else newest
        assert newest["zones"] == http.get("/api/v1/zones").json()
        drones = http.get("/api/v1/drones").json()["drones"]
        assert [one["position"] for one in newest["drones"]["drones"]] == [one["position"] for one in drones]
        assert newest["seen_m2"] > newest["closed_m2"] > 0.0


def test_who_comes_later_gets_the_newest_step_at_once(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        assert service.live is not None
        for view in views(6):
            service.live.intake.give_view(message(view))
        settle(service)
        with asked(service) as http, http.websocket_connect("/api/v1/stream") as one:
            assert one.receive_json()["type"] == "hello"
            while (told := one.receive_json())["type"] != "step":  # alerts come by the clock of the machine
                pass
            assert told["belief_version"] == service.mission.newest.number


def test_a_listener_that_never_reads_holds_up_nobody_and_is_cut_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stream, "SEND_WITHIN_S", 0.3)
    monkeypatch.setattr(stream, "STEPS_PER_S", 1000.0)
    monkeypatch.setattr(stream, "MESSAGES_PER_S", 1e6)
    with running(tmp_path) as service, on_the_network(service) as address:
        host, _, port = address.partition(":")
        deaf = socket.create_connection((host, int(port)))
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.sendall(
            b"GET /api/v1/stream HTTP/1.1\r\nHost: x\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
            b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        )
        with connect(f"ws://{address}/api/v1/stream") as other:
            assert json.loads(other.recv(timeout=10))["type"] == "hello"
            for number in range(40):
                service.hub.tell({"type": "alert", "alert": {"number": number, "text": "x" * 500_000}})
                heard = json.loads(other.recv(timeout=10))
                assert heard["alert"]["number"] == number
            for _ in range(500):
                if service.hub.cut_off:
                    break
                time.sleep(0.02)
            assert (service.hub.cut_off, service.hub.listeners) == (1, 1)
        deaf.close()


class Listening:
    """One end of a connection that is never closed."""

    def __init__(self) -> None:
        self.heard: list[dict[str, int]] = []

    async def accept(self) -> None: ...

    async def send_text(self, text: str) -> None:
        self.heard.append(json.loads(text))

    async def receive(self) -> dict[str, str]:
        await asyncio.Event().wait()
        raise AssertionError


def test_a_step_made_for_who_comes_later_is_heard_by_who_was_there() -> None:
    async def heard() -> tuple[dict[str, int], dict[str, int]]:
        hub, first, second = stream.Hub(), Listening(), Listening()
        hub.start()
        tasks = [asyncio.create_task(hub.serve(first, {"hello": 0}))]
        hub.step(lambda _: {"step": 1})
        while {"step": 1} not in first.heard:
            await asyncio.sleep(0.001)
        # In the pause between two steps.
        hub.step(lambda _: {"step": 2})
        tasks.append(asyncio.create_task(hub.serve(second, {"hello": 0})))
        while {"step": 2} not in second.heard:
            await asyncio.sleep(0.001)
        await asyncio.sleep(3.0 * stream.pause_s(2))
        for task in tasks:
            task.cancel()
        return first.heard[-1], second.heard[-1]

    assert run_apart(heard()) == ({"step": 2}, {"step": 2})


def test_a_step_that_waited_for_a_slow_listener_has_the_ages_of_its_sending(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stream, "FRESH_S", 0.05)

    async def heard() -> list[dict[str, int]]:
        hub, slow, reads = stream.Hub(), Listening(), asyncio.Event()

        async def send_text(text: str) -> None:
            slow.heard.append(json.loads(text))
            await reads.wait()

        slow.send_text = send_text  # type: ignore[method-assign]
        hub.start()
        serving = asyncio.create_task(hub.serve(slow, {"hello": 0}))
        while not slow.heard:
            await asyncio.sleep(0.001)
        age = iter(range(100))
        hub.step(lambda _: {"age": next(age)})
        await asyncio.sleep(0.2)
        reads.set()
        while len(slow.heard) < 2:
            await asyncio.sleep(0.001)
        serving.cancel()
        return slow.heard

    told = run_apart(heard())
    assert told == [{"hello": 0}, {"age": 1}]


def test_a_listener_that_goes_while_a_message_arrives_is_served_no_more() -> None:
    """Until Python 3.12 the cancellation of its sender was lost, and the end of the service waited for it."""

    async def lasted() -> int:
        for steps in range(6):
            hub, one, here = stream.Hub(), Listening(), asyncio.all_tasks()
            hub.start()
            first = asyncio.create_task(hub.serve(one, {"hello": 0}))
            while not one.heard:
                await asyncio.sleep(0.001)
            serving = asyncio.all_tasks() - here
            assert first in serving
            hub.tell({"alert": 0})
            for _ in range(steps):  # of the loop, from when the message is there until its listener is awake
                await asyncio.sleep(0)
            for task in serving:  # as at the end of a loop
                task.cancel()
            _, left = await asyncio.wait(serving, timeout=2.0)
            if left:
                for task in left:
                    task.cancel()
                return len(left)
        return 0

    assert run_apart(lasted(), within_s=60.0) == 0


@pytest.mark.parametrize(("alerts", "is_cut_off"), [(900, False), (2001, True)])
def test_no_alert_is_left_out(alerts: int, is_cut_off: bool) -> None:
    """Hundreds of zones appear with one step: all but the newest 200 alarms were dropped without a word."""

    async def heard() -> tuple[list[dict[str, int]], list[int], int]:
        hub, one, closed = stream.Hub(), Listening(), []

        async def close(code: int, reason: str) -> None:
            closed.append(code)

        one.close = close  # type: ignore[attr-defined]
        hub.start()
        serving = asyncio.create_task(hub.serve(one, {"hello": 0}))
        while not one.heard:
            await asyncio.sleep(0.001)
        for number in range(alerts):
            hub.tell({"alert": number})
        while len(one.heard) <= alerts and not serving.done():
            await asyncio.sleep(0.001)
        serving.cancel()
        return one.heard[1:], closed, hub.cut_off

    told, closed, cut_off = run_apart(heard())
    if is_cut_off:
        assert (closed, cut_off) == ([1013], 1), "it may come again, and asks for all there are"
    else:
        assert told == [{"alert": number} for number in range(alerts)]
        assert (closed, cut_off) == ([], 0)


def test_many_listeners_leave_time_for_the_drones() -> None:
    """Ten steps a second to 15, then 150 a second to all together."""
    assert [stream.pause_s(listeners) for listeners in (1, 15, 30, 150)] == [0.1, 0.1, 0.2, 1.0]


def test_steps_that_take_long_to_make_leave_time_for_the_drones() -> None:
    """With thousands of zones one open page took all of it: views waited a quarter of a second each."""
    made: list[float] = []

    def make() -> dict[str, object]:
        made.append(time.monotonic())
        time.sleep(0.1)
        return {}

    async def listened() -> None:
        hub = stream.Hub()
        hub.start()
        hub._listeners.add(stream._Listener(with_static=True))
        end_s = time.monotonic() + 2.0
        while time.monotonic() < end_s:
            hub.step(lambda _: make())  # another one every time
            await asyncio.sleep(0.02)

    run_apart(listened())
    assert 2 <= len(made) <= 5


def test_the_body_of_an_answer_does_not_wait_for_the_acknowledgement_of_its_head() -> None:
    """Which the other side puts off for 40 ms, so that one client was answered 22 times a second."""
    with (
        listen(uvicorn.Config("", host="127.0.0.1", port=0, log_config=None)) as listening,
        socket.create_connection(listening.getsockname()),
    ):
        connection, _ = listening.accept()
        with connection:
            assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
            # One whose other side is gone without a word would be kept for good.
            assert connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
            assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) == 30


def test_whoever_connects_and_says_nothing_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """They were kept for good, until there was no place for drones."""
    monkeypatch.setattr(server, "_FIRST_WORD_S", 0.3)

    class Answering(asyncio.Protocol):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            self.transport = transport

        def data_received(self, data: bytes) -> None:
            self.transport.write(data)  # type: ignore[attr-defined]

    async def answered() -> tuple[bytes, bytes]:
        at = await asyncio.get_running_loop().create_server(server.impatient(Answering), "127.0.0.1", 0)
        async with at:
            place = at.sockets[0].getsockname()
            silent, _ = await asyncio.open_connection(*place)
            reader, writer = await asyncio.open_connection(*place)
            writer.write(b"a")
            first, nothing = await reader.read(1), await asyncio.wait_for(silent.read(), 20.0)
            writer.write(b"b")
            second = await reader.read(1)
            writer.close()  # the server waits for all that are connected, from Python 3.12 on
            return nothing, first + second

    assert run_apart(answered()) == (b"", b"ab")


def test_a_service_takes_more_connections_than_files_are_open_as_a_rule(tmp_path: Path) -> None:
    """With 1024 connections open, which it has at most where nobody says otherwise, it served nobody any more
    and logged 50,000 lines a second."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    if before[1] < 2048:
        pytest.skip(f"this system lets a process open {before[1]} files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (1024, before[1]))  # as the process inherits it
    try:
        with serving(tmp_path) as served:
            limits = Path(f"/proc/{served.process.pid}/limits").read_text()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    (line,) = [line for line in limits.splitlines() if line.startswith("Max open files")]
    assert int(line.split()[3]) >= 2048


def test_the_python_client_against_a_server(tmp_path: Path) -> None:
    with (
        running(tmp_path) as service,
        on_the_network(service) as address,
        Client(f"http://{address}") as client,
    ):
        flown = views(9)
        places = [client.give(view) for view in flown]
        assert places == sorted(set(places)) and client.give(flown[0]) == places[0]
        settle(service)
        ids = {zone["id"] for zone in client.zones()["zones"]}
        assert "Z1" in ids and {drone["status"] for drone in client.drones()} <= {"ok"}
        name = client.add_zone([(1, 1), (4, 1), (4, 4)], "ambulance")["id"]
        assert client.lock_zone("Z1", "stage")["locked"] and not client.unlock_zone("Z1", "over")["locked"]
        assert client.dismiss_zone("Z1", "rescue")["dismissed"] is not None
        features = json.loads(client.export("geojson"))["features"]
        assert {feature["properties"]["id"] for feature in features} == (ids | {name}) - {"Z1"}
        assert len(client.belief()) > 100 and client.terrain().shape == (60, 60)
        messages = client.stream()
        assert next(messages)["type"] == "hello"
        messages.close()
        alert = client.alerts()[0]
        assert client.acknowledge(alert["id"])["acknowledged_by"] == "local"
