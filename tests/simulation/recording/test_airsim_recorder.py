"""A simulated mission as an AirSim recording: read back by our importer, equal poses and images."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from crowdfence.simulation.landscape.ground import Cover
from crowdfence.simulation.recording.airsim_frames import PALETTE
from crowdfence.simulation.recording.airsim_recorder import record_airsim
from crowdfence.simulation.recording.frame_maker import FrameMaker, FrameOptions
from crowdfence.simulation.recording.mission_recorder import record_mission
from crowdfence.simulation.rendering.raycast_labels import raycast_labels
from crowdfence.simulation.scenarios.scenario import ScenarioError, TroublePlan
from crowdfence.simulation.scenarios.scenario_file import load_scenario
from crowdfence.simulation.scene import build_scene
from crowdfence.simulation.scene_class import SceneClass
from crowdfence.simulation.schedule import build_schedule
from crowdfence.sources import open_recording
from crowdfence.truth.at_exposure import crowd_definition
from support.opengl import needs_opengl

LABELS = FrameOptions(rgb=False)
NOISE = TroublePlan(
    trigger_spread_ms=60.0,
    clock_offset_ms=30.0,
    position_noise_m=0.05,
    position_bias_m=0.2,
    attitude_noise_deg=0.2,
    gimbal_bias_deg=0.3,
    telemetry_loss=0.02,
)


@pytest.fixture(scope="module")
def scene():
    camera = {"width": 60, "height": 44}
    scenario = load_scenario("beach", frames=4, camera=camera, voxel_size_m=8.0)
    return build_scene(replace(scenario, trouble=NOISE), 2)


@pytest.fixture(scope="module")
def recorded(scene, tmp_path_factory):
    return record_airsim(scene, tmp_path_factory.mktemp("a") / "airsim", options=LABELS, workers=1)


@pytest.fixture(scope="module")
def mission(scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("m") / "mission.mcap"
    return record_mission(scene, path, options=LABELS, workers=1).path


def test_the_importer_gives_the_poses_of_the_mission(scene, recorded, mission):
    airsim, native = open_recording(recorded.path), open_recording(mission)
    assert airsim.drones == native.drones and airsim.georeference == native.georeference
    assert airsim.refused == () and len(airsim.frames) == len(native.frames) == 12
    for ours, theirs in zip(airsim.frames, native.frames, strict=True):
        assert (ours.drone, ours.stamp_ns) == (theirs.drone, theirs.stamp_ns)
        np.testing.assert_allclose(ours.world_from_camera, theirs.world_from_camera, atol=1e-9)
        for name in ("width", "height", "fx", "fy", "cx", "cy"):
            assert getattr(ours.camera, name) == getattr(theirs.camera, name)
    for drone, track in native.tracks().items():
        np.testing.assert_array_equal(airsim.tracks()[drone].stamps_ns, track.stamps_ns)


def test_the_importer_gives_the_pixels_of_the_mission(recorded, mission):
    options = {"crowd_colors": [PALETTE[SceneClass.CROWD]]}
    airsim, native = open_recording(recorded.path, **options), open_recording(mission)
    assert airsim.terrain == recorded.terrain[0]
    for ours, theirs in zip(airsim.frames, native.frames, strict=True):
        for name in ("depth_m", "regions", "silhouettes", "heatmap"):
            np.testing.assert_array_equal(getattr(ours, name)(), getattr(theirs, name)())
        stem = f"{ours.drone}_{ours.stamp_ns}.png"
        instances = np.asarray(Image.open(recorded.path / "truth/instances" / f"instance_{stem}"))
        np.testing.assert_array_equal(instances, theirs.instances())


def test_the_importer_gives_the_world_of_the_mission(recorded, mission):
    airsim, native = open_recording(recorded.path), open_recording(mission)
    assert list(airsim.people.stamps_ns) == list(native.people.stamps_ns) != []
    for stamp_ns in airsim.people.stamps_ns:
        ours, theirs = airsim.people.read(stamp_ns), native.people.read(stamp_ns)
        for name in ("position", "person", "crowd"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    for ours, theirs in zip(airsim.frames, native.frames, strict=True):
        assert ours.exposure_ns() == theirs.exposure_ns()
        true = [frame.true_pose().world_from_camera() for frame in (ours, theirs)]
        np.testing.assert_allclose(*true, atol=1e-9)
    assert crowd_definition(airsim.manifest) == crowd_definition(native.manifest)


@pytest.fixture(scope="module")
def with_pictures(scene, tmp_path_factory):
    """One rendered frame of each drone."""
    short = build_scene(replace(scene.scenario, frames=1), 2)
    path = tmp_path_factory.mktemp("p") / "airsim"
    return short, record_airsim(short, path, options=FrameOptions(supersample=1), workers=1)


@needs_opengl
def test_pictures_show_what_lies_where_each_camera_was(with_pictures):
    """Where rays from the true pose, cast without OpenGL, meet the sea the picture is blue, where they meet
    sand it is yellow, and depth is their length along the axis, in whole centimetres."""
    scene, recorded = with_pictures
    schedule, surface = build_schedule(scene), scene.landscape.surface
    camera, sea, sand = scene.scenario.intrinsics(), [], []
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.unproject(np.stack([u.ravel() + 0.5, v.ravel() + 0.5], axis=-1))
    for drone, name in enumerate(scene.scenario.drone_names):
        (frame,) = open_recording(recorded.path).frames_of(name)
        t_s = schedule.exposure_s(drone, 0)
        pose = scene.flight.at(drone, t_s).world_from_camera
        cast = raycast_labels(scene, camera, t_s, pose)
        ground = (cast.class_id == SceneClass.GROUND) & (cast.instance_id == 0) & (cast.depth_m < 250.0)
        # The rays pass through parasols, tents and towels: few pixels show one.
        assert (np.abs(frame.depth_m() - cast.depth_m)[ground] < 0.0051).mean() > 0.97

        rays_m = rays[ground.ravel()] / rays[ground.ravel(), 2:] * cast.depth_m[ground][:, None]
        x, y, _ = (rays_m @ pose[:3, :3].T + pose[:3, 3]).T
        red, _, blue = frame.image()[ground].astype(int).T
        water_m = surface.lattice.interpolate(surface.water_depth_m, x, y)
        is_sand = surface.lattice.interpolate(surface.cover[..., Cover.SAND], x, y) > 200
        sea.append((blue - red)[water_m > 1.0])
        sand.append((red - blue)[is_sand & (water_m == 0.0)])
    assert all(len(pixels) > 50 and (pixels > 20).all() for pixels in sea)
    assert all(len(pixels) > 1000 and (pixels > 20).mean() > 0.95 for pixels in sand)


@needs_opengl
def test_a_picture_made_again_is_the_same(with_pictures):
    """Rendering is repeatable: what a resumed recording adds fits what was there."""
    scene, recorded = with_pictures
    frame = open_recording(recorded.path).frames_of("uav1")[0]
    (capture,) = build_schedule(scene).captures(0)
    with FrameMaker(scene, FrameOptions(supersample=1, picture_format="PNG")) as maker:
        again = maker.make(capture)
    assert frame.encoded_image() == again.image
    np.testing.assert_array_equal(frame.depth_m(), again.depth_m)


def test_the_table_holds_true_poses_in_airsim_axes(scene, recorded):
    """North, east, down from each start; the quaternion turns forward (x) into where the nose points."""
    settings = json.loads((recorded.path / "settings.json").read_text())
    header, *lines = (recorded.path / "airsim_rec.txt").read_text().splitlines()
    assert header.split("\t")[:3] == ["VehicleName", "TimeStamp", "POS_X"] and len(lines) == 12
    schedule = build_schedule(scene)
    captures = {(c.drone, c.stamp_ns // 1_000_000): c for d in range(3) for c in schedule.captures(d)}
    for line in lines:
        name, stamp_ms, *numbers, images = line.split("\t")
        x, y, z, qw, qx, qy, qz = map(float, numbers)
        drone = int(name.removeprefix("uav")) - 1
        capture = captures[drone, int(stamp_ms)]
        body = scene.flight.at(drone, schedule.exposure_s(drone, capture.frame)).world_from_body
        start = [settings["Vehicles"][name][axis] for axis in "XYZ"]
        north, east, down = (offset + value for offset, value in zip(start, (x, y, z), strict=True))
        np.testing.assert_allclose([east, north, -down], body[:3, 3], atol=1e-9)
        # First column of the rotation matrix, written out.
        nose = [1 - 2 * (qy**2 + qz**2), 2 * (qx * qy + qw * qz), 2 * (qx * qz - qw * qy)]
        np.testing.assert_allclose([nose[1], nose[0], -nose[2]], body[:3, 0], atol=1e-9)
        assert all((recorded.path / "images" / image).is_file() for image in images.split(";"))


def test_what_is_there_is_taken_over(scene, recorded, tmp_path):
    folder = tmp_path / "airsim"
    stopped = []

    def killed(done, planned):
        stopped.append(done)
        if done == 5:
            raise SystemExit

    with pytest.raises(SystemExit):
        record_airsim(scene, folder, options=LABELS, workers=1, progress=killed)
    part = open_recording(folder)
    assert len(part.frames) + len(part.refused) == 5
    assert "the simulation was interrupted, and nothing of what came after" in part.warnings
    assert not any("interrupted" in one for one in open_recording(recorded.path).warnings)
    with pytest.raises(FileExistsError, match="--resume"):
        record_airsim(scene, folder, options=LABELS, workers=1)
    resumed = record_airsim(scene, folder, options=LABELS, workers=1, resume=True)
    assert (resumed.resumed_frames, resumed.complete) == (5, True)
    assert resumed.statistics == recorded.statistics
    files, expected = (
        sorted(path.relative_to(top) for path in top.rglob("*") if path.suffix != ".tif")
        for top in (folder, recorded.path)
    )
    assert files == expected
    for file in files:
        if (folder / file).is_file():
            assert (folder / file).read_bytes() == (recorded.path / file).read_bytes(), file
    other = build_scene(scene.scenario, 9)
    with pytest.raises(ValueError, match="of another mission and cannot be resumed: seed is 9, was 2"):
        record_airsim(other, folder, options=LABELS, workers=1, resume=True)


def test_a_lens_that_airsim_cannot_describe_is_refused(scene, tmp_path):
    bent = replace(scene.scenario, trouble=TroublePlan(lens_distortion=(-0.1, 0.01, 0.0, 0.0)))
    with pytest.raises(ScenarioError, match=r"lens_distortion .* set it to \[\]"):
        record_airsim(build_scene(bent, 2), tmp_path / "airsim", options=LABELS, workers=1)


# --- what is there already --------------------------------------------------------------------------------


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def quiet_beach(seed, **changes):
    """Stamps of perfect clocks are those of every other world."""
    camera = {"width": 64, "height": 48}
    scenario = load_scenario(
        "beach", frames=2, camera=camera, voxel_size_m=8.0, trouble=TroublePlan(), **changes
    )
    return build_scene(scenario, seed)


def test_a_recording_that_is_replaced_leaves_nothing_behind(tmp_path):
    """Heatmaps of another world at the same stamps would be taken for those of this one."""
    fewer, folder = FrameOptions(rgb=False, heatmaps=False), tmp_path / "airsim"
    record_airsim(quiet_beach(2), folder, options=LABELS, workers=1)
    record_airsim(quiet_beach(3, drones=2), folder, options=fewer, workers=1, overwrite=True)
    record_airsim(quiet_beach(3, drones=2), tmp_path / "new", options=fewer, workers=1)
    assert files(folder) == files(tmp_path / "new")
    assert not any(frame.pixels.heatmap for frame in open_recording(folder).frames)


def test_a_replacement_that_was_killed_goes_on_with_its_own_frames(tmp_path):
    folder, other = tmp_path / "airsim", quiet_beach(3)
    record_airsim(quiet_beach(2), folder, options=LABELS, workers=1)

    def killed(done, planned):
        raise SystemExit

    with pytest.raises(SystemExit):
        record_airsim(other, folder, options=LABELS, workers=1, overwrite=True, progress=killed)
    resumed = record_airsim(other, folder, options=LABELS, workers=1, resume=True)
    assert resumed.complete and resumed.resumed_frames == 1
    record_airsim(other, tmp_path / "new", options=LABELS, workers=1)
    assert files(folder) == files(tmp_path / "new")


@pytest.mark.parametrize("how", ["resume", "overwrite"])
def test_a_run_that_goes_on_is_left_alone(tmp_path, how):
    """Both wrote into one folder, and the table ended with rows of both."""
    folder, refused = tmp_path / "airsim", []

    def another(done, planned):
        if not refused:
            before = files(folder)
            with pytest.raises(FileExistsError, match="airsim is being written by another command"):
                record_airsim(quiet_beach(3), folder, options=LABELS, workers=1, **{how: True})
            refused.append(files(folder) == before)

    record_airsim(quiet_beach(3), folder, options=LABELS, workers=1, progress=another)
    assert refused == [True]
    assert record_airsim(quiet_beach(3), folder, options=LABELS, workers=1, resume=True).complete


@pytest.mark.parametrize("how", ["resume", "overwrite"])
def test_a_folder_of_somebody_else_is_left_alone(tmp_path, how):
    """A flight of AirSim itself has the same names."""
    (tmp_path / "airsim_rec.txt").write_text("precious")
    with pytest.raises(FileExistsError, match=r"holds no simulation\.json.*name another folder"):
        record_airsim(quiet_beach(2), tmp_path, options=LABELS, workers=1, **{how: True})
    assert files(tmp_path) == {"airsim_rec.txt": b"precious"}
