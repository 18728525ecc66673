"""Scene -> mission file: frames made side by side, written in the order of arrival, resumable at any time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from crowdfence.atomic_file import file_at
from crowdfence.simulation.landing_ground import landing_ground
from crowdfence.simulation.recording.frame_maker import FrameOptions
from crowdfence.simulation.recording.frame_pool import FramePool, MadeFrame, worker_count
from crowdfence.simulation.recording.manifest import mission_manifest
from crowdfence.simulation.recording.mission_salvage import Salvage, finished, salvage, summary_of_parts
from crowdfence.simulation.recording.preparation import Preparation
from crowdfence.simulation.recording.recorded import Progress, Recorded, require_folder, require_nothing_there
from crowdfence.simulation.recording.terrain_files import terrain_files
from crowdfence.simulation.recording.timeline import TelemetryRow, WorldInstant
from crowdfence.simulation.recording.timeline_run import TimelineRun
from crowdfence.simulation.scenarios.scenario import Scenario
from crowdfence.simulation.scene import Scene
from crowdfence.simulation.scene_truth import people_truth
from crowdfence.simulation.schedule import Capture, build_schedule
from crowdfence.sources.layers import LANDING_SITE
from crowdfence.sources.mission.layout import FramePart, LayerPart, camera_frame, topic_prefix
from crowdfence.sources.mission.messages import FrameContent, encode_frame
from crowdfence.sources.mission.topic_writer import part_path, refuse_while_written
from crowdfence.sources.mission.writer import MissionWriter
from crowdfence.sources.recorded_truth import RecordedPeople
from crowdfence.stop_request import StopRequest


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
    would have written. With `overwrite` an earlier mission is gone as soon as its map is replaced. `workers`
    processes make the frames; by default as many as there are cores.

    Raises NoOpenGL when pictures are wanted and cannot be rendered, ScenarioError for a scenario that cannot
    be recorded so, ValueError to resume another mission, FileExistsError unless `resume` or `overwrite`, and
    OSError when the file cannot be written; what is written then stays and can be resumed.
    """
    options = options or FrameOptions()
    require_folder(path)
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; name the mission file inside it")
    refuse_while_written(path)
    if not (resume or overwrite):
        require_nothing_there(path, "exists")
        require_nothing_there(part_path(path), "is left of an interrupted run")
        _require_no_map(path)
    frames_of_reference = tuple(camera_frame(prefix) for prefix in _prefixes(scene.scenario.drone_names))
    encoder = _MissionEncoder(scene.scenario, frames_of_reference)
    workers = worker_count(workers)
    schedule = build_schedule(scene)
    with StopRequest() as stop:
        with Preparation(scene, options, apart=workers > 1) as preparation:
            renderer = preparation.renderer()
            manifest = mission_manifest(scene, schedule, options, renderer)
            earlier = Salvage([], _parts_of(options))
            if resume:
                earlier = salvage(path, manifest, _parts_of(options))
            elif overwrite:
                _remove_earlier(path)
            map_files = preparation.write_map(path.parent, path.stem)
        with FramePool(scene, options, encoder, workers) as pool:
            run = TimelineRun(schedule, pool, stop, progress)
            statistics = _write(scene, path, options, map_files.octomap, manifest, run, earlier)
    if run.complete:
        finished(path)
    return Recorded(
        path,
        run.complete,
        run.written,
        run.planned,
        run.resumed,
        path.stat().st_size,
        statistics,
        renderer,
        map_files,
    )


def _remove_earlier(path: Path) -> None:
    """What may be replaced goes before its map does: a mission names the map beside it, and if this run is
    killed an earlier one would be read on the ground of another."""
    finished(path)
    part_path(path).unlink(missing_ok=True)
    file_at(path).unlink(missing_ok=True)


def _require_no_map(path: Path) -> None:
    """FileExistsError for a map that the one of the mission would replace."""
    for file in terrain_files(path.parent, path.stem):
        if file.exists():
            raise FileExistsError(
                f"{file} exists, where the map of the mission is written: name another mission file, go on "
                "with the run that wrote it (--resume), or replace it (--force)"
            )


def _write(
    scene: Scene,
    path: Path,
    options: FrameOptions,
    map_path: Path,
    manifest: Mapping[str, Any],
    run: TimelineRun,
    earlier: Salvage,
) -> dict[str, Any]:
    """The mission file, as far as the run goes; returns the statistics."""
    writer = MissionWriter(
        path, georeference=scene.scenario.georeference, terrain=map_path, source="simulation"
    )
    try:
        writer.add_simulation(manifest)
        for name in scene.scenario.drone_names:
            writer.add_drone(name)
        _write_layers(scene, writer, options)
        run.into(_MissionSink(scene, writer, earlier))
        statistics = run.statistics()
        writer.add_statistics(statistics)
        writer.close()
    except OSError as error:
        writer.abandon()
        raise run.explained(error, part_path(path)) from error
    except BaseException:
        writer.abandon()
        raise
    return statistics


def _write_layers(scene: Scene, writer: MissionWriter, options: FrameOptions) -> None:
    """Where in the world the classes of further layers are."""
    if LANDING_SITE in options.layers:
        ground = landing_ground(scene.landscape)
        writer.add_layer_ground(LANDING_SITE, ground, scene.scenario.epoch_ns)


class _MissionSink:
    """The mission file as the timeline fills it."""

    def __init__(self, scene: Scene, writer: MissionWriter, earlier: Salvage) -> None:
        self._scene, self._writer, self._earlier = scene, writer, earlier
        self._names = scene.scenario.drone_names
        self._prefixes = _prefixes(self._names)
        self._camera = scene.scenario.intrinsics()

    def earlier(self, capture: Capture, *, footprint: bool) -> MadeFrame | None:
        parts = self._earlier.frame(self._prefixes[capture.drone], capture.stamp_ns)
        if parts is None:
            return None
        summary = summary_of_parts(parts, self._camera, footprint=footprint)
        return MadeFrame(cast(Mapping[str, bytes], parts), summary)

    def write_telemetry(self, row: TelemetryRow) -> None:
        position, quaternion = row.poses.camera_position, row.poses.camera_quaternion
        self._writer.add_pose(
            self._names[row.drone], row.stamp_ns, position[row.index], quaternion[row.index]
        )

    def write_world(self, instant: WorldInstant) -> None:
        self._writer.add_people(_everybody(self._scene, instant))

    def write_frame(self, capture: Capture, made: MadeFrame) -> None:
        self._writer.add_encoded_frame(
            self._names[capture.drone],
            capture.stamp_ns,
            cast(Mapping[FramePart, bytes], made.pieces),
            arrival_ns=capture.arrival_ns,
        )


def _everybody(scene: Scene, instant: WorldInstant) -> RecordedPeople:
    truth = people_truth(scene, instant.t_s)
    return RecordedPeople(
        instant.stamp_ns,
        truth.position.astype(np.float32),
        np.arange(1, len(truth.crowd) + 1, dtype=np.uint32),
        truth.crowd.astype(np.uint32),
    )


def _parts_of(options: FrameOptions) -> frozenset[FramePart]:
    """The parts of every frame of a simulated mission."""
    parts: set[FramePart] = {"camera_info", "regions", "depth_cm", "segmentation", "instances"}
    parts |= {"true_pose", "exposure", "people"}
    if options.rgb:
        parts.add("image")
    if options.heatmaps:
        parts |= {"heatmap", "heatmap_info"}
    for layer in options.layers:
        parts.add(LayerPart(layer, "labels"))
        if options.heatmaps:
            parts |= {LayerPart(layer, "heatmap"), LayerPart(layer, "heatmap_info")}
    return frozenset(parts)


def _prefixes(names: tuple[str, ...]) -> tuple[str, ...]:
    taken: list[str] = []
    for name in names:
        taken.append(topic_prefix(name, set(taken)))
    return tuple(taken)
