"""Interrupts and the processes that only help.

A terminal sends Ctrl-C to all processes at once: helpers ignore it and end with their parent.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import parent_process
from types import FrameType

_TO_HAND_OVER_S = 1.0
"""Longer than any result takes on its way to the parent."""
_end_is_wanted = False


@contextmanager
def interrupts_ignored() -> Iterator[None]:
    """Processes that are started meanwhile ignore interrupts from their first instruction on."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def ignore_interrupts() -> None:
    """For a helping process: its parent decides when to stop."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def end_between_tasks() -> None:
    """For a helping process with large results: SIGTERM ends it where its next task begins, or a little
    later, and not with half a result handed over. The parent would wait for the other half for ever."""
    signal.signal(signal.SIGTERM, _end_soon)


def end_if_wanted() -> None:
    """Where a task begins."""
    if _end_is_wanted:
        os._exit(1)


def _end_soon(number: int, frame: FrameType | None) -> None:
    global _end_is_wanted
    _end_is_wanted = True
    late = threading.Timer(_TO_HAND_OVER_S, os._exit, (1,))
    late.daemon = True
    late.start()


def end_with_parent() -> None:
    """For a helping process: end when the parent is gone, however it went."""
    threading.Thread(target=_wait_for_parent, daemon=True).start()


def _wait_for_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
