"""`crowdfence serve` as a process, and its page as somebody sits before it."""

import json
import signal
import socket
import subprocess
import sys
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from playwright.sync_api import BrowserContext, Page

import crowdfence

RECORDING = Path(crowdfence.__file__).parent / "demo_data" / "race.mcap"


# Chrome draws WebGL without a graphics card only when told so.
SOFTWARE_GL = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)


def replay(detector: str, speed: str) -> list[str]:
    """The bundled mission."""
    buffer = ["--buffer", "fixed:distance_m=5"]
    return [str(RECORDING), "--detector", detector, "--replay-speed", speed, *buffer]


def free_port() -> int:
    with socket.socket() as any_port:
        any_port.bind(("127.0.0.1", 0))
        return int(any_port.getsockname()[1])


@dataclass
class Server:
    """`crowdfence serve` as a process of its own."""

    tokens: Path
    port: int = 0
    url: str = ""
    token: dict[str, str] = field(default_factory=dict)
    """By role."""
    process: "subprocess.Popen[str] | None" = None
    mission: list[str] = field(default_factory=list)
    """What is served, as words of the command."""

    def admit(self, role: str) -> None:
        """A token for somebody of this role."""
        command = [sys.executable, "-m", "crowdfence", "token", "add", f"a-{role}", "--role", role, "--json"]
        made = subprocess.run(
            [*command, "--tokens", str(self.tokens)], capture_output=True, text=True, check=True
        )
        self.token[role] = json.loads(made.stdout)["token"]

    def start(self) -> None:
        command = [sys.executable, "-m", "crowdfence", "serve", *self.mission, "--json"]
        command += ["--port", str(self.port), "--tokens", str(self.tokens)]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True
        )
        said = ""
        assert self.process.stdout is not None
        while not said.rstrip().endswith("}"):
            line = self.process.stdout.readline()
            assert line, "the server ended before it listened"
            said += line
        self.url = json.loads(said)["url"].rstrip("/")

    def kill(self) -> None:
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()

    def ask(self, path: str, role: str = "operator", body: Any = None) -> Any:
        """What the interface answers beside the page."""
        request = urllib.request.Request(
            f"{self.url}/api/v1{path}",
            data=None if body is None else json.dumps(body).encode(),
            headers={"Authorization": f"Bearer {self.token[role]}", "Content-Type": "application/json"},
        )
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.load(answer)


THREE_FRAMES = """() => new Promise(shown => {
  let left = 3;
  const next = () => (left-- > 0 ? requestAnimationFrame(next) : shown());
  next();
})"""


@dataclass
class Console:
    """The page as somebody sits before it, and what a browser would tell its developer."""

    page: Page
    server: Server
    complaints: list[str] = field(default_factory=list)
    hosts: set[str] = field(default_factory=set)

    def hear(self, level: str, text: str) -> None:
        """What the browser tells its developer."""
        if level in ("error", "warning"):
            self.complaints.append(text)

    def state(self, path: str) -> Any:
        """A value of the page's state, such as `moment.stamp_ns`."""
        return self.page.evaluate(
            "path => path.split('.').reduce((one, name) => one?.[name], window.__crowdfence?.state) ?? null",
            path,
        )

    def wait(self, path: str, holds: Any = lambda value: bool(value)) -> Any:
        """Its value once it is as wanted. The content security policy keeps the browser from waiting for
        an expression by itself."""
        for _ in range(600):
            value = self.state(path)
            if holds(value):
                return value
            self.page.wait_for_timeout(150)
        raise AssertionError(f"{path} is still {value!r}")

    def find(self, name: str) -> Any:
        return self.page.locator(f'[data-test="{name}"]')

    def pause(self) -> str:
        """Stays one instant before the moment shown; its stamp, once the map shows it."""
        self.page.keyboard.press("ArrowLeft")
        stamp = str(self.state("time.stamp_ns"))
        return str(self.wait("moment.stamp_ns", lambda shown: shown == stamp))

    def rewind(self) -> None:
        """Stays at the first instant of the mission, once the map shows it."""
        stamp = ""
        while stamp != (stamp := self.pause()):
            pass
        self.wait("belief.stamp_ns", lambda shown: shown == stamp)
        self.page.evaluate(THREE_FRAMES)

    def link_to(self, stamp: str) -> str:
        """What follows the address of the page, once it names the moment."""
        for _ in range(600):
            link = str(self.page.evaluate("location.hash"))
            if f"t={stamp}" in link:
                return link
            self.page.wait_for_timeout(150)
        raise AssertionError(f"the address is still {link!r}")

    def drawn(self, after: int) -> None:
        """Until the ground was painted once more than `after` times (`drapes`) and the map has shown it,
        however busy the machine is."""
        self.wait("drapes", lambda drapes: drapes > after)
        self.page.evaluate(THREE_FRAMES)

    def choose(self, zone: str) -> None:
        self.page.locator(f'[data-zone="{zone}"]').click()
        self.find("zone-card").wait_for()


def open_console(context: BrowserContext, server: Server, role: str, after: str = "") -> Console:
    console = Console(context.new_page(), server)
    page = console.page
    page.on("console", lambda said: console.hear(said.type, said.text))
    page.on("pageerror", lambda error: console.complaints.append(str(error)))
    page.on("request", lambda request: console.hosts.add(request.url.split("/")[2]))
    page.set_default_timeout(90_000)
    page.goto(f"{server.url}/?token={server.token[role]}", wait_until="commit")
    if after:
        page.goto(f"{server.url}/{after}", wait_until="commit")
    console.wait("drapes")
    console.wait("belief")
    return console
