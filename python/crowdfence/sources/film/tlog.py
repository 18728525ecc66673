"""MAVLink telemetry logs (.tlog) through pymavlink (extra `mavlink`).

A record is the time of its arrival in microseconds since 1970 and a MAVLink frame. The first autopilot in it
is the drone. Times are those of the drone (time_boot_ms), laid on the arrival of its first position, so that
the delay of a radio does not shake them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from crowdfence.sources.film.flight_log import FlightLog
from crowdfence.sources.film.gimbal_turns import gimbal_turns
from crowdfence.sources.film.merged_rows import Turns, merged
from crowdfence.sources.rotation import from_yaw_pitch_roll_deg

KINDS = (
    "GLOBAL_POSITION_INT",
    "ATTITUDE",
    "ATTITUDE_QUATERNION",
    "GIMBAL_DEVICE_ATTITUDE_STATUS",
    "MOUNT_ORIENTATION",
    "HOME_POSITION",
)
"""Messages that say where a drone and its camera are."""
_LATEST_S = 2**31


def read_tlog(path: Path) -> FlightLog:
    """ValueError when the file holds no position of a drone."""
    messages = _messages(path)
    places = messages["GLOBAL_POSITION_INT"]
    if len(places) < 2:
        raise ValueError(f"{path} holds no positions (GLOBAL_POSITION_INT): no MAVLink log, or a damaged one")
    arrived_s = places[0]._timestamp
    start_ns = round(arrived_s * 1e6) * 1000 if 0 < arrived_s < _LATEST_S else None
    return log_of_messages(messages, places[0].time_boot_ms, start_ns)


def log_of_messages(messages: Mapping[str, Sequence[Any]], first_ms: int, start_ns: int | None) -> FlightLog:
    """Decoded messages by kind (`KINDS`) as a log that begins `first_ms` after the autopilot, at the stamp
    `start_ns`. ValueError when there is no position or no attitude."""
    places = messages["GLOBAL_POSITION_INT"]
    position = {
        "time_s": [(one.time_boot_ms - first_ms) / 1e3 for one in places],
        "latitude": [one.lat / 1e7 for one in places],
        "longitude": [one.lon / 1e7 for one in places],
        "sea": [one.alt / 1e3 for one in places],
        "take-off": [one.relative_alt / 1e3 for one in places],
    }

    def time_s(found: Sequence[Any]) -> list[float]:
        return [(one.time_boot_ms - first_ms) / 1e3 for one in found]

    turns = messages["ATTITUDE_QUATERNION"]
    body = Turns.of(time_s(turns), [[one.q1, one.q2, one.q3, one.q4] for one in turns])
    if body is None:
        angles = messages["ATTITUDE"]
        body = Turns.of(time_s(angles), [_turn(one.yaw, one.pitch, one.roll) for one in angles])
    homes = messages["HOME_POSITION"]
    remarks: list[str] = []
    return merged(
        position,
        {"sea": "sea", "take-off": "take-off"},
        body,
        _camera(messages, time_s, body, remarks),
        start_ns=start_ns,
        take_off=(homes[-1].latitude / 1e7, homes[-1].longitude / 1e7) if homes else None,
        remarks=remarks,
    )


def _messages(path: Path) -> dict[str, list[Any]]:
    """Messages of the first autopilot by kind."""
    from pymavlink import mavutil

    found: dict[str, list[Any]] = {kind: [] for kind in KINDS}
    system: int | None = None
    try:
        log = mavutil.mavlink_connection(str(path), robust_parsing=True)
        while (message := log.recv_match(type=list(KINDS))) is not None:
            kind, sender = message.get_type(), message.get_srcSystem()
            if system is None and kind == "GLOBAL_POSITION_INT":
                system = sender
            if system is None or sender == system:
                found[kind].append(message)
    except Exception as error:  # whatever the library meets in a damaged file
        if len(found["GLOBAL_POSITION_INT"]) < 2:
            raise ValueError(f"{path} is no MAVLink log, or damaged: {error}") from error
    return found


def _camera(
    messages: Mapping[str, Sequence[Any]], time_s: Any, body: Turns | None, remarks: list[str]
) -> Turns | None:
    gimbal = messages["GIMBAL_DEVICE_ATTITUDE_STATUS"]
    if gimbal:
        rows, flags = [one.q for one in gimbal], [one.flags for one in gimbal]
        return gimbal_turns(time_s(gimbal), rows, flags, body, remarks)
    mount = [one for one in messages["MOUNT_ORIENTATION"] if math.isfinite(one.yaw_absolute)]
    degrees = [from_yaw_pitch_roll_deg(one.yaw_absolute, one.pitch, one.roll) for one in mount]
    return Turns.of(time_s(mount), degrees)


def _turn(yaw: float, pitch: float, roll: float) -> Any:
    """Radians."""
    return from_yaw_pitch_roll_deg(math.degrees(yaw), math.degrees(pitch), math.degrees(roll))
