"""The real server on the bundled mission, and a browser with software GL."""

import os
import shutil
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, BrowserContext, sync_playwright

from support.map_page import SOFTWARE_GL, Console, Server, free_port, open_console, replay
from support.near_ground import write_near_ground


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """One for each file: how far its mission is must not depend on the files before."""
    tokens = tmp_path_factory.mktemp("page") / "tokens.json"
    server = Server(tokens, free_port())  # known beforehand, so that it can be started there again
    near = ["--terrain", str(write_near_ground(tokens.parent))]
    server.mission = [*replay("recorded", "0.03"), *near]  # slow: still going on when the page has loaded
    if "CROWDFENCE_PICTURE" in os.environ:
        # The picture in the documentation is of the whole mission, with the shipped detector.
        server.mission = replay("auto", "1")
    server.admit("viewer")
    server.admit("operator")
    server.start()
    yield server
    server.kill()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
    assert chromium, "no chromium: `make chromium` installs it"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=list(SOFTWARE_GL))
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def context(browser: Browser) -> Iterator[BrowserContext]:
    context = browser.new_context(
        viewport={"width": 1280, "height": 720}, color_scheme="dark", reduced_motion="reduce"
    )
    yield context
    context.close()


@pytest.fixture(scope="module")
def console(context: BrowserContext, server: Server) -> Console:
    """An operator's."""
    return open_console(context, server, "operator")
