"""Drones and gimbals: rigid poses, clear of the ground, smooth, looking where they should."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence._core import Terrain
from crowdfence.simulation.flight.flight import build_flight
from crowdfence.simulation.flight.gimbal import CAMERA_IN_BODY_M, body_attitude, camera_attitude
from crowdfence.simulation.flight.top_surface import TopSurface, rounded_above
from crowdfence.simulation.landscape.triangle_mesh import merged
from crowdfence.simulation.scenarios.plans import FlightPlan
from crowdfence.simulation.scenarios.scenario import ScenarioError
from crowdfence.simulation.scene import Scene
from support.simulated_scenes import SEED, scene_of

EAST, NORTH, UP = np.eye(3)


def positions(scene: Scene, drone: int, times: np.ndarray) -> np.ndarray:
    return np.array([scene.flight.at(drone, float(t_s)).world_from_body[:3, 3] for t_s in times])


def tilt_deg(world_from_camera: np.ndarray) -> float:
    return float(np.degrees(np.arcsin(-world_from_camera[2, 2])))


# Attitudes by hand


def test_camera_attitude_by_hand() -> None:
    level_east = camera_attitude(0.0, 0.0)
    np.testing.assert_allclose(level_east, np.stack([-NORTH, -UP, EAST], axis=-1), atol=1e-15)
    down_north_up = camera_attitude(np.pi / 2, np.pi / 2)
    np.testing.assert_allclose(down_north_up, np.stack([EAST, -NORTH, -UP], axis=-1), atol=1e-15)


def test_body_attitude_by_hand() -> None:
    still = np.zeros(3)
    np.testing.assert_allclose(body_attitude(0.0, still, still), np.eye(3), atol=1e-15)
    # Speeding up eastwards at g: the thrust points 45 degrees forward, the nose 45 degrees down.
    leaning = body_attitude(0.0, still, 9.81 * EAST)
    np.testing.assert_allclose(leaning[:, 2], (EAST + UP) / np.sqrt(2), atol=1e-12)
    np.testing.assert_allclose(leaning[:, 0], (EAST - UP) / np.sqrt(2), atol=1e-12)


@given(
    heights=st.lists(st.floats(-100.0, 3000.0), min_size=1, max_size=200),
    rounding=st.floats(0.5, 20.0),
    closed=st.booleans(),
)
def test_rounded_heights_are_never_below(heights: list[float], rounding: float, closed: bool) -> None:
    rounded = rounded_above(np.array(heights), rounding, closed=closed)
    assert (rounded >= np.array(heights) - 1e-6).all()
    assert rounded.max() <= max(heights) + 1e-6


# Both patterns


@pytest.mark.parametrize("name", ["race", "empty"])
@given(drone=st.integers(0, 2), t_s=st.floats(-5.0, 2000.0))
@settings(max_examples=40)
def test_poses_are_rigid_and_the_camera_stays_on_the_drone(name: str, drone: int, t_s: float) -> None:
    state = scene_of(name).flight.at(drone, t_s)
    for pose in (state.world_from_body, state.world_from_camera):
        np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-12)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
        np.testing.assert_array_equal(pose[3], [0, 0, 0, 1])
    in_body = np.linalg.inv(state.world_from_body) @ state.world_from_camera
    np.testing.assert_allclose(in_body[:3, 3], CAMERA_IN_BODY_M, atol=1e-9)
    assert abs(state.world_from_camera[2, 0]) < 1e-12, "the gimbal keeps the horizon level"


@pytest.mark.parametrize("name", ["race", "empty"])
def test_drones_stay_clear_of_ground_trees_and_each_other(name: str) -> None:
    scene = scene_of(name)
    times = np.arange(0.0, scene.scenario.duration_s, 0.5)
    top = TopSurface.of(scene.landscape, 0.0, 0.0)
    ways = [positions(scene, drone, times) for drone in range(scene.scenario.drones)]
    lowest = scene.scenario.flight.altitude_m[0]
    for way in ways:
        ground = scene.landscape.height_m(way[:, 0], way[:, 1])
        assert (way[:, 2] - ground).min() >= lowest
        assert (way[:, 2] - top.at(way[:, :2])).min() > 0.0
        assert (way[:, 2] - ground).max() < 130.0
    for number, way in enumerate(ways):
        for other in ways[:number]:
            assert np.linalg.norm(way - other, axis=1).min() > 5.0


@pytest.mark.parametrize("name", ["race", "empty"])
def test_flight_is_smooth(name: str) -> None:
    """From positions alone: speed, acceleration and turning of the camera that a small multirotor can do."""
    scene, step_s = scene_of(name), 0.1
    times = np.arange(0.0, 100.0, step_s)
    for drone in range(3):
        states = [scene.flight.at(drone, float(t_s)) for t_s in times]
        way = np.array([state.world_from_body[:3, 3] for state in states])
        velocity = np.diff(way, axis=0) / step_s
        assert np.linalg.norm(velocity, axis=1).max() < 17.0
        assert np.linalg.norm(np.diff(velocity, axis=0) / step_s, axis=1).max() < 6.0
        looks = np.array([state.world_from_camera[:3, :3] for state in states])
        cosine = 0.5 * (np.einsum("nij,nij->n", looks[1:], looks[:-1]) - 1.0)
        assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() / step_s < 60.0
        middle = np.array([state.velocity for state in states])[1:-1]
        np.testing.assert_allclose(middle, 0.5 * (velocity[1:] + velocity[:-1]), atol=0.3)


def test_no_such_drone() -> None:
    with pytest.raises(ValueError, match="drone must be between 0 and 2, got 3"):
        scene_of("race").flight.at(3, 0.0)


# Following


def test_each_drone_keeps_its_cyclist_in_the_image() -> None:
    scene = scene_of("race")
    camera = scene.scenario.intrinsics()
    for t_s in (20.0, 30.0, 40.0, 50.0, 95.0, 100.0):  # nobody shares a view then
        riders = scene.cyclists.at(t_s).position
        for drone in range(3):
            pose = scene.flight.at(drone, t_s).world_from_camera
            u, v = camera.project((riders[drone : drone + 1] - pose[:3, 3]) @ pose[:3, :3])[0]
            assert 0 < u < camera.width and 0 < v < camera.height


def test_in_shared_views_all_cameras_see_one_place() -> None:
    scene = scene_of("race")
    camera = scene.scenario.intrinsics()
    for t_s in (4.0, 64.0, 70.0, 79.0):
        ahead = float(scene.cyclists.along_m(t_s).mean()) + 16.0
        assert scene.cyclists.line is not None
        x, y = scene.cyclists.line.position(ahead)
        place = np.array([[x, y, scene.landscape.height_m(np.array([x]), np.array([y]))[0] + 1.0]])
        for drone in range(3):
            pose = scene.flight.at(drone, t_s).world_from_camera
            u, v = camera.project((place - pose[:3, 3]) @ pose[:3, :3])[0]
            assert u == pytest.approx(320.0, abs=1.0)
            assert 0 < v < 480, "the tilt has limits"


def people_in_view(scene: Scene, drone: int, t_s: float, range_m: float) -> int:
    """People of crowds inside the image, whatever stands in front of them."""
    pose = scene.flight.at(drone, t_s).world_from_camera
    state = scene.people.at(t_s)
    in_camera = (state.position[state.in_crowd] + UP - pose[:3, 3]) @ pose[:3, :3]
    u, v = scene.scenario.intrinsics().project(in_camera).T
    near = (in_camera[:, 2] > 0) & (in_camera[:, 2] < range_m)
    return int(np.count_nonzero(near & (u > 0) & (u < 640) & (v > 0) & (v < 480)))


def test_crowds_are_in_view_through_most_of_the_race() -> None:
    scene = scene_of("race")
    for drone in range(3):
        times = np.arange(0.0, 105.0, 3.0)
        assert np.mean([people_in_view(scene, drone, float(t_s), 100.0) >= 5 for t_s in times]) > 0.85


def test_tilts_stay_in_the_plan() -> None:
    for name in ("race", "empty"):
        scene = scene_of(name)
        low, high = scene.scenario.flight.tilt_deg
        tilts = [
            tilt_deg(scene.flight.at(drone, float(t_s)).world_from_camera)
            for drone in range(3)
            for t_s in np.arange(0.0, 60.0, 2.0)
        ]
        assert low - 1e-6 <= min(tilts) and max(tilts) <= high + 1e-6
        assert max(tilts) - min(tilts) > 0.5 * (high - low), "and use it"


def test_more_drones_than_cyclists_queue_up() -> None:
    scene = scene_of("race")
    flight = build_flight(replace(scene.scenario, drones=6), SEED, scene.landscape, scene.cyclists)
    for t_s in (0.0, 33.0, 70.0):
        one, next_in_line = (flight.at(drone, t_s).world_from_body[:3, 3] for drone in (0, 3))
        assert np.linalg.norm(one - next_in_line) > 3.0


# Surveys


def test_survey_stays_over_its_square() -> None:
    scene = scene_of("empty")
    half = 0.5 * scene.scenario.flight.area_m
    for drone in range(3):
        way = positions(scene, drone, np.arange(0.0, 600.0, 2.0))
        assert np.abs(way[:, :2]).max() <= half + 0.01
        assert np.ptp(way[:, :2], axis=0).min() > 30.0


def test_survey_flies_clear_of_houses() -> None:
    """Against the very triangles of the houses, as voxels of the core."""
    scene = scene_of("street")
    houses = merged(scene.landscape.solids)
    voxels = Terrain.from_triangles(houses.vertices, houses.triangles, 1.0)
    for drone in range(scene.scenario.drones):
        way = positions(scene, drone, np.arange(0.0, 90.0, 0.5))
        _, below_m = voxels.raycast(way, np.broadcast_to(-UP, way.shape), 200.0)
        assert below_m.min() > scene.scenario.flight.altitude_m[0] - 1.5
        assert np.isfinite(below_m).any(), "some of the way leads over houses"


@pytest.mark.parametrize("name", ["festival", "street"])
def test_surveys_keep_people_in_view(name: str) -> None:
    scene = scene_of(name)
    for drone in range(scene.scenario.drones):
        times = np.arange(0.0, scene.scenario.duration_s, 5.0)
        assert np.mean([people_in_view(scene, drone, float(t_s), 150.0) >= 5 for t_s in times]) > 0.7


def test_survey_outside_the_landscape_is_refused() -> None:
    scene = scene_of("empty")
    outside = replace(scene.scenario, flight=FlightPlan(area_m=300.0, x_m=350.0))
    with pytest.raises(ScenarioError, match=r"flight.area_m 300 around \(350, 0\) leaves the landscape"):
        build_flight(outside, SEED, scene.landscape, scene.cyclists)
