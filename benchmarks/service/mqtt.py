"""As much of MQTT 3.1.1 as a publisher at quality 1 and a subscriber need, and mosquitto to talk to."""

import shutil
import socket
import struct
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_PUBLISH, _PUBACK = 0x32, 0x40


class Publisher:
    """One message at a time: published, acknowledged."""

    def __init__(self, port: int, name: str) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        who = name.encode()
        self._send(0x10, b"\x00\x04MQTT\x04\x02\x00\x3c" + struct.pack(">H", len(who)) + who)
        _, answer = self.read()
        assert answer[1] == 0, answer
        self._number = 0

    def subscribe(self, topic: str) -> None:
        name = topic.encode()
        self._send(0x82, b"\x00\x01" + struct.pack(">H", len(name)) + name + b"\x00")
        self.read()

    def publish(self, topic: str, body: bytes) -> None:
        """Returns once the broker has taken it."""
        self._number = self._number % 65535 + 1
        name = topic.encode()
        head = struct.pack(">H", len(name)) + name + struct.pack(">H", self._number)
        self._send(_PUBLISH, head + body)
        kind, _ = self.read()
        assert kind & 0xF0 == _PUBACK, kind

    def close(self) -> None:
        self._socket.close()

    def _send(self, kind: int, body: bytes) -> None:
        length, rest = b"", len(body)
        while True:
            rest, digit = divmod(rest, 128)[0], rest % 128
            length += bytes([digit | (0x80 if rest else 0)])
            if not rest:
                break
        self._socket.sendall(bytes([kind]) + length + body)

    def read(self) -> tuple[int, bytes]:
        """Kind and body of the next packet."""
        kind = self._exactly(1)[0]
        length, shift = 0, 0
        while True:
            digit = self._exactly(1)[0]
            length |= (digit & 0x7F) << shift
            shift += 7
            if not digit & 0x80:
                return kind, self._exactly(length)

    def _exactly(self, count: int) -> bytes:
        parts = bytearray()
        while len(parts) < count:
            part = self._socket.recv(count - len(parts))
            if not part:
                raise ConnectionError("the broker went away")
            parts += part
        return bytes(parts)


def broker_path() -> str | None:
    return shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")


@contextmanager
def broker(folder: Path) -> Iterator[tuple[int, subprocess.Popen[bytes]]]:
    """mosquitto on a free port of this machine, with its process."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port = int(one.getsockname()[1])
    config = folder / "mosquitto.conf"
    config.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\nmax_queued_messages 0\n")
    program = broker_path()
    assert program is not None
    process = subprocess.Popen([program, "-c", str(config)], stderr=subprocess.DEVNULL)
    try:
        for _ in range(200):
            try:
                socket.create_connection(("127.0.0.1", port)).close()
                break
            except OSError:
                time.sleep(0.05)
        yield port, process
    finally:
        process.terminate()
        process.wait()
