"""What a live service closes, asked for over HTTP.

While a vehicle is watched that happens in the background, once a second: nobody waits for the service who has
to hear the vehicle. The zones of others, of which there may be thousands, come over the line once, and so
does the scene: the watches of a fleet share the requests that one address may make.
"""

from __future__ import annotations

import json
import ssl
from collections.abc import Iterable, Mapping
from dataclasses import replace
from http.client import HTTPException
from os import PathLike
from threading import Event, Thread
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

from crowdfence.errors import one_line, quoted
from crowdfence.fence_sync.placed_zones import PlacedZones
from crowdfence.georeference import Georeference
from crowdfence.zones import MAX_ID_LENGTH, Zone
from crowdfence.zones.history import polygon_of

EVERY_S = 1.0
"""Between two questions."""
PATIENCE_S = 5.0
"""For one answer."""
_UNKNOWN = 401


def is_address(text: str) -> bool:
    return text.startswith(("http://", "https://"))


class ServiceZones:
    """The zones of a service's newest moment, without those that an operator lets drones pass."""

    def __init__(self, url: str, *, token: str | None = None, ca: str | PathLike[str] | None = None) -> None:
        """`ca`: PEM file of an authority, or of the service's own certificate, that is trusted besides those
        of the system. ValueError for what is no address, OSError for a `ca` that cannot be read."""
        if not is_address(url):
            raise ValueError(f"url is {quoted(url)}; it must begin with http:// or https://")
        self.url = url.rstrip("/")
        self._token = token
        self._trust = ssl.create_default_context()
        if ca is not None:
            self._trust.load_verify_locations(ca)
        self._static: tuple[str, tuple[Zone, ...]] | None = None
        """The zones of others, and which version of them these are."""
        self._scene: dict[str, Any] | None = None
        """Once nothing of it changes while the service runs."""
        self._follows: Thread | None = None
        self._closed = Event()
        self._newest: PlacedZones | Exception | None = None
        """The last answer in the background, or why there was none."""
        self._taken: PlacedZones | None = None

    def read(self) -> PlacedZones:
        """What was heard last. ConnectionError where the service refuses, or does not answer; ValueError for
        an answer that cannot be used."""
        self._taken = None  # what is read after a failure is new, also where it is the same
        newest = self._ask() if self._newest is None else self._newest
        if isinstance(newest, Exception):
            raise newest
        self._taken = newest
        return newest

    def has_changed(self) -> bool:
        """Whether there was a step since `read`, or a failure. Asks in the background from now on."""
        if self._follows is None:
            self._follows = Thread(target=self._follow, name="service zones", daemon=True)
            self._follows.start()
        return self._newest is not None and self._newest != self._taken

    def close(self) -> None:
        """Ask no more."""
        self._closed.set()
        if self._follows is not None:
            self._follows.join()

    def _follow(self) -> None:
        while not self._closed.wait(EVERY_S):
            try:
                self._newest = self._ask()
            except (OSError, ValueError) as error:
                self._newest = error

    def _ask(self) -> PlacedZones:
        try:
            scene = self._scene or self._get("/scene")
            told = self._get("/zones" if self._static is None else f"/zones?without_static={self._static[0]}")
            if self._scene is not None and told.get("run") != scene["run"]:  # it was started anew
                scene = self._get("/scene")
            anchor = scene["anchor"]
            if anchor is None:
                raise ValueError("the mission has no place on Earth, so its zones cannot be sent")
            has_begun, says_run = scene["first_stamp_ns"] is not None, "run" in told
            self._scene = scene if has_begun and says_run and told["run"] == scene.get("run") else None
            return PlacedZones(
                (*_zones(one for one in told["zones"] if one["kind"] != "static"), *self._others(told)),
                Georeference(anchor["latitude_deg"], anchor["longitude_deg"], anchor["height_m"]),
                _whole(scene["first_stamp_ns"]),
                _whole(told["stamp_ns"]),
            )
        except (LookupError, TypeError, AttributeError) as error:
            what = f"{error} is missing" if isinstance(error, KeyError) else one_line(error)
            raise ValueError(f"{self.url}: no service of crowdfence answers there: {what}") from error
        except ValueError as error:
            raise ValueError(f"{self.url}: {one_line(error)}") from error

    def _others(self, told: Mapping[str, Any]) -> tuple[Zone, ...]:
        """The zones of others, which the answer leaves out where they are those that we have."""
        if self._static is None or not told.get("static_left_out"):
            zones = tuple(_zones(one for one in told["zones"] if one["kind"] == "static"))
            self._static = str(told["static_version"]), zones
        return self._static[1]

    def _get(self, path: str) -> Any:
        request = Request(f"{self.url}/api/v1{path}")
        if self._token is not None:
            request.add_unredirected_header("Authorization", f"Bearer {self._token}")
        try:
            with urlopen(request, timeout=PATIENCE_S, context=self._trust) as answer:
                return json.loads(answer.read())
        except HTTPError as error:
            with error:
                hint = "; give --token" if error.code == _UNKNOWN else ""
                raise ConnectionError(f"{self.url}: {_detail(error)} ({error.code}){hint}") from error
        except (OSError, HTTPException) as error:
            why = error.reason if isinstance(error, URLError) else error
            words = one_line(why) if isinstance(why, Exception) else why
            hint = "; give it as --ca" if isinstance(why, ssl.SSLCertVerificationError) else ""
            raise ConnectionError(f"{self.url}: no answer: {words}{hint}") from error


def _zones(told: Iterable[Mapping[str, Any]]) -> Iterable[Zone]:
    """As far as a fence goes by them."""
    for one in told:
        if one["dismissed"]:
            continue
        ground = one["ground"]["lower_m"], one["ground"]["upper_m"]
        zone = Zone.of_no_look(
            one["id"][:MAX_ID_LENGTH], polygon_of(one["polygon"]), one["kind"], one["reason"], ground_m=ground
        )
        yield replace(zone, valid_until_ns=_whole(one["valid_until_ns"]))


def _whole(stamp_ns: str | None) -> int | None:
    """Of the text in which JSON has nanoseconds."""
    return None if stamp_ns is None else int(stamp_ns)


def _detail(error: HTTPError) -> str:
    """Why a service refuses, in its words where they are those of ours."""
    try:
        told = json.loads(error.read())["detail"]
    except (OSError, HTTPException, ValueError, LookupError, TypeError):
        told = None
    return told if isinstance(told, str) else error.reason
