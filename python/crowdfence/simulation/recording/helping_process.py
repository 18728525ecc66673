"""Processes that only help, each with a pipe of its own to the one that asks.

Nobody else holds an end of that pipe, so that it ends when its process does: whoever waits for an answer of a
process that the kernel kills hears of it, also in the middle of the answer. A pool whose processes share a
pipe would wait for the rest of that answer for ever.
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection
from typing import Any, TypeVar

_T = TypeVar("_T")


class HelperKilled(RuntimeError):
    """A helping process ended without being asked to."""


class HelpingProcess:
    """A process that does what it is asked, one thing after the other.

    It sees neither Ctrl-C nor SIGTERM, which a terminal and systemd send to all processes at once: its parent
    decides when to stop. It ends with its parent, however that went.
    """

    def __init__(self) -> None:
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        # Nothing large goes along: a process that is killed before it has read it leaves the parent waiting.
        self._process = context.Process(target=_answer_all, args=(theirs,))
        with _interrupts_held_back():
            self._process.start()
        theirs.close()

    def call(self, function: Callable[..., _T], *arguments: Any) -> _T:
        """What a function of a module returns there, or the error that it raises there. HelperKilled when the
        process is no more."""
        asked = pickle.dumps((function, arguments))
        try:
            self._pipe.send_bytes(asked)
            answered = self._pipe.recv_bytes()
        except (EOFError, OSError) as error:  # OSError in the middle of a message
            raise HelperKilled from error
        answer = pickle.loads(answered)
        if isinstance(answer, _Failure):
            raise answer.error from RuntimeError(answer.traceback)
        return answer  # type: ignore[no-any-return]

    def kill(self) -> None:
        """End it at once; whoever waits for an answer meanwhile gets HelperKilled."""
        self._process.kill()

    def close(self) -> None:
        """Wait until what it does is done, and it has ended."""
        self._pipe.close()
        self._process.join()


@dataclass(frozen=True, slots=True, eq=False)
class _Failure:
    error: Exception
    traceback: str


@contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Processes that are started meanwhile never see them, from their first instruction on; this one does
    afterwards."""
    resource_tracker.ensure_running()  # the first process starts it, and it lets them through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _answer_all(pipe: Connection) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # the parent wants no more
        while True:
            function, arguments = pickle.loads(pipe.recv_bytes())
            pipe.send_bytes(_answer(function, arguments))


def _answer(function: Callable[..., Any], arguments: tuple[Any, ...]) -> bytes:
    try:
        return pickle.dumps(function(*arguments))
    except Exception as error:
        return pickle.dumps(_Failure(error, traceback.format_exc()))


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
