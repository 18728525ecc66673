"""Zones of others come to the page once, and every moment shows them."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Request, WebSocket

from support.live_field import give_views, live_field
from support.map_page import Console, Server
from support.served import ORIGIN


def hospital(folder: Path) -> str:
    """A file with a zone of 20 m near the origin."""
    latitude, longitude = (float(word) for word in ORIGIN.split(",")[:2])
    half = 1e-4
    corners = [
        [longitude + east * half, latitude + north * half] for east, north in ((0, 0), (1, 0), (1, 1), (0, 0))
    ]
    zone = {
        "type": "Feature",
        "properties": {"id": "HOSP"},
        "geometry": {"type": "Polygon", "coordinates": [corners]},
    }
    path = folder / "hospital.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [zone]}))
    return str(path)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("field")
    with live_field(folder, "--static-zones", hospital(folder)) as server:
        give_views(server, ["uav1"], count=3, every_s=0.4)
        yield server


def test_a_moment_has_those_that_the_page_was_told_before(console: Console, server: Server) -> None:
    steps: list[list[str]] = []
    whole: list[str] = []

    def hear(text: str | bytes) -> None:
        told = json.loads(text)
        if told["type"] == "step":
            steps.append([zone["id"] for zone in told["zones"]["zones"]])

    def listen(socket: WebSocket) -> None:
        socket.on("framereceived", hear)

    def ask(request: Request) -> None:
        path = request.url.split("/api/v1")[-1]
        if path.startswith("/zones") and "without_static" not in path:
            whole.append(path)

    console.page.on("websocket", listen)
    console.page.on("request", ask)
    console.page.reload()
    console.page.locator('[data-zone="HOSP"]').wait_for()
    first = console.state("moment.stamp_ns")
    give_views(server, ["uav1"], count=3, every_s=0.4)
    console.wait("moment.stamp_ns", lambda stamp: int(stamp) > int(first))
    assert console.page.locator('[data-zone="HOSP"]').count() == 1
    console.rewind()
    assert console.page.locator('[data-zone="HOSP"]').count() == 1
    assert len(steps) > 1 and not any("HOSP" in step for step in steps)
    assert len(whole) == 1, whole
