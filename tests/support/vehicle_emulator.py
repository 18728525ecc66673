"""A vehicle's end of the fence protocol, as a real PX4 v1.12 was measured to do it, on pymavlink's own codec.

It takes a list when its last item has arrived, holds 63 items, takes commands that are no fences, refuses a
polygon of two corners, accepts a reposition into a fence with an answer and refuses it with a text, and says
nothing of shapes that hold the vehicle or its home, which it does not keep.

What it does with packets that are lost, come twice or out of order is what the sources of PX4
(mavlink_mission.cpp) and of ArduPilot (MissionItemProtocol.cpp) do.
"""

import math
import random
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import product

import numpy as np
import shapely
from pymavlink.dialects.v20 import common as mavlink

from crowdfence.great_circle import great_circle_m

FENCE = mavlink.MAV_MISSION_TYPE_FENCE
PX4, ARDUPILOT = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
POLYGONS = (
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
)
CIRCLE = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
CAPABILITIES = mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
RETRY_S = 0.25
GIVE_UP_S = 5.0
PX4_SPHERE_M = 6_371_000.0

RawItem = tuple[int, float, int, int]
"""command, param1, latitude and longitude in 1e-7 degrees."""


def polygon(*corners: tuple[float, float], command: int = POLYGONS[1]) -> list[RawItem]:
    """Corners (latitude, longitude)."""
    return [(command, float(len(corners)), round(a * 1e7), round(b * 1e7)) for a, b in corners]


def closes(items: list[RawItem], latitude: float, longitude: float) -> list[int]:
    """Where the exclusion shapes begin that hold a place, as PX4 works it out."""
    found, start = [], 0
    while start < len(items):
        command, param1, north, east = items[start]
        size = int(param1) if command in POLYGONS else 1
        if command == POLYGONS[1]:
            ring = shapely.Polygon([(one[3] / 1e7, one[2] / 1e7) for one in items[start : start + size]])
            is_in = ring.intersects(shapely.Point(longitude, latitude))
        else:
            place = (np.array([longitude]), np.array([latitude]))
            distance_m = great_circle_m((east / 1e7, north / 1e7), *place, sphere_m=PX4_SPHERE_M)[0]
            is_in = command == CIRCLE and distance_m <= param1
        if is_in:
            found.append(start)
        start += size
    return found


@dataclass
class EmulatedVehicle:
    """Bytes and time in, packets out."""

    system: int = 1
    component: int = 1
    autopilot: int = PX4
    capacity: int = 63
    storage_bytes: int | None = None
    """ArduPilot's bound, by bytes."""
    position: tuple[float, float] | None = (47.3977, 8.5456)
    home: tuple[float, float] | None = (47.3977, 8.5456)
    uid: int = 0x1234
    armed: bool = True
    mute: bool = False
    geofence: tuple[bool, bool] | None = None
    """Present and enabled, as ArduPilot says it."""
    rejects: int | None = None
    """MAV_MISSION_RESULT of every upload."""
    says: str | None = None
    """After an upload that was accepted."""
    in_place: bool = False
    """Older PX4 (v1.12): items overwrite those that stand there as they come, and the number of them changes
    with the last one."""
    parameters: dict[str, int] = field(default_factory=lambda: {"GF_ACTION": 2})
    items: list[RawItem] = field(default_factory=list)
    lists: list[list[RawItem]] = field(default_factory=list)
    """Every list that was taken."""
    moved_to: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        self.out: list[bytes] = []
        self._mavlink = mavlink.MAVLink(None, srcSystem=self.system, srcComponent=self.component)
        self._mavlink.robust_parsing = True
        self._expected: int | None = None
        self._count = 0
        self._coming: list[RawItem] = []
        self._asked_s = self._begun_s = 0.0
        self._sending: int | None = None
        """Of PX4: the item that is read next, from the first word to the last one."""
        self._beat_s = -math.inf
        self._peer = (0, 0)

    def tick(self, now_s: float) -> None:
        """What it says by itself."""
        if self.mute:
            return
        if now_s < self._beat_s:  # another link, whose clock begins anew
            self._beat_s = self._begun_s = self._asked_s = -math.inf
        if now_s - self._beat_s >= 1.0:
            self._beat_s = now_s
            mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
            self._say(self._mavlink.heartbeat_encode(2, self.autopilot, mode, 0, 4))
            if self.position is not None:
                self._say(self._position_packet())
            if self.geofence is not None:
                bits = [mavlink.MAV_SYS_STATUS_GEOFENCE * one for one in self.geofence]
                self._say(self._mavlink.sys_status_encode(*bits, bits[0], 0, 0, 0, 0, 0, 0, 0, 0, 0, 0))
        if now_s - self._begun_s > GIVE_UP_S:
            self._expected = self._sending = None
        if self._expected is not None and now_s - self._asked_s >= RETRY_S:
            self._request(now_s)

    def receive(self, data: bytes, now_s: float) -> None:
        for packet in self._mavlink.parse_buffer(data) or []:
            if getattr(packet, "target_system", 0) not in (0, self.system) or self.mute:
                continue
            self._peer = (packet.get_srcSystem(), packet.get_srcComponent())
            handler: Callable[[object, float], None] | None = getattr(
                self, f"_on_{packet.get_type().lower()}", None
            )
            if handler is not None and getattr(packet, "mission_type", FENCE) == FENCE:
                handler(packet, now_s)

    def text(self, words: str, severity: int = mavlink.MAV_SEVERITY_WARNING) -> None:
        self._say(self._mavlink.statustext_encode(severity, words.encode()))

    @property
    def is_taking_a_list(self) -> bool:
        """Between the first word of a list and its last item."""
        return self._expected is not None

    @property
    def kept(self) -> list[int]:
        """Where the shapes begin that PX4 keeps: those that hold neither the vehicle nor its home."""
        dropped = {
            start for place in (self.position, self.home) if place for start in closes(self.items, *place)
        }
        starts, at = [], 0
        while at < len(self.items):
            starts.append(at)
            at += int(self.items[at][1]) if self.items[at][0] in POLYGONS else 1
        return [start for start in starts if start not in dropped]

    def _say(self, packet: object) -> None:
        self.out.append(bytes(packet.pack(self._mavlink)))  # type: ignore[attr-defined]

    def _ack(self, result: int) -> None:
        self._say(self._mavlink.mission_ack_encode(*self._peer, result, FENCE))

    def _request(self, now_s: float) -> None:
        self._asked_s = now_s
        self._say(self._mavlink.mission_request_int_encode(*self._peer, self._expected, FENCE))

    def _on_mission_count(self, packet: object, now_s: float) -> None:
        count = packet.count  # type: ignore[attr-defined]
        if self.rejects is not None:
            return self._ack(self.rejects)
        if self.autopilot == PX4 and (self._sending is not None or self._expected):
            self.text("WPM: IGN MISSION_COUNT: Busy")
            return self._ack(mavlink.MAV_MISSION_ERROR)
        if count > self.capacity:
            return self._ack(mavlink.MAV_MISSION_NO_SPACE)
        if count == 0:
            self._take([])
            return self._ack(mavlink.MAV_MISSION_ACCEPTED)
        if self._expected is None or self.autopilot != PX4:
            self._expected, self._count, self._coming = 0, count, []
        self._begun_s = now_s
        return self._request(now_s)

    def _on_mission_item_int(self, packet: object, now_s: float) -> None:
        seq = packet.seq  # type: ignore[attr-defined]
        if self._expected is None:
            is_last_again = self.autopilot == PX4 and self._sending is None and seq + 1 == len(self._coming)
            return self._ack(mavlink.MAV_MISSION_ACCEPTED if is_last_again else mavlink.MAV_MISSION_ERROR)
        if seq != self._expected:
            if self.autopilot == ARDUPILOT:
                self._ack(mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return None
        self._coming.append((packet.command, packet.param1, packet.x, packet.y))  # type: ignore[attr-defined]
        if self.in_place and seq < len(self.items):
            self.items = [*self.items[:seq], self._coming[seq], *self.items[seq + 1 :]]
        self._expected, self._begun_s = self._expected + 1, now_s
        if self._expected < self._count:
            return self._request(now_s)
        self._expected = None
        result = self._checked(self._coming)
        if result == mavlink.MAV_MISSION_ACCEPTED:
            self._take(self._coming)
        self._ack(result)
        if result == mavlink.MAV_MISSION_ACCEPTED and self.says:
            self.text(self.says)
        return None

    def _take(self, items: list[RawItem]) -> None:
        self.items = items
        self.lists.append(items)

    def _checked(self, items: list[RawItem]) -> int:
        at, size_bytes = 0, 5
        while at < len(items):
            command, param1, _, _ = items[at]
            size = int(param1) if command in POLYGONS else 1
            if command in POLYGONS and size < 3:
                self.text("Fence: too few vertices")
                return mavlink.MAV_MISSION_ERROR
            if {(one[0], one[1]) for one in items[at : at + size]} != {(command, param1)}:
                return mavlink.MAV_MISSION_ERROR
            size_bytes += 2 + 8 * size if command in POLYGONS else 13
            at += size
        if at != len(items):
            return mavlink.MAV_MISSION_ERROR
        if self.storage_bytes is not None and size_bytes > self.storage_bytes:
            self.text("Fence exceeds storage size")
            return mavlink.MAV_MISSION_ERROR
        return mavlink.MAV_MISSION_ACCEPTED

    def _on_mission_request_list(self, packet: object, now_s: float) -> None:
        if self._expected is not None:
            if self.autopilot == ARDUPILOT:
                self._ack(mavlink.MAV_MISSION_DENIED)
            return
        if self.autopilot == PX4:
            self._sending, self._begun_s = 0, now_s
        self._say(self._mavlink.mission_count_encode(*self._peer, len(self.items), FENCE))

    def _on_mission_ack(self, packet: object, now_s: float) -> None:
        self._sending = None

    def _on_mission_request_int(self, packet: object, now_s: float) -> None:
        seq = packet.seq  # type: ignore[attr-defined]
        if self.autopilot == PX4:
            if self._sending is None:
                return
            if seq not in (self._sending - 1, self._sending) or seq >= len(self.items):
                self._sending = None
                self.text("WPM: REJ. CMD: Req. WP was unexpected")
                return self._ack(mavlink.MAV_MISSION_ERROR)
            self._sending, self._begun_s = seq + 1, now_s
        if seq >= len(self.items):
            return
        command, param1, north, east = self.items[seq]
        self._say(
            self._mavlink.mission_item_int_encode(
                *self._peer, seq, 0, command, 0, 1, param1, 0, 0, 0, north, east, 0, FENCE
            )
        )

    def _on_mission_clear_all(self, packet: object, now_s: float) -> None:
        self._take([])
        self._ack(mavlink.MAV_MISSION_ACCEPTED)

    def _on_param_request_read(self, packet: object, now_s: float) -> None:
        name = packet.param_id  # type: ignore[attr-defined]
        if name not in self.parameters:
            return
        value: float = self.parameters[name]
        if self.autopilot == PX4:  # the bytes of the whole number
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        self._say(
            self._mavlink.param_value_encode(name.encode(), value, mavlink.MAV_PARAM_TYPE_INT32, 100, 0)
        )

    def _on_command_long(self, packet: object, now_s: float) -> None:
        number = packet.param1  # type: ignore[attr-defined]
        if packet.command != mavlink.MAV_CMD_REQUEST_MESSAGE:  # type: ignore[attr-defined]
            return self._command_ack(packet.command, mavlink.MAV_RESULT_UNSUPPORTED)  # type: ignore[attr-defined]
        self._command_ack(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_RESULT_ACCEPTED)
        if number == mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT and self.position is not None:
            self._say(self._position_packet())
        if number == mavlink.MAVLINK_MSG_ID_HOME_POSITION and self.home is not None:
            north, east = (round(value * 1e7) for value in self.home)
            self._say(self._mavlink.home_position_encode(north, east, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))
        if number == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            self._say(
                self._mavlink.autopilot_version_encode(
                    CAPABILITIES, 0, 0, 0, 0, bytes(8), bytes(8), bytes(8), 0, 0, self.uid, bytes(18)
                )
            )
        return None

    def _on_command_int(self, packet: object, now_s: float) -> None:
        """Accepted, whatever becomes of it."""
        place = (packet.x / 1e7, packet.y / 1e7)  # type: ignore[attr-defined]
        self._command_ack(packet.command, mavlink.MAV_RESULT_ACCEPTED)  # type: ignore[attr-defined]
        if closes(self.items, *place):
            self.text("Reposition is outside geofence")
        else:
            self.moved_to = place

    def _command_ack(self, command: int, result: int) -> None:
        self._say(self._mavlink.command_ack_encode(command, result))

    def _position_packet(self) -> object:
        assert self.position is not None
        north, east = (round(value * 1e7) for value in self.position)
        return self._mavlink.global_position_int_encode(0, north, east, 500_000, 30_000, 0, 0, 0, 0)


@dataclass
class Channel:
    """What a radio does to packets: each may be lost, come twice, or come late."""

    seed: int = 0
    lose: float = 0.0
    twice: float = 0.0
    late: float = 0.0
    delay_s: float = 0.002
    late_s: float = 0.3

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)

    def arrivals(self, now_s: float) -> list[float]:
        """When a packet that is sent now arrives, each time that it does."""
        if self._random.random() < self.lose:
            return []
        times = [now_s + self.delay_s]
        if self._random.random() < self.twice:
            times.append(now_s + self.delay_s + self._random.uniform(0.0, self.late_s))
        if self._random.random() < self.late:
            times[0] += self._random.uniform(0.0, self.late_s)
        return times


class EmulatedLink:
    """Both ends in one thread, on a clock of its own: nothing waits, every run is the same."""

    def __init__(self, *vehicles: EmulatedVehicle, channel: Channel | None = None) -> None:
        self.vehicles = vehicles
        self.now_s = 0.0
        self._channel = Channel() if channel is None else channel
        self._flying: list[tuple[float, int, EmulatedVehicle | None, bytes]] = []
        self._number = 0
        self.before_receive: Callable[[], None] = lambda: None
        self.broken_until_s: float | None = None
        """While it is not None everything fails; from then on it can be opened again."""

    def clock(self) -> float:
        return self.now_s

    def send(self, data: bytes) -> None:
        self._check()
        for vehicle in self.vehicles:
            self._launch(vehicle, data)

    def receive(self, timeout_s: float) -> bytes | None:
        self._check()
        end_s = self.now_s + timeout_s
        while True:
            self.before_receive()
            for vehicle in self.vehicles:
                vehicle.tick(self.now_s)
                self._collect(vehicle)
            next_s = min([one[0] for one in self._flying] + [self.now_s + 0.05])
            if next_s > end_s:
                self.now_s = end_s
                return None
            self.now_s = max(self.now_s, next_s)
            for data in self._landed():
                return data

    def reopen(self) -> None:
        if self.broken_until_s is not None and self.now_s >= self.broken_until_s:
            self.broken_until_s = None
        self._check()

    def close(self) -> None:
        pass

    def _check(self) -> None:
        if self.broken_until_s is not None:
            raise ConnectionError("the other end closed the link")

    def _landed(self) -> Iterator[bytes]:
        """What has come to the ground station; what has come to a vehicle is given to it."""
        due = sorted(one for one in self._flying if one[0] <= self.now_s)
        for one in due:
            self._flying.remove(one)
            _, _, vehicle, data = one
            if vehicle is None:
                yield data
                return
            vehicle.receive(data, self.now_s)
            self._collect(vehicle)

    def _collect(self, vehicle: EmulatedVehicle) -> None:
        packets, vehicle.out = vehicle.out, []
        for packet in packets:
            self._launch(None, packet)

    def _launch(self, to: EmulatedVehicle | None, data: bytes) -> None:
        for arrival_s in self._channel.arrivals(self.now_s):
            self._number += 1
            self._flying.append((arrival_s, self._number, to, data))


class UdpVehicle:
    """The same behind a real UDP socket on loopback; it answers whoever spoke last."""

    def __init__(self, vehicle: EmulatedVehicle, calls: int | None = None) -> None:
        """`calls` is a port to which it speaks first; else it waits to be spoken to."""
        self.vehicle = vehicle
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.02)
        self.port: int = self._socket.getsockname()[1]
        self._peers = set() if calls is None else {("127.0.0.1", calls)}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "UdpVehicle":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                data, peer = self._socket.recvfrom(4096)
                self._peers.add(peer)
                self.vehicle.receive(data, time.monotonic())
            except OSError:
                pass
            self.vehicle.tick(time.monotonic())
            packets, self.vehicle.out = self.vehicle.out, []
            for packet, peer in product(packets, self._peers):
                with suppress(OSError):  # nobody listens there any more
                    self._socket.sendto(packet, peer)
