"""What has to be read is there to be read: long alerts, cards, names and panels in windows of all sizes."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator

from crowdfence import Georeference
from support.live_field import field_console, give_views, live_field
from support.map_page import Console, Server

NAME = "fleet/uav-of-the-north-sector-with-a-name-as-long-as-names-of-drones-may-be-for-some-reason-or-other"
REASON = "ambulance at work, stay away until it has left; " * 6


def write_given_zone(path: Path) -> Path:
    """40 m square, north of where the drones look."""
    corners = [
        [-20.0, 40.0, 0.0],
        [20.0, 40.0, 0.0],
        [20.0, 80.0, 0.0],
        [-20.0, 80.0, 0.0],
        [-20.0, 40.0, 0.0],
    ]
    latitude, longitude, _ = Georeference(46.5, 8.0, 1200.0).geodetic_from_local(corners)
    ring = np.column_stack([longitude, latitude]).tolist()
    feature = {
        "type": "Feature",
        "properties": {"name": "range"},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("field")
    given = write_given_zone(folder / "given.geojson")
    with live_field(folder, "--silent-after-s", "4", "--static-zones", str(given)) as server:
        yield server


@pytest.fixture(scope="module")
def console(browser: Browser, server: Server) -> Iterator[Console]:
    # One drone shows a crowd where another, whose camera is covered, sees nobody.
    give_views(server, [NAME, "uav2"], count=12, every_s=0.4, blind=["uav2"])
    with field_console(browser, server) as console:
        yield console


def width(one: Locator) -> float:
    box = one.bounding_box()
    assert box is not None
    return float(box["width"])


def test_the_text_of_an_alert_has_the_width_of_the_panel(console: Console) -> None:
    """On a phone it had 115 of 390 pixels, and 15 lines."""
    console.find("alerts-button").click()
    alert = console.page.locator(".alert", has_text="saw nobody")
    for across in (390, 1280):
        console.page.set_viewport_size({"width": across, "height": 720})
        assert width(alert.locator("p")) > 0.85 * width(alert)
    console.page.keyboard.press("Escape")


def test_the_focus_goes_into_a_panel_that_opens_and_back(console: Console) -> None:
    console.find("alerts-button").focus()
    console.page.keyboard.press("Enter")
    console.find("panel-alerts").wait_for()
    console.page.keyboard.press("Tab")
    assert console.page.evaluate("document.activeElement.closest('.panel') !== null")
    console.page.keyboard.press("Escape")
    console.find("panel-alerts").wait_for(state="detached")
    assert console.page.evaluate("document.activeElement.dataset.test") == "alerts-button"


def test_the_label_of_a_drone_with_a_long_name_leaves_the_map_in_view(console: Console) -> None:
    label = console.page.locator(f'.drone-label[title="{NAME}"] span')
    label.wait_for()
    assert width(label) < 260


def test_the_label_of_ground_that_is_given_has_one_frame(console: Console) -> None:
    label = console.page.locator(".zone-label.kind-static")
    assert label.locator("b").evaluate("one => getComputedStyle(one).borderTopWidth") == "0px"
    assert label.locator("span").evaluate("one => getComputedStyle(one).borderTopStyle") == "dashed"


def test_a_silent_drone_is_no_paler_than_others(console: Console) -> None:
    silence = console.page.locator(".drone-row .stale small", has_text="silent").first
    silence.wait_for()
    opacity = """one => {
      let all = 1;
      for (let at = one; at; at = at.parentElement) all *= Number(getComputedStyle(at).opacity);
      return all;
    }"""
    assert silence.evaluate(opacity) == 1


def test_a_card_tells_a_long_reason_once_and_the_next_card_begins_at_its_top(
    console: Console, server: Server
) -> None:
    corners = [[-60.0, -60.0], [-50.0, -60.0], [-50.0, -50.0]]
    zone = server.ask("/zones", body={"polygon": corners, "reason": REASON, "restriction": "prohibited"})
    console.wait("moment.zones.zones", lambda zones: any(one["id"] == zone["id"] for one in zones))
    console.choose(zone["id"])
    assert console.find("zone-card").inner_text().count("ambulance at work") == 6
    console.page.set_viewport_size({"width": 1280, "height": 420})
    inspector = console.find("inspector")
    inspector.evaluate("one => one.scrollTo(0, 1000)")
    assert inspector.evaluate("one => one.scrollTop") > 0
    console.choose("Z1")
    assert inspector.evaluate("one => one.scrollTop") == 0


def test_a_tablet_that_is_turned_upright_has_one_panel_at_most(console: Console) -> None:
    console.page.set_viewport_size({"width": 1024, "height": 768})
    assert console.page.locator(".side").count() == 2
    console.page.set_viewport_size({"width": 768, "height": 1024})
    console.page.locator(".side.left").wait_for(state="detached")
    console.find("zone-card").wait_for()
    console.page.set_viewport_size({"width": 1024, "height": 768})
    console.page.locator(".side.left").wait_for()
    assert console.complaints == []
