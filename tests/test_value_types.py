"""Values of the core travel: pickled at every protocol, copied, and sent to another process."""

import copy
import multiprocessing
import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields

import numpy as np
import pytest

from crowdfence import (
    Camera,
    CrowdMap,
    CrowdMass,
    Evidence,
    Georeference,
    LikelihoodRatio,
    LinearPool,
    LogOdds,
    LogPool,
    MovingAverage,
    Observation,
    Or,
    Paper,
    Rates,
    Terrain,
    View,
)
from crowdfence.config import RunConfig
from crowdfence.sources.recording import RefusedFrame

SIZE = (640, 480)
THIRD = 1.0 / 3.0  # no short decimal: a copy through text or float32 would differ
INTRINSICS = (500.0 + THIRD, 501.0, 320.0 - THIRD, -0.0)
CAMERAS = {
    "pinhole": Camera.pinhole(*SIZE, *INTRINSICS),
    "brown_conrady": Camera.pinhole(*SIZE, *INTRINSICS, [-0.1 * THIRD, 0.01, 1e-4, -2e-4, 0.0]),
    "kannala_brandt": Camera.fisheye(*SIZE, *INTRINSICS, [0.01 * THIRD, -0.002, 0.0, 1e-5]),
}
RATES = Rates(0.9 + 0.1 * THIRD, 0.1 * THIRD)
CROWD_MASS = CrowdMass(ground=2.0 + THIRD, hole=THIRD, sky=1e-3 * THIRD)
FLOOR = Terrain.from_occupancy(np.ones((4, 4, 1), bool), 1.0)
OBSERVATION = Observation(
    FLOOR,
    "uav1",
    1_763_780_000_250_000_001,
    voxel_ids=[0, 7],
    mean=[THIRD, 1.0],
    pixel_count=[3, 0],
    range_m=[20.0 + THIRD, 1e4],
    tilt_deg=[-THIRD, 90.0],
    occluded_ids=[1, 2],
    crowd_mass=CROWD_MASS,
    focal_px=380.0 + THIRD,
)
SWITCHED = Paper(
    RATES,
    0.2 * THIRD,
    alpha=THIRD,
    decay=1e-3 * THIRD,
    fleet_size=5,
    b_threshold=0.25,
    unseen="visible",
    normalise=True,
    initial="first",
    decay_unit="frame",
)
RATIO = LikelihoodRatio(
    [0.1 * THIRD],
    [10.0],
    [THIRD],
    THIRD * np.arange(8).reshape(2, 2, 2),
    (10 * THIRD, LikelihoodRatio([], [], [0.5], [[[-THIRD, THIRD]]])),
)
EVIDENCE = Evidence(
    RATIO,
    prior=0.1 * THIRD,
    memory_s=10.0 * THIRD,
    sharp_gsd_m=0.1 * THIRD,
    doubt=THIRD,
    agreement=THIRD,
    threshold=0.5 * THIRD,
    cleared=0.01 * THIRD,
    focal_px=1000.0 * THIRD,
    from_below="against",
)
VALUES = {
    **CAMERAS,
    "crowd mass": CROWD_MASS,
    "rates": RATES,
    "likelihood ratio": RATIO,
    "evidence": EVIDENCE,
    "paper": SWITCHED,
    "or": Or(b_threshold=THIRD),
    "linear pool": LinearPool(RATES, 0.1 * THIRD, alpha=THIRD, decay=THIRD, b_threshold=THIRD),
    "log pool": LogPool(
        RATIO, prior=0.1 * THIRD, alpha=THIRD, decay=THIRD, threshold=THIRD, focal_px=1000.0 * THIRD
    ),
    "log odds": LogOdds(RATES, THIRD, b_threshold=THIRD, clamp_low=-THIRD, clamp_high=10.0 * THIRD),
    "moving average": MovingAverage(
        RATIO, prior=0.1 * THIRD, memory_s=10.0 * THIRD, threshold=THIRD, focal_px=1000.0 * THIRD
    ),
}
WITH_ARRAYS = {
    "observation": OBSERVATION,
    "update": CrowdMap(FLOOR, Or()).integrate_observations([OBSERVATION], OBSERVATION.stamp_ns),
}


def _through_pickle(protocol: int) -> Callable[[object], object]:
    return lambda value: pickle.loads(pickle.dumps(value, protocol))


COPIES = {
    f"pickle {protocol}": _through_pickle(protocol) for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1)
}
COPIES |= {"copy": copy.copy, "deepcopy": copy.deepcopy}
every_copy = pytest.mark.parametrize("copied", COPIES.values(), ids=COPIES)


@pytest.fixture(scope="module")
def other_process() -> Iterator[ProcessPoolExecutor]:
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield pool


def _view(camera: Camera = CAMERAS["brown_conrady"]) -> View:
    turn = np.deg2rad(30.0 + THIRD)
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    pose[:3, 3] = 4.5e5 + THIRD, 5.2e6 - THIRD, THIRD
    heatmap = np.random.default_rng(0).random((48, 64), np.float32)
    return View("uav1", 1_763_780_000_250_000_001, camera, pose, heatmap)


def _part_of_a_view() -> View:
    """The lower half of its heatmap was looked at."""
    whole = _view()
    heatmap = np.ma.array(whole.heatmap, mask=np.arange(48 * 64).reshape(48, 64) < 24 * 64)
    return View(whole.drone, whole.stamp_ns, whole.camera, whole.world_from_camera, heatmap)


def _bits(camera: Camera) -> bytes:
    numbers = [camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion]
    return np.array(numbers).tobytes()


def _assert_same_view(view: View, other: View) -> None:
    assert (view.drone, view.stamp_ns, view.camera) == (other.drone, other.stamp_ns, other.camera)
    assert view.world_from_camera.tobytes() == other.world_from_camera.tobytes()
    assert view.heatmap.tobytes() == other.heatmap.tobytes()
    assert np.array_equal(view.looked_at, other.looked_at)


@every_copy
@pytest.mark.parametrize("name", VALUES)
def test_parameters_come_back_equal_and_hash_alike(name: str, copied: Callable[[object], object]) -> None:
    value = VALUES[name]
    other = copied(value)
    assert type(other) is type(value)
    assert other == value and hash(other) == hash(value)


@every_copy
@pytest.mark.parametrize("name", CAMERAS)
def test_cameras_come_back_to_the_bit(name: str, copied: Callable[[Camera], Camera]) -> None:
    camera = CAMERAS[name]
    other = copied(camera)
    assert _bits(other) == _bits(camera)
    assert (other.width, other.height, other.model) == (*SIZE, name)


@every_copy
def test_rates_come_back_to_the_bit(copied: Callable[[Rates], Rates]) -> None:
    other = copied(VALUES["rates"])
    assert (other.true_positive, other.false_positive) == (0.9 + 0.1 * THIRD, 0.1 * THIRD)


@every_copy
@pytest.mark.parametrize("name", CAMERAS)
def test_views_come_back_to_the_bit(name: str, copied: Callable[[View], View]) -> None:
    view = _view(CAMERAS[name])
    _assert_same_view(copied(view), view)


@every_copy
def test_what_was_not_looked_at_travels_with_a_view(copied: Callable[[View], View]) -> None:
    view = _part_of_a_view()
    assert view.looked_at is not None and view.looked_at.sum() == 24 * 64
    _assert_same_view(copied(view), view)


def test_equal_values_are_one_key() -> None:
    zero, negative_zero = (Camera.pinhole(*SIZE, 500, 500, 320, cy) for cy in (0.0, -0.0))
    assert zero == negative_zero and len({zero, negative_zero}) == 1
    assert len({Rates(0.9, 0.1), Rates(0.9, 0.1), Rates(0.9, 0.2)}) == 2
    assert len({*CAMERAS.values(), CAMERAS["pinhole"]}) == 3


@every_copy
def test_terrains_come_back_with_their_frame(copied: Callable[[Terrain], Terrain]) -> None:
    heights = np.random.default_rng(1).uniform(-5.0, 5.0, (20, 30))
    terrain = Terrain.from_height_map(heights, 0.5, origin=(4.5e5 + THIRD, 5.2e6, -THIRD))
    terrain.georeference = Georeference(46.5, 9.8, 1800.0)
    other = copied(terrain)
    assert (other.fingerprint, other.georeference) == (terrain.fingerprint, terrain.georeference)
    assert (other.origin, other.voxel_size_m) == (terrain.origin, terrain.voxel_size_m)
    assert np.array_equal(*(t.voxel_indices(np.arange(terrain.voxel_count)) for t in (terrain, other)))


def test_values_reach_another_process_and_return(other_process: ProcessPoolExecutor) -> None:
    for value in VALUES.values():
        assert other_process.submit(copy.copy, value).result() == value
    view = _view()
    _assert_same_view(other_process.submit(copy.copy, view).result(), view)


PLAIN = [Georeference(46.5 + THIRD, 9.8, 1800.0), RunConfig(), RefusedFrame("uav1", None, "has no pose")]


@every_copy
@pytest.mark.parametrize("value", PLAIN, ids=lambda value: type(value).__name__)
def test_frozen_dataclasses_come_back_equal(value: object, copied: Callable[[object], object]) -> None:
    other = copied(value)
    assert type(other) is type(value)
    for field in fields(value):  # type: ignore[arg-type]
        assert getattr(other, field.name) == getattr(value, field.name)


def test_the_representation_of_a_method_hides_no_switch() -> None:
    text = repr(SWITCHED)
    for name, value in SWITCHED.parameters.items():
        assert f"{name.removesuffix('_rate')}={value!r}" in text
    assert repr(Or(b_threshold=0.25)) == "Or(b_threshold=0.25)"


@every_copy
@pytest.mark.parametrize("value", WITH_ARRAYS.values(), ids=WITH_ARRAYS)
def test_what_holds_arrays_comes_back_equal(value: object, copied: Callable[[object], object]) -> None:
    other = copied(value)
    assert type(other) is type(value) and other == value
