"""A telemetry log that goes on while the autopilot starts anew: after a change of battery its clock, the
milliseconds since it started, begins again.

Within a boot times are the autopilot's, so that the delay of a radio does not shake them. Each boot lies
where its first position arrived, with the delay of the usual message, so that the pause between two stays a
pause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from crowdfence.sources.film.component_clock import offset_ms, on_one_clock, timed_by

PLACE = "GLOBAL_POSITION_INT"

_FALLS_MS = 1000
"""A message so much older than the newest may be of a new boot ..."""
_LATEST_S = 5.0
"""... unless it is a packet that was held up on its way for no longer than this."""


@dataclass(frozen=True, slots=True)
class Boot:
    """What an autopilot said between two of its starts."""

    messages: Mapping[str, Sequence[Any]]
    """By kind, in order of arrival."""
    zero_ms: float
    """Its clock at time 0 of the log."""
    arrived_s: float = 0.0
    """When its first position came, had it come like the usual message."""

    def time_s(self, kind: str) -> list[float]:
        return [(one.time_boot_ms - self.zero_ms) / 1e3 for one in self.messages[kind]]


def boots_of(messages: Sequence[Any], kinds: Sequence[str], remarks: list[str]) -> list[Boot]:
    """Decoded messages of one vehicle in order of arrival (`_timestamp`, seconds), a position among them ->
    its boots that tell positions; time 0 is the first one."""
    found: list[Boot] = []
    began_s, ended_s = 0.0, -1.0
    component = next(one.get_srcComponent() for one in messages if one.get_type() == PLACE)
    for told in _runs(messages, component):
        if not any(one.get_type() == PLACE and one.get_srcComponent() == component for one in told):
            continue
        run = on_one_clock(told, component, remarks)
        of_kind = {kind: [one for one in run if one.get_type() == kind] for kind in kinds}
        places = of_kind[PLACE]
        arrived_s = (places[0].time_boot_ms + offset_ms(timed_by(told, component))) / 1e3
        if (set_by_s := _clock_set_by_s(timed_by(told, component))) > _LATEST_S:
            remarks.append(
                f"the clock of who wrote the log was set by {set_by_s:.0f} s in flight: times of day may be "
                "off by that, so that views of other drones do not belong to the same moment"
            )
        if not found:
            began_s = arrived_s
        begin_s = arrived_s - began_s
        if begin_s <= ended_s:
            remarks.append(
                f"{len(places)} positions after a new start of the autopilot are left out: the clock of who "
                f"wrote the log fell too, by {ended_s - begin_s:.1f} s"
            )
            continue
        found.append(Boot(of_kind, places[0].time_boot_ms - begin_s * 1e3, arrived_s))
        ended_s = found[-1].time_s(PLACE)[-1]
    if len(found) > 1:
        begins = ", ".join(f"{boot.time_s(PLACE)[0]:.1f}" for boot in found[1:])
        remarks.append(
            f"the autopilot started anew: the log holds {len(found)} boots, each laid on the arrival of its "
            f"first position (the later ones at {begins} s); heights above the take-off count from each "
            "one's own"
        )
    return found


def _clock_set_by_s(messages: Sequence[Any]) -> float:
    """By how much arrivals part from the autopilot's clock between two tenths of a boot, of the usual message
    of each: single ones are held up on their way, and clocks drift by less."""
    size = -(-len(messages) // 10)
    usual_ms = [offset_ms(messages[begin : begin + size]) for begin in range(0, len(messages), size)]
    return (max(usual_ms) - min(usual_ms)) / 1e3


def _runs(messages: Sequence[Any], component: int) -> list[list[Any]]:
    """The messages from one start to the next, by the clock of the component that tells positions."""
    runs: list[list[Any]] = [[]]
    newest: Any = None
    for one in messages:
        if one.get_srcComponent() == component and hasattr(one, "time_boot_ms"):
            if newest is not None and _started_anew(newest, one):
                runs.append([])
                newest = None
            if newest is None or one.time_boot_ms >= newest.time_boot_ms:
                newest = one
        runs[-1].append(one)
    return runs


def _started_anew(newest: Any, one: Any) -> bool:
    falls_ms, pause_s = newest.time_boot_ms - one.time_boot_ms, one._timestamp - newest._timestamp
    held_up = pause_s >= 0 and pause_s + falls_ms / 1e3 <= _LATEST_S
    return bool(falls_ms > _FALLS_MS and not held_up)
