"""The map page in a browser, on the real server. The tests go through one visit, in their order."""

import io
import json
import os
import urllib.error
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, BrowserContext, expect

from support.map_page import THREE_FRAMES, Console, Server, open_console

THIN_SPACE = "\u2009"
MOST_PICTURE_BYTES = 600_000


def pixels(console: Console) -> np.ndarray:
    """What the map shows [H, W, 3]."""
    picture = Image.open(io.BytesIO(console.find("map").screenshot()))
    return np.asarray(picture.convert("RGB")).astype(int)


def share(map_pixels: np.ndarray, colour: str) -> float:
    """Of the map, of a coarse colour: which channel leads, clearly."""
    red, green, blue = (map_pixels[..., k] for k in range(3))
    hues = {
        "crowd": (red > green + 40) & (red > blue + 40),
        "empty": (green > red + 25) & (blue > red + 20),
        "not cleared": (blue > green + 12) & (red > green + 4),
    }
    return float(hues[colour].mean())


def toggle(console: Console, *layers: str) -> None:
    for layer in layers:
        console.page.locator(f'[data-layer="{layer}"]').click()


def area(square_metres: float) -> str:
    return f"{square_metres:,.0f}".replace(",", THIN_SPACE) + " m²"


def test_it_loads_without_complaints_or_requests_elsewhere(console: Console, server: Server) -> None:
    assert console.hosts == {server.url.removeprefix("http://")}
    assert console.complaints == []
    assert console.page.title() == "race · crowdfence"
    assert "token" not in console.page.url


def test_the_map_shows_ground_crowd_and_what_was_not_cleared(console: Console) -> None:
    # These have colours of their own.
    others = ("pictures", "tracks", "footprints")
    toggle(console, *others)
    console.rewind()  # how far the mission is when the page has loaded depends on the machine
    shown = pixels(console)
    assert len(np.unique(shown.reshape(-1, 3) // 32, axis=0)) > 30
    assert share(shown, "crowd") > 0.002
    assert share(shown, "empty") > 0.002  # the flight has just begun
    assert share(shown, "not cleared") > 0.02
    drawn = console.state("drapes")
    toggle(console, "belief")
    console.drawn(drawn)
    hidden = pixels(console)
    assert share(hidden, "empty") < share(shown, "empty") / 4, "teal without the layer that says so"
    assert share(hidden, "not cleared") < share(shown, "not cleared") / 4
    toggle(console, "belief", *others)
    console.find("follow").click()


def test_updates_arrive_by_themselves(console: Console) -> None:
    assert console.state("mode") == "replay"
    expect(console.find("mode")).to_have_text("REPLAYING")
    first = int(console.state("moment.stamp_ns"))
    points = len(console.state("timeline.points"))
    console.wait("moment.stamp_ns", lambda stamp: int(stamp) > first)
    console.wait("timeline.points", lambda now: len(now) > points)


def test_the_card_of_a_zone_has_the_figures_of_the_interface(console: Console, server: Server) -> None:
    stamp = console.pause()
    zones = server.ask(f"/zones?at={stamp}")["zones"]
    assert len(zones) >= 2
    assert console.page.locator("[data-zone]").count() == len(zones)
    zone = zones[0]
    console.choose(zone["id"])
    card = console.find("zone-card")
    assert card.locator("h1").inner_text() == zone["id"]
    assert console.find("closed-area").inner_text() == area(zone["closed_m2"])
    probability = zone["probability_max"]
    shown = console.find("probability").inner_text()
    assert shown == (
        "> 0.999" if 0.999 < probability < 1 else f"{probability:.{3 if probability < 0.1 else 2}f}"
    )
    assert zone["why"][1:] in console.find("why").inner_text()
    rows = card.locator("tbody tr").all_inner_texts()
    for row, look in zip(rows, zone["evidence"], strict=True):
        cells = row.split()
        assert cells[0] == look["drone"] and cells[-1] == str(look["looks"])
        assert f"{look['value']:.2f}" in cells and f"{look['range_m']:.0f}" in cells


def test_a_picture_of_it_can_be_shown_to_others(console: Console, server: Server, tmp_path: Path) -> None:
    # `make page-picture` keeps it in the documentation, of the whole mission.
    picture = Path(os.environ.get("CROWDFENCE_PICTURE", tmp_path / "page.png"))
    if "CROWDFENCE_PICTURE" in os.environ:
        console.find("follow").click()
        console.wait("mode", lambda mode: mode == "finished")
        for _ in range(3):  # of several zones that a drone is near, the next is told after the first
            for alert in server.ask("/alerts")["alerts"]:
                if alert["acknowledged_ns"] is None:
                    server.ask(f"/alerts/{alert['id']}/acknowledge", body={})
            console.page.wait_for_timeout(2000)
        console.page.reload()
        console.wait("belief")
        console.choose("Z1")
        console.page.wait_for_timeout(2500)
        console.page.keyboard.press("Home")
    console.page.wait_for_timeout(2500)
    Image.open(io.BytesIO(console.page.screenshot())).convert("RGB").quantize(
        256, kmeans=3, dither=Image.Dither.NONE
    ).save(picture, optimize=True)
    assert 50_000 < picture.stat().st_size < MOST_PICTURE_BYTES


def test_it_goes_back_in_time_and_plays_from_there(console: Console) -> None:
    first, last = (console.state("timeline.points")[k]["stamp_ns"] for k in (0, -1))
    track = console.find("track").bounding_box()
    console.page.mouse.click(track["x"] + 1, track["y"] + track["height"] / 2)
    console.wait("moment.stamp_ns", lambda stamp: stamp == first)
    assert console.find("past").is_visible()
    expect(console.find("mode")).to_have_text("PAUSED")
    console.find("play").click()
    console.wait("moment.stamp_ns", lambda stamp: int(first) < int(stamp) <= int(last))
    console.pause()


def test_a_link_leads_to_the_same_moment_and_zone(
    console: Console, context: BrowserContext, server: Server
) -> None:
    stamp = console.pause()
    other = open_console(context, server, "operator", console.link_to(stamp))
    assert other.wait("moment.stamp_ns", lambda shown: shown == stamp)
    assert other.state("selection") == console.state("selection")
    assert other.state("camera.zoom") == pytest.approx(console.state("camera.zoom"), abs=0.01)
    other.page.close()


def test_an_alert_is_acknowledged_by_its_operator(console: Console, server: Server) -> None:
    console.find("follow").click()
    console.find("alerts-button").click()
    row = console.page.locator(".alert:not(.done)").first
    alert = row.get_attribute("data-alert")
    row.locator('[data-test="acknowledge"]').click()
    console.page.locator(f'.alert.done[data-alert="{alert}"]').wait_for()
    kept = next(one for one in server.ask("/alerts")["alerts"] if one["id"] == alert)
    assert kept["acknowledged_by"] == "a-operator"
    console.page.keyboard.press("Escape")


def test_the_zones_leave_as_a_file(console: Console, tmp_path: Path) -> None:
    console.find("export-button").click()
    with console.page.expect_download() as started:
        console.page.locator('[data-export="geojson"]').click()
    file = tmp_path / started.value.suggested_filename
    started.value.save_as(file)
    features = json.loads(file.read_text())["features"]
    assert file.suffix == ".geojson"
    assert {feature["properties"]["id"] for feature in features} >= {"Z1", "Z2"}
    console.page.keyboard.press("Escape")


def test_an_operator_closes_ground_and_says_why(console: Console, server: Server) -> None:
    page = console.page
    page.keyboard.press("Escape")
    console.find("draw").click()
    box = console.find("map").bounding_box()
    for right, down in ((0.42, 0.45), (0.58, 0.45), (0.52, 0.6)):
        page.mouse.click(box["x"] + right * box["width"], box["y"] + down * box["height"])
    console.wait("drawing", lambda corners: len(corners) == 3)
    console.find("draw-done").click()
    dialog = console.find("reason-dialog")
    confirm = dialog.locator("button[type=submit]")
    assert confirm.is_disabled(), "no reason was given"
    dialog.locator("textarea").fill("ambulance at work")
    confirm.click()
    console.wait("selection", lambda chosen: chosen and chosen["kind"] == "zone")
    added = [zone for zone in server.ask("/zones")["zones"] if zone["kind"] == "operator"]
    assert [zone["operator"] for zone in added] == [{"name": "a-operator", "reason": "ambulance at work"}]
    console.find("zone-card").get_by_text("ambulance at work").first.wait_for()
    entry = server.ask("/audit")["entries"][0]
    assert (entry["user"], entry["action"], entry["reason"]) == ("a-operator", "add", "ambulance at work")


IS_COVERED = """([place, kind]) => {
  const on = document.elementFromPoint(...place);
  return on.tagName !== "CANVAS" && !on.closest(`.${kind}-label`);
}"""


def middle_of_a_label(console: Console, kind: str) -> tuple[float, float]:
    """Of one over which no banner or panel of the page lies."""
    for label in console.page.locator(f".{kind}-label span:visible").all():
        box = label.bounding_box()
        assert box is not None
        middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        if not console.page.evaluate(IS_COVERED, [middle, kind]):
            return middle
    raise AssertionError(f"no label of a {kind} is free")


def test_a_corner_is_set_where_a_label_stands(console: Console) -> None:
    """The label took the click: the outline lacked that corner, and closed less than was drawn."""
    console.pause()
    console.find("draw").click()
    for number, kind in enumerate(("zone", "drone"), start=1):
        console.page.mouse.click(*middle_of_a_label(console, kind))
        console.wait("drawing", lambda corners, number=number: len(corners) == number)
    console.page.keyboard.press("Escape")
    console.wait("drawing", lambda drawing: drawing is None)
    console.find("follow").click()


def test_a_viewer_sees_everything_and_changes_nothing(browser: Browser, server: Server) -> None:
    context = browser.new_context(viewport={"width": 1024, "height": 768}, color_scheme="light")
    viewer = open_console(context, server, "viewer")
    assert viewer.state("scene.role") == "viewer"
    assert viewer.find("draw").is_disabled()
    viewer.choose("Z1")
    assert viewer.find("lock").is_disabled() and viewer.find("dismiss").is_disabled()
    assert viewer.find("no-role").is_visible()
    # Whoever takes the page apart gets no further.
    answer = viewer.page.evaluate(
        """async () => (await fetch("/api/v1/zones/Z1/dismiss", {method: "POST", body: '{"reason": "none"}',
        headers: {"Content-Type": "application/json"}})).status"""
    )
    assert answer == 403
    with pytest.raises(urllib.error.HTTPError, match="403"):
        server.ask("/audit", role="viewer")
    context.close()


def test_an_upright_tablet_begins_with_the_map_and_lays_one_panel_over_it(
    browser: Browser, server: Server
) -> None:
    context = browser.new_context(viewport={"width": 768, "height": 1024}, reduced_motion="reduce")
    tablet = open_console(context, server, "viewer")
    tablet.wait("moment.zones.zones")

    def across(name: str) -> tuple[float, float]:
        box = tablet.find(name).bounding_box()
        return box["x"], box["x"] + box["width"]

    assert across("map") == (0, 768)
    assert len(np.unique(pixels(tablet).reshape(-1, 3) // 32, axis=0)) > 30, "the map is drawn"
    assert tablet.find("zones").is_visible() and not tablet.find("inspector").is_visible()
    tablet.page.keyboard.press("j")
    tablet.find("zone-card").wait_for()
    assert across("map") == (0, 768) and across("inspector") == (448, 768)
    tablet.page.keyboard.press("[")
    tablet.page.locator("[data-zone]").first.wait_for()
    assert not tablet.find("inspector").is_visible()
    tablet.page.locator("[data-zone]").first.click()
    tablet.find("zone-card").wait_for()
    assert tablet.page.locator("[data-zone]").count() == 0
    tablet.page.get_by_label("Close", exact=True).click()
    tablet.find("inspector").wait_for(state="detached")
    assert across("timeline") == (0, 768) and tablet.complaints == []
    context.close()


def test_every_button_above_the_map_and_of_drawing_is_on_a_phone(browser: Browser, server: Server) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 800}, reduced_motion="reduce")
    phone = open_console(context, server, "operator")
    phone.page.locator(".clock").wait_for()
    phone.find("draw").click()
    buttons = phone.page.locator(".top-bar button, .draw-bar button").all()
    assert len(buttons) == 5 + 3
    for button in buttons:
        box = button.bounding_box()
        assert box is not None and box["x"] >= 0 and box["x"] + box["width"] <= 390, button.inner_text()
    phone.page.get_by_label("Help").click()
    phone.find("panel-help").wait_for()
    context.close()


def test_on_a_phone_no_label_covers_another_and_the_surest_crowd_keeps_its_own(
    browser: Browser, server: Server
) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 844}, reduced_motion="reduce")
    phone = open_console(context, server, "operator")
    phone.pause()
    zones, drones = phone.state("moment.zones.zones"), phone.state("moment.drones")
    surest = max(zones, key=lambda zone: zone["probability_max"] or 0.0)
    for _ in range(4):  # until all of the mission is hardly larger than a label
        zoom = phone.state("camera.zoom")
        phone.page.get_by_label("Farther").click()
        phone.wait("camera.zoom", lambda now, before=zoom: now < before)
        phone.page.evaluate(THREE_FRAMES)
        shown = phone.page.evaluate(LABELS_SHOWN)
        assert any(text.startswith(surest["id"]) for text, *_ in shown)
        for number, (text, *box) in enumerate(shown):
            assert [other for other, *its in shown[:number] if overlap(box, its)] == [], text
    assert len(shown) < len(zones) + len(drones), "there is no room for all"
    context.close()


LABELS_SHOWN = """() => [...document.querySelectorAll(".label span")]
  .filter(one => one.checkVisibility({ visibilityProperty: true }))
  .map(one => [one, one.getBoundingClientRect()])
  .map(([one, box]) => [one.textContent, box.left, box.top, box.right, box.bottom])"""


def overlap(one: list[float], other: list[float]) -> bool:
    return all(one[low] < other[low + 2] and other[low] < one[low + 2] for low in (0, 1))


def test_it_comes_back_when_the_server_does(console: Console, server: Server) -> None:
    console.find("follow").click()
    server.kill()
    console.wait("connected", lambda connected: connected is False)
    console.find("offline").wait_for()
    expect(console.find("mode")).to_have_text("OFFLINE")
    assert console.state("moment.zones.zones"), "what was closed stays closed on the page"
    server.start()
    console.wait("connected")
    console.wait("moment.arrived", lambda arrived: arrived is not None)
    console.find("offline").wait_for(state="hidden")
    stamp = int(server.ask("/zones")["stamp_ns"])
    console.wait("moment.stamp_ns", lambda shown: int(shown) >= stamp)
