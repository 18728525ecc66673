"""The service on the network."""

from __future__ import annotations

import asyncio
import errno
import ipaddress
import resource
import socket
import ssl
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from signal import SIGTERM, signal
from threading import current_thread, main_thread
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

from crowdfence.service.service import Service

if TYPE_CHECKING:
    import uvicorn

LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
_MOST_CONNECTIONS = 1500
"""Whoever comes beyond them is told 503."""
_OPEN_FILES = 16384
"""Far more than connections. Where a system's limit is reached (1024 as a rule), asyncio tries to accept all
the time and logs every attempt: nobody is served any more, and the disk is full of it within hours."""
_FIRST_WORD_S = 30.0
"""Whoever connects and says nothing for so long is cut off: it costs a place."""
_GONE = {"TCP_KEEPIDLE": 30, "TCP_KEEPINTVL": 10, "TCP_KEEPCNT": 3}
"""Seconds of silence until the other side is asked whether it is there, seconds to the next time, and times.
A drone whose radio fails in the middle of a picture says no farewell, and comes again over another
connection."""


class OpenToAll(ValueError):
    """Other machines would reach a service that asks nobody who they are."""


@dataclass(frozen=True, slots=True)
class Address:
    """Where the service listens."""

    host: str = "127.0.0.1"
    port: int = 8080
    """0: any that is free."""
    certificate: Path | None = None
    key: Path | None = None

    @property
    def is_loopback(self) -> bool:
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def check(self, *, has_tokens: bool) -> None:
        """OpenToAll for an address of other machines without tokens; ValueError for a certificate without its
        key, and a key that anybody on this machine can read; OSError for files that are not there."""
        if not self.is_loopback and not has_tokens:
            raise OpenToAll(
                f"--host {self.host} can be reached by other machines, and nobody would be asked who it is: "
                "make tokens (crowdfence token add NAME --role viewer --tokens FILE) and give --tokens FILE"
            )
        if (self.certificate is None) != (self.key is None):
            raise ValueError("TLS needs both --tls-certificate and --tls-key")
        if self.certificate is not None and self.key is not None:
            _check_pair(self.certificate, self.key)

    def url(self, port: int) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'http' if self.certificate is None else 'https'}://{host}:{port}/"


def _check_pair(certificate: Path, key: Path) -> None:
    """Before anybody is told the address."""
    if key.stat().st_mode & stat.S_IRWXO:
        raise ValueError(
            f"--tls-key {key} can be read by every user of this machine, who could pass for the service: "
            f"chmod 600 {key}"
        )
    certificate.stat()
    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        # A key with a pass phrase would ask a terminal that a service may not have.
        context.load_cert_chain(certificate, key, password="")
    except ssl.SSLError as error:
        raise ValueError(
            f"--tls-certificate {certificate} and --tls-key {key} are no pair of PEM files, or the key has a "
            f"pass phrase: {error.reason or error}"
        ) from error


def listen(config: uvicorn.Config) -> socket.socket:
    """A socket on which whoever reads the address may connect at once. OSError that names the address where
    it cannot: uvicorn's own binding ends the process instead, with the exit code of a gate."""
    listening = socket.socket(socket.AF_INET6 if ":" in config.host else socket.AF_INET)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    # Connections inherit it. An answer's head and body are written apart: without it the body waits until
    # the other side acknowledges the head, 40 ms. asyncio sets it only on sockets that name their protocol.
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in _GONE.items():
        listening.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
    try:
        listening.bind((config.host, config.port))
        listening.listen(config.backlog)
    except OSError as error:
        listening.close()
        what = "--port takes another, 0 any that is free" if error.errno == errno.EADDRINUSE else "see --host"
        raise OSError(
            error.errno, f"cannot listen on {config.host}:{config.port}: {error.strerror}; {what}"
        ) from error
    return listening


def _with_room_for_connections() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = _OPEN_FILES if hard == resource.RLIM_INFINITY else min(_OPEN_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def impatient(protocol: type[asyncio.Protocol]) -> type[asyncio.Protocol]:
    """A protocol of a connection that closes it where the other side says nothing at all."""

    class Impatient(protocol):  # type: ignore[misc, valid-type]
        def connection_made(self, transport: asyncio.Transport) -> None:
            super().connection_made(transport)
            self._closing = asyncio.get_running_loop().call_later(_FIRST_WORD_S, transport.close)

        def data_received(self, data: bytes) -> None:
            self._closing.cancel()
            super().data_received(data)

    return Impatient


def serve(service: Service, address: Address, on_ready: Callable[[str], None]) -> None:
    """Until the process is told to end (SIGINT, SIGTERM). `on_ready` gets the address once it listens.
    OSError where it cannot."""
    import uvicorn
    from uvicorn.protocols.http.auto import AutoHTTPProtocol

    from crowdfence.service.app import make_app

    address.check(has_tokens=service.access.needs_token)
    hosts = frozenset() if service.access.needs_token else LOOPBACK_NAMES | {address.host}
    config = uvicorn.Config(
        make_app(service, hosts=hosts, secure=address.certificate is not None),
        host=address.host,
        port=address.port,
        http=impatient(AutoHTTPProtocol),
        ssl_certfile=None if address.certificate is None else str(address.certificate),
        ssl_keyfile=None if address.key is None else str(address.key),
        log_config=None,
        access_log=False,
        server_header=False,
        limit_concurrency=_MOST_CONNECTIONS,
        timeout_keep_alive=30,
        timeout_graceful_shutdown=3,
        ws_max_size=1 << 16,
        ws_ping_interval=20.0,
        ws_ping_timeout=20.0,
    )
    listening = listen(config)
    _with_room_for_connections()
    server = uvicorn.Server(config)
    try:
        with _sigterm_unwinds(server):
            on_ready(address.url(listening.getsockname()[1]))
            server.run(sockets=[listening])
    finally:
        listening.close()


@contextmanager
def _sigterm_unwinds(server: uvicorn.Server) -> Iterator[None]:
    """While entered, SIGTERM leaves every block that is open, as Ctrl-C does; by itself it would end the
    process on the spot, without a last snapshot. uvicorn raises it again when it is done."""

    def unwind(number: int, frame: FrameType | None) -> NoReturn:
        # Where it meets a finaliser, as imports have them, Python ignores what is raised.
        server.should_exit = True
        raise SystemExit(0)

    if current_thread() is not main_thread():  # only that one hears of signals
        yield
        return
    before = signal(SIGTERM, unwind)
    try:
        yield
    finally:
        signal(SIGTERM, before)
