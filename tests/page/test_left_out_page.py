"""An operator leaves a blind drone out on its card, and takes it in again."""

import os
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, expect

from support.live_field import field_console, give_views, live_field
from support.map_page import Console, Server


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with live_field(tmp_path_factory.mktemp("field"), "--silent-after-s", "60") as server:
        yield server


@pytest.fixture(scope="module")
def console(browser: Browser, server: Server) -> Iterator[Console]:
    give_views(server, ["uav1", "uav2"], count=12, every_s=0.4, blind=["uav2"])
    with field_console(browser, server) as console:
        yield console


def decide(console: Console, reason: str) -> None:
    console.find("leave-out").click()
    dialog = console.find("reason-dialog")
    dialog.locator("textarea").fill(reason)
    dialog.locator("button[type=submit]").click()
    dialog.wait_for(state="detached")


def test_a_blind_drone_is_left_out_and_everybody_sees_it(console: Console, server: Server) -> None:
    console.page.locator(".drone-row", has_text="uav2").locator("button.row").click()
    expect(console.find("drones")).to_have_text("2/2")
    decide(console, "rain on its lens")
    said = console.find("left-out")
    said.wait_for()
    assert "“rain on its lens”" in said.inner_text() and "a-operator" in said.inner_text()
    expect(console.find("drones")).to_have_text("1/2")
    row = console.page.locator(".drone-row", has_text="uav2").locator("small", has_text="left out")
    assert row.get_attribute("title") == "rain on its lens"
    console.wait("alerts", lambda alerts: "left_out" in [one["kind"] for one in alerts])
    (alert,) = [one for one in server.ask("/alerts")["alerts"] if one["kind"] == "left_out"]
    assert alert["cleared_ms"] is None and "rain on its lens" in alert["text"]
    if folder := os.environ.get("CROWDFENCE_PICTURES"):
        console.page.screenshot(path=f"{folder}/left-out.png")


def test_it_is_taken_in_again(console: Console, server: Server) -> None:
    decide(console, "it was wiped")
    console.find("left-out").wait_for(state="detached")
    expect(console.find("drones")).to_have_text("2/2")
    audit = server.ask("/audit")["entries"]
    assert [(one["action"], one["drone"], one["reason"]) for one in audit[:2]] == [
        ("take_in", "uav2", "it was wiped"),
        ("leave_out", "uav2", "rain on its lens"),
    ]
