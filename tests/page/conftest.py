"""The real server on the bundled mission, and a browser with software GL."""

import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, BrowserContext, sync_playwright

from support.map_page import Console, Server, open_console

# Chrome draws WebGL without a graphics card only when told so.
SOFTWARE_GL = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)


def _free_port() -> int:
    with socket.socket() as any_port:
        any_port.bind(("127.0.0.1", 0))
        return int(any_port.getsockname()[1])


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    tokens = tmp_path_factory.mktemp("page") / "tokens.json"
    server = Server(tokens, _free_port())  # known beforehand, so that it can be started there again
    if "CROWDFENCE_PICTURE" in os.environ:
        # The picture in the documentation is of the whole mission, with the shipped detector.
        server.detector, server.speed = "auto", "1"
    for role in ("viewer", "operator"):
        command = [sys.executable, "-m", "crowdfence", "token", "add", f"a-{role}", "--role", role, "--json"]
        made = subprocess.run([*command, "--tokens", str(tokens)], capture_output=True, text=True, check=True)
        server.token[role] = json.loads(made.stdout)["token"]
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
    context = browser.new_context(viewport={"width": 1280, "height": 720}, color_scheme="dark")
    yield context
    context.close()


@pytest.fixture(scope="module")
def console(context: BrowserContext, server: Server) -> Console:
    """An operator's."""
    return open_console(context, server, "operator")
