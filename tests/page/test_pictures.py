"""What a camera showed is told by its own age, and is not left there once another moment is shown."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from support.live_field import field_console, give_views, live_field
from support.map_page import Console, Server

PAINTED = """() => {
  const canvas = document.querySelector(".camera canvas");
  if (!canvas) return false;
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  return pixels.data.some(value => value > 0);
}"""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with live_field(tmp_path_factory.mktemp("field"), "--silent-after-s", "2") as server:
        yield server


def give_crowd(server: Server, count: int = 1) -> None:
    give_views(server, ["uav1"], count=count, every_s=0.5)


@pytest.fixture(scope="module")
def console(browser: Browser, server: Server) -> Iterator[Console]:
    give_crowd(server)
    with field_console(browser, server) as console:
        yield console


def wait_until_painted(console: Console) -> None:
    """The first picture of a drone takes its time on a busy machine."""
    console.page.wait_for_function(PAINTED)


def painted(console: Console) -> bool:
    """Whether the picture of the drone shows anything, once it is as it stays."""
    console.page.wait_for_timeout(1000)
    return bool(console.page.evaluate(PAINTED))


def test_a_picture_that_is_long_on_its_way_leaves_the_one_before_with_its_age(
    console: Console, server: Server
) -> None:
    wait_until_painted(console)
    console.page.route("**/heatmap*", lambda _: None)
    give_crowd(server, 8)
    console.page.locator(".taken", has_text="ago").first.wait_for()
    console.page.unroute_all(behavior="ignoreErrors")
    console.page.locator(".taken").first.wait_for(state="detached")


def test_where_no_picture_came_the_one_before_is_not_left_there(console: Console, server: Server) -> None:
    wait_until_painted(console)
    console.page.route("**/heatmap*", lambda route: route.abort())
    give_crowd(server)
    console.page.locator(".camera em", has_text="no picture").wait_for()
    assert not painted(console)
    console.page.unroute("**/heatmap*")
    give_crowd(server)
    console.page.locator(".camera em").wait_for(state="detached")
    wait_until_painted(console)
