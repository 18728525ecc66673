"""Simulated missions on disk: true to the scene, resumable, honest about what cannot be written."""

import errno
import json
import os
import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from scipy.ndimage import uniform_filter

from crowdfence.simulation.recording import mission_recorder
from crowdfence.simulation.recording.airsim_recorder import record_airsim
from crowdfence.simulation.recording.frame_maker import FrameMaker, FrameOptions
from crowdfence.simulation.recording.manifest import first_difference
from crowdfence.simulation.recording.mission_recorder import record_mission
from crowdfence.simulation.recording.timeline import TelemetryRow, WorldInstant, arriving, timeline
from crowdfence.simulation.rendering.opengl_context import NoOpenGL
from crowdfence.simulation.scenarios.scenario import ScenarioError, TroublePlan
from crowdfence.simulation.scenarios.scenario_file import load_scenario
from crowdfence.simulation.scene import Scene, build_scene
from crowdfence.simulation.scene_class import SceneClass
from crowdfence.simulation.scene_truth import people_truth
from crowdfence.simulation.schedule import Capture, build_schedule
from crowdfence.simulation.simulated_detector import SimulatedDetector
from crowdfence.sources import open_recording
from crowdfence.sources.convert import convert
from crowdfence.sources.mission import topic_writer
from crowdfence.sources.mission.layout import CLASSES, CROWD_CLASS
from crowdfence.sources.mission.messages import depth_in_whole_cm
from crowdfence.sources.mission.topic_writer import part_path
from crowdfence.stop_request import StopRequest
from crowdfence.truth.at_exposure import MAX_PEOPLE_GAP_S

LABELS = FrameOptions(rgb=False)
SEED, FRAMES, DRONES = 3, 6, 3
TROUBLE = {"dropped": 0.15, "duplicated": 0.15, "late": 0.2, "late_ms": 250.0, "lens_distortion": []}


@lru_cache(maxsize=4)
def beach(seed: int = SEED, **overrides: object) -> Scene:
    camera = {"width": 64, "height": 48}
    scenario = load_scenario("beach", frames=FRAMES, camera=camera, voxel_size_m=5.0, trouble=dict(TROUBLE))
    return build_scene(replace(scenario, **overrides), seed)


@pytest.fixture(scope="module", autouse=True)
def small_chunks():
    """As many chunks as a mission with large frames has."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(topic_writer, "CHUNK_BYTES", 100_000)
        yield


@pytest.fixture(scope="module")
def mission(tmp_path_factory, small_chunks):
    path = tmp_path_factory.mktemp("mission") / "beach.mcap"
    return record_mission(beach(), path, options=LABELS, workers=1)


def messages(path):
    """(topic, log time, publish time, bytes) of every message in the order of the file, and the metadata."""
    with path.open("rb") as file:
        found = [
            (channel.topic, message.log_time, message.publish_time, message.data)
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False)
        ]
        file.seek(0)
        metadata = {record.name: record.metadata for record in make_reader(file).iter_metadata()}
    return found, metadata


# --- true to the scene ------------------------------------------------------------------------------------


def test_frames_show_the_scene(mission):
    """Depth and the true pose of every ground pixel lead to the ground; persons are where people stand."""
    scene, recording = beach(), open_recording(mission.path)
    camera, errors, persons = scene.scenario.intrinsics(), [], 0
    v, u = np.mgrid[0:48, 0:64]
    rays = camera.unproject(np.stack([u.ravel() + 0.5, v.ravel() + 0.5], axis=-1))
    for frame in recording.frames:
        depth, instance = frame.depth_m().ravel(), frame.instances().ravel()
        pose = frame.true_pose().world_from_camera()
        points = rays / rays[:, 2:] * np.nan_to_num(depth)[:, None] @ pose[:3, :3].T + pose[:3, 3]
        ground = (frame.segmentation().ravel() == SceneClass.GROUND) & (instance == 0) & (depth < 250)
        # Half a centimetre of rounding along the axis, and at grazing rays it shows in the height in full.
        errors.append(points[ground, 2] - scene.landscape.height_m(*points[ground, :2].T))
        feet = people_truth(scene, (frame.exposure_ns() - scene.scenario.epoch_ns) / 1e9).position
        for number in np.unique(instance[instance > 0]):
            shown = points[instance == number]
            assert np.linalg.norm(shown[:, :2] - feet[number - 1, :2], axis=1).max() < 0.8
            persons += 1
        assert np.isnan(frame.depth_m()[frame.segmentation() == SceneClass.SKY]).all()
    assert persons > 20
    assert np.percentile(np.abs(np.concatenate(errors)), 99) < 0.05


def test_poses_are_kept_true_and_as_logged(mission):
    scene, recording = beach(), open_recording(mission.path)
    schedule = build_schedule(scene)
    exposed = {}
    for drone, name in enumerate(scene.scenario.drone_names):
        for capture in schedule.captures(drone):
            number = capture.frame if capture.duplicate_of is None else capture.duplicate_of
            exposed[name, capture.stamp_ns] = (drone, schedule.exposure_s(drone, number))
    for frame in recording.frames:
        drone, t_s = exposed[frame.drone, frame.stamp_ns]
        true = scene.flight.at(drone, t_s).world_from_camera
        np.testing.assert_allclose(frame.true_pose().world_from_camera(), true, atol=1e-12)
        assert frame.exposure_ns() == scene.scenario.epoch_ns + round(t_s * 1e9)
    for drone, name in enumerate(scene.scenario.drone_names):
        telemetry, track = schedule.telemetry(drone), recording.tracks()[name]
        np.testing.assert_array_equal(track.stamps_ns, telemetry.stamps_ns)
        np.testing.assert_array_equal(track.positions, telemetry.noisy.camera_position)


def test_people_are_where_the_world_says(mission):
    scene, recording = beach(), open_recording(mission.path)
    assert len(recording.people.stamps_ns) == FRAMES
    for number in range(FRAMES):
        stamp_ns = scene.scenario.epoch_ns + round(number / scene.scenario.fps * 1e9)
        people = recording.people_truth(stamp_ns + 20_000_000)
        assert people is not None and people.stamp_ns == stamp_ns
        truth = people_truth(scene, number / scene.scenario.fps)
        np.testing.assert_allclose(people.position, truth.position, atol=1e-4)
        np.testing.assert_array_equal(people.crowd, truth.crowd)
        np.testing.assert_array_equal(people.person, np.arange(1, scene.people.count + 1))
    assert recording.people_truth(0) is None


def test_people_in_a_frame_are_those_its_pixels_show(mission):
    for frame in open_recording(mission.path).frames:
        people, (numbers, pixels) = frame.people(), np.unique(frame.instances(), return_counts=True)
        shown = {int(n): int(c) for n, c in zip(numbers, pixels, strict=True) if n}
        assert {int(n): int(c) for n, c in zip(people.person, people.pixels, strict=True) if c} == shown
        crowd_of = dict(zip(people.person.tolist(), people.crowd.tolist(), strict=True))
        for number in shown:
            classes = frame.segmentation()[frame.instances() == number]
            expected = SceneClass.CROWD if crowd_of[number] else SceneClass.GROUND
            assert (classes == expected).all()
        regions = frame.regions()
        assert (regions[frame.segmentation() == SceneClass.CROWD] > 0).all()


def test_the_manifest_says_everything(mission):
    manifest = open_recording(mission.path).manifest
    simulation, statistics = manifest["simulation"], manifest["statistics"]
    assert (simulation["seed"], simulation["scenario"]["name"]) == (SEED, "beach")
    assert simulation["scenario"]["crowd_definition"] == {"min_people": 3, "radius_m": 2.0}
    assert "raycast" in simulation["renderer"]
    assert [drone["name"] for drone in simulation["trouble"]["drones"]] == ["uav1", "uav2", "uav3"]
    assert set(simulation["trouble"]["drones"][0]) > {"clock_offset_s", "position_bias_m", "gimbal_bias_deg"}
    assert simulation["trouble"]["plan"]["dropped"] == 0.15
    assert statistics["complete"] is True and statistics["frames"] == mission.frames
    assert sum(statistics["class_share"].values()) == pytest.approx(1.0)
    assert statistics["overlap"]["instants"] == FRAMES and len(statistics["overlap"]["pairs"]) == 3
    fates = statistics["captures"].values()
    for fate in ("dropped", "duplicated", "late"):
        assert sum(drone[fate] for drone in fates) > 0, f"this seed shows no {fate} frame"


def test_class_shares_are_those_of_the_frames(mission):
    recording = open_recording(mission.path, max_jump_s=1e6)
    found, _ = messages(mission.path)
    delivered = sum(topic.endswith("/truth/segmentation") for topic, *_ in found)
    assert delivered == mission.frames
    # Late frames are refused by the reader, so the shares are compared drone by drone where none is late.
    statistics = recording.manifest["statistics"]
    punctual = [name for name, fate in statistics["captures"].items() if not fate["late"]]
    for name in punctual:
        classes = np.stack([frame.segmentation() for frame in recording.frames_of(name)])
        for kind in SceneClass:
            share = statistics["drones"][name]["class_share"][kind.name.lower()]
            assert share == pytest.approx(float((classes == kind).mean()))


def test_others_read_the_truth(mission):
    """An independent implementation of MCAP and CDR, with its own definitions of the message types."""
    scene, store = beach(), get_typestore(Stores.ROS2_HUMBLE)
    kinds = {}
    with AnyReader([mission.path], default_typestore=store) as reader:
        for connection, log_time_ns, raw in reader.messages():
            message = store.deserialize_cdr(raw, connection.msgtype)
            kinds.setdefault(connection.topic, connection.msgtype)
            if connection.topic == "/truth/people":
                names = [field.name for field in message.fields]
                assert names == ["x", "y", "z", "person", "crowd"]
                rows = message.data.view("<f4").reshape(message.width, len(names))
                t_s = (log_time_ns - scene.scenario.epoch_ns) / 1e9
                np.testing.assert_allclose(rows[:, :3], scene.people.positions(t_s), atol=1e-4)
    assert kinds["/uav1/truth/exposure"] == "sensor_msgs/msg/TimeReference"
    assert kinds["/uav2/truth/people"] == "sensor_msgs/msg/PointCloud2"
    assert kinds["/uav3/truth/pose"] == "geometry_msgs/msg/PoseStamped"


def test_the_classes_of_simulator_and_mission_are_the_same():
    assert {kind.value: kind.name.lower() for kind in SceneClass} == CLASSES
    assert CROWD_CLASS == SceneClass.CROWD


def test_converting_keeps_the_truth(mission, tmp_path):
    before = open_recording(mission.path)
    convert(before, tmp_path / "copy.mcap")
    after = open_recording(tmp_path / "copy.mcap")
    assert {**after.manifest, "path": 0, "source": 0, "terrain": 0} == {
        **before.manifest,
        "path": 0,
        "source": 0,
        "terrain": 0,
    }
    assert after.people.stamps_ns == before.people.stamps_ns
    assert len(after.frames) == len(before.frames) > 0
    for a, b in zip(before.frames, after.frames, strict=True):
        for name in ("segmentation", "instances", "regions", "silhouettes", "depth_m", "heatmap"):
            np.testing.assert_array_equal(getattr(a, name)(), getattr(b, name)())
        assert a.exposure_ns() == b.exposure_ns()
        np.testing.assert_array_equal(a.true_pose().quaternion, b.true_pose().quaternion)
        np.testing.assert_array_equal(a.people().pixels, b.people().pixels)


# --- order, clocks, resume --------------------------------------------------------------------------------


def test_everything_is_recorded_once_and_in_order():
    schedule = build_schedule(beach())
    events = list(timeline(schedule))
    times = [event.arrival_ns if isinstance(event, Capture) else event.stamp_ns for event in events]
    assert times == sorted(times)
    assert sum(isinstance(event, WorldInstant) for event in events) == FRAMES
    for drone in range(DRONES):
        planned = [capture for capture in schedule.captures(drone) if not capture.dropped]
        arrived = [event for event in events if isinstance(event, Capture) and event.drone == drone]
        assert sorted(arrived, key=lambda capture: capture.frame) == planned
        rows = [
            event.stamp_ns for event in events if isinstance(event, TelemetryRow) and event.drone == drone
        ]
        assert rows == schedule.telemetry(drone).stamps_ns.tolist()


def test_a_late_frame_stands_behind_younger_ones():
    plan = TroublePlan(late=0.5, late_ms=300.0)  # three frames later to the nanosecond at 10 Hz
    schedule = build_schedule(beach(trouble=plan, frames=40))
    order = [capture.frame for capture in arriving(schedule, 0)]
    late = {capture.frame for capture in schedule.captures(0) if capture.late_by_s}
    assert sorted(order) == list(range(40)) and 5 < len(late) < 35
    place = {frame: position for position, frame in enumerate(order)}
    for frame in sorted(late)[:-3]:
        on_time = [younger for younger in (frame + 1, frame + 2) if younger not in late]
        assert all(place[younger] < place[frame] for younger in on_time)
        # It arrives together with the one three later, and goes first if that is on time.
        assert frame + 3 in late or place[frame] < place[frame + 3]


def test_processes_write_the_same_bytes(mission, tmp_path):
    """Two workers, each with a scene of its own making, against one in this process."""
    again = record_mission(beach(), tmp_path / "beach.mcap", options=LABELS, workers=2)
    assert again.path.read_bytes() == mission.path.read_bytes()
    for one, other in zip(again.terrain, mission.terrain, strict=True):
        if one.suffix != ".tif":  # GDAL writes the time
            assert one.read_bytes() == other.read_bytes()


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.85])
def test_a_killed_run_goes_on(mission, tmp_path, share):
    """What a kill leaves is a file that ends anywhere."""
    whole, path = mission.path.read_bytes(), tmp_path / "beach.mcap"
    part_path(path).write_bytes(whole[: int(share * len(whole))])
    if share >= 0.5:
        assert 0 < len(open_recording(part_path(path)).frames) < mission.frames
    resumed = record_mission(beach(), path, options=LABELS, workers=1, resume=True)
    assert resumed.complete and messages(path) == messages(mission.path)
    assert resumed.resumed_frames < mission.frames
    assert (resumed.resumed_frames > 0) == (share >= 0.5)
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "beach.bt",
        "beach.mcap",
        "beach.ply",
        "beach.tif",
    ]


def test_a_second_kill_loses_nothing(mission, tmp_path, monkeypatch):
    path = tmp_path / "beach.mcap"
    whole = mission.path.read_bytes()
    part_path(path).write_bytes(whole[: len(whole) * 3 // 4])

    def killed(done, planned):
        raise SystemExit

    with pytest.raises(SystemExit):
        record_mission(beach(), path, options=LABELS, workers=1, resume=True, progress=killed)
    resumed = record_mission(beach(), path, options=LABELS, workers=1, resume=True)
    assert resumed.resumed_frames > mission.frames // 2
    assert messages(path) == messages(mission.path)


def test_a_mission_goes_before_its_map_does(mission, tmp_path):
    """A mission names the map beside it: killed while it was replaced by one of another seed, it stayed, on
    the ground of that seed, and what was there of the new one could not be resumed."""
    path = tmp_path / "beach.mcap"
    path.write_bytes(mission.path.read_bytes())
    part_path(path).write_bytes(mission.path.read_bytes())

    def killed(done, planned):
        raise SystemExit

    with pytest.raises(SystemExit):
        record_mission(beach(seed=4), path, options=LABELS, workers=1, overwrite=True, progress=killed)
    assert not path.exists()
    resumed = record_mission(beach(seed=4), path, options=LABELS, workers=1, resume=True)
    assert resumed.complete and open_recording(path).manifest["simulation"]["seed"] == 4


@pytest.mark.parametrize(("fps", "spread_ms"), [(0.5, 1000.0), (1.0, 1000.0), (3.0, 700.0), (10.0, 80.0)])
def test_it_is_recorded_where_people_were_at_every_exposure(fps, spread_ms):
    """Of slow cameras that expose long after each other nobody's position was recorded then."""
    trouble = TroublePlan(trigger_spread_ms=spread_ms)
    scene = beach()
    scenario = replace(scene.scenario, frames=6, fps=fps, trouble=trouble)
    for seed in range(5):
        schedule = build_schedule(replace(scene, scenario=scenario, seed=seed))
        events = list(timeline(schedule))
        world_s = np.array([event.t_s for event in events if isinstance(event, WorldInstant)])
        assert (np.diff(world_s) > 0.0).all() and set(np.arange(6) / fps) <= set(world_s)
        for event in events:
            if isinstance(event, Capture):
                assert np.abs(world_s - event.t_s).min() <= MAX_PEOPLE_GAP_S


def test_an_interrupt_ends_the_file_properly(mission, tmp_path, monkeypatch):
    path = tmp_path / "beach.mcap"

    def interrupt(done, planned):
        if done == 4:
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    stopped = record_mission(beach(), path, options=LABELS, workers=1, progress=interrupt)
    assert signal.getsignal(signal.SIGINT) is before
    assert not stopped.complete and stopped.frames == 4
    recording = open_recording(path)
    (warning,) = recording.warnings
    assert warning.startswith(f"the simulation was interrupted: 4 of {stopped.planned_frames} frames are")
    assert recording.manifest["statistics"]["complete"] is False
    resumed = record_mission(beach(), path, options=LABELS, workers=1, resume=True)
    assert (resumed.resumed_frames, resumed.complete) == (4, True)
    assert messages(path) == messages(mission.path)
    # Resuming what is complete changes nothing.
    record_mission(beach(), path, options=LABELS, workers=1, resume=True)
    assert messages(path) == messages(mission.path)


def test_a_second_interrupt_is_obeyed_at_once():
    with StopRequest() as stop:
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop.wanted
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(1)


def test_another_mission_is_not_resumed(mission, tmp_path):
    path = tmp_path / "beach.mcap"
    path.write_bytes(mission.path.read_bytes())
    with pytest.raises(ValueError, match=r"cannot be resumed: seed is 4, was 3.*--force"):
        record_mission(beach(seed=4), path, options=LABELS, workers=1, resume=True)
    assert path.read_bytes() == mission.path.read_bytes()
    path.write_bytes(b"something else entirely")
    with pytest.raises(ValueError, match="not an MCAP file"):
        record_mission(beach(), path, options=LABELS, workers=1, resume=True)


def test_the_first_difference_is_named():
    assert first_difference({"a": {"b": 1, "c": 2}}, {"a": {"b": 1, "c": 3}}) == "a.c is 2, was 3"
    assert first_difference({"a": 1}, {"a": 1, "d": [2]}) == "d is None, was [2]"
    assert first_difference({"a": [1, {"x": 0}]}, {"a": [1, {"x": 0}]}) is None


# --- what cannot be written -------------------------------------------------------------------------------


def test_nothing_is_overwritten_unasked(mission, tmp_path):
    path = tmp_path / "beach.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(FileExistsError, match=r"beach\.mcap exists: .*--resume.*--force"):
        record_mission(beach(), path, options=LABELS, workers=1)
    path.rename(part_path(path))
    with pytest.raises(FileExistsError, match="is left of an interrupted run"):
        record_mission(beach(), path, options=LABELS, workers=1)
    assert part_path(path).read_bytes() == b"precious"
    record_mission(beach(), path, options=LABELS, workers=1, overwrite=True)
    assert messages(path) == messages(mission.path)


@pytest.mark.parametrize("name", ["beach.bt", "beach.tif", "beach.ply"])
def test_no_map_is_overwritten_unasked(tmp_path, name):
    """Somebody's own height model is called as the mission more often than not."""
    (tmp_path / name).write_bytes(b"precious")
    with pytest.raises(FileExistsError, match=rf"{name} exists.*--force"):
        record_mission(beach(), tmp_path / "beach.mcap", options=LABELS, workers=1)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"precious"]


@pytest.mark.parametrize("how", [{}, {"resume": True}, {"overwrite": True}])
def test_a_run_that_goes_on_is_left_alone(mission, tmp_path, how):
    """Its file was taken for what a kill had left, and both runs wrote into one."""
    path = tmp_path / "beach.mcap"
    with mission_recorder.MissionWriter(path) as writer:
        writer.add_drone("uav1")
        with pytest.raises(FileExistsError, match="is being written by another command"):
            record_mission(beach(), path, options=LABELS, workers=1, **how)
    assert [file.name for file in tmp_path.iterdir()] == ["beach.mcap"]


def test_a_target_that_cannot_be_is_refused_first(tmp_path):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        record_mission(beach(), tmp_path / "no" / "beach.mcap", options=LABELS)
    with pytest.raises(IsADirectoryError, match="is a folder"):
        record_mission(beach(), tmp_path, options=LABELS)


def test_a_full_disk_leaves_what_was_written(mission, tmp_path, monkeypatch):
    path = tmp_path / "beach.mcap"

    class FullDisk(mission_recorder.MissionWriter):
        left = 8

        def add_encoded_frame(self, *arguments, **options):
            FullDisk.left -= 1
            if FullDisk.left < 0:
                self._mcap.add_metadata("flush", {})  # what is on the disk when it fills up
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            super().add_encoded_frame(*arguments, **options)

    with monkeypatch.context() as patched:
        patched.setattr(mission_recorder, "MissionWriter", FullDisk)
        with pytest.raises(OSError, match="No space left on device: 8 of .* --resume") as caught:
            record_mission(beach(), path, options=LABELS, workers=1)
    assert caught.value.errno == errno.ENOSPC and caught.value.filename == str(part_path(path))
    resumed = record_mission(beach(), path, options=LABELS, workers=1, resume=True)
    assert resumed.complete and messages(path) == messages(mission.path)


def test_without_opengl_the_error_says_how_to_get_labels(tmp_path, monkeypatch):
    def missing(*arguments, **options):
        raise NoOpenGL("no EGL here")

    monkeypatch.setattr("crowdfence.simulation.recording.frame_maker.Renderer", missing)
    with pytest.raises(NoOpenGL, match="no EGL here"):
        record_mission(beach(), tmp_path / "m.mcap", workers=1)
    assert list(tmp_path.iterdir()) == []


def test_a_rolling_exposure_needs_pictures():
    scene = beach(trouble=TroublePlan(rolling_exposure_ms=10.0))
    with pytest.raises(ScenarioError, match=r"rolling_exposure_ms is 10.*set it to 0"):
        FrameMaker(scene, LABELS)


@pytest.mark.parametrize("workers", [0, -2, 100_000])
def test_workers_that_are_none_or_too_many_are_refused_before_anything_is_written(tmp_path, workers):
    """0 is no word for as many as there are cores; 100,000 took the machine's memory."""
    with pytest.raises(ValueError, match=rf"workers must be between 1 and \d+, got {workers}"):
        record_mission(beach(), tmp_path / "beach.mcap", options=LABELS, workers=workers)
    with pytest.raises(ValueError, match=rf"workers must be between 1 and \d+, got {workers}"):
        record_airsim(beach(), tmp_path / "beach", options=LABELS, workers=workers)
    assert list(tmp_path.iterdir()) == []


# --- parts ------------------------------------------------------------------------------------------------


@given(arrays.arrays(np.float32, (3, 4), elements=st.floats(0, 2000, width=32)))
def test_compact_depth_is_right_to_half_a_centimetre_or_unknown(depth_m):
    kept = depth_in_whole_cm(depth_m)
    known = np.isfinite(kept)
    assert (np.abs(kept[known].astype(np.float64) - depth_m[known]) <= 0.005 + 1e-4).all()
    assert ((depth_m[~known] < 0.005001) | (depth_m[~known] > 655.35)).all()
    np.testing.assert_array_equal(depth_in_whole_cm(kept), kept)


def test_the_detector_stand_in_is_good_but_not_perfect():
    regions = np.zeros((96, 128), np.uint16)
    regions[20:60, 30:80] = 1
    instances = np.zeros_like(regions)
    instances[70:90, 100:106] = 7  # somebody in no crowd
    detector = SimulatedDetector()
    heatmaps = np.stack([detector.heatmap(regions, instances, 1, 0, frame) for frame in range(40)]) / 255
    inside = np.zeros((24, 32), bool)
    inside[5:15, 8:20] = True
    outside = uniform_filter((np.kron(inside, np.ones((1, 1))) > 0).astype(float), 5) == 0
    assert heatmaps.shape == (40, 24, 32)
    assert 0.9 < (heatmaps[:, inside] >= 0.5).mean() < 1.0
    assert 0.0 < (heatmaps[:, outside] >= 0.5).mean() < 0.03
    # Mistakes differ from frame to frame, but not from run to run.
    assert (heatmaps[0] != heatmaps[1]).any()
    np.testing.assert_array_equal(detector.heatmap(regions, instances, 1, 0, 5) / 255, heatmaps[5])
    with pytest.raises(ValueError, match="no whole cells"):
        detector.heatmap(regions[:95], instances[:95], 1, 0, 0)


# --- the command ------------------------------------------------------------------------------------------


def crowdfence(*arguments, **options):
    environment = {**os.environ, "COLUMNS": "120", "NO_COLOR": "1"}
    command = [sys.executable, "-m", "crowdfence", *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, **options
    )


SMALL = ["--size", "60x44", "--voxel", "8", "--no-rgb", "--workers", "1"]


def test_the_command_is_interrupted_and_resumed(tmp_path):
    path = tmp_path / "empty.mcap"
    command = ["simulate", "empty", "-o", path, "--frames", "60", "--seed", "5", *SMALL]
    process = crowdfence(*command)
    for _ in range(600):
        time.sleep(0.05)
        if part_path(path).exists() and part_path(path).stat().st_size > 20_000:
            break
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130, stderr
    assert "--resume goes on" in stderr and len(stderr.strip().splitlines()) == 1
    assert len(open_recording(path).frames) > 0
    done = crowdfence(*command, "--resume", "--json")
    stdout, stderr = done.communicate(timeout=120)
    assert done.returncode == 0, stderr
    report = json.loads(stdout)
    assert report["complete"] and 0 < report["resumed_frames"] < report["frames"]
    assert report["bytes"] == path.stat().st_size


@pytest.mark.parametrize("everybody", [True, False])
@pytest.mark.parametrize("recording", [True, False])
def test_workers_that_are_ended(tmp_path, everybody, recording):
    """With the command, as systemd and `timeout` do: a stop like any other, also before the first frame.
    Alone, as the kernel does where memory is short: an error."""
    path = tmp_path / "empty.mcap"
    command = ["simulate", "empty", "-o", path, "--frames", "400", *SMALL[:-1], "2"]
    process = crowdfence(*command, start_new_session=True)
    for _ in range(1200):
        time.sleep(0.05)
        if part_path(path).exists() and part_path(path).stat().st_size > 20_000:
            break
        if not recording and _workers_of(process):
            break
    if everybody:
        os.killpg(process.pid, signal.SIGTERM)
    else:
        os.kill(max(_workers_of(process)), signal.SIGKILL)
    _, stderr = process.communicate(timeout=60)
    (line,) = stderr.strip().splitlines()
    if everybody:
        assert process.returncode == 130 and "--resume goes on" in line
        assert open_recording(path).manifest["statistics"]["complete"] is False
    else:
        advice = "go on with --resume and fewer" if recording else "choose larger voxels"
        assert process.returncode == 1 and f"was killed (out of memory?); {advice}" in line
    if recording:
        assert len(open_recording(path if everybody else part_path(path)).frames) > 0


def _workers_of(process) -> list[int]:
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [int(one) for one in children if b"spawn_main" in Path(f"/proc/{one}/cmdline").read_bytes()]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["race", "--drones", "0"], "drones must be between 1 and 64, got 0"),
        (["race", "--size", "96x90"], "--size must be a multiple of 4 from 16 to 4096 pixels, got 90"),
        (["race", "--size", "wide"], "--size is 'wide', expected two numbers such as 640x480"),
        (["nowhere"], "unknown scenario 'nowhere'"),
        (["race", "--fps", "0"], "fps"),
    ],
)
def test_impossible_parameters_are_one_clear_line(tmp_path, arguments, message):
    done = crowdfence("simulate", *arguments, "-o", tmp_path / "m.mcap")
    stdout, stderr = done.communicate(timeout=60)
    assert done.returncode == 1 and stdout == ""
    assert len(stderr.strip().splitlines()) == 1 and message in stderr
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_may_not_grow_is_one_clear_line(tmp_path):
    def no_growth():
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))

    done = crowdfence(
        "simulate", "empty", "-o", tmp_path / "m.mcap", "--frames", 2, *SMALL, preexec_fn=no_growth
    )
    _, stderr = done.communicate(timeout=60)
    assert done.returncode == 1 and "Traceback" not in stderr
    assert "File too large" in stderr and len(stderr.strip().splitlines()) == 1
