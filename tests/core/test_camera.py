"""`crowdfence.Camera` against OpenCV on random cameras, and its edges seen from outside."""

from collections.abc import Callable, Iterator

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from crowdfence import Camera, ViewError

Array = NDArray[np.float64]

CAMERAS_PER_MODEL = 40
POINTS_PER_CAMERA = 400
# OpenCV's default of five fixed-point steps leaves errors of many pixels.
UNTIL_CONVERGED = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 500, 1e-14)


def _random_intrinsics(
    rng: np.random.Generator, focal_per_width: tuple[float, float]
) -> tuple[int, int, float, float, float, float]:
    width, height = ((640, 480), (1280, 720), (4000, 3000))[rng.integers(3)]
    fx = width * rng.uniform(*focal_per_width)
    fy = fx * rng.uniform(0.97, 1.03)
    return width, height, fx, fy, width * rng.uniform(0.45, 0.55), height * rng.uniform(0.45, 0.55)


def _brown_conrady_cameras() -> Iterator[Camera]:
    """Action camera (strong barrel) to telephoto (light pincushion)."""
    rng = np.random.default_rng(2)
    low = (-0.32, -0.05, -2e-3, -2e-3, -0.01)
    high = (0.10, 0.12, 2e-3, 2e-3, 0.01)
    for index in range(CAMERAS_PER_MODEL):
        count = 5 if index % 2 else 4
        coefficients = rng.uniform(low, high)[:count].tolist()
        yield Camera.pinhole(*_random_intrinsics(rng, (0.8, 2.5)), coefficients)


def _kannala_brandt_cameras() -> Iterator[Camera]:
    rng = np.random.default_rng(3)
    bound = np.array([0.06, 0.02, 0.01, 0.003])
    for _ in range(CAMERAS_PER_MODEL):
        yield Camera.fisheye(*_random_intrinsics(rng, (0.35, 0.6)), rng.uniform(-bound, bound).tolist())


def _matrix(camera: Camera) -> Array:
    return np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])


def _opencv_project(camera: Camera, points: Array) -> Array:
    project = cv2.fisheye.projectPoints if camera.model == "kannala_brandt" else cv2.projectPoints
    at_rest = np.zeros(3)
    pixels, _ = project(points[:, None], at_rest, at_rest, _matrix(camera), np.array(camera.distortion))
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def _opencv_rays(camera: Camera, pixels: Array) -> Array:
    """Unit rays [N, 3]; NaN where OpenCV's own iteration did not come back to the pixel."""
    given = pixels[:, None], _matrix(camera), np.array(camera.distortion)
    if camera.model == "kannala_brandt":
        plane = cv2.fisheye.undistortPoints(*given, criteria=UNTIL_CONVERGED)
    elif cv2.__version__.startswith("4."):
        plane = cv2.undistortPointsIter(*given, None, None, UNTIL_CONVERGED)
    else:
        plane = cv2.undistortPoints(*given, criteria=UNTIL_CONVERGED)
    rays = np.column_stack([np.asarray(plane, dtype=np.float64).reshape(-1, 2), np.ones(len(pixels))])
    miss_px = np.linalg.norm(_opencv_project(camera, rays) - pixels, axis=1)
    rays[miss_px > 1e-7] = np.nan
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _directions(rng: np.random.Generator, max_angle_deg: float) -> Array:
    """Points [N, 3] at 1 m to 1 km, at most `max_angle_deg` off the optical axis."""
    angle = np.radians(rng.uniform(0.0, max_angle_deg, POINTS_PER_CAMERA))
    azimuth = rng.uniform(0.0, 2 * np.pi, POINTS_PER_CAMERA)
    unit = np.column_stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)])
    return unit * 10.0 ** rng.uniform(0.0, 3.0, (POINTS_PER_CAMERA, 1))


def _pixels(rng: np.random.Generator, camera: Camera) -> Array:
    return rng.uniform((0.0, 0.0), (camera.width, camera.height), (POINTS_PER_CAMERA, 2))


def _angle_between(a: Array, b: Array) -> Array:
    return 2 * np.arcsin(np.minimum(np.linalg.norm(a - b, axis=1) / 2, 1.0))


MODELS = pytest.mark.parametrize(
    ("cameras", "max_angle_deg"),
    [(_brown_conrady_cameras, 35.0), (_kannala_brandt_cameras, 85.0)],
    ids=["brown_conrady", "kannala_brandt"],
)


@MODELS
def test_project_agrees_with_opencv(cameras: Callable[[], Iterator[Camera]], max_angle_deg: float) -> None:
    rng = np.random.default_rng(5)
    seen_count = 0
    for camera in cameras():
        points = _directions(rng, max_angle_deg)
        pixels = camera.project(points)
        seen = ~np.isnan(pixels[:, 0])
        seen_count += int(np.count_nonzero(seen))
        np.testing.assert_allclose(pixels[seen], _opencv_project(camera, points)[seen], rtol=0, atol=1e-6)
    # Beyond the fold OpenCV wraps points back into the image, so that there is nothing to agree with.
    assert seen_count > 0.9 * CAMERAS_PER_MODEL * POINTS_PER_CAMERA


@MODELS
def test_unproject_agrees_with_opencv(cameras: Callable[[], Iterator[Camera]], max_angle_deg: float) -> None:
    rng = np.random.default_rng(7)
    compared = 0
    for camera in cameras():
        pixels = _pixels(rng, camera)
        try:
            rays = camera.unproject(pixels)
        except ValueError:
            continue  # a fold inside the image; too many of these would fail the count below
        expected = _opencv_rays(camera, pixels)
        known = ~np.isnan(expected[:, 0]) & (expected[:, 2] > np.cos(np.radians(max_angle_deg)))
        compared += int(np.count_nonzero(known))
        assert _angle_between(rays[known], expected[known]).max() < 1e-8
    assert compared > 0.7 * CAMERAS_PER_MODEL * POINTS_PER_CAMERA


@given(
    st.lists(st.floats(-0.5, 0.5), min_size=4, max_size=5),
    st.lists(st.tuples(st.floats(0.0, 640.0), st.floats(0.0, 480.0)), min_size=1, max_size=8),
)
def test_pixel_comes_back_or_is_refused(coefficients: list[float], pixels: list[tuple[float, float]]) -> None:
    coefficients[2:4] = [0.02 * coefficients[2], 0.02 * coefficients[3]]
    camera = Camera.pinhole(640, 480, 400.0, 410.0, 320.0, 240.0, coefficients)
    for pixel in pixels:
        try:
            ray = camera.unproject([pixel])
        except ValueError as refusal:
            assert "cannot be inverted" in str(refusal)
        else:
            np.testing.assert_allclose(camera.project(ray), [pixel], rtol=0, atol=1e-9)


def test_principal_point_counts_from_the_corner_of_the_image() -> None:
    camera = Camera.pinhole(2, 2, 1.0, 1.0, 1.0, 1.0)
    ray = camera.unproject([[0.5, 1.5]])  # centre of the lower left pixel
    np.testing.assert_allclose(ray, np.array([[-0.5, 0.5, 1.0]]) / np.sqrt(1.5), rtol=0, atol=1e-15)


def test_properties_return_what_was_given() -> None:
    plain = Camera.pinhole(640, 480, 400.0, 410.0, 321.0, 241.0)
    assert (plain.width, plain.height) == (640, 480)
    assert (plain.fx, plain.fy, plain.cx, plain.cy) == (400.0, 410.0, 321.0, 241.0)
    assert (plain.model, plain.distortion) == ("pinhole", [])
    brown = Camera.pinhole(640, 480, 400.0, 410.0, 321.0, 241.0, (-0.2, 0.03, 1e-3, -1e-3))
    assert (brown.model, brown.distortion) == ("brown_conrady", [-0.2, 0.03, 1e-3, -1e-3, 0.0])
    fisheye = Camera.fisheye(640, 480, 200.0, 200.0, 320.0, 240.0, (0.1, 0.02, 0.003, 0.0004))
    assert (fisheye.model, fisheye.distortion) == ("kannala_brandt", [0.1, 0.02, 0.003, 0.0004])


def test_distortion_as_calibrations_of_opencv_give_it() -> None:
    """`cv2.calibrateCamera` gives a row or a column, by its version; `cv2.fisheye.calibrate` a column."""
    intrinsics, pinhole, fisheye = (
        (640, 480, 500.0, 500.0, 320.0, 240.0),
        (0.1, 0.01, 1e-3, 2e-3, 0.03),
        (0.1,) * 4,
    )
    for shape in ((5,), (1, 5), (5, 1)):
        given = np.reshape(pinhole, shape)
        assert Camera.pinhole(*intrinsics, given) == Camera.pinhole(*intrinsics, pinhole)
    assert Camera.fisheye(*intrinsics, np.reshape(fisheye, (4, 1))) == Camera.fisheye(*intrinsics, fisheye)
    with pytest.raises(ValueError, match=r"distortion has shape \[2, 2\]"):
        Camera.pinhole(*intrinsics, np.zeros((2, 2)))


def test_fisheye_sees_sideways_and_backwards_but_not_straight_behind() -> None:
    camera = Camera.fisheye(640, 480, 100.0, 100.0, 320.0, 240.0)
    pixels = camera.project([[5.0, 0.0, 0.0], [0.0, 5.0, -5.0], [0.0, 0.0, -5.0]])
    expected = [[320 + 50 * np.pi, 240], [320, 240 + 75 * np.pi], [np.nan, np.nan]]
    np.testing.assert_allclose(pixels, expected, rtol=0, atol=1e-9)


def test_point_outside_the_field_of_view_is_not_imaged_where_opencv_wraps_it() -> None:
    camera = Camera.pinhole(640, 480, 300.0, 300.0, 320.0, 240.0, (-1 / 3, 0.0, 0.0, 0.0))
    beyond = np.array([[1.7, 0.0, 1.0]])  # the fold is at 1
    wrapped = _opencv_project(camera, beyond)
    assert 0.0 < wrapped[0, 0] < 640.0
    assert np.isnan(camera.project(beyond)).all()
    assert np.isnan(camera.project([[0.1, 0.1, -1.0], [np.nan, 0.0, 1.0]])).all()


def test_pixels_beyond_the_fold_are_blind_and_named() -> None:
    # The fold is imaged at 2/3 of 300 pixels from the centre.
    camera = Camera.pinhole(640, 480, 300.0, 300.0, 320.0, 240.0, (-1 / 3, 0.0, 0.0, 0.0))
    column, row = np.meshgrid(np.arange(640) + 0.5, np.arange(480) + 0.5)
    assert camera.blind_pixel_count() == np.count_nonzero(np.hypot(column - 320, row - 240) > 200)
    with pytest.raises(ValueError, match=r"521.*240.*cannot be inverted"):
        camera.unproject([[320.0, 240.0], [521.0, 240.0], [600.0, 240.0]])
    assert Camera.pinhole(640, 480, 300.0, 300.0, 320.0, 240.0).blind_pixel_count() == 0


@pytest.mark.parametrize("focal_px", [0.0, -300.0, np.nan, np.inf])
def test_focal_length_must_be_positive(focal_px: float) -> None:
    with pytest.raises(ValueError, match=r"fy is .* pixels: it must be positive"):
        Camera.pinhole(640, 480, 300.0, focal_px, 320.0, 240.0)
    with pytest.raises(ValueError, match=r"fx is .* pixels: it must be positive"):
        Camera.fisheye(640, 480, focal_px, 300.0, 320.0, 240.0)


def test_refusals_name_the_value() -> None:
    with pytest.raises(ValueError, match="0 x 480"):
        Camera.pinhole(0, 480, 300.0, 300.0, 320.0, 240.0)
    for side in (-1, 2**32, 2**63):
        with pytest.raises(ViewError, match=f"a side of {side} pixels: it must be at least 1"):
            Camera.pinhole(side, 480, 300.0, 300.0, 320.0, 240.0)
        with pytest.raises(ViewError, match=f"a side of {side} pixels"):
            Camera.fisheye(640, side, 300.0, 300.0, 320.0, 240.0)
    with pytest.raises(ValueError, match="cx is NaN"):
        Camera.pinhole(640, 480, 300.0, 300.0, float("nan"), 240.0)
    with pytest.raises(ValueError, match="k2 is inf"):
        Camera.fisheye(640, 480, 300.0, 300.0, 320.0, 240.0, (0.0, float("inf"), 0.0, 0.0))
    with pytest.raises(ValueError, match="3 distortion coefficients"):
        Camera.pinhole(640, 480, 300.0, 300.0, 320.0, 240.0, (0.1, 0.2, 0.3))
    with pytest.raises(ValueError, match="8 distortion coefficients"):
        Camera.pinhole(640, 480, 300.0, 300.0, 320.0, 240.0, [0.1] * 8)


def test_arrays_must_be_rows_of_the_right_length() -> None:
    camera = Camera.pinhole(640, 480, 300.0, 300.0, 320.0, 240.0)
    with pytest.raises(ValueError, match="3"):
        camera.project(np.zeros((4, 2)))
    with pytest.raises(ValueError, match="2"):
        camera.unproject(np.zeros((4, 3)))
    assert camera.project(np.zeros((0, 3))).shape == (0, 2)
    assert camera.unproject(np.zeros((0, 2))).shape == (0, 3)
