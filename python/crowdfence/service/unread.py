"""Messages of a stream between the line and whoever reads them.

The line is always read. Where it was not, hundreds of steps wait in the buffers of both ends, and who takes
longer for each than it takes the next to come would go by zones that are older with every step.
"""

from __future__ import annotations

from collections import deque
from threading import Condition
from typing import Any

Message = dict[str, Any]
_NEWEST_ONLY = ("step", "ping")
"""Kinds whose newest says all."""


class Unread:
    """`put` and `end` by who reads the line, `take` by who reads the messages."""

    def __init__(self) -> None:
        self._messages: deque[Message] = deque()
        self._changed = Condition()
        self._is_over = False
        self._error: Exception | None = None

    def put(self, message: Message) -> None:
        """Of the steps that nobody has taken the newest stays, of everything else all."""
        kind = message.get("type")
        with self._changed:
            if kind in _NEWEST_ONLY:
                self._leave_out(kind)
            self._messages.append(message)
            self._changed.notify()

    def end(self, error: Exception | None = None) -> None:
        """Nothing follows. After an error the step that nobody has taken may not hold any more."""
        with self._changed:
            if error is not None:
                self._leave_out("step")
            self._is_over, self._error = True, error
            self._changed.notify()

    def take(self) -> Message | None:
        """Wait for the next one; None, or the error, after the last."""
        with self._changed:
            self._changed.wait_for(lambda: self._messages or self._is_over)
            if self._messages:
                return self._messages.popleft()
            if self._error is not None:
                raise self._error
            return None

    def _leave_out(self, kind: str) -> None:
        self._messages = deque(one for one in self._messages if one.get("type") != kind)
