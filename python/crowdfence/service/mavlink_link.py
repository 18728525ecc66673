"""MAVLink over UDP through pymavlink (extra `mavlink`): what autopilots send to us, and what we ask them.

Autopilots, or a router such as mavlink-router, send to an address of ours. We answer with a heartbeat,
because some send nothing to a silent listener, ask for the time (TIMESYNC) and, until it is known, for the
home.
"""

from __future__ import annotations

import hashlib
import ipaddress
import logging
import socket
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from threading import Event, Thread
from typing import Any

from crowdfence.service.clock import Clock
from crowdfence.service.telemetry import Telemetry

_LOG = logging.getLogger(__name__)
_OUR_SYSTEM, _OUR_COMPONENT = 254, 191
"""Not those of a ground station, so that both can talk to one vehicle; MAV_COMP_ID_ONBOARD_COMPUTER."""
_AUTOPILOT = 1
_ONBOARD_CONTROLLER, _NO_AUTOPILOT, _ACTIVE = 18, 8, 4
_REQUEST_MESSAGE, _HOME_POSITION = 512, 242
_ASK_EVERY_S = 1.0
_HOME_AGAIN_S = 20.0
"""Home is set anew where a drone takes off again, and what it says of that may be lost on its way."""
_HANDOVER_S = 3.0
"""A second sender is heard once the first one has been silent for so long."""
_MOST_DOUBLES = 100
_LISTEN_S = 0.2
_SIGNING_EPOCH_S = 1_420_070_400
"""2015, from which MAVLink counts the stamps of signatures."""


@dataclass(frozen=True, slots=True)
class TelemetryAddress:
    """Where the telemetry of one drone arrives."""

    drone: str
    host: str
    port: int
    system: int | None = None
    """MAVLink system id; None: the first autopilot that is heard there."""

    @classmethod
    def parse(cls, text: str) -> TelemetryAddress:
        """From DRONE=udp:HOST:PORT[:SYSTEM]. ValueError."""
        drone, _, address = text.partition("=")
        kind, *parts = address.split(":")
        try:
            if not drone or kind != "udp" or len(parts) not in (2, 3):
                raise ValueError
            ipaddress.ip_address(parts[0])
            numbers = [int(part) for part in parts[1:]]
            if not 0 <= numbers[0] <= 65535 or not all(1 <= number <= 255 for number in numbers[1:]):
                raise ValueError
        except ValueError:
            raise ValueError(
                f"--mavlink {text!r} must be DRONE=udp:ADDRESS:PORT[:SYSTEM], such as "
                "uav1=udp:127.0.0.1:14550"
            ) from None
        return cls(drone, parts[0], *numbers)

    def check(self, *, has_key: bool) -> None:
        """ValueError for an address of other machines without a key: poses move zones, and whoever reaches
        the port could tell them."""
        if not (has_key or ipaddress.ip_address(self.host).is_loopback):
            raise ValueError(
                f"--mavlink {self.drone}=udp:{self.host}:{self.port} can be reached by other machines, which "
                "could tell wrong poses: have the autopilot sign (MAVLink 2 signing) and give --mavlink-key "
                "FILE, or let a router on this machine send to 127.0.0.1"
            )


def check_ports(addresses: Sequence[TelemetryAddress]) -> None:
    """ValueError for drones on one port that nothing tells apart: whose poses are whose would follow from who
    speaks first."""
    by_port: dict[tuple[str, int], list[TelemetryAddress]] = {}
    for one in addresses:
        by_port.setdefault((one.host, one.port), []).append(one)
    for (host, port), here in by_port.items():
        systems = [one.system for one in here]
        if len(here) > 1 and (None in systems or len(set(systems)) < len(here)):
            raise ValueError(
                f"--mavlink: {' and '.join(one.drone for one in here)} share the port {host}:{port}: give "
                f"each its own MAVLink system id there, such as {here[0].drone}=udp:{host}:{port}:1"
            )


class MavlinkLink:
    """One socket and the drones that send to it. OSError where it cannot listen, ModuleNotFoundError without
    pymavlink."""

    def __init__(
        self,
        host: str,
        port: int,
        drones: Mapping[str, tuple[int | None, Telemetry]],
        clock: Clock,
        *,
        key: str | None = None,
    ) -> None:
        """`drones`: system id, or None, and telemetry by name; `key`: pass phrase of the signatures."""
        from pymavlink.dialects.v20 import common

        self._clock = clock
        self._telemetry = {name: telemetry for name, (_, telemetry) in drones.items()}
        self._systems = {name: system for name, (system, _) in drones.items()}
        self._by_first = next((name for name, system in self._systems.items() if system is None), None)
        """Drone whose system id nobody said: it is that of the first autopilot that is heard."""
        self._senders: dict[int, Any] = {}
        """Where the packets of a system's autopilot came from."""
        self._heard: dict[tuple[int, int], tuple[Any, float]] = {}
        """Who speaks for a component of a system, and when last, by a steady clock."""
        self._doubles: dict[tuple[int, int, Any], float] = {}
        """Those that spoke while another one did, and since when."""
        self._home_asked_s: dict[str, float] = {}
        self._mavlink = common.MAVLink(None, srcSystem=_OUR_SYSTEM, srcComponent=_OUR_COMPONENT)
        self._mavlink.robust_parsing = True
        if key is not None:
            signing = self._mavlink.signing
            signing.secret_key = hashlib.sha256(key.encode()).digest()
            signing.timestamp = int((time.time() - _SIGNING_EPOCH_S) * 1e5)
            signing.sign_outgoing = True
        self._socket = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError:
            self._socket.close()
            raise
        self._socket.settimeout(_LISTEN_S)
        self.port: int = self._socket.getsockname()[1]
        self._stopping = Event()
        self._thread = Thread(target=self._listen, name="mavlink", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stopping.set()
        self._thread.join()
        self._socket.close()

    def _listen(self) -> None:
        asked_s = 0.0
        while not self._stopping.is_set():
            try:
                with suppress(TimeoutError):
                    self._take(*self._socket.recvfrom(65536))
                if time.monotonic() - asked_s > _ASK_EVERY_S:
                    asked_s = time.monotonic()
                    self._ask()
            except Exception:  # one message, or a network that is down for a moment, must not end all poses
                _LOG.exception("telemetry at port %d could not be taken; it goes on", self.port)
                self._stopping.wait(_LISTEN_S)

    def _take(self, packet: bytes, sender: Any) -> None:
        now_ns = self._clock.now_ns()
        try:
            messages = self._mavlink.parse_buffer(packet) or []
        except Exception as error:  # whatever the library meets in what strangers send
            _LOG.warning("a packet is no MAVLink: %s", error)
            return
        for message in messages:
            if message.get_type() == "BAD_DATA":
                continue
            drone = self._drone_of(message)
            if drone is None or self._is_double(message, sender, drone):
                continue
            telemetry, system = self._telemetry[drone], message.get_srcSystem()
            # Of the autopilot, not of its gimbal; of anybody who is there before it.
            if system not in self._senders or telemetry.is_autopilot(message.get_srcComponent()):
                self._senders[system] = sender
            if message.get_type() == "TIMESYNC":
                if message.tc1 > 0:
                    telemetry.answered(message.ts1, message.tc1, now_ns, message.get_srcComponent())
                continue
            telemetry.heard(message, now_ns)

    def _is_double(self, message: Any, sender: Any, drone: str) -> bool:
        """Whether somebody else speaks for this component: a second drone of the same system id, whose poses
        would mix with those of the first, or a second way of the same one, not needed while the first works.
        """
        who, now_s = (message.get_srcSystem(), message.get_srcComponent()), time.monotonic()
        known, heard_s = self._heard.get(who, (sender, now_s))
        if known == sender or now_s - heard_s > _HANDOVER_S:
            self._heard[who] = sender, now_s
            return False
        telemetry, double = self._telemetry[drone], (*who, sender)
        # One that was started anew speaks from elsewhere, but not beside the one before.
        is_lasting = now_s - self._doubles.get(double, now_s) > 2.0 * _HANDOVER_S
        if is_lasting and telemetry.is_autopilot(who[1]):
            telemetry.confused = (
                f"two senders speak as system {who[0]} at the port of {drone}: one is heard, and as soon as "
                "it falls silent the other is taken for it; give drones system ids of their own "
                "(MAV_SYS_ID of PX4, SYSID_THISMAV of ArduPilot), or acknowledge this where they are two "
                "ways of one drone"
            )
        if double not in self._doubles and len(self._doubles) < _MOST_DOUBLES:
            self._doubles[double] = now_s
            _LOG.warning(
                "system %d, component %d speaks from %s and from %s: only the first is heard while it does; "
                "drones need system ids of their own",
                *who,
                known,
                sender,
            )
        return True

    def _drone_of(self, message: Any) -> str | None:
        """By system id; the first autopilot that is heard becomes that of a drone without one."""
        system = message.get_srcSystem()
        for name, known in self._systems.items():
            if known == system:
                return name
        if message.get_type() != "GLOBAL_POSITION_INT":
            return None
        for name, known in self._systems.items():
            if known is None:
                self._systems[name] = system
                _LOG.info("telemetry", extra={"drone": name, "system": system})
                return name
        if self._by_first is not None:
            taken = self._systems[self._by_first]
            self._telemetry[self._by_first].confused = (
                f"autopilots with the system ids {taken} and {system} speak at the port of {self._by_first}: "
                f"the poses of {taken} are taken, because it was heard first; say which is right with "
                f"--mavlink {self._by_first}=udp:ADDRESS:{self.port}:{taken}, or :{system}"
            )
        return None

    def _ask(self) -> None:
        mavlink = self._mavlink
        for name, system in self._systems.items():
            sender = self._senders.get(system or 0)
            if sender is None:
                continue
            questions = [
                mavlink.heartbeat_encode(_ONBOARD_CONTROLLER, _NO_AUTOPILOT, 0, 0, _ACTIVE),
                mavlink.timesync_encode(0, self._clock.now_ns()),
            ]
            now_s, asked_s = time.monotonic(), self._home_asked_s.get(name, float("-inf"))
            if not self._telemetry[name].knows_home or now_s - asked_s >= _HOME_AGAIN_S:
                self._home_asked_s[name] = now_s
                to = (system, _AUTOPILOT, _REQUEST_MESSAGE, 0, _HOME_POSITION)
                questions.append(mavlink.command_long_encode(*to, 0, 0, 0, 0, 0, 0))
            for question in questions:
                with suppress(OSError):  # nobody listens there any more
                    self._socket.sendto(question.pack(mavlink), sender)


def links(
    addresses: Sequence[TelemetryAddress],
    telemetry: Mapping[str, Telemetry],
    clock: Clock,
    *,
    key: str | None = None,
) -> list[MavlinkLink]:
    """One for each port; ValueError as for `TelemetryAddress.check`."""
    by_port: dict[tuple[str, int], dict[str, tuple[int | None, Telemetry]]] = {}
    for one in addresses:
        one.check(has_key=key is not None)
        there = by_port.setdefault((one.host, one.port), {})
        there[one.drone] = one.system, telemetry[one.drone]
    return [MavlinkLink(host, port, drones, clock, key=key) for (host, port), drones in by_port.items()]
