"""Somebody without a mouse: a key on what has the focus does what browsers do there, and nothing else."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from support.map_page import Console, Server, open_console


@pytest.fixture(scope="module")
def console(browser: Browser, server: Server) -> Iterator[Console]:
    context = browser.new_context(viewport={"width": 1280, "height": 720}, reduced_motion="reduce")
    yield open_console(context, server, "viewer")
    context.close()


def test_space_ticks_a_layer_and_the_page_stays_at_the_newest_moment(console: Console) -> None:
    console.page.locator('[data-layer="walls"]').focus()
    console.page.keyboard.press(" ")
    console.wait("layers.walls", lambda shown: shown is False)
    assert console.state("time.following")
    console.page.keyboard.press(" ")
    console.wait("layers.walls")


def test_arrows_move_a_slider_and_the_page_stays_at_the_newest_moment(console: Console) -> None:
    console.page.get_by_label("Strength").focus()
    console.page.keyboard.press("ArrowLeft")
    console.wait("strength", lambda strength: strength < 1)
    console.page.keyboard.press("ArrowRight")
    console.wait("strength", lambda strength: strength == 1)
    assert console.state("time.following")


def test_enter_downloads_the_zones(console: Console) -> None:
    console.page.keyboard.press("e")
    console.page.locator('[data-export="geojson"]').focus()
    with console.page.expect_download(timeout=20_000) as started:
        console.page.keyboard.press("Enter")
    assert started.value.suggested_filename.endswith(".geojson")
    console.page.keyboard.press("Escape")


def test_a_key_of_the_page_works_wherever_the_focus_is(console: Console) -> None:
    console.page.locator('[data-layer="walls"]').focus()
    console.page.keyboard.press("ArrowLeft")
    console.wait("time.following", lambda following: following is False)
    console.page.keyboard.press("l")
    console.wait("time.following")
