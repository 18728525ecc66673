"""Views of many drones into the service over loopback, against a baseline that does nothing with them.

    python benchmarks/service/load.py [--seconds 20]

For 12 and 48 drones: how many views a second are accepted, and how long it takes from the acknowledgement of
a view to the zones that follow from it (p50, p99, upper bounds of the histogram's buckets). The baseline is
FastAPI that reads the same bodies and answers. Clients are two processes with keep-alive; everything shares
the machine.
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

from crowdfence import View
from crowdfence.service.app import make_app
from crowdfence.service.latency import BOUNDS_S
from support.small_service import CAMERA, SETTINGS, message, pose, running

RATE_HZ = 2.0
HEATMAP = (60, 80)
CLIENTS = 2


def give(port: int, drones: list[str], seconds: float, answers: Any) -> None:
    """Every drone RATE_HZ times a second, as far as that is possible; what was answered, how often."""
    counts: dict[int, int] = {}
    rng = np.random.default_rng(len(drones))
    heatmaps = [rng.uniform(0, 1, HEATMAP).astype(np.float32) ** 8 for _ in range(8)]
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
    told = [answers.get() for _ in clients]
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
    print(
        "| | drones | wanted /s | accepted /s | others | p50 s | p99 s |\n|---|---|---|---|---|---|---|",
        flush=True,
    )
    for drones in (12, 48):
        counts, taken_s = bombarded(baseline(), drones, seconds)
        print(
            f"| baseline | {drones} | {RATE_HZ * drones:.0f} | {counts.get(200, 0) / taken_s:.1f} | | | |",
            flush=True,
        )
        settings = replace(
            SETTINGS, clock="system", snapshot_every=200, waiting_per_drone=16, views_per_s=30.0
        )
        with TemporaryDirectory() as folder, running(Path(folder), settings=settings) as service:
            counts, taken_s = bombarded(make_app(service), drones, seconds)
            others = {code: count for code, count in counts.items() if code != 202}
            rate, publishing = counts.get(202, 0) / taken_s, service.live.publishing
            print(
                f"| service | {drones} | {RATE_HZ * drones:.0f} | {rate:.1f} | {others or ''} | "
                f"{percentile_s(publishing, 0.5):g} | {percentile_s(publishing, 0.99):g} |",
                flush=True,
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=20.0)
    main(parser.parse_args().seconds)
