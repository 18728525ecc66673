"""A drone with a long name: what is told of it stays in view, above all how old its picture is."""

import time
from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator

from crowdfence import Camera, Client, View
from support.map_page import Console, Server, free_port, open_console
from support.served import ORIGIN, write_level_ground

NAME = "fleet/uav-of-the-north-sector-with-a-long-name-2"
STRAIGHT_DOWN = np.array([[1.0, 0, 0, 0], [0, -1.0, 0, 0], [0, 0, -1.0, 20.0], [0, 0, 0, 1.0]])


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("field")
    server = Server(folder / "tokens.json", free_port())
    server.mission = ["--terrain", str(write_level_ground(folder / "dem.tif")), "--origin", ORIGIN]
    server.mission += ["--data", str(folder / "live"), "--silent-after-s", "2"]
    server.admit("operator")
    server.start()
    yield server
    server.kill()


def give_crowd(server: Server) -> None:
    camera = Camera.pinhole(320, 240, 240.0, 240.0, 160.0, 120.0)
    heatmap = np.zeros((24, 32), np.float32)
    heatmap[8:16, 12:20] = 0.95
    with Client(server.url, token=server.token["operator"]) as client:
        for _ in range(3):
            client.give(View(NAME, time.time_ns(), camera, STRAIGHT_DOWN, heatmap))
            time.sleep(0.3)


def right(one: Locator) -> float:
    box = one.bounding_box()
    assert box is not None and box["width"] > 0
    return float(box["x"] + box["width"])


@pytest.fixture(scope="module")
def console(browser: Browser, server: Server) -> Iterator[Console]:
    give_crowd(server)
    context = browser.new_context(viewport={"width": 1280, "height": 720}, reduced_motion="reduce")
    yield open_console(context, server, "operator")
    context.close()


def test_the_age_of_an_old_picture_is_in_the_picture(console: Console) -> None:
    age = console.page.locator(".camera-name small", has_text="ago")
    age.wait_for()
    assert right(age) <= right(console.page.locator(".camera"))
    assert console.page.locator(".camera-name").get_attribute("title") == NAME
    assert console.page.locator(".camera-picture em").count() == 0, "there is a picture"


def test_what_the_drone_showed_is_in_the_card(console: Console) -> None:
    console.choose("Z1")
    looks = console.page.locator(".evidence tbody td").last
    looks.wait_for()
    card = console.find("zone-card")
    for width in (1280, 1024):
        console.page.set_viewport_size({"width": width, "height": 720})
        assert right(looks) <= right(card) + 1
