"""Components of a drone that count time from a start of their own, such as a gimbal or a companion computer.

MAVLink's time_boot_ms is the time since its sender started, and a drone has several senders. What another
component than the autopilot says is laid on the autopilot's clock by when both arrive.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from statistics import median
from typing import Any

OF_GIMBALS = ("GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION")
"""Kinds of messages that any component may send; everything else about the drone is the autopilot's."""
OWN_CLOCK_MS = 200
"""From so far apart on, two clocks are two: less is what ways of messages differ by."""
_FALLS_MS = 1000
"""A message so much older than the newest is of a component that started anew."""


def at_autopilot_time(message: Any, shift_ms: float) -> Any:
    """The message as if the autopilot had timed it."""
    laid = copy.copy(message)
    laid.time_boot_ms = round(message.time_boot_ms + shift_ms)
    return laid


def on_one_clock(messages: Sequence[Any], component: int, remarks: list[str]) -> list[Any]:
    """Decoded messages of one vehicle in order of arrival (`_timestamp`, seconds), while its autopilot, the
    `component`, did not start anew: those of gimbals that are components of their own on its clock, others
    that are not its own left out."""
    autopilot_ms = offset_ms(timed_by(messages, component))
    laid: dict[int, Any] = {}
    for other in sorted({one.get_srcComponent() for one in messages} - {component}):
        theirs = [one for one in messages if one.get_srcComponent() == other]
        _tell_left_out(theirs, other, remarks)
        of_gimbal = [one for one in theirs if one.get_type() in OF_GIMBALS]
        shifts_ms = []
        for started in _starts(of_gimbal):
            shift_ms = offset_ms(started) - autopilot_ms
            shift_ms = shift_ms if abs(shift_ms) > OWN_CLOCK_MS else 0.0
            shifts_ms.append(shift_ms)
            laid |= {id(one): at_autopilot_time(one, shift_ms) for one in started}
        if any(shifts_ms):
            apart = ", ".join(f"{-shift_ms / 1e3:+.1f}" for shift_ms in shifts_ms)
            remarks.append(
                f"component {other} counts time on a clock of its own, {apart} s from the autopilot's: its "
                "attitudes are laid on that one by when both arrived"
            )
    return [
        laid.get(id(one), one) for one in messages if one.get_srcComponent() == component or id(one) in laid
    ]


def _tell_left_out(messages: Sequence[Any], component: int, remarks: list[str]) -> None:
    kinds = [one.get_type() for one in messages if one.get_type() not in OF_GIMBALS]
    for kind in sorted(set(kinds)):
        remarks.append(
            f"{kinds.count(kind)} {kind} of component {component} are left out: they are not the autopilot's"
        )


def timed_by(messages: Sequence[Any], component: int) -> list[Any]:
    """Those that a component stamped with the time since its start."""
    return [one for one in messages if one.get_srcComponent() == component and hasattr(one, "time_boot_ms")]


def offset_ms(messages: Sequence[Any]) -> float:
    """Arrival less time since the start, of the usual message: one may be held up on its way."""
    return median(one._timestamp * 1e3 - one.time_boot_ms for one in messages)


def _starts(messages: Sequence[Any]) -> list[list[Any]]:
    """From one start of a component to the next."""
    found: list[list[Any]] = []
    for one in messages:
        if not found or one.time_boot_ms < found[-1][-1].time_boot_ms - _FALLS_MS:
            found.append([])
        found[-1].append(one)
    return found
