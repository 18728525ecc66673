"""Everything that a mission records, in the order in which it is recorded."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heappop, heappush, merge

import numpy as np

from crowdfence.simulation.flight.telemetry import PoseRows
from crowdfence.simulation.schedule import TELEMETRY_MARGIN_S, Capture, Schedule
from crowdfence.truth.at_exposure import MAX_PEOPLE_GAP_S

_TELEMETRY_BLOCK_S = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class TelemetryRow:
    """What a drone logs about itself."""

    drone: int
    stamp_ns: int
    poses: PoseRows
    """Noisy; this row is number `index` of them."""
    index: int


@dataclass(frozen=True, slots=True)
class WorldInstant:
    """Time to record where everybody is."""

    t_s: float
    stamp_ns: int


Event = TelemetryRow | WorldInstant | Capture


def timeline(schedule: Schedule) -> Iterator[Event]:
    """Telemetry as logged, captures as they arrive (without dropped ones) and the world at the frame
    rate, or more often where exposures would lie too far from it to be told where people were.

    Ordered by log time; equal times by kind and drone. Made as it is asked for, a few seconds at a time.
    """
    drones = range(schedule.scenario.drones)
    streams: list[Iterator[tuple[int, int, int, Event]]] = [_world(schedule)]
    streams += [_telemetry(schedule, drone) for drone in drones]
    streams += [_captures(schedule, drone) for drone in drones]
    return (event for _, _, _, event in merge(*streams, key=lambda entry: entry[:3]))


def arriving(schedule: Schedule, drone: int) -> Iterator[Capture]:
    """The captures of one drone in the order of arrival, then of exposure; dropped ones are left out."""
    waiting: list[tuple[int, int, Capture]] = []
    for capture in schedule.captures(drone):
        while waiting and waiting[0][0] < capture.stamp_ns:
            yield heappop(waiting)[2]
        if not capture.dropped:
            heappush(waiting, (capture.arrival_ns, capture.frame, capture))
    while waiting:
        yield heappop(waiting)[2]


def _world(schedule: Schedule) -> Iterator[tuple[int, int, int, Event]]:
    scenario = schedule.scenario
    latest_s = max(clock.trigger_s for clock in schedule.clocks)
    rate_hz, last = scenario.fps, scenario.frames - 1
    if latest_s > MAX_PEOPLE_GAP_S:  # cameras that expose so late would find nobody recorded
        rate_hz *= math.ceil(1.0 / (MAX_PEOPLE_GAP_S * scenario.fps))
        last = math.ceil((scenario.duration_s + latest_s) * rate_hz)
    for number in range(last + 1):
        t_s = number / rate_hz
        stamp_ns = scenario.epoch_ns + round(t_s * 1e9)
        yield stamp_ns, 0, 0, WorldInstant(t_s, stamp_ns)


def _telemetry(schedule: Schedule, drone: int) -> Iterator[tuple[int, int, int, Event]]:
    end_s = schedule.scenario.duration_s + 2 * TELEMETRY_MARGIN_S + schedule.clocks[drone].trigger_s
    start_s = -2 * TELEMETRY_MARGIN_S
    for block in range(int(np.ceil((end_s - start_s) / _TELEMETRY_BLOCK_S))):
        from_s = start_s + block * _TELEMETRY_BLOCK_S
        rows = schedule.telemetry(drone, from_s, from_s + _TELEMETRY_BLOCK_S)
        for index, stamp_ns in enumerate(rows.stamps_ns.tolist()):
            yield stamp_ns, 1, drone, TelemetryRow(drone, stamp_ns, rows.noisy, index)


def _captures(schedule: Schedule, drone: int) -> Iterator[tuple[int, int, int, Event]]:
    return ((capture.arrival_ns, 2, drone, capture) for capture in arriving(schedule, drone))
