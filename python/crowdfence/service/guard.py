"""What stands between the network and the routes: hosts, origins, sizes, rates and headers."""

from __future__ import annotations

import json
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable, MutableMapping
from threading import Lock
from typing import Any
from urllib.parse import urlsplit

from crowdfence.service.access import hashed

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

CONTENT_SECURITY_POLICY = "; ".join(
    (
        "default-src 'self'",
        "img-src 'self' blob:",
        "object-src 'none'",
        "base-uri 'none'",
        "form-action 'self'",
        "frame-ancestors 'none'",
    )
)
"""Nothing from other hosts; blob: is a picture that the page fetched itself."""

HEADERS = [
    (b"content-security-policy", CONTENT_SECURITY_POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-frame-options", b"DENY"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
]
_MOST_BUCKETS = 4096
MOST_DECIDED_BYTES = 262_144
"""Of a body that is no view: a zone of 2000 corners has a third of it. FastAPI reads it before anybody is
asked for a token, and makes objects of 400 MB of 16 MB of JSON."""


class Rate:
    """A token bucket per name: so many a second on average, twice as many at once."""

    def __init__(self, per_s: float, now_s: Callable[[], float] = time.monotonic) -> None:
        self._per_s, self._now_s = per_s, now_s
        self._lock = Lock()
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def wait_s(self, name: str) -> float:
        """0 where one more is fine, and it is counted; else seconds until it is."""
        now_s = self._now_s()
        with self._lock:
            left, then_s = self._buckets.pop(name, (2.0 * self._per_s, now_s))
            left = min(2.0 * self._per_s, left + (now_s - then_s) * self._per_s)
            fine = left >= 1.0
            self._buckets[name] = (left - 1.0 if fine else left, now_s)
            while len(self._buckets) > _MOST_BUCKETS:
                self._buckets.popitem(last=False)
        return 0.0 if fine else (1.0 - left) / self._per_s


class _TooLarge(Exception):
    pass


class Guard:
    """ASGI middleware."""

    def __init__(
        self,
        app: App,
        *,
        hosts: frozenset[str],
        max_body: int,
        requests: Rate,
        views: Rate,
        gives: frozenset[str],
        on_flood: Callable[[Scope], str],
    ) -> None:
        """`hosts` are the names that the service answers to (a page of another site that points its name here
        is refused); empty for any, which is for those who need tokens. `views` are those that are posted to
        the paths `gives`, counted apart from all other `requests`: a page and the drones behind one address
        do not stop each other. `on_flood` hears of each that is refused, and says why."""
        self._app, self._hosts, self._max_body, self._requests = app, hosts, max_body, requests
        self._views, self._gives, self._on_flood = views, gives, on_flood

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        refusal = self._refusal(scope, headers)
        if refusal is not None:
            await _answer(scope, send, *refusal)
            return
        if scope["type"] == "websocket":
            await self._app(scope, receive, send)
            return
        try:
            await self._app(scope, _limited(receive, self._most_bytes(scope)), _with_headers(send))
        except _TooLarge as error:
            await _answer(scope, send, 413, str(error), 0.0)

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str, float] | None:
        host = headers.get("host", "")
        if self._hosts and _name_of(host) not in self._hosts:
            return 421, f"this service does not answer to the name {host[:80]!r}", 0.0
        origin = headers.get("origin")
        if origin is not None and _netloc_of(origin) != host:
            return 403, _of_another_site(origin, host), 0.0
        length, most = headers.get("content-length", "0"), self._most_bytes(scope)
        if not length.isdigit() or int(length) > most:
            return 413, _too_large(most), 0.0
        coding = headers.get("content-encoding", "identity").lower()
        if coding != "identity":
            return 415, f"the body is encoded ({coding[:20]!r}): send it without Content-Encoding", 0.0
        who = headers.get("authorization") or headers.get("cookie")
        client = scope.get("client") or ("", 0)
        gives = self._is_giving(scope)
        rate = self._views if gives else self._requests
        wait_s = rate.wait_s(hashed(who) if who else str(client[0]))
        if wait_s > 0.0:
            return 429, self._on_flood(scope) if gives else "too many requests", wait_s
        return None

    def _is_giving(self, scope: Scope) -> bool:
        return scope.get("method") == "POST" and scope["path"] in self._gives

    def _most_bytes(self, scope: Scope) -> int:
        return self._max_body if self._is_giving(scope) else min(self._max_body, MOST_DECIDED_BYTES)


def _limited(receive: Receive, most: int) -> Receive:
    """A body without a length is cut off as well."""
    left = most

    async def limited() -> MutableMapping[str, Any]:
        nonlocal left
        message = await receive()
        left -= len(message.get("body", b""))
        if left < 0:
            raise _TooLarge(_too_large(most))
        return message

    return limited


def _too_large(most: int) -> str:
    return f"a body has at most {most} bytes here"


def _name_of(host: str) -> str:
    """Without the port."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0].lower()


def _of_another_site(origin: str, host: str) -> str:
    return (
        f"requests from pages of other sites are refused: this one is of {origin[:80]!r}, to {host[:80]!r}; "
        "a proxy between them must pass the header Host on as it is"
    )


def _netloc_of(origin: str) -> str | None:
    """None for what is no address."""
    try:
        return urlsplit(origin).netloc or None
    except ValueError:
        return None


def _with_headers(send: Send) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            there = {name for name, _ in message.get("headers", ())}
            message["headers"] = [
                *message.get("headers", ()),
                *(header for header in HEADERS if header[0] not in there),
            ]
            if b"cache-control" not in there:
                message["headers"].append((b"cache-control", b"no-store"))
        await send(message)

    return sending


async def _answer(scope: Scope, send: Send, status: int, detail: str, wait_s: float) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": detail[:100]})
        return
    body = json.dumps({"detail": detail}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    if wait_s > 0.0:
        headers.append((b"retry-after", str(max(1, round(wait_s))).encode()))
    sending = _with_headers(send)
    await sending({"type": "http.response.start", "status": status, "headers": headers})
    await sending({"type": "http.response.body", "body": body})
