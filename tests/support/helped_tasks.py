"""What a helping process is asked to do in tests: it has to find these functions by their module."""

from __future__ import annotations

import multiprocessing.connection
import os
import signal
from typing import Any

LARGE = 1_000_000
"""More than any pipe takes before somebody reads it."""


def frame(number: int) -> tuple[int, bytes]:
    return number, bytes(LARGE)


def frame_killed_while_handed_over(sent: int) -> bytes:
    """The kernel kills the process once `sent` bytes of its answer are on their way."""

    def send(self: Any, data: bytes, write: Any = None) -> None:
        nonlocal sent
        view = memoryview(data)
        while view:
            if sent == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            written = os.write(self.fileno(), view[:sent])
            sent, view = sent - written, view[written:]

    multiprocessing.connection.Connection._send = send
    return bytes(LARGE)


def fails() -> None:
    raise FileNotFoundError(2, "No such file or directory", "map.tif")
