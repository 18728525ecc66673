"""Views of many drones into the service over loopback, against two that do nothing with them.

    python benchmarks/service/load.py [--seconds 20] [--drones 12 48] [--rates 2 10] [--viewers 200]

How many views a second are accepted and refused, what one costs the process that takes them, how long an
answer takes, and how long from the acknowledgement of a view to the zones that follow from it (p50, p99);
then the same with 200 WebSocket listeners, and how old a step is when they have it. Every view shows one
crowd, ten heatmap pixels in radius, over the same plain. The baselines take the same bodies: FastAPI that
reads and answers, and mosquitto at quality 1 (Debian's package; left out where it is missing), to which
somebody subscribes. Clients are two processes; all share the machine.
"""

import argparse
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

import numpy as np
import uvicorn
from clients import DRONE, STAMP, Told, result, started
from fastapi import FastAPI, Request
from mqtt import Publisher, broker, broker_path

from crowdfence import Camera, View
from crowdfence.service.app import make_app
from crowdfence.service.server import listen
from support.small_service import SETTINGS, message, pose, running

CAMERA = Camera.pinhole(80, 60, 60.0, 60.0, 40.0, 30.0)
CLIENTS = 2


def bodies() -> list[bytes]:
    """Views to be named and stamped: eight heatmaps from three places."""
    v, u = np.mgrid[0:60, 0:80]
    made = []
    for number in range(24):
        crowd = (u - 40 - 3 * (number % 8)) ** 2 + (v - 30) ** 2 < 100
        heatmap = np.where(crowd, 0.95, 0.02).astype(np.float32)
        place = pose(f"uav{1 + number % 3}", number / 3)
        made.append(message(View(DRONE, STAMP, CAMERA, place, heatmap)))
    return made


def bombarded(kind: str, port: int, drones: int, rate_hz: float, seconds: float) -> Told:
    """All clients together."""
    names, made = [f"uav{number}" for number in range(drones)], bodies()
    clients = [
        started("give", kind, port, names[first::CLIENTS], made, rate_hz, seconds) for first in range(CLIENTS)
    ]
    all_told = [result(client) for client in clients]
    counts: dict[int, int] = {}
    for one in all_told:
        for code, count in one.counts.items():
            counts[code] = counts.get(code, 0) + count
    taken_s = max(one.taken_s for one in all_told)
    return Told(counts, taken_s, [second for one in all_told for second in one.answers_s])


def served(app: FastAPI, use: Callable[[int], Told]) -> Told:
    """What `use` finds on the port where the application listens."""
    config = uvicorn.Config(app, host="127.0.0.1", port=0, log_config=None)
    server, listening = uvicorn.Server(config), listen(config)
    thread = Thread(target=server.run, args=([listening],), daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        return use(listening.getsockname()[1])
    finally:
        server.should_exit = True
        thread.join()


def fastapi_baseline() -> FastAPI:
    app = FastAPI()

    @app.post("/api/v1/views", status_code=202)
    async def views(request: Request) -> dict[str, int]:
        return {"accepted": len(await request.body())}

    return app


class Samples:
    """In place of the service's histogram: every time, not its bucket."""

    def __init__(self) -> None:
        self.seconds: list[float] = []

    def took(self, seconds: float) -> None:
        self.seconds.append(seconds)


def service_row(drones: int, rate_hz: float, seconds: float, viewers: int = 0) -> None:
    settings = replace(SETTINGS, clock="system", snapshot_every=200, waiting_per_drone=16)
    watching: subprocess.Popen[bytes] | None = None
    ages_s: list[list[float]] = []
    with TemporaryDirectory() as folder, running(Path(folder), settings=settings) as service:
        live = service.live
        assert live is not None
        live.heard.publishing = Samples()  # type: ignore[assignment]
        spent_s = time.process_time()

        def use(port: int) -> Told:
            nonlocal watching, spent_s
            if viewers:
                watching = started("view", viewers, port, seconds + 20.0)
                while service.hub.listeners < viewers:
                    time.sleep(0.1)
                spent_s = time.process_time()  # of views and steps, not of handshakes
            told = bombarded("http", port, drones, rate_hz, seconds)
            if watching is not None:
                ages_s.extend(result(watching))
            return told

        told = served(make_app(service), use)
        waiting = live.applying.waiting
        live.applying.settled(120.0)
        live.finish()
        name = f"service, {viewers} listeners" if viewers else "service"
        published = live.heard.publishing.seconds
        _row(name, drones, rate_hz, told, time.process_time() - spent_s, published)
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"    waiting at the end {waiting}, largest memory of the process {peak_mb:.0f} MB")
        if viewers:
            heard = [one for one in ages_s if one]
            everything = [age for one in heard for age in one]
            print(
                f"    {len(heard)} of {viewers} listeners heard {len(everything)} steps, "
                f"{service.hub.cut_off} were cut off; a step was {_percentiles(everything)} s old"
            )


def baseline_row(drones: int, rate_hz: float, seconds: float) -> None:
    spent_s = time.process_time()
    told = served(fastapi_baseline(), lambda port: bombarded("http", port, drones, rate_hz, seconds))
    _row("FastAPI", drones, rate_hz, told, time.process_time() - spent_s, [])


def mqtt_row(drones: int, rate_hz: float, seconds: float) -> None:
    with TemporaryDirectory() as folder, broker(Path(folder)) as (port, process):
        reader = Publisher(port, "reader")
        reader.subscribe("views/#")
        Thread(target=_read_all, args=(reader,), daemon=True).start()
        told = bombarded("mqtt", port, drones, rate_hz, seconds)
        ticks = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
        spent_s = (int(ticks[11]) + int(ticks[12])) / os.sysconf("SC_CLK_TCK")
        _row("mosquitto, QoS 1", drones, rate_hz, told, spent_s, [])
        reader.close()


def _read_all(reader: Publisher) -> None:
    try:
        while True:
            reader.read()
    except OSError:
        return


def _row(name: str, drones: int, rate_hz: float, told: Told, cpu_s: float, published_s: list[float]) -> None:
    accepted = told.counts.get(202, 0)
    others = {code: count for code, count in sorted(told.counts.items()) if code != 202}
    cells = (
        name,
        drones,
        f"{drones * rate_hz:.0f}",
        f"{accepted / told.taken_s:.1f}",
        ", ".join(f"{count} x {code}" for code, count in others.items()),
        f"{1e3 * cpu_s / max(1, accepted):.1f}",
        _percentiles(told.answers_s),
        _percentiles(published_s),
    )
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


def _percentiles(seconds: list[float]) -> str:
    if not seconds:
        return ""
    return " / ".join(f"{value:.3f}" for value in np.percentile(seconds, [50, 99]))


def main(seconds: float, drones: list[int], rates_hz: list[float], viewers: int) -> None:
    body = len(bodies()[0])
    print(f"{os.cpu_count()} cores, load average {_load()}, {seconds:g} s a row, {body} bytes a view\n")
    names = ("", "drones", "wanted /s", "accepted /s", "refused", "CPU ms a view")
    print(f"| {' | '.join((*names, 'answer p50 / p99 s', 'zones p50 / p99 s'))} |")
    print("|---" * (len(names) + 2) + "|")
    for count in drones:
        for rate_hz in rates_hz:
            baseline_row(count, rate_hz, seconds)
            if broker_path() is not None:
                mqtt_row(count, rate_hz, seconds)
            service_row(count, rate_hz, seconds)
    if viewers:
        service_row(drones[0], rates_hz[0], seconds, viewers)
    print(f"\nload average {_load()}")


def _load() -> str:
    return " ".join(f"{one:.1f}" for one in os.getloadavg())


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--drones", type=int, nargs="+", default=[12, 48])
    parser.add_argument("--rates", type=float, nargs="+", default=[2.0, 10.0])
    parser.add_argument("--viewers", type=int, default=200)
    given = parser.parse_args()
    main(given.seconds, given.drones, given.rates, given.viewers)
