"""The page while a fleet flies: a live service, drones that give views as they take them, and a base map.

The tests go through one flight, in their order.
"""

import io
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import rasterio
from PIL import Image
from playwright.sync_api import APIResponse, Browser, BrowserContext, Route, expect

from crowdfence import Camera, Client, Georeference, View
from crowdfence.service.client import ServiceError
from support.map_page import Console, Server, free_port, open_console
from support.small_service import SIDE_M, heatmap, pose
from support.tile_archive import Box, write_pictures

ANCHOR = Georeference(46.5, 8.0, 1200.0)
EVERY_S = 1.0
CAMERA = Camera.pinhole(320, 240, 240.0, 240.0, 160.0, 120.0)
"""The field of view of `support.small_service`, in finer pixels: one drone alone is sure of what it sees."""
MAGENTA = (20.0, 20.0, 40.0, 40.0)
"""West, south, east, north in local metres: what the base map shows there."""
SIDE_OF_THE_GROUND = (156, 162, 166)
"""As the light palette has it (`skirt`)."""


class Fleet(threading.Thread):
    """Two drones that hover, side by side, and give a view a second, also to a service that is
    away for a while."""

    def __init__(self, server: Server) -> None:
        super().__init__(daemon=True)
        self.server = server
        self.flying = {"uav1", "uav2"}
        self.crowd = False
        self.landed = threading.Event()

    def run(self) -> None:
        with Client(self.server.url, token=self.server.token["operator"]) as client:
            while not self.landed.wait(EVERY_S):
                for drone in sorted(self.flying):
                    there = self.crowd & (heatmap(drone, 0.0) > 0.5)
                    values = np.where(there, 0.9, 0.0).astype(np.float32)  # sure of both
                    taken = View(drone, time.time_ns(), CAMERA, pose(drone, 0.0), values)
                    try:
                        client.give(taken)
                    except (httpx.TransportError, ServiceError):  # the next view is as good
                        continue


def degrees(box: Box) -> Box:
    """Of a box in local metres."""
    west, south, east, north = box
    latitude, longitude, _ = ANCHOR.geodetic_from_local([[west, south, 0.0], [east, north, 0.0]])
    return float(longitude[0]), float(latitude[0]), float(longitude[1]), float(latitude[1])


def write_plain(path: Path) -> None:
    """Level ground at the height of the anchor, the anchor in its south-west corner."""
    crs = "+proj=aeqd +lat_0=46.5 +lon_0=8 +datum=WGS84"
    transform = rasterio.transform.from_origin(0.0, SIDE_M, 1.0, 1.0)
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": crs, "transform": transform}
    with rasterio.open(path, "w", width=SIDE_M, height=SIDE_M, **profile) as raster:
        raster.write(np.full((SIDE_M, SIDE_M), 1200.0, np.float32), 1)


def write_base_map(path: Path) -> None:
    """Grey, and magenta in one box."""
    west, south, east, north = degrees(MAGENTA)

    def colour(latitude: np.ndarray, longitude: np.ndarray) -> np.ndarray:
        inside = (latitude > south) & (latitude < north) & (longitude > west) & (longitude < east)
        return np.where(inside[..., None], (240, 20, 240), (120, 120, 120)).astype(np.uint8)

    write_pictures(path, degrees((-200.0, -200.0, 260.0, 260.0)), 18, colour)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("field")
    write_plain(folder / "dem.tif")
    write_base_map(folder / "base.pmtiles")
    server = Server(folder / "tokens.json", free_port())
    server.mission = ["--terrain", str(folder / "dem.tif"), "--origin", "46.5,8.0,1200"]
    server.mission += ["--data", str(folder / "live"), "--name", "meadow", "--silent-after-s", "3"]
    server.mission += ["--drone", "uav1", "--drone", "uav2", "--buffer", "fixed:distance_m=3"]
    server.mission += ["--stale-after-s", "10"]
    server.mission += ["--base-map", str(folder / "base.pmtiles")]
    server.admit("operator")
    server.start()
    yield server
    server.kill()


@pytest.fixture(scope="module")
def fleet(server: Server) -> Iterator[Fleet]:
    fleet = Fleet(server)
    fleet.start()
    yield fleet
    fleet.landed.set()
    fleet.join()


@pytest.fixture(scope="module")
def context(browser: Browser) -> Iterator[BrowserContext]:
    context = browser.new_context(
        viewport={"width": 1280, "height": 720}, color_scheme="light", reduced_motion="reduce"
    )
    yield context
    context.close()


@pytest.fixture(scope="module")
def console(context: BrowserContext, server: Server, fleet: Fleet) -> Console:
    return open_console(context, server, "operator")


def keep(console: Console, name: str) -> None:
    """`make page-picture` takes it into the documentation."""
    if "CROWDFENCE_PICTURE" in os.environ:
        picture = Image.open(io.BytesIO(console.page.screenshot())).convert("RGB")
        file = Path(os.environ["CROWDFENCE_PICTURE"]).with_name(name)
        picture.quantize(256, kmeans=3, dither=Image.Dither.NONE).save(file, optimize=True)


def test_views_arrive_as_they_are_taken(console: Console) -> None:
    assert console.state("mode") == "live"
    expect(console.find("mode")).to_have_text("LIVE")
    first = int(console.state("moment.stamp_ns"))
    console.wait("moment.stamp_ns", lambda stamp: int(stamp) > first + 1_000_000_000)
    expect(console.find("drones")).to_have_text("2/2")
    assert console.state("moment.zones.zones") == []
    console.page.get_by_text("No zone is closed.").wait_for()


def test_a_crowd_that_gathers_becomes_a_zone(console: Console, fleet: Fleet, server: Server) -> None:
    fleet.crowd = True
    zones = console.wait("moment.zones.zones")
    console.choose(zones[0]["id"])
    console.find("why").get_by_text("A drone saw crowd in it").wait_for()
    assert "uav" in console.find("zone-card").locator("tbody").inner_text()
    told = [alert for alert in server.ask("/alerts")["alerts"] if alert["kind"] == "new_zone"]
    assert {alert["zone"] for alert in told} >= {zones[0]["id"]}


def test_what_is_dismissed_is_what_was_looked_at(console: Console) -> None:
    """While the reason is written the mission goes on, and crowd may come to the zone."""
    page, sent = console.page, []

    def refuse(route: Route) -> None:
        sent.append(route.request.post_data_json)
        route.fulfill(status=409, json={"detail": "look again"})

    page.route("**/zones/*/dismiss", refuse)
    before = int(console.state("moment.stamp_ns"))
    console.find("dismiss").click()
    dialog = console.find("reason-dialog")
    dialog.locator("textarea").wait_for()
    clicked = int(console.state("moment.stamp_ns"))
    console.wait("moment.stamp_ns", lambda stamp: int(stamp) > clicked + 1_000_000_000)
    dialog.locator("textarea").fill("two cars")
    dialog.locator("button[type=submit]").click()
    dialog.get_by_text("look again").wait_for()
    (told,) = sent
    assert told["reason"] == "two cars" and before <= int(told["seen_ns"]) <= clicked
    dialog.get_by_text("Cancel").click()
    page.unroute("**/zones/*/dismiss")
    console.complaints.clear()


def test_an_address_that_is_given_while_the_page_writes_its_own_is_followed(console: Console) -> None:
    """A change is due to be written when somebody opens a link: the page must not write over it."""
    console.wait("camera.target")
    for east in (31.0, 32.0, 33.0):
        console.page.evaluate(
            """east => {
                document.querySelector('[data-layer="tracks"]').click();
                const begun = performance.now();
                while (performance.now() - begun < 500);
                location.hash = `#view=${east},30,0,4,90,0`;
            }""",
            east,
        )
        console.wait("camera.target", lambda target, east=east: target[:2] == [east, 30.0])


def test_the_base_map_lies_where_its_coordinates_say(console: Console) -> None:
    """Straight down on places inside and outside of what it shows in magenta."""
    console.wait("attribution")
    console.page.get_by_text("Somebody").wait_for()
    for layer in ("belief", "zones", "walls", "tracks", "footprints", "labels"):
        console.page.locator(f'[data-layer="{layer}"]').click()

    def magenta(east: float, north: float) -> bool:
        console.page.evaluate(f"location.hash = '#view={east},{north},0,4,90,0'")
        console.wait("camera.target", lambda target: target[:2] == [east, north])
        console.drawn(console.state("drapes") + 1)  # a fleet that flies has the ground painted every second
        picture = Image.open(io.BytesIO(console.find("map").screenshot())).convert("RGB")
        middle = np.asarray(picture).astype(int)
        middle = middle[middle.shape[0] // 2 - 12 :, middle.shape[1] // 2 - 12 :][:24, :24].reshape(-1, 3)
        red, green, blue = middle.mean(axis=0)
        return bool(red > green + 15 and blue > green + 15)

    # Inside and outside of two of its corners, a metre and a half from both sides.
    west, south, east, north = MAGENTA
    assert magenta(west + 1.5, south + 1.5) and not magenta(west - 1.5, south - 1.5)
    assert magenta(east - 1.5, north - 1.5) and not magenta(east + 1.5, north + 1.5)
    console.page.locator('[data-layer="base"]').click()
    assert not magenta(30.0, 30.0)
    for layer in ("base", "belief", "zones", "walls", "tracks", "footprints", "labels"):
        console.page.locator(f'[data-layer="{layer}"]').click()
    console.page.keyboard.press("Home")
    assert console.complaints == []
    assert console.hosts == {console.server.url.removeprefix("http://")}


def test_colours_of_the_map_are_those_of_the_page(console: Console) -> None:
    """They were lit by lamps that nobody had set up: the map was a third darker than its legend."""
    home = console.state("camera.target")
    console.page.evaluate("location.hash = '#view=30,30,0,2,10,0'")  # a low look at the side of the ground
    console.wait("camera.target", lambda target: target != home)
    console.drawn(console.state("drapes") + 1)
    picture = Image.open(io.BytesIO(console.find("map").screenshot())).convert("RGB")
    side = (np.asarray(picture) == SIDE_OF_THE_GROUND).all(axis=-1)
    console.page.keyboard.press("Home")
    assert side.mean() > 0.01


def test_a_drone_that_falls_silent_is_an_alarm(console: Console, fleet: Fleet, server: Server) -> None:
    closed = {zone["id"] for zone in console.state("moment.zones.zones")}
    fleet.flying = {"uav1"}
    silent = console.wait("alerts", lambda alerts: open_alerts(alerts, "drone_silent"))
    alert = open_alerts(silent, "drone_silent")[0]
    assert (alert["drone"], alert["level"]) == ("uav2", "alarm")
    console.page.locator(".drone-row .stale", has_text="uav2").get_by_text("silent").wait_for()
    expect(console.find("drones")).to_have_text("1/2")  # the other one may be late too, on a busy machine
    # What somebody else acknowledges leaves this page too, and the banner is for what is left.
    for other in server.ask("/alerts")["alerts"]:
        if other["kind"] != "drone_silent":
            server.ask(f"/alerts/{other['id']}/acknowledge", body={})
    banner = console.page.locator(".banner.alarm", has_text="no view from uav2")
    banner.wait_for()
    keep(console, "page-live.png")
    assert closed <= {zone["id"] for zone in console.state("moment.zones.zones")}, "silence opens nothing"
    fleet.flying = {"uav1", "uav2"}
    banner.wait_for(state="detached")


def open_alerts(alerts: list[dict[str, Any]], kind: str) -> list[dict[str, Any]]:
    return [one for one in alerts if one["kind"] == kind and one["cleared_ms"] is None]


def test_it_goes_on_after_the_server_was_killed(console: Console, server: Server) -> None:
    before = {zone["id"] for zone in console.state("moment.zones.zones")}
    server.kill()
    console.wait("connected", lambda connected: connected is False)
    console.find("offline").wait_for()
    stopped = int(console.state("moment.stamp_ns"))
    server.start()
    console.wait("connected")
    console.wait("moment.stamp_ns", lambda stamp: int(stamp) > stopped + 1_000_000_000)
    console.find("offline").wait_for(state="hidden")
    assert before <= {zone["id"] for zone in console.state("moment.zones.zones")}
    expect(console.find("mode")).to_have_text("LIVE")


def test_silence_makes_everything_old_also_for_who_comes_later(
    console: Console, context: BrowserContext, fleet: Fleet, server: Server
) -> None:
    closed = {zone["id"] for zone in console.state("moment.zones.zones")}
    console.page.keyboard.press("Escape")
    for _ in range(300):  # the map from above comes after the moment
        if ground(console, "seen, empty") != "0 m²":
            break
        console.page.wait_for_timeout(150)
    assert ground(console, "seen, empty") != "0 m²"
    fleet.flying = set()
    console.wait("older_s", lambda older: older >= 11)
    for one in (console, open_console(context, server, "operator")):
        expect(one.find("mode")).to_have_text("NO DATA")
        expect(one.find("drones")).to_have_text("0/2")
        one.page.get_by_text("No view has arrived for").wait_for()
        hours, minutes, seconds = (int(part) for part in clock(one).split(":"))
        behind_s = (time.time() - 3600 * hours - 60 * minutes - seconds) % 86_400
        assert min(behind_s, 86_400 - behind_s) < 5.0, "the clock is that of now"
        assert closed <= {zone["id"] for zone in one.state("moment.zones.zones")}
        one.page.keyboard.press("Escape")
        assert ground(one, "seen, empty") == "0 m²" and ground(one, "too long ago") != "0 m²"


def ground(console: Console, state: str) -> str:
    """Its area, on the card of the mission."""
    row = console.page.locator(".areas li", has_text=state)
    return str(row.locator("b").inner_text())


def clock(console: Console) -> str:
    return str(console.page.locator(".clock b").inner_text())


def test_an_alarm_that_is_raised_while_the_page_loads_is_on_it(
    context: BrowserContext, server: Server, fleet: Fleet
) -> None:
    """Between the answer with the alerts there are and the stream with those to come."""
    loading = Console(context.new_page(), server)
    held: list[Route] = []
    loading.page.route("**/api/v1/terrain*", lambda route: held.append(route))
    with loading.page.expect_response("**/api/v1/alerts"):
        loading.page.goto(f"{server.url}/?token={server.token['operator']}", wait_until="commit")
    while not held:
        loading.page.wait_for_timeout(50)
    with Client(server.url, token=server.token["operator"]) as client:
        stamp_ns = time.time_ns() - 3_600_000_000_000
        with pytest.raises(ServiceError, match="behind the clock of the service"):
            client.give(View("uav9", stamp_ns, CAMERA, pose("uav1", 0.0), np.zeros((2, 2), np.float32)))
    held[0].continue_()
    loading.wait("alerts", lambda alerts: any(one["drone"] == "uav9" for one in alerts or []))
    loading.page.close()


def test_an_alarm_that_is_raised_while_alerts_are_asked_for_stays(
    context: BrowserContext, server: Server, fleet: Fleet
) -> None:
    """The stream told it before an older answer came, which was taken for all there are."""
    page = open_console(context, server, "operator")
    with Client(server.url, token=server.token["operator"]) as client:

        def clock_is_wrong(drone: str) -> None:
            stamp_ns = time.time_ns() - 3_600_000_000_000
            with pytest.raises(ServiceError, match="behind the clock of the service"):
                client.give(View(drone, stamp_ns, CAMERA, pose("uav1", 0.0), np.zeros((2, 2), np.float32)))
            page.wait("alerts", lambda alerts: any(one["drone"] == drone for one in alerts or []))

        clock_is_wrong("uav7")
        held: list[tuple[Route, APIResponse]] = []
        page.page.route("**/api/v1/alerts", lambda route: held.append((route, route.fetch())))
        page.page.locator(".banner.alarm").get_by_role("button", name="Acknowledge").first.click()
        while not held:
            page.page.wait_for_timeout(50)
        clock_is_wrong("uav8")
        ((route, answer),) = held
        with page.page.expect_response("**/api/v1/alerts"):
            route.fulfill(response=answer)
        page.page.wait_for_timeout(300)
        assert {"uav7", "uav8"} <= {one["drone"] for one in page.state("alerts")}
        ticks = {one["id"] for one in page.state("timeline.alerts")}
        assert {one["id"] for one in page.state("alerts")} <= ticks
    page.page.close()
