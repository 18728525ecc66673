"""Our end of a link to one vehicle: holds conversations, and remembers what it says besides."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from typing import TypeVar

from crowdfence.fence_sync.conversation import Clock, Conversation, Patience
from crowdfence.fence_sync.fence_error import FenceError
from crowdfence.fence_sync.mavlink_codec import Heard, MavlinkCodec
from crowdfence.fence_sync.messages import (
    Autopilot,
    Geofence,
    Heartbeat,
    Home,
    Message,
    Position,
    StatusText,
    Version,
)
from crowdfence.fence_sync.transport import Transport

HEARTBEAT_S = 1.0
SEVERAL_VEHICLES_S = 1.5
"""After the first heartbeat, because every vehicle sends one a second."""
_AUTOPILOT_COMPONENT = 1
_MOST_TEXTS = 200

T = TypeVar("T")


@dataclass(slots=True)
class Vehicle:
    """What is known of the vehicle, as it says it."""

    system: int
    component: int
    autopilot: int
    armed: bool = False
    heard_s: float = 0.0
    position: Position | None = None
    position_s: float = float("-inf")
    home: Home | None = None
    geofence: Geofence | None = None
    """None where it says nothing of it."""
    uid: str = ""
    strangers: set[str] = field(default_factory=set)
    """Numbers of others that answer under its system id."""
    texts: deque[StatusText] = field(default_factory=lambda: deque(maxlen=_MOST_TEXTS))

    @property
    def name(self) -> str:
        kind = {Autopilot.PX4: "PX4", Autopilot.ARDUPILOT: "ArduPilot"}.get(
            self.autopilot,  # type: ignore[call-overload]
            f"autopilot {self.autopilot}",
        )
        return f"vehicle {self.system} ({kind})"


class GroundStation:
    """Talks to one vehicle; only what that one says, to us or to all, is heard."""

    def __init__(
        self, transport: Transport, *, clock: Clock = time.monotonic, patience: Patience | None = None
    ) -> None:
        self.clock = clock
        self.patience = Patience() if patience is None else patience
        self._transport = transport
        self._codec = MavlinkCodec()
        self._heard: deque[Heard] = deque()
        self._beat_s = float("-inf")
        self._vehicle: Vehicle | None = None

    @property
    def vehicle(self) -> Vehicle:
        """FenceError before `find_vehicle` found it."""
        if self._vehicle is None:
            raise FenceError("no vehicle was looked for yet")
        return self._vehicle

    def find_vehicle(self, timeout_s: float, system: int | None = None) -> Vehicle:
        """Wait for a heartbeat, of the vehicle with a system id or of the only one. FenceError where none is
        heard, or several are and none was chosen."""
        found: dict[int, Heard] = {}
        end_s = self.clock() + timeout_s
        while (heard := self._next_heard(end_s)) is not None:
            message = heard.message
            if not isinstance(message, Heartbeat) or not _is_autopilot(heard, message):
                continue
            if not found and system is None:
                end_s = self.clock() + SEVERAL_VEHICLES_S
            found[heard.system] = heard
            if heard.system == system:
                break
        self._vehicle = _chosen(found, system, timeout_s)
        self._vehicle.heard_s = self.clock()
        return self._vehicle

    def hold(self, conversation: Conversation[T]) -> T:
        """Hold a conversation to its end; its errors are those of the conversation."""
        vehicle = self.vehicle
        try:
            waiting = next(conversation)
            while True:
                for message in waiting.say:
                    self._transport.send(self._codec.packet(message, vehicle.system, vehicle.component))
                waiting = conversation.send(self._next(waiting.until_s))
        except StopIteration as end:
            result: T = end.value
            return result

    def listen(self, duration_s: float) -> None:
        """Hear what the vehicle says by itself."""
        until_s = self.clock() + duration_s
        while self._next(until_s) is not None:
            pass

    def reconnect(self) -> None:
        """Open a link anew that broke with an OSError; the vehicle is to be heard again first. OSError."""
        self._heard.clear()
        self.vehicle.heard_s = float("-inf")
        self._transport.reopen()

    def close(self) -> None:
        self._transport.close()

    def _next(self, until_s: float) -> Message | None:
        """The next thing that the vehicle says, None when it says nothing until then."""
        vehicle = self.vehicle
        while (heard := self._next_heard(until_s)) is not None:
            if (heard.system, heard.component) != (vehicle.system, vehicle.component):
                continue
            if heard.to_system not in (0, self._codec.system):
                continue
            if heard.to_component not in (0, self._codec.component):
                continue
            _note(vehicle, heard.message, self.clock())
            return heard.message
        return None

    def _next_heard(self, until_s: float) -> Heard | None:
        while True:
            self._beat()
            left_s = until_s - self.clock()
            if left_s <= 0.0:
                return None
            if self._heard:
                return self._heard.popleft()
            data = self._transport.receive(min(left_s, HEARTBEAT_S))
            if data is not None:
                self._heard.extend(self._codec.messages(data))

    def _beat(self) -> None:
        if self.clock() - self._beat_s >= HEARTBEAT_S:
            self._beat_s = self.clock()
            self._transport.send(self._codec.packet(Heartbeat(Autopilot.INVALID), 0, 0))


def _is_autopilot(heard: Heard, heartbeat: Heartbeat) -> bool:
    return heartbeat.autopilot != Autopilot.INVALID and heard.component == _AUTOPILOT_COMPONENT


def _chosen(found: dict[int, Heard], system: int | None, timeout_s: float) -> Vehicle:
    if system is None and len(found) > 1:
        names = ", ".join(map(str, sorted(found)))
        raise FenceError(f"vehicles {names} are on this link; choose one with --system")
    if (system is not None and system not in found) or not found:
        others = "" if not found else f", only of {', '.join(map(str, sorted(found)))}"
        raise FenceError(
            f"no heartbeat of {'a vehicle' if system is None else f'vehicle {system}'} was heard in "
            f"{timeout_s:g} s{others}; check --link, and that the vehicle is on"
        )
    heard = next(iter(found.values())) if system is None else found[system]
    assert isinstance(heard.message, Heartbeat)
    return Vehicle(heard.system, heard.component, heard.message.autopilot, heard.message.armed)


def _note(vehicle: Vehicle, message: Message, now_s: float) -> None:
    vehicle.heard_s = now_s
    if isinstance(message, Heartbeat):
        vehicle.armed = message.armed
    elif isinstance(message, Position):
        vehicle.position, vehicle.position_s = message, now_s
    elif isinstance(message, Home):
        vehicle.home = message
    elif isinstance(message, Geofence):
        vehicle.geofence = message
    elif isinstance(message, Version):
        if vehicle.uid and message.uid not in ("", vehicle.uid):
            vehicle.strangers.add(message.uid)
        else:
            vehicle.uid = message.uid or vehicle.uid
    elif isinstance(message, StatusText):
        vehicle.texts.append(message)
