"""Views of many drones into the service over loopback, against a baseline that does nothing with them.

    python benchmarks/service/load.py [--seconds 20]

For 12 and 48 drones, twice a second each: how many views a second are accepted, what one costs the service's
process, and how long it takes from the acknowledgement of a view to the zones that follow from it (p50, p99,
upper bounds of buckets). Every view shows one crowd, ten heatmap pixels in radius, over the same plain. The
baseline is FastAPI that reads the same bodies and answers. Clients are two processes; all share the machine.
"""

import argparse
import multiprocessing
import socket
import sys
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

import httpx
import numpy as np
import uvicorn
from fastapi import FastAPI, Request

from crowdfence import Camera, View
from crowdfence.service.app import make_app
from crowdfence.service.latency import BOUNDS_S
from support.small_service import SETTINGS, message, pose, running

RATE_HZ = 2.0
CAMERA = Camera.pinhole(80, 60, 60.0, 60.0, 40.0, 30.0)
CLIENTS = 2


def give(port: int, drones: list[str], seconds: float, answers: Any) -> None:
    """Every drone RATE_HZ times a second, as far as that is possible; what was answered, how often."""
    counts: dict[int, int] = {}
    v, u = np.mgrid[0:60, 0:80]
    heatmaps = [
        np.where((u - 40 - 3 * k) ** 2 + (v - 30) ** 2 < 100, 0.95, 0.02).astype(np.float32) for k in range(8)
    ]
    begin_s, number = time.monotonic(), 0
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30.0) as http:
        while time.monotonic() - begin_s < seconds:
            drone = drones[number % len(drones)]
            due_s = begin_s + number / (RATE_HZ * len(drones))
            time.sleep(max(0.0, due_s - time.monotonic()))
            place = pose(f"uav{1 + number % 3}", (number / 10) % 8)
            body = message(View(drone, time.time_ns(), CAMERA, place, heatmaps[number % 8]))
            code = http.post("/api/v1/views", content=body).status_code
            counts[code] = counts.get(code, 0) + 1
            number += 1
    answers.put((counts, time.monotonic() - begin_s))


def bombarded(app: FastAPI, drones: int, seconds: float) -> tuple[dict[int, int], float]:
    """Answers by status, and seconds."""
    config = uvicorn.Config(app, log_config=None)
    listening = socket.create_server(("127.0.0.1", 0))
    server = uvicorn.Server(config)
    thread = Thread(target=server.run, args=([listening],), daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    context = multiprocessing.get_context("spawn")
    answers = context.Queue()
    names = [f"uav{number}" for number in range(drones)]
    port = listening.getsockname()[1]
    clients = [
        context.Process(target=give, args=(port, names[first::CLIENTS], seconds, answers))
        for first in range(CLIENTS)
    ]
    for client in clients:
        client.start()
    told = [answers.get(timeout=10.0 * seconds) for _ in clients]
    for client in clients:
        client.join()
    server.should_exit = True
    thread.join()
    together: dict[int, int] = {}
    for counts, _ in told:
        for code, count in counts.items():
            together[code] = together.get(code, 0) + count
    return together, max(taken for _, taken in told)


def baseline() -> FastAPI:
    app = FastAPI()

    @app.post("/api/v1/views")
    async def views(request: Request) -> dict[str, int]:
        return {"accepted": len(await request.body())}

    return app


def percentile_s(latency: Any, share: float) -> float:
    """Upper bound of the bucket that it lies in."""
    counts = latency._counts
    reached = np.cumsum(counts) >= share * sum(counts)
    place = int(np.argmax(reached))
    return BOUNDS_S[place] if place < len(BOUNDS_S) else float("inf")


def main(seconds: float) -> None:
    names = ("", "drones", "wanted /s", "accepted /s", "other answers", "CPU ms a view", "p50 s", "p99 s")
    _row(*names)
    _row(*["---"] * len(names))
    for drones in (12, 48):
        wanted, spent_s = RATE_HZ * drones, time.process_time()
        counts, taken_s = bombarded(baseline(), drones, seconds)
        accepted = counts.get(200, 0)
        cpu_ms = (time.process_time() - spent_s) / accepted * 1e3
        _row("baseline", drones, f"{wanted:.0f}", f"{accepted / taken_s:.1f}", "", f"{cpu_ms:.1f}", "", "")
        settings = replace(SETTINGS, clock="system", snapshot_every=200, waiting_per_drone=16)
        with TemporaryDirectory() as folder, running(Path(folder), settings=settings) as service:
            spent_s = time.process_time()
            counts, taken_s = bombarded(make_app(service), drones, seconds)
            assert service.live is not None
            service.live.finish()
            accepted, publishing = counts.pop(202, 0), service.live.publishing
            cpu_ms = (time.process_time() - spent_s) / accepted * 1e3
            times = [f"{percentile_s(publishing, share):g}" for share in (0.5, 0.99)]
            _row(
                "service",
                drones,
                f"{wanted:.0f}",
                f"{accepted / taken_s:.1f}",
                counts or "",
                f"{cpu_ms:.1f}",
                *times,
            )


def _row(*cells: object) -> None:
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=20.0)
    main(parser.parse_args().seconds)
