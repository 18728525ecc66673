"""What a camera showed is told by its own age, and is not left there once another moment is shown."""

import time
from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Browser

from crowdfence import Camera, Client, View
from support.map_page import Console, Server, free_port, open_console
from support.served import ORIGIN, write_level_ground

STRAIGHT_DOWN = np.array([[1.0, 0, 0, 0], [0, -1.0, 0, 0], [0, 0, -1.0, 20.0], [0, 0, 0, 1.0]])
PAINTED = """() => {
  const canvas = document.querySelector(".camera canvas");
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  return pixels.data.some(value => value > 0);
}"""


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


def give_crowd(server: Server, views: int = 1) -> None:
    camera = Camera.pinhole(320, 240, 240.0, 240.0, 160.0, 120.0)
    heatmap = np.zeros((24, 32), np.float32)
    heatmap[8:16, 12:20] = 0.95
    with Client(server.url, token=server.token["operator"]) as client:
        for _ in range(views):
            client.give(View("uav1", time.time_ns(), camera, STRAIGHT_DOWN, heatmap))
            time.sleep(0.5)


@pytest.fixture(scope="module")
def console(browser: Browser, server: Server) -> Iterator[Console]:
    give_crowd(server)
    context = browser.new_context(viewport={"width": 1280, "height": 720}, reduced_motion="reduce")
    yield open_console(context, server, "operator")
    context.close()


def painted(console: Console) -> bool:
    """Whether the picture of the drone shows anything, once it is as it stays."""
    console.page.wait_for_timeout(1000)
    return bool(console.page.evaluate(PAINTED))


def test_a_picture_that_is_long_on_its_way_leaves_the_one_before_with_its_age(
    console: Console, server: Server
) -> None:
    assert painted(console)
    console.page.route("**/heatmap*", lambda _: None)
    give_crowd(server, 8)
    console.page.locator(".taken", has_text="ago").first.wait_for()
    console.page.unroute_all(behavior="ignoreErrors")
    console.page.locator(".taken").first.wait_for(state="detached")


def test_where_no_picture_came_the_one_before_is_not_left_there(console: Console, server: Server) -> None:
    assert painted(console)
    console.page.route("**/heatmap*", lambda route: route.abort())
    give_crowd(server)
    console.page.locator(".camera em", has_text="no picture").wait_for()
    assert not painted(console)
    console.page.unroute("**/heatmap*")
    give_crowd(server)
    console.page.locator(".camera em").wait_for(state="detached")
    assert painted(console)
