"""Clients of the load test, in processes of their own that import next to nothing.

python clients.py       a pickled (name, arguments) on stdin, a pickled answer on stdout
"""

import asyncio
import pickle
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Any

STAMP, DRONE = 1_234_567_890_123_456_789, "thedrone"
"""What bodies hold until they are sent."""
STEP = re.compile(r'{"type": "step", "stamp_ns": "(\d+)"')


@dataclass
class Told:
    """What the clients saw."""

    counts: dict[int, int]
    taken_s: float
    answers_s: list[float]


def give(kind: str, port: int, drones: list[str], made: list[bytes], rate_hz: float, seconds: float) -> Told:
    """Every drone `rate_hz` times a second, as far as that is possible."""
    told = Told({}, 0.0, [])
    if kind == "mqtt":
        from mqtt import Publisher

        mqtt = Publisher(port, f"publisher {drones[0]}")
    else:
        import httpx

        http = httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30.0)
    begin_s, number = time.monotonic(), 0
    while time.monotonic() - begin_s < seconds:
        due_s = begin_s + number / (rate_hz * len(drones))
        time.sleep(max(0.0, due_s - time.monotonic()))
        drone = drones[number % len(drones)]
        body = made[number % len(made)].replace(str(STAMP).encode(), str(time.time_ns()).encode(), 1)
        body = body.replace(DRONE.encode(), drone.encode(), 1)
        sent_s, code = time.monotonic(), 202
        if kind == "mqtt":
            mqtt.publish(f"views/{drone}", body)
        else:
            code = http.post("/api/v1/views", content=body).status_code
        told.answers_s.append(time.monotonic() - sent_s)
        told.counts[code] = told.counts.get(code, 0) + 1
        number += 1
    told.taken_s = time.monotonic() - begin_s
    return told


def view(listeners: int, port: int, seconds: float) -> list[list[float]]:
    """How old every step was, in seconds, when each of the listeners had it."""
    from websockets.asyncio.client import connect

    connected: list[int] = []

    async def listen(ages_s: list[float]) -> None:
        address = f"ws://127.0.0.1:{port}/api/v1/stream"
        async with connect(address, max_size=None, open_timeout=120) as one:
            connected.append(1)
            async for text in one:
                stamp = STEP.match(text)  # reading all of it would measure this client
                if stamp is not None:
                    ages_s.append((time.time_ns() - int(stamp[1])) / 1e9)

    async def listen_all() -> list[list[float]]:
        ages_s: list[list[float]] = [[] for _ in range(listeners)]
        tasks = [asyncio.create_task(listen(one)) for one in ages_s]
        while len(connected) < listeners:
            await asyncio.sleep(0.1)
        await asyncio.wait(tasks, timeout=seconds)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return ages_s

    return asyncio.run(listen_all())


def started(*task: Any) -> subprocess.Popen[bytes]:
    """A client with something to do: the name of a function above and its arguments."""
    client = subprocess.Popen([sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert client.stdin is not None
    pickle.dump(task, client.stdin)
    client.stdin.close()
    return client


def result(client: subprocess.Popen[bytes]) -> Any:
    """What it found, once it is done."""
    assert client.stdout is not None
    found = pickle.load(client.stdout)
    client.wait()
    return found if not isinstance(found, dict) else Told(**found)


def main() -> None:
    name, *arguments = pickle.load(sys.stdin.buffer)
    found = {"give": give, "view": view}[name](*arguments)
    # A class of __main__ would not be found on the other side.
    pickle.dump(vars(found) if isinstance(found, Told) else found, sys.stdout.buffer)


if __name__ == "__main__":
    main()
