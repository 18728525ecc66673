"""MAVLink telemetry logs (.tlog) through pymavlink (extra `mavlink`).

A record is the time of its arrival in microseconds since 1970 and a MAVLink frame. The first autopilot in it
is the drone. Times are those of the drone (time_boot_ms), laid on the arrival of its first position, once per
start of the autopilot (`boots`).
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from statistics import median
from typing import Any

from crowdfence.errors import one_line
from crowdfence.sources.film.boots import PLACE, Boot, boots_of
from crowdfence.sources.film.flight_log import FlightLog
from crowdfence.sources.film.gimbal_turns import gimbal_turns, one_gimbal
from crowdfence.sources.film.merged_rows import Turns, merged
from crowdfence.sources.film.receivers import ADRIFT, RECEIVERS, Receivers
from crowdfence.sources.rotation import from_yaw_pitch_roll_deg

KINDS = (
    PLACE,
    "ATTITUDE",
    "ATTITUDE_QUATERNION",
    "GIMBAL_DEVICE_ATTITUDE_STATUS",
    "MOUNT_ORIENTATION",
    "HOME_POSITION",
)
"""Messages that say where a drone and its camera are."""
_LATEST_S = 2**31
_METRES_PER_E7 = 0.01113
"""Of a great circle, in degrees of 1e-7."""
_SAME_HOME_M = 10.0
"""Homes no further apart are one: a receiver tells the same place anew by some metres."""
_SAME_HEIGHT_M = 5.0
"""The same of their heights, with what barometers drift by."""


def read_tlog(path: Path) -> FlightLog:
    """ValueError when the file holds no position of a drone."""
    remarks: list[str] = []
    messages = _messages(path, remarks)
    boots = boots_of(messages, KINDS, remarks)
    arrived_s = boots[0].arrived_s
    start_ns = round(arrived_s * 1e6) * 1000 if 0 < arrived_s < _LATEST_S else None
    return log_of_boots(boots, start_ns, remarks)


def log_of_boots(boots: Sequence[Boot], start_ns: int | None, remarks: Sequence[str]) -> FlightLog:
    """Decoded messages (`KINDS`) as a log whose time 0 is the stamp `start_ns`. ValueError when there is no
    position or no attitude."""
    said = list(remarks)
    places = _all(boots, PLACE)
    position = {
        "time_s": _times_s(boots, PLACE),
        "latitude": [one.lat / 1e7 for one in places],
        "longitude": [one.lon / 1e7 for one in places],
        "sea": [one.alt / 1e3 for one in places],
    }
    homes = [one for one in _all(boots, "HOME_POSITION") if one.latitude or one.longitude]
    if (moved_m := _moved_m(homes)) > _SAME_HOME_M:
        last_m = (places[-1].alt - places[-1].relative_alt) / 1e3
        position["take-off"] = [height_m - last_m for height_m in position["sea"]]
        said.append(
            f"its home moved by {moved_m:.0f} m: heights above the take-off count from the last one, also of "
            "the time before, by those above the sea"
        )
    else:
        position["take-off"] = [height_m for boot in boots for height_m in _above_home_m(boot, said)]
    turns = _all(boots, "ATTITUDE_QUATERNION")
    rows = [[one.q1, one.q2, one.q3, one.q4] for one in turns]
    body = Turns.of(_times_s(boots, "ATTITUDE_QUATERNION"), rows)
    if body is None:
        angles = [_turn(one.yaw, one.pitch, one.roll) for one in _all(boots, "ATTITUDE")]
        body = Turns.of(_times_s(boots, "ATTITUDE"), angles)
    return merged(
        position,
        {"sea": "sea", "take-off": "take-off"},
        body,
        _camera(boots, body, said),
        start_ns=start_ns,
        take_off=(homes[-1].latitude / 1e7, homes[-1].longitude / 1e7) if homes else None,
        remarks=said,
    )


def _above_home_m(boot: Boot, remarks: list[str]) -> list[float]:
    """Heights of a boot's positions above its home, metres. One that is set anew in the air is no ground, and
    does not take the flight down with it: the lowest that was told counts for all."""
    places = boot.messages[PLACE]
    counted_m = [(one.alt - one.relative_alt) / 1e3 for one in places if one.lat or one.lon]
    if not counted_m or max(counted_m) - min(counted_m) <= _SAME_HEIGHT_M:
        return [one.relative_alt / 1e3 for one in places]
    told_m = [one.altitude / 1e3 for one in boot.messages["HOME_POSITION"] if one.altitude]
    home_m = min(told_m, default=median(counted_m))
    remarks.append(
        f"its heights above the take-off count from {min(counted_m):.0f} to {max(counted_m):.0f} m above the "
        f"sea, as where home is set anew: all are counted from {home_m:.0f} m, by those above the sea; "
        "--heights sea uses these alone"
    )
    return [one.alt / 1e3 - home_m for one in places]


def _moved_m(homes: Sequence[Any]) -> float:
    """How far a home lies from the last one, at most."""
    if not homes:
        return 0.0
    to_last = [(one.latitude - homes[-1].latitude, one.longitude - homes[-1].longitude) for one in homes]
    east = math.cos(math.radians(homes[-1].latitude / 1e7))
    # A home may lie beyond the date line.
    apart = [(north, math.remainder(across, 3.6e9) * east) for north, across in to_last]
    return max(math.hypot(*one) for one in apart) * _METRES_PER_E7


def _messages(path: Path, remarks: list[str]) -> list[Any]:
    """Messages of the first drone that tells its position, in order of arrival."""
    from pymavlink import mavutil

    found: list[Any] = []
    systems: list[int] = []
    receivers: defaultdict[int, Receivers] = defaultdict(Receivers)
    adrift: list[int] = []
    try:
        with closing(mavutil.mavlink_connection(str(path), robust_parsing=True)) as log:
            while (message := log.recv_match(type=[*KINDS, *RECEIVERS])) is not None:
                system = message.get_srcSystem()
                if message.get_type() in RECEIVERS:
                    receivers[system].heard(message)
                    continue
                found.append(message)
                if message.get_type() == PLACE:
                    systems.append(system)
                    adrift += [system] if receivers[system].are_lost else []
    except Exception as error:  # whatever the library meets in a damaged file
        if len(systems) < 2:
            raise ValueError(f"{path} is no MAVLink log, or damaged: {one_line(error)}") from error
    if systems.count(systems[0] if systems else 0) < 2:
        raise ValueError(f"{path} holds no positions ({PLACE}): no MAVLink log, or a damaged one")
    if others := sorted(set(systems) - {systems[0]}):
        remarks.append(
            f"{path.name} holds the positions of several drones: system {systems[0]} is taken, not "
            f"{', '.join(map(str, others))}"
        )
    if lost := adrift.count(systems[0]):
        remarks.append(f"{lost} of {systems.count(systems[0])} positions {ADRIFT}")
    return [one for one in found if one.get_srcSystem() == systems[0]]


def _all(boots: Sequence[Boot], kind: str) -> list[Any]:
    return [one for boot in boots for one in boot.messages[kind]]


def _times_s(boots: Sequence[Boot], kind: str) -> list[float]:
    return [time_s for boot in boots for time_s in boot.time_s(kind)]


def _camera(boots: Sequence[Boot], body: Turns | None, remarks: list[str]) -> Turns | None:
    gimbal = _of_one_gimbal(_timed(boots, "GIMBAL_DEVICE_ATTITUDE_STATUS"), remarks)
    if gimbal:
        rows, flags = [one.q for _, one in gimbal], [one.flags for _, one in gimbal]
        return gimbal_turns([time_s for time_s, _ in gimbal], rows, flags, body, remarks)
    told = _of_one_gimbal(_timed(boots, "MOUNT_ORIENTATION"), remarks)
    mount = [
        (time_s, from_yaw_pitch_roll_deg(one.yaw_absolute, one.pitch, one.roll))
        for time_s, one in told
        if math.isfinite(one.yaw_absolute)
    ]
    if mount and not any(one.yaw_absolute for _, one in told):
        # A later extension of the message: it is 0 where it was not sent, and NaN where it is not known.
        remarks.append(
            f"yaw_absolute is 0 in all {len(mount)} MOUNT_ORIENTATION: where the camera looked is not told"
        )
        return None
    return Turns.of([time_s for time_s, _ in mount], [turn for _, turn in mount])


def _timed(boots: Sequence[Boot], kind: str) -> list[tuple[float, Any]]:
    return list(zip(_times_s(boots, kind), _all(boots, kind), strict=True))


def _of_one_gimbal(told: list[tuple[float, Any]], remarks: list[str]) -> list[tuple[float, Any]]:
    if not told:
        return []
    of = [gimbal_of(one) for _, one in told]
    taken = one_gimbal(Counter(of), "component", remarks)
    return [one for one, gimbal in zip(told, of, strict=True) if gimbal == taken]


def gimbal_of(message: Any) -> tuple[int, int]:
    """Which gimbal a message is about: the component that tells it, and the number that it has there."""
    return message.get_srcComponent(), getattr(message, "gimbal_device_id", 0)


def _turn(yaw: float, pitch: float, roll: float) -> Any:
    """Radians."""
    return from_yaw_pitch_roll_deg(math.degrees(yaw), math.degrees(pitch), math.degrees(roll))
