"""Where the page cannot show what is closed it says so: a blank map, or empty lists, look like all-clear."""

import io
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, BrowserContext, expect

from crowdfence.service.access import remove_token
from support.live_field import give_views, live_field
from support.map_page import Console, Server, open_console

LOSE_CONTEXT = """() => document.querySelector('[data-test=map] canvas').getContext('webgl2')
  .getExtension('WEBGL_lose_context').loseContext()"""
WITHOUT_GL = ("--no-sandbox", "--disable-gpu", "--disable-software-rasterizer")


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with live_field(tmp_path_factory.mktemp("field")) as server:
        give_views(server, ["uav1"], count=2, every_s=0.5)
        yield server


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    context = browser.new_context(viewport={"width": 1280, "height": 720}, reduced_motion="reduce")
    yield context
    context.close()


def sign_in(context: BrowserContext, server: Server) -> None:
    context.request.get(f"{server.url}/?token={server.token['operator']}")


def colours(console: Console) -> int:
    """How many colours the middle of the map has."""
    picture = Image.open(io.BytesIO(console.find("map").screenshot())).convert("RGB")
    pixels = np.asarray(picture.crop((200, 200, 500, 500))).reshape(-1, 3)
    return len(np.unique(pixels, axis=0))


def test_a_map_that_the_browser_lost_is_told_and_drawn_again(context: BrowserContext, server: Server) -> None:
    console = open_console(context, server, "operator")
    console.page.evaluate(LOSE_CONTEXT)
    console.find("blank").get_by_text("does not draw the map").wait_for()
    assert console.page.locator(".zone-label").count() == 0, "labels alone would look like a map"
    console.page.locator('[data-zone="Z1"]').wait_for()
    drapes = console.state("drapes")
    console.find("blank").wait_for(state="detached")
    console.drawn(drapes)
    console.page.locator(".zone-label b").wait_for()
    assert colours(console) > 20
    console.page.keyboard.press("Home")
    console.page.mouse.click(600, 400)
    console.page.wait_for_timeout(300)
    assert console.state("selection") is not None, "it can be clicked again"


def test_a_browser_without_webgl_shows_no_empty_map(browser: Browser, server: Server) -> None:
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
    other = browser.browser_type.launch(executable_path=chromium, args=list(WITHOUT_GL))
    try:
        console = Console(other.new_page(), server)
        console.page.goto(f"{server.url}/?token={server.token['operator']}")
        console.find("blank").get_by_text("an empty map is no all-clear").wait_for()
        console.page.locator('[data-zone="Z1"]').click()
        console.find("why").wait_for()
    finally:
        other.close()


def test_a_page_that_hears_no_stream_does_not_say_that_nothing_was_seen(
    context: BrowserContext, server: Server
) -> None:
    """As behind a proxy that passes no WebSockets on."""
    console = Console(context.new_page(), server)
    console.page.route_web_socket(re.compile("/api/v1/stream"), lambda socket: socket.close())
    console.page.goto(f"{server.url}/?token={server.token['operator']}")
    console.find("unheard").get_by_text("do not take it for an all-clear").wait_for()
    assert console.page.get_by_text("Nothing has been seen yet").count() == 0
    assert console.page.get_by_text("No drone has sent a view yet").count() == 0
    assert console.page.get_by_text("No zone is closed").count() == 0


def test_a_link_to_what_is_no_longer_kept_shows_what_is_closed_now(
    context: BrowserContext, server: Server
) -> None:
    sign_in(context, server)
    console = Console(context.new_page(), server)
    console.page.goto(f"{server.url}/#t=1000000000")
    assert [zone["id"] for zone in console.wait("moment.zones.zones")] == ["Z1"]
    assert console.state("time.following")
    expect(console.find("mode")).to_have_text("NO DATA")


def test_the_card_of_a_drone_says_how_late_its_views_come(context: BrowserContext, server: Server) -> None:
    console = open_console(context, server, "operator", "#drone=uav1")
    (uav1,) = server.ask("/drones")["drones"]
    assert 0.0 <= uav1["lag_s"] < 9.0
    assert console.find("lag").inner_text() == f"{uav1['lag_s']:.1f} s after their stamps"


def test_a_page_whose_token_was_taken_back_does_not_wait_for_the_network(
    browser: Browser, tmp_path: Path
) -> None:
    with live_field(tmp_path) as server:
        server.admit("viewer")
        give_views(server, ["uav1"], count=2, every_s=0.5)
        context = browser.new_context(reduced_motion="reduce")
        console = open_console(context, server, "operator")
        server.kill()
        console.find("offline").get_by_text("The connection to the service is lost").wait_for()
        remove_token(server.tokens, "a-operator")
        server.start()
        console.find("offline").get_by_text("The service no longer knows your token").wait_for()
        context.close()
