"""Bytes to a vehicle and back, over UDP or TCP.

udpin:HOST:PORT   waits for vehicles that send there, and answers them
udpout:HOST:PORT  sends there, and takes what comes back
tcp:HOST:PORT     connects
"""

from __future__ import annotations

import select
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from crowdfence.fence_sync.fence_error import FenceError

_MOST_BYTES = 4096
_MOST_PEERS = 16
_CONNECT_S = 5.0


class Transport(Protocol):
    """Where bytes go."""

    def send(self, data: bytes) -> None: ...
    def receive(self, timeout_s: float) -> bytes | None:
        """What arrived, None when nothing did in time."""

    def reopen(self) -> None:
        """Begin anew after an OSError of the other two. OSError where that is not possible now."""

    def close(self) -> None: ...


def open_transport(address: str) -> Transport:
    """A link by its address. FenceError for one that is not understood, OSError for one that cannot be
    opened."""
    kind, _, place = address.partition(":")
    host, _, port = place.rpartition(":")
    if kind not in _KINDS or not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise FenceError(
            f"{address!r} is no link; give udpin:HOST:PORT, udpout:HOST:PORT or tcp:HOST:PORT, such as "
            "udpin:0.0.0.0:14550 (serial ports: through mavlink-router or MAVProxy)"
        )
    try:
        return _KINDS[kind](host, int(port))
    except OSError as error:
        raise OSError(
            error.errno, f"the link {address} cannot be opened: {error.strerror or error}"
        ) from error


class _Udp:
    """One socket; `peers` are those that what is sent goes to."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._peers: list[tuple[str, int]] = []

    def send(self, data: bytes) -> None:
        for peer in self._peers:
            with suppress(OSError):  # a vehicle that is away may come back
                self._socket.sendto(data, peer)

    def receive(self, timeout_s: float) -> bytes | None:
        if not select.select([self._socket], [], [], max(0.0, timeout_s))[0]:
            return None
        try:
            data, peer = self._socket.recvfrom(_MOST_BYTES)
        except OSError:  # the other end says that nobody listens there
            return None
        self._met(peer)
        return data

    def _met(self, peer: tuple[str, int]) -> None:
        pass

    def reopen(self) -> None:
        """Nothing is to be done: what is away may come back at any time."""

    def close(self) -> None:
        self._socket.close()


class UdpOut(_Udp):
    """To one address."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__()
        self._peers = [(socket.gethostbyname(host), port)]


class UdpIn(_Udp):
    """To everybody who sent something here."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__()
        try:
            self._socket.bind((host, port))
        except OSError:
            self._socket.close()
            raise

    def _met(self, peer: tuple[str, int]) -> None:
        if peer not in self._peers:
            self._peers = [*self._peers[-_MOST_PEERS + 1 :], peer]


class Tcp:
    """A stream; one that ends is an error."""

    def __init__(self, host: str, port: int) -> None:
        self._place = (host, port)
        self._socket = socket.create_connection(self._place, timeout=_CONNECT_S)

    def send(self, data: bytes) -> None:
        self._socket.sendall(data)

    def receive(self, timeout_s: float) -> bytes | None:
        if not select.select([self._socket], [], [], max(0.0, timeout_s))[0]:
            return None
        data = self._socket.recv(_MOST_BYTES)
        if not data:
            raise ConnectionError("the other end closed the link")
        return data

    def reopen(self) -> None:
        self._socket.close()
        self._socket = socket.create_connection(self._place, timeout=_CONNECT_S)

    def close(self) -> None:
        self._socket.close()


_KINDS: dict[str, Callable[[str, int], Transport]] = {"udpin": UdpIn, "udpout": UdpOut, "tcp": Tcp}
