"""One pass over the timeline: frames begun ahead, everything handed to a sink in its order."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from crowdfence.simulation.recording.frame_pool import FramePool, MadeFrame
from crowdfence.simulation.recording.frame_summary import MissionStatistics
from crowdfence.simulation.recording.recorded import Progress
from crowdfence.simulation.recording.timeline import Event, TelemetryRow, WorldInstant, timeline
from crowdfence.simulation.schedule import Capture, Schedule
from crowdfence.stop_request import StopRequest

FRAMES_AHEAD = 3
"""Frames per worker that are begun before they are needed."""


class Sink(Protocol):
    """A recording in the making."""

    def earlier(self, capture: Capture, *, footprint: bool) -> MadeFrame | None:
        """The frame as an earlier run left it, None when it has to be made."""
        ...

    def write_telemetry(self, row: TelemetryRow) -> None: ...

    def write_world(self, instant: WorldInstant) -> None: ...

    def write_frame(self, capture: Capture, made: MadeFrame) -> None: ...


class TimelineRun:
    """Counts what was written; memory holds the frames of a few workers at a time."""

    def __init__(
        self, schedule: Schedule, pool: FramePool, stop: StopRequest, progress: Progress | None
    ) -> None:
        self._schedule, self._pool, self._stop, self._progress = schedule, pool, stop, progress
        self._statistics = MissionStatistics(schedule.scenario)
        self._fates = capture_counts(schedule)
        self._pending: deque[tuple[Event, Callable[[], MadeFrame] | None]] = deque()
        self.planned = sum(fate["delivered"] for fate in self._fates.values())
        self.written = self.resumed = 0

    @property
    def complete(self) -> bool:
        return self.written == self.planned

    def into(self, sink: Sink) -> None:
        """Record everything, or until a stop is wanted."""
        begun = 0
        for event in timeline(self._schedule):
            if self._stop.wanted:
                return
            self._pending.append((event, self._begin(event, sink)))
            begun += isinstance(event, Capture)
            while begun - self.written > FRAMES_AHEAD * self._pool.workers:
                self._write_oldest(sink)
        while self._pending and not self._stop.wanted:
            self._write_oldest(sink)

    def statistics(self) -> dict[str, Any]:
        """What came out, ready for JSON."""
        return {
            "complete": self.complete,
            "planned_frames": self.planned,
            "captures": self._fates,
            **self._statistics.manifest(),
        }

    def explained(self, error: OSError, path: Path) -> OSError:
        """The error of a target that can no longer be written, with what to do about it."""
        left = f"{self.written} of {self.planned} frames are in it; remove the cause and go on with --resume"
        return OSError(error.errno, f"{error.strerror or error}: {left}", error.filename or os.fspath(path))

    def _begin(self, event: Event, sink: Sink) -> Callable[[], MadeFrame] | None:
        if not isinstance(event, Capture):
            return None
        footprint = self._statistics.wants_footprint(event.frame)
        earlier = sink.earlier(event, footprint=footprint)
        if earlier is None:
            return self._pool.begin(event, footprint=footprint)
        self.resumed += 1
        return lambda: earlier

    def _write_oldest(self, sink: Sink) -> None:
        event, frame = self._pending.popleft()
        if isinstance(event, TelemetryRow):
            sink.write_telemetry(event)
        elif isinstance(event, WorldInstant):
            sink.write_world(event)
        elif frame is not None:
            made = frame()
            sink.write_frame(event, made)
            self._statistics.add(event.drone, event.frame, made.summary)
            self.written += 1
            if self._progress is not None:
                self._progress(self.written, self.planned)


def capture_counts(schedule: Schedule) -> dict[str, dict[str, int]]:
    """What becomes of the captures of each drone."""
    counts = {}
    for drone, name in enumerate(schedule.scenario.drone_names):
        fate = dict.fromkeys(("delivered", "dropped", "duplicated", "late"), 0)
        for capture in schedule.captures(drone):
            fate["dropped" if capture.dropped else "delivered"] += 1
            fate["duplicated"] += capture.duplicate_of is not None
            fate["late"] += not capture.dropped and capture.late_by_s > 0
        counts[name] = fate
    return counts
