"""Rendered frames from outside: labels and depth against the map, the raycast and rays worked out by hand."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from crowdfence._core import Camera, Terrain
from crowdfence.simulation.people.bodies import Bodies
from crowdfence.simulation.people.cyclists import Cyclists
from crowdfence.simulation.people.people import People
from crowdfence.simulation.rendering.clip_space import clip_from_camera, light_from_world
from crowdfence.simulation.rendering.opengl_context import INSTALL_LINE, NoOpenGL, open_context
from crowdfence.simulation.rendering.picture_settings import PictureSettings
from crowdfence.simulation.rendering.ray_surface import capsule_hits, triangle_hits
from crowdfence.simulation.rendering.raycast_labels import LabelRaycaster
from crowdfence.simulation.rendering.renderer import Renderer
from crowdfence.simulation.rendering.sample_lattice import lattice_for
from crowdfence.simulation.scenarios.scenario_file import load_scenario
from crowdfence.simulation.scene import build_scene
from crowdfence.simulation.scene_class import SceneClass
from support.opengl import needs_opengl

WIDTH, HEIGHT = 160, 128
CAMERA = Camera.pinhole(WIDTH, HEIGHT, 100.0, 100.0, 80.0, 64.0)
LENS = Camera.pinhole(WIDTH, HEIGHT, 100.0, 100.0, 80.0, 64.0, [-0.08, 0.02, 0.0005, -0.0003])


@pytest.fixture(scope="module")
def scene():
    scenario = load_scenario(
        "race",
        landscape={"size_m": 512, "relief_m": 60, "trees": 60, "bushes": 30, "rocks": 30, "cars": 4},
        crowds=[
            {"along_m": 200, "side": "right", "people": 40, "length_m": 20, "depth_m": 5, "speed_m_s": 0.3}
        ],
        walkers={"count": 3},
    )
    return build_scene(scenario, 11)


def looking(eye, target, up=(0.0, 0.0, 1.0)):
    """world_from_camera [4, 4] at `eye` with the optical axis through `target`."""
    ahead = np.asarray(target, float) - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :4] = np.column_stack([right, np.cross(ahead, right), ahead, eye])
    return pose


def pose_at(scene, along_m=190.0, height_m=25.0):
    road = scene.landscape.road
    eye, target = road.position(np.array([along_m - 30.0, along_m + 15.0]))
    return looking(eye + np.array([0, 0, height_m]), target)


def back_projected(frame, camera, pose):
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays = camera.unproject(np.stack([u, v], axis=-1).reshape(-1, 2))
    rays = rays / rays[:, 2:] @ pose[:3, :3].T
    return pose[:3, 3] + frame.depth_m.reshape(-1, 1).astype(float) * rays, rays


@pytest.fixture(scope="module")
def frame(scene):
    with Renderer(scene, CAMERA) as renderer:
        assert renderer.description
        return renderer.render(5.0, pose_at(scene))


@needs_opengl
@pytest.mark.parametrize("supersample", [1, 2, 3])
def test_depth_of_road_pixels_lies_on_the_map(scene, supersample):
    pose = pose_at(scene)
    with Renderer(scene, CAMERA, supersample=supersample) as renderer:
        frame = renderer.render(5.0, pose)
    points, _ = back_projected(frame, CAMERA, pose)
    road = (frame.class_id.ravel() == SceneClass.ROAD) & (frame.depth_m.ravel() < 250)
    assert road.sum() > 500
    x, y, z = points[road].T
    assert np.percentile(np.abs(z - scene.landscape.height_m(x, y)), 99) < 0.01
    assert scene.landscape.on_road(x, y).mean() > 0.999


@needs_opengl
def test_depth_through_a_distorting_lens_lies_on_the_map(scene):
    pose = pose_at(scene)
    with Renderer(scene, LENS) as renderer:
        frame = renderer.render(5.0, pose)
    points, _ = back_projected(frame, LENS, pose)
    road = (frame.class_id.ravel() == SceneClass.ROAD) & (frame.depth_m.ravel() < 250)
    x, y, z = points[road].T
    assert np.percentile(np.abs(z - scene.landscape.height_m(x, y)), 99) < 0.05
    assert scene.landscape.on_road(x, y).mean() > 0.99


@needs_opengl
def test_depth_agrees_with_the_cores_raycast(scene, frame):
    pose, ground, voxel_m = pose_at(scene), scene.landscape.ground, 0.5
    near = np.abs(ground.vertices[ground.triangles].mean(axis=1)[:, :2] - pose[:2, 3]).max(axis=1) < 120
    terrain = Terrain.from_triangles(
        ground.vertices, ground.triangles[near], voxel_m, tuple(ground.vertices.min(axis=0) - 1)
    )
    points, rays = back_projected(frame, CAMERA, pose)
    road = np.flatnonzero((frame.class_id.ravel() == SceneClass.ROAD) & (frame.depth_m.ravel() < 90))
    ids, _ = terrain.raycast(np.broadcast_to(pose[:3, 3], (len(road), 3)), rays[road], 400.0)
    assert (ids >= 0).all()
    # The ray enters the voxel on or before the surface point: at most some voxels ahead at a grazing angle.
    away = np.linalg.norm(terrain.voxel_centers(ids) - points[road], axis=1)
    assert np.percentile(away, 90) < 3 * voxel_m
    inside = terrain.voxel_ids(np.floor((points[road] - terrain.origin) / voxel_m).astype(int)) >= 0
    assert inside.mean() > 0.999


@needs_opengl
def test_people_are_where_the_scene_says(scene, frame):
    pose = pose_at(scene)
    people = scene.people.at(5.0)
    points, _ = back_projected(frame, CAMERA, pose)
    seen = np.unique(frame.instance_id[frame.instance_id > 0])
    assert len(seen) > 15
    for person in seen[seen <= scene.people.count]:
        pixels = frame.instance_id.ravel() == person
        offset = points[pixels] - people.position[person - 1]
        assert np.hypot(offset[:, 0], offset[:, 1]).max() < 1.1
        assert offset[:, 2].min() > -0.1
        assert offset[:, 2].max() < 1.4 * scene.people.height_m[person - 1]
        expected = SceneClass.CROWD if people.in_crowd[person - 1] else SceneClass.GROUND
        assert (frame.class_id.ravel()[pixels] == expected).all()


@needs_opengl
def test_girth_widens_and_stance_parts_the_legs(scene):
    """A walker from 8 m in front, at 50 pixels a metre."""
    camera = Camera.pinhole(WIDTH, HEIGHT, 400.0, 400.0, 80.0, 64.0)
    walker = scene.people.count - 1
    state = scene.people.at(5.0)
    ahead = np.array([np.cos(state.heading_rad[walker]), np.sin(state.heading_rad[walker]), 0.0])
    middle = state.position[walker] + [0.0, 0.0, 0.9]
    pose = looking(middle + 8.0 * ahead, middle)

    def shown(girth, stance_rad):
        count = scene.people.count
        bodies = Bodies(np.full(count, girth), np.full(count, stance_rad), 0.0)
        with Renderer(replace(scene, people=replace(scene.people, bodies=bodies)), camera) as renderer:
            return renderer.render(5.0, pose).instance_id == walker + 1

    usual, stout, astride = shown(1.0, 0.0), shown(1.6, 0.0), shown(1.0, 0.4)
    assert stout.sum() / usual.sum() == pytest.approx(1.6, rel=0.1)

    def feet_apart_px(mask):
        lowest_half_metre = mask[np.flatnonzero(mask.any(axis=1))[-25:]]
        return np.ptp(np.flatnonzero(lowest_half_metre.any(axis=0))) + 1

    # Hip joints 0.088 m from the middle, legs of 0.92 m, shoes 0.1 m wide.
    assert feet_apart_px(usual) == pytest.approx(50.0 * (2.0 * 0.088 + 0.1), abs=4.0)
    astride_m = 2.0 * (0.088 + 0.92 * np.sin(0.4)) + 0.1
    assert feet_apart_px(astride) == pytest.approx(50.0 * astride_m, abs=4.0)


@needs_opengl
def test_cheering_raises_the_hands(scene, monkeypatch):
    """Somebody who stands, from 10 m in front, at 40 pixels a metre."""
    camera = Camera.pinhole(WIDTH, HEIGHT, 400.0, 400.0, 80.0, 64.0)
    person = scene.people.count - 1
    moving = scene.people.at(5.0)
    still, nobody = np.zeros_like(moving.speed_m_s), np.zeros_like(moving.arms)
    ahead = np.array([np.cos(moving.heading_rad[person]), np.sin(moving.heading_rad[person]), 0.0])
    middle = moving.position[person] + [0.0, 0.0, 0.9]

    def top_m(arms):
        posed = replace(moving, speed_m_s=still, phase=still, arms=arms)
        monkeypatch.setattr(People, "at", lambda *_: posed)
        with Renderer(scene, camera) as renderer:
            shown = renderer.render(5.0, looking(middle + 10.0 * ahead, middle)).instance_id == person + 1
        return 0.9 + (64 - np.flatnonzero(shown.any(axis=1))[0]) / 40.0

    size = scene.people.height_m[person] / 1.75
    assert top_m(nobody) == pytest.approx(1.75 * size, abs=0.05)
    # Shoulder 1.42 m high, upper arm 0.28 m, from elbow to fingers 0.38 m. The left arm is raised by
    # 2.5 + 0.3 sin(1) = 2.75 rad and bent by 0.25 + 0.16 * 2.75, the right by 2.25 and 0.25 + 0.16 * 2.25.
    left_m = 1.42 - 0.28 * np.cos(2.75) - 0.38 * np.cos(3.44)
    right_m = 1.42 - 0.28 * np.cos(2.25) - 0.38 * np.cos(2.86)
    raised = 1 + person * 7 % 3  # 1 left, 2 right, 3 both
    highest = max(height for arm, height in ((1, left_m), (2, right_m)) if raised & arm)
    assert top_m(nobody + 1.0) == pytest.approx(highest * size, abs=0.05)


@needs_opengl
def test_pedals_turn(scene, monkeypatch):
    """A cyclist from 4 m in front, at 100 pixels a metre: cranks of 0.17 m, 0.09 m beside the middle, turn
    about the bracket, 0.28 m high; the left one points down at phase 0."""
    camera = Camera.pinhole(WIDTH, HEIGHT, 400.0, 400.0, 80.0, 64.0)
    riding = scene.cyclists.at(5.0)
    ahead = np.array([np.cos(riding.heading_rad[0]), np.sin(riding.heading_rad[0]), 0.0])
    bracket = riding.position[0] + [0.0, 0.0, 0.28]

    def lowest_m(phase):
        """Of the left and of the right leg, above the bracket."""
        posed = replace(
            riding, pitch_rad=0.0 * riding.pitch_rad, pedal_phase=0.0 * riding.pedal_phase + phase
        )
        monkeypatch.setattr(Cyclists, "at", lambda *_: posed)
        with Renderer(scene, camera) as renderer:
            frame = renderer.render(5.0, looking(bracket + 4.0 * ahead, bracket))
        shown = frame.instance_id == scene.people.count + 1
        # The rider's left is on the right of who looks at him; columns 5 to 14 cm beside the middle.
        sides = shown[:, 85:95], shown[:, 65:75]
        return [(64 - 1 - np.flatnonzero(side.any(axis=1))[-1]) / 100.0 for side in sides]

    assert lowest_m(0.0) == pytest.approx([-0.17, 0.0], abs=0.03)
    assert lowest_m(np.pi) == pytest.approx([0.0, -0.17], abs=0.03)
    assert lowest_m(np.pi / 2) == pytest.approx([0.0, 0.0], abs=0.08)  # level; a foot hangs below its pedal


@needs_opengl
def test_frames_repeat_and_do_not_depend_on_earlier_ones(scene, frame):
    with Renderer(scene, CAMERA) as renderer:
        renderer.render(77.0, pose_at(scene, 260.0, 60.0))
        again = renderer.render(5.0, pose_at(scene))
    for name in ("rgb", "class_id", "instance_id", "depth_m"):
        assert getattr(again, name).tobytes() == getattr(frame, name).tobytes(), name


@needs_opengl
def test_sky_has_no_depth_and_everything_else_has(scene):
    pose = looking([0.0, 0.0, 120.0], [100.0, 0.0, 125.0])
    with Renderer(scene, CAMERA) as renderer:
        frame = renderer.render(5.0, pose)
    sky = frame.class_id == SceneClass.SKY
    assert 0.2 < sky.mean() < 0.8
    assert sky[: HEIGHT // 4].all()
    assert np.isinf(frame.depth_m[sky]).all()
    assert np.isfinite(frame.depth_m[~sky]).all()
    assert (frame.instance_id[sky] == 0).all()


@needs_opengl
def test_noise_and_blur_touch_colours_only(scene, frame):
    pose = pose_at(scene)
    later = pose.copy()
    later[:3, 3] += 4.0 * pose[:3, 0]
    with Renderer(scene, CAMERA, picture=PictureSettings(noise_sigma=0.05)) as renderer:
        noisy = renderer.render(5.0, pose, noise_seed=1)
        other = renderer.render(5.0, pose, noise_seed=2)
    with Renderer(scene, CAMERA, picture=PictureSettings(noise_sigma=0.0)) as renderer:
        clean = renderer.render(5.0, pose)
        blurred = renderer.render(5.0, pose, world_from_camera_blurred=later)
    for changed in (noisy, other, blurred):
        assert changed.class_id.tobytes() == frame.class_id.tobytes()
        assert changed.depth_m.tobytes() == frame.depth_m.tobytes()
    assert (noisy.rgb != other.rgb).mean() > 0.5
    noise = noisy.rgb.astype(float) - clean.rgb
    assert 0.02 * 255 < noise[..., 1].std() < 0.08 * 255

    def detail(rgb):
        return np.abs(np.diff(rgb.astype(float), axis=1)).mean()

    assert detail(blurred.rgb) < 0.85 * detail(clean.rgb)


@needs_opengl
def test_rolling_exposure_takes_each_row_from_its_own_pose(scene):
    start = pose_at(scene)
    end = start.copy()
    end[:3, 3] += 0.5 * start[:3, 0] + 0.2 * start[:3, 2]
    with Renderer(scene, CAMERA) as renderer:
        rolling = renderer.render(5.0, start, world_from_camera_end=end)
        for row in (20, 64, 110):
            pose = start.copy()
            pose[:3, 3] += (row + 0.5) / HEIGHT * (end[:3, 3] - start[:3, 3])
            still = renderer.render(5.0, pose)
            assert (still.class_id[row] == rolling.class_id[row]).mean() > 0.97
            difference = np.abs(still.depth_m[row] - rolling.depth_m[row])
            assert np.median(difference) < 0.05


def test_raycast_labels_agree_with_the_map(scene):
    pose = pose_at(scene)
    frame = LabelRaycaster(scene, CAMERA).render(5.0, pose)
    assert frame.rgb is None
    points, _ = back_projected(frame, CAMERA, pose)
    bare = (frame.instance_id.ravel() == 0) & np.isfinite(frame.depth_m.ravel())
    x, y, z = points[bare].T
    assert np.abs(z - scene.landscape.height_m(x, y)).max() < 0.01
    road = frame.class_id.ravel()[bare] == SceneClass.ROAD
    assert (road == scene.landscape.on_road(x, y)).mean() > 0.999
    people = scene.people.at(5.0)
    for person in np.unique(frame.instance_id)[1:]:
        if person <= scene.people.count:
            mine = points[frame.instance_id.ravel() == person]
            away = np.hypot(*(mine - people.position[person - 1])[:, :2].T)
            assert away.max() < 0.12 * 2.05


@needs_opengl
def test_raycast_labels_agree_with_the_renderer(scene, frame):
    cast = LabelRaycaster(scene, CAMERA).render(5.0, pose_at(scene))
    on_map = cast.class_id != SceneClass.SKY
    assert on_map.mean() > 0.5
    assert (cast.class_id == frame.class_id)[on_map].mean() > 0.97
    bare = (cast.class_id == SceneClass.ROAD) & (frame.class_id == SceneClass.ROAD)
    assert bare.sum() > 500
    assert np.abs(cast.depth_m[bare] - frame.depth_m[bare]).max() < 0.05


def test_capsule_hits_worked_out_by_hand():
    # Upright capsule of radius 1 over (10, 0), from z = 1 to 4; rays along +x and one from above.
    origin = np.array([0.0, 0.0, 2.0])
    low, high = np.array([10.0, 0.0, 1.0]), np.array([10.0, 0.0, 4.0])
    rays = np.array([[1.0, 0, 0], [2.0, 0, 0], [1.0, 0.2, 0], [-1.0, 0, 0]])
    hits = capsule_hits(origin, rays, low, high, 1.0)
    np.testing.assert_allclose(hits[:2], [9.0, 4.5])
    assert np.isinf(hits[2:]).all()
    # Straight down onto the upper ball: its top is at z = 5.
    down = capsule_hits(np.array([10.0, 0.0, 20.0]), np.array([[0.0, 0.0, -1.0]]), low, high, 1.0)
    np.testing.assert_allclose(down, [15.0])


def test_triangle_hits_worked_out_by_hand():
    triangle = np.array([[[0.0, 0.0, 5.0], [4.0, 0.0, 5.0], [0.0, 4.0, 5.0]]])
    rays = np.array([[0.2, 0.2, 1.0], [0.5, 0.5, 1.0], [0.2, 0.2, -1.0]])
    hits = triangle_hits(np.zeros(3), rays, triangle)
    assert hits[0] == pytest.approx(5.0)  # meets (1, 1, 5)
    assert np.isinf(hits[1:]).all()  # (2.5, 2.5) lies outside; the third looks away


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_every_pixel_centre_is_a_sample(samples):
    lattice = lattice_for(CAMERA, samples)
    at = lattice.pixel_samples
    np.testing.assert_allclose(at - np.floor(at), 0.5)
    # The lattice's pinhole sends the ray of pixel (u, v) to that very sample.
    u, v = 37.5, 101.5
    x, y = (u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy
    expected = (lattice.fx * x + lattice.cx, lattice.fy * y + lattice.cy)
    np.testing.assert_allclose(at[101, 37], expected, atol=1e-4)
    assert (at.reshape(-1, 2).max(axis=0) < (lattice.width, lattice.height)).all()


def test_lattice_holds_every_ray_of_a_distorting_lens():
    lattice = lattice_for(LENS, 2)
    assert lattice.distorted
    at = lattice.pixel_samples.reshape(-1, 2)
    assert (at > 1).all()
    assert (at < np.array([lattice.width, lattice.height]) - 1).all()


def test_clip_space_puts_row_0_first_and_keeps_depth_in_w():
    lattice = lattice_for(CAMERA, 1)
    ray = np.array([(0.5 - 80) / 100, (0.5 - 64) / 100, 1.0]) * 7.0  # pixel (0, 0), 7 m along the axis
    clip = clip_from_camera(lattice) @ np.append(ray, 1.0)
    assert clip[3] == pytest.approx(7.0)
    np.testing.assert_allclose(clip[:2] / clip[3], [1 / WIDTH - 1, 1 / HEIGHT - 1])


def test_light_space_looks_along_the_suns_rays():
    sun = np.array([0.6, 0.0, 0.8])
    matrix = light_from_world(sun, np.zeros(3), 50.0, 1000, 100.0)
    near, far = (matrix @ np.append(k * sun, 1.0) for k in (20.0, -20.0))
    np.testing.assert_allclose(near[:2], far[:2], atol=1e-12)
    assert near[2] == pytest.approx(-0.2)
    assert far[2] == pytest.approx(0.2)


def test_bad_settings_are_refused_by_name():
    with pytest.raises(ValueError, match="supersample must be 1 to 3, got 4"):
        lattice_for(CAMERA, 4)
    with pytest.raises(ValueError, match="noise_sigma must be 0 to 0.5, got 0.9"):
        PictureSettings(noise_sigma=0.9)
    with pytest.raises(ValueError, match="160 degrees"):
        lattice_for(Camera.fisheye(WIDTH, HEIGHT, 40.0, 40.0, 80.0, 64.0), 1)


@needs_opengl
def test_a_broken_pose_is_refused(scene):
    with Renderer(scene, CAMERA) as renderer, pytest.raises(ValueError, match="finite"):
        renderer.render(0.0, np.full((4, 4), np.nan))


def test_without_moderngl_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "moderngl", None)
    with pytest.raises(NoOpenGL, match="pip install"):
        open_context()


def test_without_a_driver_the_error_says_what_to_install(monkeypatch):
    class Refusing:
        @staticmethod
        def create_context(**settings):
            raise Exception("libEGL.so not loaded")

    monkeypatch.setitem(sys.modules, "moderngl", Refusing)
    with pytest.raises(NoOpenGL, match=INSTALL_LINE):
        open_context()
