"""Ground that an operator closes while the page shows the past."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Route

from support.live_field import give_views, live_field
from support.map_page import Console, Server


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with live_field(tmp_path_factory.mktemp("field")) as server:
        give_views(server, ["uav1"], count=4, every_s=0.4)
        yield server


def test_what_was_closed_in_the_past_is_shown_as_closed(console: Console, server: Server) -> None:
    console.pause()
    page = console.page
    page.keyboard.press("d")
    for k, (x, y) in enumerate([(400, 300), (520, 300), (520, 400), (400, 400)]):
        page.mouse.click(x, y)
        console.wait("drawing", lambda drawing, k=k: len(drawing) == k + 1)
    page.keyboard.press("Enter")
    page.locator("dialog textarea").fill("a stage is being set up")
    page.locator("dialog").get_by_role("button", name="Close").click()
    console.find("why").get_by_text("a stage is being set up").wait_for()
    assert console.find("mode").inner_text() != "PAUSED" and console.state("time.following")
    drawn = [zone["id"] for zone in server.ask("/zones")["zones"] if zone["kind"] == "operator"]
    assert len(drawn) == 1 and console.state("selection") == {"kind": "zone", "id": drawn[0]}
    console.page.locator(f'[data-zone="{drawn[0]}"]').wait_for()


def test_ground_is_closed_to_all_flight_unless_the_operator_says_otherwise_of_this_very_ground(
    console: Console, server: Server
) -> None:
    """The choice for the ground before stood there still: the next was closed to sustained flight alone."""
    page = console.page
    for number, restriction in enumerate(["no_sustained_flight", None]):
        page.keyboard.press("d")
        for k, (x, y) in enumerate([(400, 320), (520, 320), (520, 420)]):
            page.mouse.click(x, y + 40 * number)
            console.wait("drawing", lambda drawing, k=k: len(drawing) == k + 1)
        page.keyboard.press("Enter")
        if restriction is not None:
            page.locator("dialog select").select_option(restriction)
        page.locator("dialog textarea").fill(f"number {number}")
        page.locator("dialog").get_by_role("button", name="Close").click()
        console.find("why").get_by_text(f"number {number}").wait_for()
    zones = server.ask("/zones")["zones"]
    told = {zone["operator"]["reason"]: zone["restriction"] for zone in zones if zone["kind"] == "operator"}
    assert (told["number 0"], told["number 1"]) == ("no_sustained_flight", "prohibited")


def test_what_is_cancelled_after_it_was_sent_is_told_and_closes_no_other_question(
    console: Console, server: Server
) -> None:
    """The service did it, seconds later, and its answer shut the dialog that stood there by then."""
    page = console.page
    held: list[Route] = []
    page.route("**/api/v1/zones", lambda route: route.continue_() if held else held.append(route))
    _draw_at(console, 300)
    page.locator("dialog textarea").fill("first")
    page.locator("dialog").get_by_role("button", name="Close").click()
    while not held:
        page.wait_for_timeout(50)
    page.locator("dialog").get_by_role("button", name="Cancel").click()
    page.get_by_text("Close this ground: it was sent already, and may still be done.").wait_for()
    _draw_at(console, 420)
    page.locator("dialog textarea").fill("second")
    held[0].continue_()
    while "first" not in (drawn := _drawn(server)):
        page.wait_for_timeout(50)
    page.get_by_text(f"{drawn['first']} is closed.").wait_for()
    assert page.locator("dialog textarea").input_value() == "second"
    page.locator("dialog").get_by_role("button", name="Close").click()
    console.find("why").get_by_text("second").wait_for()
    assert {"first", "second"} <= _drawn(server).keys()


def _drawn(server: Server) -> dict[str, str]:
    """Zones that operators drew, by why they did."""
    zones = server.ask("/zones")["zones"]
    return {zone["operator"]["reason"]: zone["id"] for zone in zones if zone["operator"]}


def _draw_at(console: Console, top: int) -> None:
    """A triangle, and the question that it ends in."""
    console.page.keyboard.press("d")
    for k, (x, y) in enumerate([(420, top), (500, top), (500, top + 60)]):
        console.page.mouse.click(x, y)
        console.wait("drawing", lambda drawing, k=k: len(drawing) == k + 1)
    console.page.keyboard.press("Enter")
