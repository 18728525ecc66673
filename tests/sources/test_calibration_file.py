"""Calibration files of OpenCV, ROS and kalibr: the same lens, as the core and OpenCV see it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence import Camera
from crowdfence.sources.lens.calibration_file import read_calibration
from crowdfence.sources.lens.focal_length import camera_from_35mm, camera_from_sensor, scaled_camera

K = np.array([[700.5, 0, 639.25], [0, 701.25, 359.75], [0, 0, 1]])
D = np.array([-0.1, 0.02, 0.001, -0.002, 0.003])
ROS = """\
image_width: 1280
image_height: 720
camera_name: front
camera_matrix: {rows: 3, cols: 3, data: [700.5, 0, 639.25, 0, 701.25, 359.75, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.02, 0.001, -0.002, 0.003]}
"""
KALIBR = """\
cam0:
  camera_model: pinhole
  intrinsics: [700.5, 701.25, 639.25, 359.75]
  distortion_model: radtan
  distortion_coeffs: [-0.1, 0.02, 0.001, -0.002]
  resolution: [1280, 720]
  rostopic: /cam0/image_raw
cam1:
  camera_model: pinhole
  intrinsics: [400, 400, 320, 240]
  distortion_model: equidistant
  distortion_coeffs: [0.01, 0.0, 0.0, 0.0]
  resolution: [640, 480]
"""


def write_opencv(path: Path) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 1280)
    storage.write("image_height", 720)
    storage.write("camera_matrix", K)
    storage.write("distortion_coefficients", D.reshape(1, 5))
    storage.release()
    return path


@pytest.mark.parametrize("kind", ["opencv", "ros"])
def test_a_point_is_seen_where_opencv_sees_it(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "camera.yaml"
    if kind == "opencv":
        write_opencv(path)
    else:
        path.write_text(ROS)
    camera = read_calibration(path)
    assert (camera.width, camera.height) == (1280, 720)
    point = np.array([[0.4, -0.3, 2.0]])
    pixel = cv2.projectPoints(point, np.zeros(3), np.zeros(3), K, D)[0].reshape(2)
    # OpenCV has the centre of the first pixel at (0, 0), we have it at (0.5, 0.5).
    assert np.allclose(camera.cx - K[0, 2], 0.5) and np.allclose(camera.cy - K[1, 2], 0.5)
    assert np.allclose(camera.project(point)[0], pixel + 0.5, atol=1e-6)


@pytest.mark.parametrize("fisheye", [0, 1])
def test_a_fisheye_of_opencv_is_one(tmp_path: Path, fisheye: int) -> None:
    """The calibration program of OpenCV says so in a line of its own; its four numbers fit both models."""
    path, four = tmp_path / "camera.yml", np.array([-0.05, 0.01, 0.002, -0.001])
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 1280)
    storage.write("image_height", 720)
    storage.write("fisheye_model", fisheye)
    storage.write("camera_matrix", K)
    storage.write("distortion_coefficients", four.reshape(4, 1))
    storage.release()
    camera = read_calibration(path)
    point = np.array([[0.8, -0.5, 1.0]])
    if fisheye:
        pixel = cv2.fisheye.projectPoints(point[None], np.zeros(3), np.zeros(3), K, four)[0].reshape(2)
    else:
        pixel = cv2.projectPoints(point, np.zeros(3), np.zeros(3), K, four)[0].reshape(2)
    assert np.allclose(camera.project(point)[0], pixel + 0.5, atol=1e-6)


def test_four_coefficients_of_no_model_are_not_guessed(tmp_path: Path) -> None:
    """cv2.fisheye.calibrate gives four, which as k1, k2, p1, p2 bend a picture elsewhere."""
    path = tmp_path / "camera.yaml"
    four = ROS.replace(", 0.003]", "]").replace("cols: 5", "cols: 4")
    path.write_text(four)
    assert read_calibration(path).model == "brown_conrady"
    path.write_text(four.replace("plumb_bob", "equidistant"))
    assert read_calibration(path).model == "kannala_brandt"
    path.write_text(four.replace("distortion_model: plumb_bob\n", ""))
    with pytest.raises(ValueError, match="4 distortion coefficients .* distortion_model: equidistant"):
        read_calibration(path)
    path.write_text(ROS.replace("distortion_model: plumb_bob\n", ""))
    assert read_calibration(path).model == "brown_conrady"


def test_a_camchain_names_its_cameras(tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_text(KALIBR)
    first, second = read_calibration(path), read_calibration(tmp_path / "camchain.yaml:cam1")
    assert (first.model, first.width, first.cx) == ("brown_conrady", 1280, 639.75)
    assert (second.model, second.width, second.cy) == ("kannala_brandt", 640, 240.5)
    with pytest.raises(ValueError, match="no camera 'cam7'; it has cam0, cam1"):
        read_calibration(tmp_path / "camchain.yaml:cam7")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("image_width: 1280\n", "is no calibration: no .amera_.atrix"),
        ("- 1\n- 2\n", "is no calibration: a table of names is expected; OpenCV's .*docs/recordings.md"),
        (ROS.replace("distortion_coefficients", "dist_coeff"), "'dist_coeff' is not known: .* call it dist"),
        (ROS.replace("distortion_coefficients", "D"), "'D' is not known"),
        ("a: [\n", "is not YAML"),
        (ROS.replace("plumb_bob", "thin_prism"), "distortion model 'thin_prism' is not supported"),
        (ROS.replace("plumb_bob", "equidistant"), "5 distortion coefficients: only k1, k2, k3, k4 are"),
        (ROS.replace("700.5, 0, 639.25", "700.5, 639.25"), "camera_matrix has 8 values"),
        (ROS.replace("image_width: 1280", "image_width: -3"), "cannot be used"),
        # As MATLAB writes it: the middle of the view was the corner of the picture, 42 degrees off.
        (
            ROS.replace(
                "700.5, 0, 639.25, 0, 701.25, 359.75, 0, 0, 1", "700.5, 0, 0, 0, 701.25, 0, 639.25, 359.75, 1"
            ),
            "camera_matrix is 700.5, 0, 0, 0, 701.25, 0, 639.25, 359.75, 1; it must be fx, 0, cx",
        ),
        # Pixels that lean by 5 degrees: 31 px at the upper edge.
        (
            ROS.replace("700.5, 0, 639.25", "700.5, 61.4, 639.25"),
            "camera_matrix is 700.5, 61.4, .* without skew",
        ),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=why):
        read_calibration(path)


@given(st.binary(max_size=300), st.integers(0, len(ROS)))
@settings(max_examples=60)
def test_any_bytes_are_a_calibration_or_refused(
    tmp_path_factory: pytest.TempPathFactory, noise: bytes, at: int
) -> None:
    path = tmp_path_factory.mktemp("lens") / "camera.yaml"
    path.write_bytes(ROS.encode()[:at] + noise)
    try:
        assert read_calibration(path).width > 0
    except ValueError as error:
        assert str(path) in str(error)


def test_another_size_of_the_same_part_of_the_sensor_is_scaled() -> None:
    camera = Camera.pinhole(1280, 720, 700.0, 702.0, 640.0, 360.0)
    half = scaled_camera(camera, 640, 360)
    assert (half.fx, half.fy, half.cx, half.cy) == (350.0, 351.0, 320.0, 180.0)
    with pytest.raises(ValueError, match="another proportion"):
        scaled_camera(camera, 640, 480)


def test_focal_lengths_without_a_calibration() -> None:
    # 24 mm on 35 mm film is 84.1 degrees over the diagonal, whatever the picture's proportion.
    still = camera_from_35mm(4000, 3000, 24.0, film=False).camera
    assert np.degrees(2 * np.arctan(np.hypot(2000, 1500) / still.fx)) == pytest.approx(84.06, abs=0.01)
    # 16:9 is cut from the same sensor at its full width.
    assert camera_from_35mm(4000, 2250, 24.0, film=True).camera.fx == pytest.approx(still.fx)
    # Phantom 4 Pro: 8.8 mm before 13.2 mm is 73.7 degrees across.
    wide = camera_from_sensor(5472, 3648, 8.8, "FC6310")
    assert wide is not None
    assert np.degrees(2 * np.arctan(2736 / wide.camera.fx)) == pytest.approx(73.74, abs=0.01)
    # Its pictures of 16:9 have the sensor's whole width, those of 4:3 its whole height of 8.8 mm only: 53.1
    # degrees from top to bottom, as in those of 3:2.
    for size in ((5472, 3078), (4864, 3648), (3648, 4864)):
        cut = camera_from_sensor(*size, 8.8, "FC6310")
        assert cut is not None and cut.camera.fx == pytest.approx(wide.camera.fx)
    assert np.degrees(2 * np.arctan(1824 / wide.camera.fx)) == pytest.approx(53.13, abs=0.01)
    assert camera_from_sensor(5472, 3648, 8.8, "an unknown camera") is None


@pytest.mark.parametrize(
    ("model", "size", "focal_mm", "focal_35mm"),
    [
        ("FC3411", (5472, 3648), 8.38, 22.0),  # DJI Air 2S
        ("FC3582", (4032, 3024), 6.72, 24.0),  # Mini 3 Pro
        ("FC8482", (4032, 3024), 6.72, 24.0),  # Mini 4 Pro
        ("FC8282", (4032, 3024), 6.72, 24.0),  # Air 3, wide
        ("FC8284", (4032, 3024), 19.4, 70.0),  # Air 3, tele
        ("FC6510", (5472, 3648), 8.8, 24.0),  # Zenmuse X4S
        ("XT705", (5472, 3648), 10.57, 28.6),  # Autel EVO II Pro
        ("ILCE-6000", (6000, 4000), 20.0, 30.0),  # Sony a6000: 1.5 times
        ("ILCE-5100", (6000, 4000), 20.0, 30.0),
        ("ILCE-7R", (7360, 4912), 35.0, 35.0),  # as film
    ],
)
def test_sensors_fit_what_their_makers_call_the_lens_on_film(
    model: str, size: tuple[int, int], focal_mm: float, focal_35mm: float
) -> None:
    by_sensor = camera_from_sensor(*size, focal_mm, model)
    assert by_sensor is not None
    by_film = camera_from_35mm(*size, focal_35mm, film=False)
    assert by_sensor.camera.fx == pytest.approx(by_film.camera.fx, rel=0.05)
