"""A running service from Python."""

from __future__ import annotations

import json
import ssl
import time
from collections.abc import Iterator
from os import PathLike
from threading import Thread
from types import TracebackType
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, urlsplit, urlunsplit

import httpx
import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera, Observation, View
from crowdfence.errors import quoted
from crowdfence.service.belief import ColumnBeliefs
from crowdfence.service.static_zones_held import StaticZonesHeld
from crowdfence.service.unread import Unread
from crowdfence.service.view_message import CameraMessage, HeatmapMessage, ViewMessage

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from websockets.sync.client import ClientConnection

_COME_AGAIN = (429, 503, 507)
_LONGEST_PAUSE_S = 5.0
_SILENT_S = 60.0
"""A stream says something, if only "ping", every 15 s."""
_TRY_AGAIN_LATER = 1013
"""Code of a WebSocket that is closed to one listener too many."""


class ServiceError(RuntimeError):
    """The service refused something; `status` is that of HTTP and the message says why."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(status, reason)
        self.status, self.reason = status, reason

    def __str__(self) -> str:
        return f"{self.reason} ({self.status})"


class Client:
    """Give views, ask for zones, decide: `with Client("http://127.0.0.1:8080") as client: client.zones()`.

    Answers are the service's JSON. ServiceError where it refuses, httpx.TransportError where it does not
    answer."""

    def __init__(
        self,
        url: str = "http://127.0.0.1:8080",
        *,
        token: str | None = None,
        ca: str | PathLike[str] | None = None,
        patience_s: float = 10.0,
    ) -> None:
        """`ca`: PEM file of the authority, or of the service's own certificate, that is trusted besides those
        of the system; `patience_s`: how long a view is given again to a service that is busy or starts
        anew. OSError for a `ca` that cannot be read, ValueError for what is no address or patience."""
        if urlsplit(url).scheme not in ("http", "https"):
            raise ValueError(f"url is {quoted(url)}; it must begin with http:// or https://")
        if not patience_s >= 0.0:
            raise ValueError(f"patience_s is {patience_s:g}; it must be at least 0")
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        self._url = url.rstrip("/")
        self._headers, self._patience_s = headers, patience_s
        self._trust = ssl.create_default_context()
        if ca is not None:
            self._trust.load_verify_locations(ca)
        base_url = f"{self._url}/api/v1"
        self._http = httpx.Client(base_url=base_url, headers=headers, timeout=30.0, verify=self._trust)

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._http.close()

    def give(self, view: View | Observation) -> int:
        """A view or an observation; its place in the journal once it is on disk. Giving it again is harmless,
        so that is done while the service is busy or away."""
        if isinstance(view, Observation):
            return self._give("/observations", view.to_bytes(), "application/octet-stream")
        message = ViewMessage(
            drone=view.drone,
            stamp_ns=view.stamp_ns,
            camera=CameraMessage.of(view.camera),
            world_from_camera=view.world_from_camera.tolist(),
            heatmap=HeatmapMessage.of(view.heatmap, view.looked_at),
        )
        return self._give("/views", message.model_dump_json().encode(), "application/json")

    def give_image(
        self, drone: str, stamp_ns: int, camera: Camera, world_from_camera: ArrayLike | None, image: bytes
    ) -> int:
        """A picture (JPEG or PNG) for the service's detector, otherwise as `give`. Without
        `world_from_camera` (None) the drone's telemetry tells the pose."""
        import base64

        message = ViewMessage(
            drone=drone,
            stamp_ns=stamp_ns,
            camera=CameraMessage.of(camera),
            world_from_camera=None
            if world_from_camera is None
            else np.asarray(world_from_camera, dtype=np.float64).tolist(),
            image=base64.b64encode(image).decode("ascii"),
        )
        return self._give("/views", message.model_dump_json().encode(), "application/json")

    def scene(self) -> dict[str, Any]:
        return self._json("GET", "/scene")

    def zones(self, at_ns: int | None = None) -> dict[str, Any]:
        """What is closed, now or at an earlier stamp."""
        return self._json("GET", "/zones", params=_at(at_ns))

    def drones(self, at_ns: int | None = None) -> list[dict[str, Any]]:
        drones: list[dict[str, Any]] = self._json("GET", "/drones", params=_at(at_ns))["drones"]
        return drones

    def alerts(self) -> list[dict[str, Any]]:
        """The newest first."""
        alerts: list[dict[str, Any]] = self._json("GET", "/alerts")["alerts"]
        return alerts

    def belief(self, at_ns: int | None = None) -> ColumnBeliefs:
        """The crowd map from above."""
        return ColumnBeliefs.of(self._request("GET", "/belief", params=_at(at_ns)).content)

    def terrain(self) -> NDArray[np.float32]:
        """Heights [R, C], north row first; where it lies is in `scene`."""
        told = self.scene()["terrain"]
        body = self._request("GET", "/terrain").content
        return np.frombuffer(body, "<f4").reshape(told["rows"], told["columns"]).astype(np.float32)

    def export(self, kind: str, at_ns: int | None = None, **how: Any) -> bytes:
        """The zones as a file: geojson, ed318, ed269, f3548, kml, qgc, csv, .."""
        return self._request("GET", "/export", params={"format": kind, **_at(at_ns), **how}).content

    def add_zone(self, polygon: ArrayLike, reason: str, restriction: str = "prohibited") -> dict[str, Any]:
        """Close ground: corners [N, 2], local metres."""
        corners = np.asarray(polygon, dtype=np.float64).tolist()
        told = {"polygon": corners, "reason": reason, "restriction": restriction}
        return self._json("POST", "/zones", json=told)

    def lock_zone(self, zone: str, reason: str) -> dict[str, Any]:
        return self._json("POST", f"/zones/{zone}/lock", json={"reason": reason})

    def unlock_zone(self, zone: str, reason: str) -> dict[str, Any]:
        return self._json("POST", f"/zones/{zone}/unlock", json={"reason": reason})

    def dismiss_zone(self, zone: str, reason: str, seen_ns: int | None = None) -> dict[str, Any]:
        """For crowd: for a while only. `seen_ns`: stamp of the zones in which somebody looked at it; refused
        (409) where its crowd has grown since."""
        seen = {} if seen_ns is None else {"seen_ns": str(seen_ns)}
        return self._json("POST", f"/zones/{zone}/dismiss", json={"reason": reason, **seen})

    def leave_out_drone(self, drone: str, reason: str) -> None:
        """Its looks do not count until it is taken in again, because it sees nothing."""
        self._request("POST", f"/drones/{quote(drone)}/leave-out", json={"reason": reason})

    def take_in_drone(self, drone: str, reason: str) -> None:
        """Its looks count again."""
        self._request("POST", f"/drones/{quote(drone)}/take-in", json={"reason": reason})

    def acknowledge(self, alert: str) -> dict[str, Any]:
        return self._json("POST", f"/alerts/{alert}/acknowledge")

    def stream(self) -> Iterator[dict[str, Any]]:
        """Messages as they come: hello, step, alert, mode, ping; until the service ends. Who takes long for
        one gets the newest step next, and every alert. httpx.TransportError where the line breaks or goes
        silent: what was heard last may not hold any more. Every step has all zones, also those of others,
        which come over the line once."""
        from websockets.sync.client import connect

        scheme, host, path, _, _ = urlsplit(self._url)
        address = urlunsplit(
            ("wss" if scheme == "https" else "ws", host, f"{path}/api/v1/stream", "without_static=*", "")
        )
        trust = self._trust if scheme == "https" else None
        unread, held = Unread(), StaticZonesHeld()
        with connect(address, additional_headers=self._headers, max_size=None, ssl=trust) as socket:
            Thread(target=self._read, args=(socket, unread), name="stream", daemon=True).start()
            while (message := unread.take()) is not None:
                if message["type"] == "step":
                    zones = held.whole(message["zones"])
                    if zones is None:
                        zones = held.whole(self.zones(int(message["stamp_ns"])))
                    message["zones"] = zones
                yield message

    def _read(self, socket: ClientConnection, unread: Unread) -> None:
        """In a thread, until the line ends."""
        from websockets.exceptions import ConnectionClosed

        try:
            while True:
                unread.put(json.loads(socket.recv(timeout=_SILENT_S)))
        except TimeoutError:
            unread.end(httpx.ReadTimeout(f"{self._url} said nothing for {_SILENT_S:g} s"))
        except ConnectionClosed as error:
            if error.rcvd is None:
                unread.end(httpx.ReadError(f"the line to {self._url} broke: {error}"))
            elif error.rcvd.code == _TRY_AGAIN_LATER:
                unread.end(ServiceError(503, error.rcvd.reason))
            else:
                unread.end()
        except Exception as error:
            unread.end(error)

    def _give(self, path: str, body: bytes, kind: str) -> int:
        give_up_s = time.monotonic() + self._patience_s
        pause_s = 0.05
        while True:
            try:
                answer = self._request("POST", path, content=body, headers={"Content-Type": kind})
                return int(answer.json()["accepted"])
            except ServiceError as error:
                if error.status not in _COME_AGAIN or time.monotonic() + pause_s > give_up_s:
                    raise
            except httpx.TransportError:
                if time.monotonic() + pause_s > give_up_s:
                    raise
            time.sleep(pause_s)
            pause_s = min(2.0 * pause_s, _LONGEST_PAUSE_S)

    def _json(self, method: str, path: str, **what: Any) -> dict[str, Any]:
        told: dict[str, Any] = self._request(method, path, **what).json()
        return told

    def _request(self, method: str, path: str, **what: Any) -> httpx.Response:
        answer = self._http.request(method, path, **what)
        if answer.is_error:
            raise ServiceError(answer.status_code, _reason(answer))
        return answer


def _reason(answer: httpx.Response) -> str:
    try:
        detail = answer.json()["detail"]
    except (ValueError, KeyError, TypeError):
        return answer.reason_phrase
    return detail if isinstance(detail, str) else json.dumps(detail)


def _at(at_ns: int | None) -> dict[str, str]:
    return {} if at_ns is None else {"at": str(at_ns)}
