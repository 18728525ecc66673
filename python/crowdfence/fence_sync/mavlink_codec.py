"""Messages <-> MAVLink 2 packets, through pymavlink: the one file that needs it."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from crowdfence.fence_sync.fence_error import FenceError
from crowdfence.fence_sync.fence_item import FenceItem
from crowdfence.fence_sync.messages import (
    Ack,
    Command,
    CommandAck,
    Count,
    Geofence,
    Heartbeat,
    Home,
    Item,
    Message,
    Parameter,
    Position,
    ReadParameter,
    RequestItem,
    RequestList,
    RequestMessage,
    StatusText,
    Version,
)

OUR_SYSTEM, OUR_COMPONENT = 254, 190
"""Not the 255 of operators' ground stations: ArduPilot would not notice that the link to theirs is lost while
we speak (FS_GCS_ENABLE), and would take our list for a new beginning of one that they are writing."""
_FENCE = 1
"""MAV_MISSION_TYPE_FENCE."""
_REQUEST_MESSAGE = 512
_GEOFENCE = 0x100000
"""MAV_SYS_STATUS_GEOFENCE."""
_ARMED = 128
_REAL = (9, 10)
"""MAV_PARAM_TYPE_REAL32 and 64; the others are whole numbers."""


@dataclass(frozen=True, slots=True)
class Heard:
    """A message and who said it to whom; 0 is everybody."""

    system: int
    component: int
    to_system: int
    to_component: int
    message: Message


class MavlinkCodec:
    """One end of a link: numbers what it sends, finds packets in what it receives."""

    def __init__(self, system: int = OUR_SYSTEM, component: int = OUR_COMPONENT) -> None:
        """FenceError where pymavlink is not installed."""
        try:
            from pymavlink.dialects.v20 import common
        except ImportError as error:
            raise FenceError(
                "talking to autopilots needs pymavlink: pip install 'crowdfence[mavlink]'"
            ) from error
        self.system, self.component = system, component
        self._mavlink = common.MAVLink(None, srcSystem=system, srcComponent=component)
        self._mavlink.robust_parsing = True

    def packet(self, message: Message, system: int, component: int) -> bytes:
        """A message to a vehicle, as bytes."""
        make = _PACKETS[type(message)]
        return bytes(make(self._mavlink, message, (system, component)).pack(self._mavlink))

    def messages(self, data: bytes) -> list[Heard]:
        """What is in the bytes that arrived, as far as it is about fences; damaged packets are left out."""
        heard = []
        for packet in self._mavlink.parse_buffer(data) or []:
            read = _READERS.get(packet.get_type())
            message = None if read is None else read(packet)
            if message is not None:
                heard.append(
                    Heard(
                        packet.get_srcSystem(),
                        packet.get_srcComponent(),
                        getattr(packet, "target_system", 0),
                        getattr(packet, "target_component", 0),
                        message,
                    )
                )
        return heard


def _item_packet(mavlink: Any, message: Item, to: tuple[int, int]) -> Any:
    item = message.item
    return mavlink.mission_item_int_encode(
        *to,
        message.seq,
        item.frame,
        item.command,
        0,
        1,
        item.param1,
        item.param2,
        item.param3,
        item.param4,
        item.latitude_e7,
        item.longitude_e7,
        item.z,
        _FENCE,
    )


def _command_packet(mavlink: Any, message: Command, to: tuple[int, int]) -> Any:
    place = (round(message.latitude_deg * 1e7), round(message.longitude_deg * 1e7), message.height_m)
    return mavlink.command_int_encode(*to, 0, message.command, 0, 0, -1.0, 1.0, 0.0, math.nan, *place)


_PACKETS: dict[type, Callable[[Any, Any, tuple[int, int]], Any]] = {
    # A ground station, no autopilot, active: PX4 sends its texts to ground stations alone.
    Heartbeat: lambda mavlink, message, to: mavlink.heartbeat_encode(6, message.autopilot, 0, 0, 4),
    Count: lambda mavlink, message, to: mavlink.mission_count_encode(*to, message.count, _FENCE),
    RequestList: lambda mavlink, message, to: mavlink.mission_request_list_encode(*to, _FENCE),
    RequestItem: lambda mavlink, message, to: mavlink.mission_request_int_encode(*to, message.seq, _FENCE),
    Item: _item_packet,
    Ack: lambda mavlink, message, to: mavlink.mission_ack_encode(*to, message.result, _FENCE),
    RequestMessage: lambda mavlink, message, to: mavlink.command_long_encode(
        *to, _REQUEST_MESSAGE, 0, message.number, 0, 0, 0, 0, 0, 0
    ),
    ReadParameter: lambda mavlink, message, to: mavlink.param_request_read_encode(
        *to, message.name.encode(), -1
    ),
    Command: _command_packet,
}


def _of_fence(read: Callable[[Any], Message]) -> Callable[[Any], Message | None]:
    """Missions and rally points travel in the same packets."""
    return lambda packet: read(packet) if packet.mission_type == _FENCE else None


def _read_item(packet: Any) -> Message:
    item = FenceItem(
        packet.command,
        packet.param1,
        packet.x,
        packet.y,
        packet.param2,
        packet.param3,
        packet.param4,
        packet.z,
        packet.frame,
    )
    return Item(packet.seq, item)


def _read_parameter(packet: Any) -> Message:
    value = float(packet.param_value)
    if packet.param_type in _REAL:
        return Parameter(packet.param_id, value, value)
    return Parameter(
        packet.param_id, value, float(struct.unpack("<i", struct.pack("<f", packet.param_value))[0])
    )


def _read_version(packet: Any) -> Message:
    long_uid = bytes(packet.uid2).rstrip(b"\0").hex()
    return Version(long_uid or (f"{packet.uid:x}" if packet.uid else ""))


_READERS: dict[str, Callable[[Any], Message | None]] = {
    "HEARTBEAT": lambda packet: Heartbeat(packet.autopilot, bool(packet.base_mode & _ARMED)),
    "MISSION_COUNT": _of_fence(lambda packet: Count(packet.count)),
    "MISSION_REQUEST": _of_fence(lambda packet: RequestItem(packet.seq)),
    "MISSION_REQUEST_INT": _of_fence(lambda packet: RequestItem(packet.seq)),
    "MISSION_ITEM_INT": _of_fence(_read_item),
    "MISSION_ACK": _of_fence(lambda packet: Ack(packet.type)),
    "STATUSTEXT": lambda packet: StatusText(packet.severity, packet.text.rstrip("\0\t ")),
    "GLOBAL_POSITION_INT": lambda packet: (
        Position(packet.lat / 1e7, packet.lon / 1e7) if packet.lat or packet.lon else None
    ),
    "HOME_POSITION": lambda packet: (
        Home(packet.latitude / 1e7, packet.longitude / 1e7) if packet.latitude or packet.longitude else None
    ),
    "SYS_STATUS": lambda packet: Geofence(
        bool(packet.onboard_control_sensors_present & _GEOFENCE),
        bool(packet.onboard_control_sensors_enabled & _GEOFENCE),
    ),
    "AUTOPILOT_VERSION": _read_version,
    "PARAM_VALUE": _read_parameter,
    "COMMAND_ACK": lambda packet: CommandAck(packet.command, packet.result),
}
