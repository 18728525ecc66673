"""What a live service closes, asked for over HTTP.

While a vehicle is watched that happens in the background, once a second: nobody waits for the service who has
to hear the vehicle.
"""

from __future__ import annotations

import json
import ssl
from http.client import HTTPException
from os import PathLike
from threading import Event, Thread
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

from crowdfence.errors import one_line, quoted

EVERY_S = 1.0
"""Between two questions."""
PATIENCE_S = 5.0
"""For one answer."""
_UNKNOWN = 401


def is_address(text: str) -> bool:
    return text.startswith(("http://", "https://"))


class ServiceZones:
    """The GeoJSON of a service's newest moment, as bytes."""

    def __init__(self, url: str, *, token: str | None = None, ca: str | PathLike[str] | None = None) -> None:
        """`ca`: PEM file of an authority, or of the service's own certificate, that is trusted besides those
        of the system. ValueError for what is no address, OSError for a `ca` that cannot be read."""
        if not is_address(url):
            raise ValueError(f"url is {quoted(url)}; it must begin with http:// or https://")
        self.url = url.rstrip("/")
        self._request = Request(f"{self.url}/api/v1/export?format=geojson")
        if token is not None:
            self._request.add_unredirected_header("Authorization", f"Bearer {token}")
        self._trust = ssl.create_default_context()
        if ca is not None:
            self._trust.load_verify_locations(ca)
        self._follows: Thread | None = None
        self._closed = Event()
        self._newest: bytes | OSError | None = None
        """The last answer in the background, or why there was none."""
        self._taken: bytes | None = None

    def read(self) -> bytes:
        """What was heard last. ConnectionError where the service refuses, or does not answer."""
        self._taken = None  # what is read after a failure is new, also where it is the same
        newest = self._ask() if self._newest is None else self._newest
        if isinstance(newest, OSError):
            raise newest
        self._taken = newest
        return newest

    def has_changed(self) -> bool:
        """Whether `read` would give something else than the last time, or fail. Asks in the background from
        now on."""
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
            except OSError as error:
                self._newest = error

    def _ask(self) -> bytes:
        try:
            with urlopen(self._request, timeout=PATIENCE_S, context=self._trust) as answer:
                return bytes(answer.read())
        except HTTPError as error:
            with error:
                hint = "; give --token" if error.code == _UNKNOWN else ""
                raise ConnectionError(f"{self.url}: {_detail(error)} ({error.code}){hint}") from error
        except (OSError, HTTPException) as error:
            why = error.reason if isinstance(error, URLError) else error
            words = one_line(why) if isinstance(why, Exception) else why
            raise ConnectionError(f"{self.url}: no answer: {words}") from error


def _detail(error: HTTPError) -> str:
    """Why a service refuses, in its words where they are those of ours."""
    try:
        told = json.loads(error.read())["detail"]
    except (OSError, HTTPException, ValueError, LookupError, TypeError):
        told = None
    return told if isinstance(told, str) else error.reason
