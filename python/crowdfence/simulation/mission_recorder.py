"""Scene -> mission file: frames made side by side, written in the order of arrival, resumable at any time."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from crowdfence.simulation.frame_maker import FrameOptions
from crowdfence.simulation.frame_pool import FramePool, MadeFrame, usable_workers
from crowdfence.simulation.frame_summary import MissionStatistics
from crowdfence.simulation.manifest import mission_manifest
from crowdfence.simulation.mission_salvage import Salvage, finished, salvage, summary_of_parts
from crowdfence.simulation.scenario import Scenario
from crowdfence.simulation.scene import Scene
from crowdfence.simulation.stop_request import StopRequest
from crowdfence.simulation.terrain_files import write_terrain_files
from crowdfence.simulation.timeline import Event, TelemetryRow, WorldInstant, timeline
from crowdfence.simulation.trouble import Capture, Schedule, build_schedule
from crowdfence.simulation.truth import people_truth
from crowdfence.sources.mission_layout import Part, camera_frame, topic_prefix
from crowdfence.sources.mission_messages import FrameContent, encode_frame
from crowdfence.sources.mission_writer import MissionWriter, part_path
from crowdfence.sources.recorded_truth import RecordedPeople

Progress = Callable[[int, int], None]
"""Called with (frames recorded, frames in all)."""

FRAMES_AHEAD = 3
"""Frames per worker that are begun before they are needed."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """What came out of a simulation."""

    path: Path
    complete: bool
    """False when it was interrupted; it can be resumed."""
    frames: int
    planned_frames: int
    resumed_frames: int
    """Frames taken over from an earlier run."""
    statistics: dict[str, Any]
    renderer: str


@dataclass(frozen=True, slots=True)
class _MissionEncoder:
    """Frame -> messages, inside the worker."""

    scenario: Scenario
    camera_frames: tuple[str, ...]

    def __call__(self, content: FrameContent, capture: Capture) -> Mapping[str, bytes]:
        frame = self.camera_frames[capture.drone]
        messages = encode_frame(content, self.scenario.intrinsics(), capture.stamp_ns, frame)
        return cast(Mapping[str, bytes], messages)


def record_mission(
    scene: Scene,
    path: Path,
    *,
    options: FrameOptions | None = None,
    workers: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Recorded:
    """Simulate `scene` into the mission file `path`, with the map of it beside (.bt, .tif, .ply).

    An interrupt (Ctrl-C) ends the file properly after the frame at hand; a kill leaves `<path>.part`, which
    `open_recording` reads too. `resume` goes on with either, and the result holds what an uninterrupted run
    would have written. `workers` processes make the frames; by default as many as there are cores.

    Raises NoOpenGL when pictures are wanted and cannot be rendered, ScenarioError for a scenario that cannot
    be recorded so, ValueError to resume another mission, FileExistsError unless `resume` or `overwrite`, and
    OSError when the file cannot be written; what is written then stays and can be resumed.
    """
    options = options or FrameOptions()
    require_target(path, part_path(path), resume=resume, overwrite=overwrite)
    prefixes = _prefixes(scene.scenario.drone_names)
    encoder = _MissionEncoder(scene.scenario, tuple(camera_frame(prefix) for prefix in prefixes))
    schedule = build_schedule(scene)
    with StopRequest() as stop, FramePool(scene, options, encoder, workers or usable_workers()) as pool:
        manifest = mission_manifest(scene, schedule, options, pool.description)
        earlier = Salvage([], _parts_of(options))
        if resume:
            earlier = salvage(path, part_path(path), manifest, _parts_of(options))
        elif overwrite:
            finished(path)
        map_path = write_terrain_files(scene, path.parent, path.stem).octomap
        writer = MissionWriter(
            path, georeference=scene.scenario.georeference, terrain=map_path, source="simulation"
        )
        run = _Run(scene, schedule, pool, writer, earlier, prefixes, stop, progress)
        try:
            statistics = run.record(manifest)
            writer.close()
        except OSError as error:
            writer.abandon()
            raise _explained(error, writer, run) from error
        except BaseException:
            writer.abandon()
            raise
    if run.complete:
        finished(path)
    return Recorded(
        path,
        run.complete,
        run.written,
        run.planned,
        run.resumed,
        statistics,
        pool.description,
    )


class _Run:
    """One pass over the timeline of a mission."""

    def __init__(
        self,
        scene: Scene,
        schedule: Schedule,
        pool: FramePool,
        writer: MissionWriter,
        earlier: Salvage,
        prefixes: tuple[str, ...],
        stop: StopRequest,
        progress: Progress | None,
    ) -> None:
        self._scene, self._schedule, self._pool, self._writer = scene, schedule, pool, writer
        self._earlier, self._prefixes, self._stop, self._progress = earlier, prefixes, stop, progress
        self._names = scene.scenario.drone_names
        self._camera = scene.scenario.intrinsics()
        self._statistics = MissionStatistics(scene.scenario)
        self._fates = capture_counts(schedule)
        self._pending: deque[tuple[Event, Callable[[], MadeFrame] | None]] = deque()
        self.planned = sum(fate["delivered"] for fate in self._fates.values())
        self.written = self.resumed = 0

    @property
    def complete(self) -> bool:
        return self.written == self.planned

    def record(self, manifest: Mapping[str, Any]) -> dict[str, Any]:
        """Write everything, or until a stop is wanted; returns the statistics."""
        self._writer.add_simulation(manifest)
        for name in self._names:
            self._writer.add_drone(name)
        begun = 0
        for event in timeline(self._schedule):
            if self._stop.wanted:
                break
            self._pending.append((event, self._begin(event)))
            begun += isinstance(event, Capture)
            while begun - self.written > FRAMES_AHEAD * self._pool.workers:
                self._write_oldest()
        while self._pending and not self._stop.wanted:
            self._write_oldest()
        statistics = {
            "complete": self.complete,
            "planned_frames": self.planned,
            "captures": self._fates,
            **self._statistics.manifest(),
        }
        self._writer.add_statistics(statistics)
        return statistics

    def _begin(self, event: Event) -> Callable[[], MadeFrame] | None:
        if not isinstance(event, Capture):
            return None
        footprint = self._statistics.wants_footprint(event.frame)
        parts = self._earlier.frame(self._prefixes[event.drone], event.stamp_ns)
        if parts is None:
            return self._pool.begin(event, footprint=footprint)
        self.resumed += 1
        summary = summary_of_parts(parts, self._camera, footprint=footprint)
        frame = MadeFrame(cast(Mapping[str, bytes], parts), summary)
        return lambda: frame

    def _write_oldest(self) -> None:
        event, frame = self._pending.popleft()
        if isinstance(event, TelemetryRow):
            name = self._names[event.drone]
            self._writer.add_pose(name, event.stamp_ns, event.camera_position, event.camera_quaternion)
        elif isinstance(event, WorldInstant):
            self._writer.add_people(_everybody(self._scene, event))
        elif frame is not None:
            self._write_frame(event, frame())

    def _write_frame(self, capture: Capture, made: MadeFrame) -> None:
        self._writer.add_encoded_frame(
            self._names[capture.drone],
            capture.stamp_ns,
            cast(Mapping[Part, bytes], made.pieces),
            arrival_ns=capture.arrival_ns,
        )
        self._statistics.add(capture.drone, capture.frame, made.summary)
        self.written += 1
        if self._progress is not None:
            self._progress(self.written, self.planned)


def require_target(path: Path, partial: Path, *, resume: bool, overwrite: bool) -> None:
    """OSError unless `path` can be written and nothing is in its way."""
    if not path.parent.is_dir():
        raise FileNotFoundError(f"cannot write {path}: the folder {path.parent} does not exist")
    if not os.access(path.parent, os.W_OK):
        raise PermissionError(f"cannot write {path}: no permission to write into {path.parent}")
    if resume or overwrite:
        return
    for file, state in ((path, "exists"), (partial, "is left of an interrupted run")):
        if file.exists():
            raise FileExistsError(f"{file} {state}: go on with it (--resume) or replace it (--force)")


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


def _everybody(scene: Scene, instant: WorldInstant) -> RecordedPeople:
    truth = people_truth(scene, instant.t_s)
    return RecordedPeople(
        instant.stamp_ns,
        truth.position.astype(np.float32),
        np.arange(1, len(truth.crowd) + 1, dtype=np.uint32),
        truth.crowd.astype(np.uint32),
    )


def _parts_of(options: FrameOptions) -> frozenset[Part]:
    """The parts of every frame of a simulated mission."""
    parts: set[Part] = {"camera_info", "regions", "depth_cm", "segmentation", "instances"}
    parts |= {"true_pose", "exposure", "people"}
    if options.rgb:
        parts.add("image")
    if options.heatmaps:
        parts.add("heatmap")
    return frozenset(parts)


def _prefixes(names: tuple[str, ...]) -> tuple[str, ...]:
    taken: list[str] = []
    for name in names:
        taken.append(topic_prefix(name, set(taken)))
    return tuple(taken)


def _explained(error: OSError, writer: MissionWriter, run: _Run) -> OSError:
    left = f"{run.written} of {run.planned} frames are in it; remove the cause and go on with --resume"
    return OSError(error.errno, f"{error.strerror or error}: {left}", str(part_path(writer.path)))
