"""Metres per pixel of a frame by trigonometry, and a flight against what a detector states about itself."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from crowdfence import Camera, Terrain
from crowdfence.detector.contract.contract import Contract, Validity
from crowdfence.detector.contract.model_input import ModelInput
from crowdfence.detector.contract.model_output import ModelOutput
from crowdfence.detector.ground_sampling import ground_sampling
from crowdfence.detector.validity import (
    FlightSample,
    check_ranges,
    sample_flight,
    shrunk_warning,
    shrunk_warnings,
    silence_warning,
    statement_warnings,
)
from crowdfence.sources.recording import Frame

CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 320.0, 240.0)
CONTRACT = Contract(
    "net",
    ModelInput(name="image", layout="NHWC", dtype="uint8"),
    ModelOutput("heatmap", "probability", "NCHW", 4),
)
RATES = {
    "true_positive": {"rate": 0.8, "low": 0.7, "high": 0.9},
    "false_positive": {"rate": 0.01, "low": 0.0, "high": 0.02},
    "voxel_size_m": 0.5,
    "b_threshold": 0.5,
    "coverage": "full",
    "surface": "planes",
}
HERE = {"voxel_size_m": 0.5, "b_threshold": 0.5, "coverage": "full", "surface": "planes"}
"""The setting that `RATES` were measured in."""


def plain() -> Terrain:
    """Level ground at height 0, 800 m wide, the origin in its middle."""
    return Terrain.from_height_map(np.zeros((400, 400)), 2.0, 2.0, (-400.0, -400.0, 0.0))


def looking(height_m: float, tilt_deg: float) -> NDArray[np.float64]:
    """world_from_camera of a camera above the origin that looks north and down."""
    tilt = np.radians(tilt_deg)
    forward = np.array([0.0, np.cos(tilt), -np.sin(tilt)])
    down = np.array([0.0, -np.sin(tilt), -np.cos(tilt)])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([[1.0, 0.0, 0.0], down, forward], axis=1)
    pose[:3, 3] = [0.3, 0.7, height_m]
    return pose


def test_a_camera_that_looks_straight_down() -> None:
    sampling = ground_sampling(CAMERA, looking(100.0, 90.0), plain(), max_range_m=300.0, rows=3, columns=5)
    # Cell centres of the middle row: columns 64, 192, 320, 448, 576, the camera's axis at 320.
    sideways = np.array([-256.0, -128.0, 0.0, 128.0, 256.0]) / 500.0
    expected_m = 100.0 * np.sqrt(1.0 + sideways**2)
    assert sampling.distance_m[1] == pytest.approx(expected_m)
    assert sampling.gsd_m[1] == pytest.approx(expected_m / 500.0)
    assert sampling.tilt_deg[1] == pytest.approx(np.degrees(np.arctan2(1.0, np.abs(sideways))))
    assert sampling.along_ground()[1, 2] == pytest.approx([0.2, 0.2])


def test_a_flat_ray_stretches_a_pixel_along_the_ground() -> None:
    sampling = ground_sampling(CAMERA, looking(50.0, 30.0), plain(), max_range_m=300.0, rows=1, columns=1)
    assert sampling.tilt_deg[0, 0] == pytest.approx(30.0)
    assert sampling.distance_m[0, 0] == pytest.approx(100.0)  # 50 m / sin 30 deg
    assert sampling.along_ground()[0, 0] == pytest.approx([0.2, 0.4])


def test_sky_and_what_lies_beyond_the_range_have_no_scale() -> None:
    sampling = ground_sampling(CAMERA, looking(20.0, 0.0), plain(), max_range_m=100.0, rows=4, columns=2)
    # Rows 60 and 180 look up. Row 300 falls 60 px in 500: 20 m lower after 167 m, beyond the range.
    assert np.isnan(sampling.gsd_m[:3]).all() and np.isnan(sampling.tilt_deg[:3]).all()
    assert sampling.distance_m[3] == pytest.approx(np.hypot(np.hypot(500, 160), 180) / 180 * 20.0)
    assert sampling.sees_ground
    up = ground_sampling(CAMERA, looking(20.0, -60.0), plain(), max_range_m=100.0)
    assert not up.sees_ground


def test_pixels_without_a_ray_have_no_scale() -> None:
    bent = Camera.pinhole(640, 480, 300.0, 300.0, 320.0, 240.0, distortion=[-0.5, 0.0, 0.0, 0.0])
    assert bent.blind_pixel_count() > 0
    sampling = ground_sampling(bent, looking(100.0, 90.0), plain(), max_range_m=900.0)
    assert np.isnan(sampling.gsd_m[0, 0])
    assert np.isfinite(sampling.gsd_m[6, 8])


def test_shares_outside_of_the_tested_range() -> None:
    flight = FlightSample(
        gsd_m=np.array([0.05, 0.1, 0.2, 0.3]),
        distance_m=np.array([10.0, 20.0, 30.0, 40.0]),
        tilt_deg=np.array([5.0, 30.0, 60.0, 90.0]),
    )
    tested = replace(CONTRACT, validity=Validity(gsd_m=(0.06, 0.25), distance_m=(10.0, 40.0)))
    gsd, distance, tilt = check_ranges(tested, flight)
    assert (gsd.share_below, gsd.share_above) == (0.25, 0.25)
    assert (distance.share_below, distance.share_above) == (0.0, 0.0)
    assert tilt.tested is None and tilt.warnings("net") == []
    below, above = gsd.warnings("net")
    assert "25% of the ground seen lies below 0.06 m" in below and "net" in below
    assert "25% of the ground seen lies above 0.25 m" in above
    assert distance.warnings("net") == []
    assert gsd.to_json()["flight_quantiles"]["0.5"] == pytest.approx(0.15)


def test_what_finer_cameras_were_tested_at_is_tested_too() -> None:
    finer = {"focal_px": 1000.0, "validity": {"gsd_m": [0.05, 0.2], "tilt_deg": [10.0, 90.0]}}
    contract = replace(
        CONTRACT, validity=Validity((0.1, 0.5), (40.0, 200.0), (20.0, 80.0)), rates={**RATES, "finer": finer}
    )
    flight = FlightSample(np.array([0.07, 0.3]), np.array([50.0, 250.0]), np.array([15.0, 85.0]))
    told = {
        one.quantity: (one.tested, one.share_below, one.share_above) for one in check_ranges(contract, flight)
    }
    assert told == {
        "gsd_m": ((0.05, 0.5), 0.0, 0.0),
        "distance_m": ((40.0, 200.0), 0.0, 0.5),
        "tilt_deg": ((10.0, 90.0), 0.0, 0.0),
    }


def test_a_flight_that_sees_no_ground_has_nothing_to_compare() -> None:
    frames = [Frame("a", number, CAMERA, looking(20.0, -60.0)) for number in range(3)]
    flight = sample_flight(frames, plain(), max_range_m=300.0)
    assert check_ranges(CONTRACT, flight) == []
    assert check_ranges(CONTRACT, sample_flight([], plain(), max_range_m=300.0)) == []


def test_the_flight_is_sampled_from_its_beginning_to_its_end() -> None:
    heights_m = np.linspace(20.0, 120.0, 500)
    frames = [Frame("a", number, CAMERA, looking(height, 90.0)) for number, height in enumerate(heights_m)]
    flight = sample_flight(frames, plain(), max_range_m=300.0)
    assert flight.distance_m.min() == pytest.approx(20.0, rel=0.01)
    assert flight.distance_m.max() > 120.0


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, ["states no calibration", "metres per pixel it was tested", "states no rates"]),
        ({"calibration": {"temperature": 1.0}, "validity": Validity(), "rates": RATES}, []),
    ],
)
def test_what_the_contract_leaves_open_is_said(changes: dict, expected: list[str]) -> None:
    warnings = statement_warnings(replace(CONTRACT, **changes), **HERE, rates_given=False)
    assert len(warnings) == len(expected)
    assert all(part in warning for part, warning in zip(expected, warnings, strict=True))


@pytest.mark.parametrize(
    ("resize", "size", "shown"),
    [
        ("letterbox", (640, 640), "640 x 360"),  # a third, of which 1080 rows are 360
        ("stretch", (640, 640), "640 x 640"),
        ("letterbox", (960, 960), None),  # half
        ("stretch", (1920, 360), "1920 x 360"),
        ("tile", (640, 640), None),
        ("none", None, None),
    ],
)
def test_pictures_that_a_model_sees_far_smaller_than_they_are(
    resize: str, size: tuple[int, int] | None, shown: str | None
) -> None:
    """0.05 m a pixel are 0.15 at a third."""
    contract = replace(CONTRACT, input=replace(CONTRACT.input, resize=resize, size=size))
    warning = shrunk_warning(contract, 1920, 1080, 0.05)
    if shown is None:
        assert warning is None
    else:
        assert warning is not None
        assert (
            f"1920 x 1080 pixels shrunk to {shown}, half of the ground at 0.15 m a pixel or more" in warning
        )


def test_of_pictures_of_several_sizes_those_that_are_shown_smallest_are_told() -> None:
    """640 of 2400 rows are more than a quarter, 640 of 1200 columns more than a half."""
    contract = replace(CONTRACT, input=replace(CONTRACT.input, resize="letterbox", size=(640, 640)))
    (warning,) = shrunk_warnings([contract], {(1200, 900), (600, 2400), (100, 100)})
    assert "600 x 2400 pixels shrunk to 160 x 640" in warning
    assert shrunk_warnings([contract], {(1200, 900), (100, 100)}) == []


def test_a_method_that_weighs_looks_asks_for_likelihood_ratios_and_not_for_options_that_it_refuses() -> None:
    """`evidence` takes no --tpr and no --fpr."""
    stated = replace(CONTRACT, calibration={}, validity=Validity())
    for rates in (None, RATES):
        (warning,) = statement_warnings(
            replace(stated, rates=rates), **HERE, rates_given=False, weighed_as="the shipped crowdnet-s"
        )
        assert "states no likelihood ratios" in warning and "as sure as the shipped crowdnet-s" in warning
        assert "--tpr" not in warning
    measured = replace(stated, rates={**RATES, "likelihood_ratio": {}})
    assert statement_warnings(measured, **HERE, rates_given=False, weighed_as="x") == []
    (other,) = statement_warnings(measured, **HERE | {"voxel_size_m": 2.0}, rates_given=False, weighed_as="x")
    assert other == "the rates of net were measured with voxels of 0.5 m; this run has voxels of 2 m"


def test_rates_that_were_measured_in_another_setting() -> None:
    measured = replace(CONTRACT, calibration={}, validity=Validity(), rates=RATES)
    other = {"voxel_size_m": 2.0, "b_threshold": 0.3, "coverage": "rays", "surface": "voxels"}
    assert statement_warnings(measured, **other, rates_given=False) == [
        "the rates of net were measured with voxels of 0.5 m, b_threshold 0.5, coverage full, "
        "surface planes; this run has voxels of 2 m, b_threshold 0.3, coverage rays, surface voxels"
    ]
    assert statement_warnings(measured, **other, rates_given=True) == []
    (finer,) = statement_warnings(measured, **HERE | {"voxel_size_m": 0.25}, rates_given=False)
    assert finer.endswith("were measured with voxels of 0.5 m; this run has voxels of 0.25 m")


@pytest.mark.parametrize("weighed_as", [None, "x"])
def test_rates_of_the_model_in_floating_point(weighed_as: str | None) -> None:
    """`model quantize` keeps them where it cannot measure those in eight bits."""
    rates = {**RATES, "likelihood_ratio": {}, "arithmetic": "float32"}
    stated = replace(CONTRACT, calibration={}, validity=Validity(), rates=rates, about={"arithmetic": "int8"})
    expected = (
        "the rates of net were measured with the model in floating point; this run has it in eight bits"
    )
    given = {**HERE, "rates_given": False, "weighed_as": weighed_as}
    assert statement_warnings(stated, **given) == [expected]
    for own in (replace(stated, rates={**rates, "arithmetic": "int8"}), replace(stated, about=None)):
        assert statement_warnings(own, **given) == []


def test_rates_without_a_surface_are_of_voxels() -> None:
    """They are from before there was another one."""
    old = {key: value for key, value in RATES.items() if key != "surface"}
    measured = replace(CONTRACT, calibration={}, validity=Validity(), rates=old)
    (warning,) = statement_warnings(measured, **HERE, rates_given=False)
    assert warning == "the rates of net were measured with surface voxels; this run has surface planes"
    assert statement_warnings(measured, **HERE | {"surface": "voxels"}, rates_given=False) == []


@pytest.mark.parametrize(
    ("rates", "expected"),
    [
        ({"likelihood_ratio": {"log10_ratio": [[[-2.0, -0.3]]]}}, "(largest likelihood ratio 0.5)"),
        ({"likelihood_ratio": {"log10_ratio": [[[-2.0, 0.1]]]}}, None),
        ({"likelihood_ratio": {"log10_ratio": "none"}}, None),
        (RATES, None),
        (RATES | {"false_positive": {"rate": 0.8}}, "(TPR 0.8, FPR 0.8)"),
        (None, None),
    ],
)
def test_rates_by_which_nothing_would_ever_be_closed_are_told(
    rates: dict | None, expected: str | None
) -> None:
    stated = replace(CONTRACT, calibration={}, validity=Validity(), rates=rates)
    warning = silence_warning(stated)
    assert (warning is None) == (expected is None)
    assert expected is None or expected in warning
    weighed = statement_warnings(stated, **HERE, rates_given=False, weighed_as="x")
    assert (warning in weighed) == (warning is not None and "likelihood_ratio" in rates)
