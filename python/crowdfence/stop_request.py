"""Ctrl-C as a request, granted between two steps: nothing is half done there, and work can be resumed."""

from __future__ import annotations

import signal
import threading
import time
from types import FrameType, TracebackType
from typing import Any


class StopRequest:
    """While entered, the first interrupt (SIGINT, SIGTERM) only sets `wanted`; a second one interrupts.

    Outside the main thread signals are left alone and `wanted` stays false.
    """

    def __init__(self) -> None:
        self.wanted = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> StopRequest:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._take)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def wanted_within(self, seconds: float) -> bool:
        """Whether a stop is wanted, or comes in time: whoever ends the processes of a run ends one after the
        other."""
        late_s = time.monotonic() + seconds
        while not self.wanted and time.monotonic() < late_s:
            time.sleep(0.01)
        return self.wanted

    def _take(self, number: int, frame: FrameType | None) -> None:
        if self.wanted:
            raise KeyboardInterrupt
        self.wanted = True
