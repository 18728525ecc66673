"""kill -9 at random moments: nothing that was acknowledged is lost, nothing counts twice.

`CROWDFENCE_KILLS` says how often; `make test-service-kill` takes fifty.
"""

import os
import random
import signal
import socket
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread, Timer
from time import sleep

from httpx import TransportError

from crowdfence import Client, View, run
from crowdfence.service.client import ServiceError
from crowdfence.service.service import Service
from crowdfence.service.store import FILE
from crowdfence.zones.history import history_line
from support.small_service import (
    CONFIG,
    DRONES,
    message,
    plain,
    recording,
    running,
    settle,
    view,
    views,
)

KILLS = int(os.environ.get("CROWDFENCE_KILLS", "6"))
SERVER = Path(__file__).with_name("crash_server.py")


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextmanager
def process(folder: Path, port: int) -> Iterator[subprocess.Popen[str]]:
    """The service, once it listens."""
    started = subprocess.Popen(
        [sys.executable, "-W", "ignore", str(SERVER), str(folder), str(port)],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert started.stdout is not None and started.stdout.readline().startswith("http"), started.poll()
        yield started
    finally:
        started.kill()
        started.wait()
        started.stdout.close()


def told(service: Service) -> tuple[bytes, bytes, list[dict]]:
    """Map, state and history, to the last digit."""
    assert service.live is not None
    service.store.flush()
    moments = [
        service.mission.timeline.at(stamp_ns)
        for (stamp_ns,) in service.store.rows("SELECT stamp_ns FROM moments ORDER BY number")
    ]
    lines = [history_line(one.stamp_ns, one.zones) for one in moments if one is not None]
    return service.mission.loop.crowd_map.to_bytes(), service.live.applying.to_bytes(), lines


def give_until_killed(client: Client, flown: list[View], acknowledged: int, kill_at: int, kill: Timer) -> int:
    """How many were acknowledged when the service died, or all; the end begins after `kill_at`."""
    for one in flown[acknowledged:]:
        if acknowledged == kill_at:
            kill.start()
        try:
            client.give(one)
        except (ServiceError, TransportError):
            return acknowledged
        acknowledged += 1
    return acknowledged


def test_told_to_end_it_leaves_a_snapshot(tmp_path: Path) -> None:
    """As Ctrl-C does: whoever starts it again waits for no journal."""
    port = free_port()
    with process(tmp_path, port) as service, Client(f"http://127.0.0.1:{port}") as client:
        for one in views(1):
            client.give(one)
        service.send_signal(signal.SIGTERM)
        assert service.wait(60) == 0
    with sqlite3.connect(tmp_path / FILE) as connection:
        (applied,) = connection.execute("SELECT MAX(seq) FROM snapshots").fetchone()
        assert connection.execute("SELECT MAX(seq) FROM journal").fetchone() == (applied,)


ENDED_IN_A_FINALISER = """
import os, signal, sys
from pathlib import Path
from crowdfence.service.server import Address, serve
from support.small_service import running

class Finalised:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)

def ready(address):
    Finalised()

with running(Path(sys.argv[1])) as service:
    serve(service, Address(port=0), ready)
"""


def test_told_to_end_where_python_ignores_what_is_raised_it_ends(tmp_path: Path) -> None:
    """Importing runs finalisers: told to end while it started, it went on for good."""
    told = [sys.executable, "-c", ENDED_IN_A_FINALISER, tmp_path / "data"]
    paths = os.pathsep.join(sys.path)
    done = subprocess.run(
        told, timeout=60, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True
    )
    assert done.returncode == 0 and "Exception ignored in" in done.stderr


def test_told_to_end_while_views_come_it_keeps_all_that_it_acknowledged(tmp_path: Path) -> None:
    port = free_port()
    acknowledged: dict[tuple[str, int], int] = {}

    def give(drone: str) -> None:
        with Client(f"http://127.0.0.1:{port}", patience_s=0.0) as client:
            for number in range(400):  # the journal keeps two minutes of stamps
                one = view(drone, number)
                try:
                    acknowledged[drone, one.stamp_ns] = client.give(one)
                except (ServiceError, TransportError):
                    return

    with process(tmp_path, port) as service:
        givers = [Thread(target=give, args=(drone,)) for drone in DRONES]
        for thread in givers:
            thread.start()
        sleep(0.5)
        service.send_signal(signal.SIGTERM)
        assert service.wait(60) == 0
        for thread in givers:
            thread.join()
    with sqlite3.connect(tmp_path / FILE) as connection:
        query = "SELECT drone, stamp_ns, seq FROM journal WHERE kind = 'view'"
        kept = {(drone, stamp_ns): seq for drone, stamp_ns, seq in connection.execute(query)}
        assert acknowledged and acknowledged.items() <= kept.items()
        (applied,) = connection.execute("SELECT MAX(seq) FROM snapshots").fetchone()
        assert connection.execute("SELECT MAX(seq) FROM journal").fetchone() == (applied,)


def test_what_was_acknowledged_survives_kill_9_at_random_moments(tmp_path: Path) -> None:
    chance = random.Random(7)
    flown = views(8 * (KILLS + 2))
    acknowledged = 0
    for _ in range(KILLS):
        port = free_port()
        with (
            process(tmp_path / "killed", port) as service,
            Client(f"http://127.0.0.1:{port}", patience_s=0.0) as client,
        ):
            # Somewhere within the next views: before, while or after they are written, stepped, answered.
            kill = Timer(chance.uniform(0.0, 0.05), service.send_signal, [signal.SIGKILL])
            kill_at = acknowledged + chance.randrange(12)
            acknowledged = give_until_killed(client, flown, acknowledged, kill_at, kill)
            kill.join()
            assert service.wait(20) == -signal.SIGKILL
    with running(tmp_path / "killed") as service:
        recovered = service.mission.loop.crowd_map.instant_count
        assert service.live is not None
        for one in flown[acknowledged:]:
            service.live.intake.give_view(message(one))
        settle(service)
        service.live.finish()
        after_kills = told(service)
    with running(tmp_path / "never") as service:
        assert service.live is not None
        for one in flown:
            service.live.intake.give_view(message(one))
        settle(service)
        service.live.finish()
        assert told(service)[0] == after_kills[0]
        assert told(service)[2] == after_kills[2]
    assert acknowledged >= 4 * KILLS and recovered > KILLS, "the service was killed before it took anything"
    expected = run(recording(flown), plain(), CONFIG)
    assert expected.crowd_map.to_bytes() == after_kills[0]
