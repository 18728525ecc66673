"""A drone with a long name: what is told of it stays in view, above all how old its picture is."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Locator

from support.live_field import field_console, give_views, live_field
from support.map_page import Console, Server

NAME = "fleet/uav-of-the-north-sector-with-a-long-name-2"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with live_field(tmp_path_factory.mktemp("field"), "--silent-after-s", "2") as server:
        yield server


def right(one: Locator) -> float:
    box = one.bounding_box()
    assert box is not None and box["width"] > 0
    return float(box["x"] + box["width"])


@pytest.fixture(scope="module")
def console(browser: Browser, server: Server) -> Iterator[Console]:
    give_views(server, [NAME], count=3, every_s=0.3)
    with field_console(browser, server) as console:
        yield console


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


def test_a_reason_without_spaces_stays_in_the_card(console: Console, server: Server) -> None:
    reason = "https://example.org/" + "w" * 300
    zone = server.ask("/zones", body={"polygon": [[40, 40], [60, 40], [60, 60]], "reason": reason})["id"]
    console.page.locator(f'[data-zone="{zone}"]').wait_for()
    console.choose(zone)
    why = console.find("why")
    why.get_by_text("wwww").wait_for()
    assert why.evaluate("one => one.scrollWidth - one.clientWidth") <= 1
