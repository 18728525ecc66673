"""What a ground station and a vehicle say to each other about fences, without bytes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from crowdfence.fence_sync.fence_item import FenceItem


class MissionResult(IntEnum):
    """MAV_MISSION_RESULT."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    OPERATION_CANCELLED = 15


class Autopilot(IntEnum):
    """MAV_AUTOPILOT, those whose fences are known."""

    ARDUPILOT = 3
    INVALID = 8
    """Not an autopilot: ground stations, cameras."""
    PX4 = 12


POSITION_MESSAGE = 33
"""Number of GLOBAL_POSITION_INT."""
VERSION_MESSAGE = 148
HOME_MESSAGE = 242


@dataclass(frozen=True, slots=True)
class Heartbeat:
    autopilot: int
    armed: bool = False


@dataclass(frozen=True, slots=True)
class Count:
    """So many items follow; replaces the whole list."""

    count: int


@dataclass(frozen=True, slots=True)
class RequestList:
    pass


@dataclass(frozen=True, slots=True)
class RequestItem:
    seq: int


@dataclass(frozen=True, slots=True)
class Item:
    seq: int
    item: FenceItem


@dataclass(frozen=True, slots=True)
class Ack:
    result: int
    """A `MissionResult`, or a number that is none."""


@dataclass(frozen=True, slots=True)
class StatusText:
    severity: int
    """MAV_SEVERITY: 0 emergency to 7 debug."""
    text: str


@dataclass(frozen=True, slots=True)
class Position:
    """Where the vehicle is."""

    latitude_deg: float
    longitude_deg: float


@dataclass(frozen=True, slots=True)
class Home:
    """Where it returns to."""

    latitude_deg: float
    longitude_deg: float


@dataclass(frozen=True, slots=True)
class Geofence:
    """What a vehicle says by itself of its fence (SYS_STATUS)."""

    present: bool
    enabled: bool


@dataclass(frozen=True, slots=True)
class Version:
    """Which vehicle it is."""

    uid: str


@dataclass(frozen=True, slots=True)
class RequestMessage:
    number: int


@dataclass(frozen=True, slots=True)
class ReadParameter:
    name: str


@dataclass(frozen=True, slots=True)
class Parameter:
    name: str
    value: float
    """As ArduPilot sends whole numbers, as floats."""
    value_of_bytes: float
    """As PX4 sends them: their bytes, where the float belongs."""


@dataclass(frozen=True, slots=True)
class Command:
    """MAV_CMD to a place."""

    command: int
    latitude_deg: float
    longitude_deg: float
    height_m: float


@dataclass(frozen=True, slots=True)
class CommandAck:
    command: int
    result: int
    """MAV_RESULT, 0 accepted."""


Message = (
    Heartbeat
    | Count
    | RequestList
    | RequestItem
    | Item
    | Ack
    | StatusText
    | Position
    | Home
    | Geofence
    | Version
    | RequestMessage
    | ReadParameter
    | Parameter
    | Command
    | CommandAck
)


def result_name(result: int) -> str:
    return MissionResult(result).name if result in MissionResult._value2member_map_ else f"result {result}"
