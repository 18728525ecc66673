"""What is happening, to everybody who listens: WebSocket messages.

Everybody has room for one step, the newest: who reads slowly sees fewer steps, and who does not read at all
is cut off. Nobody is waited for."""

from __future__ import annotations

import asyncio
import json
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

from starlette.websockets import WebSocket, WebSocketDisconnect

MakeStep = Callable[[bool], dict[str, Any]]
"""Given whether zones of others are in it."""

STEPS_PER_S = 10.0
MESSAGES_PER_S = 150.0
"""Steps to all listeners together. Packing and sending one of 80 kB takes 1.5 to 2 ms in the thread that the
views of drones go through, too."""
MAKING_SHARE = 0.2
"""Of the time at most so much goes into making steps: one of thousands of zones takes half a second."""
LONGEST_PAUSE_S = 2.0
SEND_WITHIN_S = 10.0
"""Who takes longer to take one message is cut off."""
_CLOSE_WITHIN_S = 1.0
FRESH_S = 1.0
"""A step that was made longer ago is made anew before it is sent: the ages in it are those of its making."""
PING_EVERY_S = 15.0
MOST_ALERTS = 2000
"""That wait for one listener, more than are remembered. With more it is cut off: whoever comes again asks for
all there are."""
MOST_LISTENERS = 1000
_AGAIN = 1013
"""Code of a WebSocket whose other end may try again later."""


class _Made(NamedTuple):
    """A step as text."""

    make: MakeStep
    text: str
    at_s: float
    """When, by a steady clock."""

    @property
    def is_fresh(self) -> bool:
        return time.monotonic() - self.at_s < FRESH_S


class _Listener:
    def __init__(self, *, with_static: bool) -> None:
        self.with_static = with_static
        """Whether its steps have zones of others in them."""
        self.news = asyncio.Event()
        self.step: _Made | None = None
        self.others: deque[str] = deque()
        self.is_behind = False


class Hub:
    """Give it messages from any thread, once it runs in an event loop."""

    def __init__(self) -> None:
        self._listeners: set[_Listener] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._make: MakeStep | None = None
        self._made: dict[bool, _Made] = {}
        """With zones of others and without."""
        self._sent: MakeStep | None = None
        self._flushing: asyncio.Task[None] | None = None
        self.cut_off = 0
        """Listeners that did not read."""

    def start(self) -> None:
        """In the event loop that sends."""
        self._loop = asyncio.get_running_loop()

    @property
    def listeners(self) -> int:
        return len(self._listeners)

    def step(self, make: MakeStep) -> None:
        """The newest step. `make` is called, in a thread, only if somebody listens."""
        self._make = make
        self._call(self._step_due)

    def tell(self, message: dict[str, Any]) -> None:
        """An alert or a change of mode."""
        self._call(self._put, json.dumps(message, allow_nan=False))

    def _call(self, function: Callable[..., None], *values: str) -> None:
        loop = self._loop
        if loop is None or loop.is_closed():
            return
        with suppress(RuntimeError):  # closed in between: nobody listens any more
            loop.call_soon_threadsafe(function, *values)

    def _put(self, text: str) -> None:
        for listener in self._listeners:
            if len(listener.others) < MOST_ALERTS:
                listener.others.append(text)
            else:
                listener.is_behind = True
            listener.news.set()

    def _step_due(self) -> None:
        if self._listeners and (self._flushing is None or self._flushing.done()):
            self._flushing = asyncio.get_running_loop().create_task(self._flush())

    async def _flush(self) -> None:
        """The newest step to everybody, then a pause, until nothing new has come meanwhile."""
        while self._listeners and self._sent is not self._make:
            self._sent = self._make  # whoever made it: a listener that has just come has it alone
            begun_s = time.monotonic()
            for with_static in {listener.with_static for listener in self._listeners}:
                made = await self._newest(with_static)
                for listener in self._listeners:
                    if listener.with_static == with_static:
                        listener.step = made
                        listener.news.set()
            took_s = time.monotonic() - begun_s
            await asyncio.sleep(
                max(pause_s(len(self._listeners)), min(took_s / MAKING_SHARE, LONGEST_PAUSE_S))
            )

    async def _newest(self, with_static: bool) -> _Made | None:
        make, made = self._make, self._made.get(with_static)
        if make is None:
            return None
        if made is None or made.make is not make or not made.is_fresh:
            now_s = time.monotonic()
            text = await asyncio.to_thread(lambda: json.dumps(make(with_static), allow_nan=False))
            made = self._made[with_static] = _Made(make, text, now_s)
        return made

    async def serve(self, socket: WebSocket, hello: dict[str, Any], *, with_static: bool = True) -> None:
        """Accept a listener and send until it goes."""
        await socket.accept()
        if len(self._listeners) >= MOST_LISTENERS:
            await socket.close(code=_AGAIN, reason="too many listeners")
            return
        listener = _Listener(with_static=with_static)
        listener.others.append(json.dumps(hello, allow_nan=False))
        self._listeners.add(listener)
        newest = await self._newest(with_static)
        if listener.step is None:  # else a newer one came while this one was made
            listener.step = newest
        listener.news.set()
        sender = asyncio.create_task(self._send_all(socket, listener))
        receiver = asyncio.create_task(_until_gone(socket))
        try:
            await asyncio.wait({sender, receiver}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._listeners.discard(listener)
            for task in (sender, receiver):
                task.cancel()
        if sender.done() and sender.exception() is None and sender.result():
            self.cut_off += 1
            with suppress(asyncio.TimeoutError, WebSocketDisconnect, RuntimeError):
                closing = socket.close(code=_AGAIN, reason="messages were not read in time")
                await asyncio.wait_for(closing, _CLOSE_WITHIN_S)

    async def _send_all(self, socket: WebSocket, listener: _Listener) -> bool:
        """Until the listener goes; whether it has to, because it does not read."""
        # Until Python 3.12 its cancellation can be lost, where what it waits for comes at the same time.
        while listener in self._listeners:
            try:
                await asyncio.wait_for(listener.news.wait(), PING_EVERY_S)
            except asyncio.TimeoutError:
                listener.others.append('{"type": "ping"}')
            listener.news.clear()
            if listener.is_behind:
                return True
            try:
                while listener.others:
                    await asyncio.wait_for(socket.send_text(listener.others.popleft()), SEND_WITHIN_S)
                made, listener.step = listener.step, None
                if made is not None and not made.is_fresh:  # it waited for a listener that reads slowly
                    made = await self._newest(listener.with_static)
                if made is not None:
                    await asyncio.wait_for(socket.send_text(made.text), SEND_WITHIN_S)
            except asyncio.TimeoutError:
                return True
            except (WebSocketDisconnect, RuntimeError):
                return False
        return False


def pause_s(listeners: int) -> float:
    """From one step to the next."""
    return max(1.0 / STEPS_PER_S, listeners / MESSAGES_PER_S)


async def _until_gone(socket: WebSocket) -> None:
    """What listeners say is ignored."""
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return
