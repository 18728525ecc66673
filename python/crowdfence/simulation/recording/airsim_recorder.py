"""Scene -> AirSim recording folder that AirSim's users, and our own importer, read.

airsim_rec.txt, settings.json, images/   as AirSim and Cosys-AirSim write them; the table holds true poses
telemetry/<vehicle>.csv                  body and gimbal as logged, noise and lost rows included
heatmaps/, truth/regions/                what our importer looks for
truth/instances/                         16-bit PNG, number of the person per pixel
truth/people/                            people inside each image: sensor_msgs/PointCloud2 as in a mission
truth/world.csv                          everybody over time
truth/cameras.csv                        the true camera of every image, ENU
terrain/                                 terrain.bt, dem.tif, terrain.ply
simulation.json                          what it was made from, and what came out
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import write_bytes
from crowdfence.atomic_folder import written_alone
from crowdfence.simulation.flight.telemetry import true_poses
from crowdfence.simulation.recording.airsim_frames import (
    AirSimEncoder,
    airsim_settings,
    body_quaternions_ned,
    frame_paths,
    gimbal_quaternions,
    ned,
    summary_of_files,
)
from crowdfence.simulation.recording.frame_maker import FrameOptions, camera_pose
from crowdfence.simulation.recording.frame_pool import FramePool, MadeFrame, worker_count
from crowdfence.simulation.recording.manifest import first_difference, mission_manifest
from crowdfence.simulation.recording.preparation import Preparation
from crowdfence.simulation.recording.recorded import Progress, Recorded, require_folder, require_nothing_there
from crowdfence.simulation.recording.timeline import TelemetryRow, WorldInstant
from crowdfence.simulation.recording.timeline_run import TimelineRun
from crowdfence.simulation.scenarios.scenario import ScenarioError
from crowdfence.simulation.scene import Scene
from crowdfence.simulation.scene_truth import people_truth
from crowdfence.simulation.schedule import Capture, Schedule, build_schedule
from crowdfence.sources.recorded_truth import CameraPose
from crowdfence.stop_request import StopRequest

MANIFEST = "simulation.json"
_FOLDERS = ("images", "heatmaps", "telemetry", "terrain", "truth/regions", "truth/instances", "truth/people")
_FILES = ("airsim_rec.txt", "settings.json")
_TABLE_HEADER = "VehicleName TimeStamp POS_X POS_Y POS_Z Q_W Q_X Q_Y Q_Z ImageFile"
_TELEMETRY_HEADER = (
    "stamp_ns position_x position_y position_z q_w q_x q_y q_z gimbal_w gimbal_x gimbal_y gimbal_z"
)
_CAMERA_HEADER = "drone stamp_ns exposure_ns x y z qw qx qy qz"
_WORLD_HEADER = "stamp_ns person x y z crowd"


def record_airsim(
    scene: Scene,
    path: Path,
    *,
    options: FrameOptions | None = None,
    workers: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Recorded:
    """Simulate `scene` into the AirSim recording folder `path`; arguments and errors as `record_mission`.

    Pictures are PNG. FileExistsError for a folder that was not simulated, whatever is asked; ScenarioError
    for a lens distortion, which AirSim's settings cannot express. An interrupt or a kill leaves a folder that
    can be read, as far as it goes, and resumed.
    """
    given = options or FrameOptions()
    options = FrameOptions(given.rgb, given.heatmaps, "PNG", given.jpeg_quality, given.supersample)
    if scene.scenario.trouble.lens_distortion:
        raise ScenarioError(
            "trouble.lens_distortion has no place in an AirSim recording; set it to [] or record a mission"
        )
    if given.layers:
        raise ScenarioError(
            f"the layer {given.layers[0]} has no place in an AirSim recording; record a mission"
        )
    require_folder(path)
    if not (resume or overwrite):
        require_nothing_there(path, "exists")
    if path.is_dir():
        with written_alone(path):  # before the work
            pass
    workers = worker_count(workers)
    schedule = build_schedule(scene)
    with StopRequest() as stop, ExitStack() as held:
        with Preparation(scene, options, apart=workers > 1) as preparation:
            renderer = preparation.renderer()
            manifest = mission_manifest(scene, schedule, options, renderer)
            path.mkdir(exist_ok=True)
            held.enter_context(written_alone(path))
            _prepare(path, manifest, resume=resume)
            map_files = preparation.write_map(path / "terrain", "terrain", "dem")
        with FramePool(scene, options, AirSimEncoder(scene.scenario), workers) as pool:
            run = TimelineRun(schedule, pool, stop, progress)
            try:
                _write_json(path / "settings.json", airsim_settings(scene.scenario, _starts(schedule)))
                with ExitStack() as files:
                    run.into(_FolderSink(scene, schedule, path, options, resume, files))
                statistics = run.statistics()
                _write_json(path / MANIFEST, {"simulation": manifest, "statistics": statistics})
            except OSError as error:
                raise run.explained(error, path) from error
    size = sum(file.stat().st_size for file in path.rglob("*") if file.parent.name != "terrain")
    return Recorded(
        path,
        run.complete,
        run.written,
        run.planned,
        run.resumed,
        size,
        statistics,
        renderer,
        map_files,
    )


def _prepare(path: Path, manifest: dict[str, Any], *, resume: bool) -> None:
    """Folders and manifest. Of a mission that is replaced nothing stays: a later one may have its stamps, and
    would take its frames for its own."""
    if not (path / MANIFEST).exists():
        if path.exists() and any(path.iterdir()):
            raise FileExistsError(
                f"{path} holds no {MANIFEST}, so that nobody simulated it: name another folder"
            )
    elif resume:
        before = json.loads((path / MANIFEST).read_text()).get("simulation", {})
        difference = first_difference(manifest, before)
        if difference is not None:
            raise ValueError(f"{path} is of another mission and cannot be resumed: {difference}")
    else:
        for folder in {name.partition("/")[0] for name in _FOLDERS}:
            if (path / folder).exists():
                shutil.rmtree(path / folder)
        for file in _FILES:
            (path / file).unlink(missing_ok=True)
    _write_json(path / MANIFEST, {"simulation": manifest})
    for folder in _FOLDERS:
        (path / folder).mkdir(parents=True, exist_ok=True)


def _write_json(path: Path, value: dict[str, Any]) -> None:
    write_bytes(path, (json.dumps(value, indent=1) + "\n").encode())


class _FolderSink:
    """The recording folder as the timeline fills it."""

    def __init__(
        self,
        scene: Scene,
        schedule: Schedule,
        folder: Path,
        options: FrameOptions,
        resume: bool,
        files: ExitStack,
    ) -> None:
        self._scene, self._schedule, self._folder = scene, schedule, folder
        self._options, self._resume = options, resume
        self._names = scene.scenario.drone_names
        self._starts = _starts(schedule)
        self._table = files.enter_context(_open(folder / "airsim_rec.txt", _TABLE_HEADER, "\t"))
        self._cameras = files.enter_context(_open(folder / "truth" / "cameras.csv", _CAMERA_HEADER))
        self._world = files.enter_context(_open(folder / "truth" / "world.csv", _WORLD_HEADER))
        self._telemetry = [
            files.enter_context(_open(folder / "telemetry" / f"{name}.csv", _TELEMETRY_HEADER))
            for name in self._names
        ]

    def earlier(self, capture: Capture, *, footprint: bool) -> MadeFrame | None:
        paths = frame_paths(self._scene.scenario, capture, rgb=self._options.rgb)
        wanted = paths.all(rgb=self._options.rgb, heatmaps=self._options.heatmaps)
        if not (self._resume and all((self._folder / file).is_file() for file in wanted)):
            return None
        # From the quaternion, as it is where the frame is made: equal to the last bit.
        pose = self._true_pose(capture).world_from_camera() if footprint else None
        return MadeFrame({}, summary_of_files(self._folder, paths, self._scene.scenario, pose))

    def write_telemetry(self, row: TelemetryRow) -> None:
        position = ned(row.poses.body_position[row.index], self._starts[row.drone])
        body = body_quaternions_ned(row.poses.body_quaternion[row.index : row.index + 1])[0]
        gimbal = gimbal_quaternions(row.poses.gimbal_quaternion[row.index : row.index + 1])[0]
        _write_row(self._telemetry[row.drone], [row.stamp_ns, *position, *body, *gimbal])

    def write_world(self, instant: WorldInstant) -> None:
        truth = people_truth(self._scene, instant.t_s)
        for person, (position, crowd) in enumerate(zip(truth.position, truth.crowd, strict=True), 1):
            _write_row(self._world, [instant.stamp_ns, person, *position, crowd])

    def write_frame(self, capture: Capture, made: MadeFrame) -> None:
        for file, content in made.pieces.items():
            write_bytes(self._folder / file, content)
        t_s = self._exposure_s(capture)
        true = true_poses(self._schedule.flight, capture.drone, np.array([t_s]))
        position = ned(true.body_position[0], self._starts[capture.drone])
        body = body_quaternions_ned(true.body_quaternion)[0]
        paths = frame_paths(self._scene.scenario, capture, rgb=self._options.rgb)
        name, milliseconds = self._names[capture.drone], capture.stamp_ns // 1_000_000
        _write_row(self._table, [name, milliseconds, *position, *body, ";".join(paths.images)], "\t")
        self._table.flush()  # after a kill the table lists what is there
        exposure_ns = self._scene.scenario.epoch_ns + round(t_s * 1e9)
        pose = self._true_pose(capture)
        _write_row(self._cameras, [name, capture.stamp_ns, exposure_ns, *pose.position, *pose.quaternion])

    def _exposure_s(self, capture: Capture) -> float:
        exposed = capture.frame if capture.duplicate_of is None else capture.duplicate_of
        return self._schedule.exposure_s(capture.drone, exposed)

    def _true_pose(self, capture: Capture) -> CameraPose:
        state = self._schedule.flight.at(capture.drone, self._exposure_s(capture))
        return camera_pose(state.world_from_camera)


def _starts(schedule: Schedule) -> NDArray[np.float64]:
    """Where each vehicle's own coordinates begin [drones, 3]: below its first place, NED, whole metres."""
    drones = range(schedule.scenario.drones)
    first = np.array([schedule.flight.at(drone, 0.0).world_from_body[:3, 3] for drone in drones])
    return np.rint(ned(first, np.zeros(3)))


def _open(path: Path, columns: str, separator: str = ",") -> TextIO:
    file = path.open("w", encoding="utf-8", newline="\n")
    file.write(columns.replace(" ", separator) + "\n")
    return file


def _write_row(file: TextIO, cells: Iterable[Any], separator: str = ",") -> None:
    # repr of a float keeps all of its bits.
    file.write(separator.join(repr(float(c)) if isinstance(c, float) else str(c) for c in cells) + "\n")
