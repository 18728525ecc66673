"""A live service on level ground, drones that hover above it, and its page before an operator."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser

from crowdfence import Camera, Client, View
from support.map_page import Console, Server, free_port, open_console
from support.served import ORIGIN, write_level_ground

CAMERA = Camera.pinhole(320, 240, 240.0, 240.0, 160.0, 120.0)
STRAIGHT_DOWN = np.array([[1.0, 0, 0, 0], [0, -1.0, 0, 0], [0, 0, -1.0, 20.0], [0, 0, 0, 1.0]])
"""From 20 m above (0, 0, 0)."""


def level_mission(folder: Path) -> list[str]:
    """Words of the command: live views over level ground."""
    ground = write_level_ground(folder / "dem.tif")
    return ["--terrain", str(ground), "--origin", ORIGIN, "--data", str(folder / "live")]


@contextmanager
def live_field(folder: Path, *words: str) -> Iterator[Server]:
    """The service with further words of its command, and an operator."""
    server = Server(folder / "tokens.json", free_port(), mission=[*level_mission(folder), *words])
    server.admit("operator")
    server.start()
    try:
        yield server
    finally:
        server.kill()


def give_views(
    server: Server, drones: Sequence[str], *, count: int, every_s: float, blind: Sequence[str] = ()
) -> None:
    """So many views of each drone, straight down on a crowd; those that are blind see nobody."""
    crowd = np.zeros((24, 32), np.float32)
    crowd[8:16, 12:20] = 0.95
    with Client(server.url, token=server.token["operator"]) as client:
        for _ in range(count):
            for drone in drones:
                shown = np.zeros_like(crowd) if drone in blind else crowd
                client.give(View(drone, time.time_ns(), CAMERA, STRAIGHT_DOWN, shown))
            time.sleep(every_s)


@contextmanager
def field_console(browser: Browser, server: Server) -> Iterator[Console]:
    """The operator's."""
    context = browser.new_context(viewport={"width": 1280, "height": 720}, reduced_motion="reduce")
    yield open_console(context, server, "operator")
    context.close()
