"""A small fleet over a plain with two crowds, as views, as a recording, and in a running service."""

import base64
import io
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from starlette.testclient import TestClient

from crowdfence import Camera, Client, Terrain, View
from crowdfence.config import EvidenceConfig, GroupingConfig, ProjectionConfig, RunConfig, ZoneConfig
from crowdfence.service.app import make_app
from crowdfence.service.client import ViewMessage
from crowdfence.service.opening import live
from crowdfence.service.service import Service
from crowdfence.service.settings import ServiceSettings
from crowdfence.service.view_message import CameraMessage, HeatmapMessage
from crowdfence.sources.recording import Frame, PixelSources, Recording

SECOND_NS = 1_000_000_000
START_NS = 1_760_000_000 * SECOND_NS
SIDE_M = 60
CAMERA = Camera.pinhole(16, 12, 12.0, 12.0, 8.0, 6.0)
DRONES = ("uav1", "uav2", "uav3")
CROWDS = ((20.0, 22.0, 5.0), (42.0, 35.0, 4.0))
"""East, north and radius; the second one leaves after 2 s."""
CONFIG = RunConfig(
    EvidenceConfig(memory_s=3.0),
    ProjectionConfig(max_range_m=80.0),
    GroupingConfig(tolerance_ms=60.0),
    ZoneConfig(min_area_m2=3.0, buffer_m=1.5, simplify_m=0.5),
)
SETTINGS = ServiceSettings(
    clock="views",
    # However slow the machine that the tests run on.
    quiet_s=600.0,
    snapshot_every=7,
    views_per_s=10_000.0,
    requests_per_s=100_000.0,
    waiting_per_drone=1000,
    turn_within_s=600.0,
)


def plain() -> Terrain:
    return Terrain.from_height_map(np.zeros((SIDE_M, SIDE_M)), cell_size_m=1.0)


def pose(drone: str, t: float) -> NDArray[np.float64]:
    """18 m up, straight down, moving slowly."""
    number = DRONES.index(drone) if drone in DRONES else 3
    east, north = 14.0 + 12.0 * number + 2.0 * t, 20.0 + 6.0 * number + 1.5 * np.sin(t + number)
    world_from_camera = np.diag([1.0, -1.0, -1.0, 1.0])
    world_from_camera[:3, 3] = (east, north, 18.0)
    return world_from_camera


def heatmap(drone: str, t: float) -> NDArray[np.float32]:
    """[12, 16]: the crowds that it has below it, and a little noise."""
    eye = pose(drone, t)[:3, 3]
    u, v = np.meshgrid(np.arange(16) + 0.5, np.arange(12) + 0.5)
    east, north = eye[0] + (u - 8.0) / 12.0 * eye[2], eye[1] - (v - 6.0) / 12.0 * eye[2]
    noise = np.random.default_rng([round(t * 1000), len(drone), ord(drone[-1])]).uniform(0.0, 0.2, (12, 16))
    here = np.zeros((12, 16), bool)
    for number, (x, y, radius) in enumerate(CROWDS):
        if number == 0 or t < 2.0:
            here |= (east - x) ** 2 + (north - y) ** 2 < radius**2
    return np.where(here, 0.95 - noise / 4, noise).astype(np.float32)


def stamp_ns(drone: str, number: int) -> int:
    """Five a second, the drones some milliseconds apart."""
    return START_NS + number * 200_000_000 + 17_000_000 * DRONES.index(drone) + 1234


def view(drone: str, number: int) -> View:
    t = number * 0.2
    return View(drone, stamp_ns(drone, number), CAMERA, pose(drone, t), heatmap(drone, t))


def sharp(one: View, *, blind: bool = False) -> View:
    """The view of a camera with ten times the pixels, as its detector gives every tenth; a blind one shows
    nobody."""
    camera = Camera.pinhole(160, 120, 120.0, 120.0, 80.0, 60.0)
    shown = np.zeros_like(one.heatmap) if blind else one.heatmap
    return View(one.drone, one.stamp_ns, camera, one.world_from_camera, shown)


def views(instants: int = 15, drones: Sequence[str] = DRONES) -> list[View]:
    """In the order of their stamps."""
    return [view(drone, number) for number in range(instants) for drone in drones]


def message(one: View) -> bytes:
    """The view as the service takes it."""
    return _message(one, heatmap=HeatmapMessage.of(one.heatmap))


def picture_message(one: View) -> bytes:
    """The picture of a sharp view as the service takes it."""
    return _message(one, image=base64.b64encode(photograph(one)).decode())


def _message(one: View, **shown: Any) -> bytes:
    camera, pose = CameraMessage.of(one.camera), one.world_from_camera.tolist()
    message = ViewMessage(
        drone=one.drone, stamp_ns=one.stamp_ns, camera=camera, world_from_camera=pose, **shown
    )
    return message.model_dump_json().encode()


def photograph(one: View) -> bytes:
    """PNG of a sharp view, as red as its heatmap is high, ten pixels a cell; the green tells pictures
    apart."""
    pixels = np.zeros((120, 160, 3), np.uint8)
    pixels[..., 0] = np.rint(np.kron(one.heatmap, np.ones((10, 10))) * 255.0)
    pixels[..., 1] = np.random.default_rng(one.stamp_ns).integers(0, 256, (120, 160))
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, format="PNG")
    return file.getvalue()


def pictured(instants: int) -> Recording:
    """The fleet's pictures, without heatmaps."""
    flown = [sharp(one) for one in views(instants)]
    shown = recording(flown)
    pictures = {(one.drone, one.stamp_ns): photograph(one) for one in flown}
    frames = tuple(
        replace(
            frame,
            pixels=PixelSources(image=lambda encoded=pictures[frame.drone, frame.stamp_ns]: encoded),  # type: ignore[misc]
        )
        for frame in shown.frames
    )
    return replace(shown, frames=frames)


def recording(flown: Sequence[View]) -> Recording:
    """The same views as a recording."""
    frames = tuple(
        Frame(
            one.drone,
            one.stamp_ns,
            one.camera,
            one.world_from_camera,
            PixelSources(heatmap=lambda heatmap=one.heatmap: heatmap),
        )
        for one in sorted(flown, key=lambda one: (one.stamp_ns, one.drone))
    )
    drones = tuple(dict.fromkeys(sorted(one.drone for one in flown)))
    return Recording("plain", drones, frames, None, None, (), (), {}, {})


@contextmanager
def running(folder: Path, **how: Any) -> Iterator[Service]:
    """A live service in this process."""
    chosen: dict[str, Any] = {"config": CONFIG, "settings": SETTINGS, "name": "plain", **how}
    with live(folder, plain(), **chosen) as service:
        yield service


@contextmanager
def asked(service: Service, **how: Any) -> Iterator[TestClient]:
    """Its HTTP face, without a network."""
    with TestClient(make_app(service, **how), base_url="http://localhost") as http:
        yield http


def settle(service: Service, timeout_s: float = 120.0) -> None:
    """Until everything that was accepted is in the map, and what is kept of it on disk."""
    assert service.live is not None
    service.live.applying.settled(timeout_s)
    service.store.flush()


def as_client(http: TestClient) -> Client:
    """The Python client on top of a test's HTTP face."""
    client = Client("http://localhost")
    client._http.close()
    http.base_url = "http://localhost/api/v1"
    client._http = http  # type: ignore[assignment]
    return client


def wait_for_end(service: Service) -> None:
    for _ in range(2000):
        if service.mode == "finished":
            return
        time.sleep(0.01)
    raise TimeoutError("the replay did not end")
