"""Points, boxes and density: people and metres per pixel become P(crowd), worked out by hand."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import ndimage

from crowdfence import Detector, DetectorError
from crowdfence.detector.inference.overlap_removal import strongest_boxes
from crowdfence.detector.inference.people_map import closed
from support.onnx_models import contract as document
from support.onnx_models import write_fixed_output_model, write_map_model

BLACK = np.zeros((64, 96, 3), np.uint8)
GSD_M = 0.25
"""Cells of 4 pixels are 1 m wide."""
HARD = {"min_people": 3, "radius_m": 2.0, "softness_people": 0.25, "closing_m": 0.0}


def sigmoid(z: float) -> float:
    return 1.0 / (1.0 + math.exp(-z))


def people(path: Path, rows: Any, kind: str = "points", **changes: Any) -> Detector:
    given = document(kind, **({"output__rule": HARD} | changes))
    output = np.array([rows], np.float32)
    write_fixed_output_model(path, output, given, output_shape=(1, "a", "b"))
    return Detector(path)


def test_points_count_within_the_radius(tmp_path: Path) -> None:
    """Three people at the centre of cell (8, 12), pixel (50, 34): n = 3 within 2 m, 0 beyond."""
    heatmap = people(tmp_path / "m.onnx", [[50, 34, 1.0]] * 3)(BLACK, GSD_M)
    assert heatmap.shape == (16, 24)
    inside, outside = sigmoid(0.5 / 0.25), sigmoid(-2.5 / 0.25)
    for (row, column), value in np.ndenumerate(heatmap):
        near = (row - 8) ** 2 + (column - 12) ** 2 <= 4
        assert value == pytest.approx(inside if near else outside, abs=1e-6)


def test_scores_are_summed(tmp_path: Path) -> None:
    rows = [[50, 34, 0.5], [50, 34, 0.25], [50, 34, 0.125], [50, 34, 0.0625]]
    detector = people(tmp_path / "m.onnx", rows, output__score_min=0.1)
    assert detector(BLACK, GSD_M)[8, 12] == pytest.approx(sigmoid((0.875 - 2.5) / 0.25), abs=1e-6)


def test_two_people_are_no_crowd_and_three_are(tmp_path: Path) -> None:
    two = people(tmp_path / "2.onnx", [[50, 34, 1.0]] * 2)(BLACK, GSD_M)
    three = people(tmp_path / "3.onnx", [[50, 34, 1.0]] * 3)(BLACK, GSD_M)
    assert two.max() < 0.5 < three.max()


def test_people_count_in_their_own_cell_however_small(tmp_path: Path) -> None:
    """At 10 m per pixel a cell is 40 m wide and the radius of 2 m reaches no centre."""
    heatmap = people(tmp_path / "m.onnx", [[48.5, 35.5, 1.0]] * 3)(BLACK, 10.0)
    assert np.argwhere(heatmap > 0.5).tolist() == [[8, 12]]


def test_metres_per_pixel_may_differ_by_place_and_direction(tmp_path: Path) -> None:
    """Right 0.25 m, down 0.5 m per pixel: the disc of 2 m is 2 cells wide and 1 cell high."""
    gsd = np.empty((2, 1, 2))
    gsd[..., 0], gsd[..., 1] = 0.25, 0.5
    heatmap = people(tmp_path / "m.onnx", [[50, 34, 1.0]] * 3)(BLACK, gsd)
    assert np.argwhere(heatmap > 0.5).tolist() == [
        [7, 12],
        [8, 10],
        [8, 11],
        [8, 12],
        [8, 13],
        [8, 14],
        [9, 12],
    ]
    upper_fine = np.array([[0.25], [1.0]])  # rows 0-7 at 0.25 m, rows 8-15 at 1 m per pixel
    heatmap = people(tmp_path / "m.onnx", [[50, 10, 1.0]] * 3 + [[50, 54, 1.0]] * 3)(BLACK, upper_fine)
    assert (heatmap[:8] > 0.5).sum() == 13  # a disc of radius 2 cells
    assert (heatmap[8:] > 0.5).sum() == 1


def test_ground_that_is_not_seen_takes_the_scale_beside_it(tmp_path: Path) -> None:
    detector = people(tmp_path / "m.onnx", [[50, 34, 1.0]] * 3)
    gsd = np.full((16, 24), GSD_M)
    expected = detector(BLACK, gsd)
    gsd[:9] = np.nan
    np.testing.assert_array_equal(detector(BLACK, gsd), expected)


@pytest.mark.parametrize(
    ("gsd_m", "message"),
    [
        (None, r"gsd_m is missing: points become a heatmap only with metres per image pixel"),
        (0.0, r"gsd_m holds 0.0; allowed: metres above 0"),
        (-1.0, r"gsd_m holds -1.0"),
        (math.nan, r"gsd_m holds no finite number"),
        (np.zeros((2, 2, 3)), r"gsd_m has shape \[2, 2, 3\]"),
        (np.zeros((0, 2)), r"gsd_m has shape \[0, 2\]"),
    ],
)
def test_metres_per_pixel_are_checked(tmp_path: Path, gsd_m: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        people(tmp_path / "m.onnx", [[50, 34, 1.0]])(BLACK, gsd_m)


@pytest.mark.parametrize(("box", "format"), [((40, 10, 60, 34), "xyxy"), ((50, 22, 20, 24), "cxcywh")])
def test_a_box_stands_on_the_middle_of_its_lower_edge(
    tmp_path: Path, box: tuple[int, ...], format: str
) -> None:
    detector = people(tmp_path / "m.onnx", [[*box, 1.0]] * 3, "boxes", output__box_format=format)
    assert np.argwhere(detector(BLACK, 10.0) > 0.5).tolist() == [[8, 12]]


def test_fractions_are_of_the_models_input(tmp_path: Path) -> None:
    """A model of 32 x 32 stretched over 96 x 64: (0.52, 0.53) is pixel (49.9, 33.9)."""
    given = {
        "input__size": [32, 32],
        "input__resize": "stretch",
        "output__coordinates": "fraction",
    }
    detector = people(tmp_path / "m.onnx", [[0.52, 0.53, 1.0]] * 3, **given)
    assert np.argwhere(detector(BLACK, 10.0) > 0.5).tolist() == [[8, 12]]


def test_letterboxed_people_come_back_to_the_image(tmp_path: Path) -> None:
    """96 x 64 in 48 x 48: half size, 32 rows in the middle, 8 above. Model (25, 25) is pixel (50, 34)."""
    given = {"input__size": [48, 48], "input__resize": "letterbox"}
    detector = people(tmp_path / "m.onnx", [[25, 25, 1.0]] * 3, **given)
    assert np.argwhere(detector(BLACK, 10.0) > 0.5).tolist() == [[8, 12]]


@pytest.mark.parametrize(
    ("row", "values", "score"),
    [
        ("none", [], 1.0),
        ("score", [0.5], 0.5),
        ("score_class", [0.5, 1], 0.5),
        ("score_class", [0.5, 0], 0.0),
        ("class_scores", [0.9, 0.5, 0.25], 0.5),
        ("objectness_class_scores", [0.5, 0.9, 0.5, 0.25], 0.25),
    ],
)
@pytest.mark.parametrize("layout", ["NDC", "NCD"])
def test_rows(tmp_path: Path, row: str, values: list[float], score: float, layout: str) -> None:
    """Class 1 is people; three of them stand on one spot."""
    rows = np.array([[50, 34, *values]] * 3)
    detector = people(
        tmp_path / "m.onnx",
        rows if layout == "NDC" else rows.T,
        output__row=row,
        output__class_index=1,
        output__layout=layout,
    )
    expected = sigmoid((3 * score - 2.5) / 0.25)
    assert detector(BLACK, GSD_M)[8, 12] == pytest.approx(expected, abs=1e-6)


def test_no_detections_are_no_crowd(tmp_path: Path) -> None:
    heatmap = people(tmp_path / "m.onnx", np.zeros((0, 5)), "boxes", output__iou_max=0.5)(BLACK, GSD_M)
    assert heatmap.max() == pytest.approx(sigmoid(-10.0), abs=1e-7)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([[50, 34, math.nan]], r"holds nan in value 2 of detection 0"),
        ([[50, math.inf, 1.0]], r"holds inf in value 1"),
        ([[50, 34, 1.5]], r"gives detection 0 the score 1.5; allowed: 0 to 1"),
        ([[50, 34]], r"has 2 values a detection; points with row 'score' .* need 3 and more"),
        ([[50, 34, 1.0]] * 10_001, r"holds 10,001 people .*allowed: 10,000; is output.score_min right"),
    ],
)
def test_detections_that_cannot_be_are_refused(tmp_path: Path, rows: Any, message: str) -> None:
    with pytest.raises(DetectorError, match=message):
        people(tmp_path / "m.onnx", rows)(BLACK, GSD_M)


@pytest.mark.parametrize(
    ("row", "values", "message"),
    [
        # Logits: of nobody below 0, and -0.5 * -0.8 would be a score of 0.4.
        ("class_scores", [-3.0, 2.0], r"gives detection 0 the score -3; allowed: 0 to 1"),
        ("objectness_class_scores", [-0.5, -0.8], r"gives detection 0 the score -0.5; allowed: 0 to 1"),
        # The class, 0, and then the score.
        ("score_class", [0.0, 0.9], r"gives detection 0 the class 0.9; .* does the class stand before the"),
    ],
)
def test_values_that_are_no_scores_leave_nobody_out_in_silence(
    tmp_path: Path, row: str, values: list[float], message: str
) -> None:
    """Three people, class 0, on one spot."""
    rows = np.array([[50, 34, *values]] * 3)
    detector = people(tmp_path / "m.onnx", rows, output__row=row, output__class_index=0)
    with pytest.raises(DetectorError, match=message):
        detector(BLACK, GSD_M)


@pytest.mark.parametrize(
    ("rows", "changes", "message"),
    [
        # 12 x 24 pixels around (60, 40), read as corners.
        ([[60, 40, 12, 24, 1.0]] * 3, {}, r"3 of 3 boxes end before they begin; .* 'cxcywh'\?"),
        ([[54, 28, 66, 52, 1.0]] * 3, {"output__coordinates": "fraction"}, r"3 of 3 people lie beyond"),
        # Of an input twice as large as the model's.
        ([[108, 56, 132, 104, 1.0]] * 3, {}, r"3 of 3 people lie beyond the input of 96 x 64 pixels"),
        ([[0.5, 0.4, 0.6, 0.8, 1.0]] * 3, {}, r"all of 3 people lie within the first pixel; .* 'fraction'\?"),
    ],
)
def test_boxes_in_other_units_than_the_contract_says_are_refused(
    tmp_path: Path, rows: Any, changes: dict[str, Any], message: str
) -> None:
    """Three people in the middle of the picture, who would stand in a corner of it, or nowhere."""
    detector = people(tmp_path / "m.onnx", rows, "boxes", **changes)
    with pytest.raises(DetectorError, match=message):
        detector(BLACK, GSD_M)


@pytest.mark.parametrize(("coordinates", "unit"), [("pixels", 1.0), ("fraction", 1 / 96)])
def test_corners_are_no_middles_and_sizes(tmp_path: Path, coordinates: str, unit: float) -> None:
    """Three people 6 x 16 pixels large at the right edge and one on the left, by their corners. Read as
    middle and size they would stand half of the picture farther down, below its edge."""
    rows = [[80, 30, 86, 46], [83, 30, 89, 46], [86, 30, 92, 46], [10, 8, 16, 24]]
    given = {"output__box_format": "cxcywh", "output__coordinates": coordinates}
    wrong = people(tmp_path / "a.onnx", [[*np.array(row) * unit, 1.0] for row in rows], "boxes", **given)
    square = np.zeros((96, 96, 3), np.uint8)
    with pytest.raises(DetectorError, match=r"all of 4 boxes are as wide .*is output.box_format 'xyxy'\?"):
        wrong(square, GSD_M)
    given["output__box_format"] = "xyxy"
    right = people(tmp_path / "b.onnx", [[*np.array(row) * unit, 1.0] for row in rows], "boxes", **given)
    assert right(square, GSD_M)[11, 21] > 0.5  # 46 / 4 pixels down, 86 / 4 across


@pytest.mark.parametrize("box", [(48, 48, 70, 80), (6, 8, 10, 16)])
def test_one_person_who_fills_the_picture_or_stands_in_its_corner_is_found(
    tmp_path: Path, box: tuple[int, ...]
) -> None:
    """Several boxes of it, none of which was removed."""
    rows = [[box[0] + shift, box[1], *box[2:], 0.9] for shift in (-1, 0, 1)]
    detector = people(tmp_path / "m.onnx", rows, "boxes", output__box_format="cxcywh")
    assert detector(np.zeros((96, 96, 3), np.uint8), GSD_M).max() > 0.5


def test_one_wrong_box_among_others_takes_nobody_away(tmp_path: Path) -> None:
    rows = [[40, 10, 60, 34, 1.0]] * 3 + [[60, 40, 12, 24, 1.0], [9e9, 9e9, 9.1e9, 9.1e9, 1.0]]
    assert people(tmp_path / "m.onnx", rows, "boxes")(BLACK, GSD_M)[8, 12] > 0.5


def test_overlapping_boxes_are_one_person() -> None:
    """10 x 10 boxes shifted by 2: overlap 80 of 120, 0.667; by 5: 50 of 150, 0.333."""
    boxes = np.array([[0, 0, 10, 10], [2, 0, 12, 10], [5, 0, 15, 10], [50, 0, 60, 10]], np.float64)
    scores = np.array([0.8, 0.9, 0.7, 0.6])
    assert strongest_boxes(boxes, scores, 0.7).tolist() == [1, 0, 2, 3]
    # Box 2 shares 70 of 130 with box 1, 0.538; box 0 would be in its way only if it were kept.
    assert strongest_boxes(boxes, scores, 0.6).tolist() == [1, 2, 3]
    assert strongest_boxes(boxes, scores, 0.5).tolist() == [1, 3]


def test_a_plain_density_is_people_per_square_metre(tmp_path: Path) -> None:
    """0.2 people a cell of 1 m2; sigmoid((0.2 - 0.24) / 0.04) = sigmoid(-1), everywhere and at the border."""
    detector = Detector(write_map_model(tmp_path / "m.onnx", document("density")))
    image = np.full((64, 96, 3), (51, 0, 0), np.uint8)
    assert detector(image, GSD_M) == pytest.approx(np.full((16, 24), 0.268941), abs=1e-5)
    # Seen from twice as near, the same output is four times as dense.
    assert detector(image, GSD_M / 2) == pytest.approx(np.full((16, 24), sigmoid(0.56 / 0.04)), abs=1e-5)


def test_count_scale_and_numbers_below_zero(tmp_path: Path) -> None:
    """Output 20 a cell * 0.01 = 0.2 people. What is below zero counts as nobody."""
    given = document("density", output__count_scale=0.01)
    image = np.full((64, 96, 3), (51, 0, 0), np.uint8)
    detector = Detector(write_map_model(tmp_path / "a.onnx", given, scale=20 / 51))
    assert detector(image, GSD_M) == pytest.approx(np.full((16, 24), 0.268941), abs=1e-5)
    below = Detector(write_map_model(tmp_path / "b.onnx", given, offset=-5.0))
    assert below(image, GSD_M) == pytest.approx(np.full((16, 24), sigmoid(-6.0)), abs=1e-5)


def test_resizing_keeps_the_number_of_people(tmp_path: Path) -> None:
    """8 x 8 cells of 0.2 people on an image of 64 x 64 pixels, 256 m2: 12.8 / 256 = 0.05 people per m2."""
    given = document("density", input__size=[32, 32], input__resize="stretch")
    detector = Detector(write_map_model(tmp_path / "m.onnx", given))
    heatmap = detector(np.full((64, 64, 3), (51, 0, 0), np.uint8), GSD_M)
    assert heatmap == pytest.approx(np.full((16, 16), sigmoid(-0.19 / 0.04)), abs=1e-5)


def test_density_is_averaged_over_the_window(tmp_path: Path) -> None:
    """One person in a window of 3 x 3 cells of 1 m2 is 1/9, at the corner of the image (2 x 2 cells) 1/4."""
    answer = np.zeros((1, 1, 16, 24))
    answer[0, 0, 8, 12] = answer[0, 0, 0, 0] = 1.0
    rule = {"people_per_m2": 0.1, "softness_per_m2": 0.05, "window_m": 3.0}
    given = document("density", output__rule=rule)
    heatmap = Detector(write_fixed_output_model(tmp_path / "m.onnx", answer, given))(BLACK, GSD_M)
    expected = np.full((16, 24), sigmoid(-0.1 / 0.05))
    expected[7:10, 11:14] = sigmoid((1 / 9 - 0.1) / 0.05)
    expected[:2, :2] = sigmoid((1 / 6 - 0.1) / 0.05)  # 2 x 3 cells along the border
    expected[0, 0] = sigmoid((1 / 4 - 0.1) / 0.05)
    expected[1, 1] = sigmoid((1 / 9 - 0.1) / 0.05)
    assert heatmap == pytest.approx(expected, abs=1e-6)


def test_density_that_is_nan_is_refused(tmp_path: Path) -> None:
    answer = np.full((1, 1, 16, 24), np.nan)
    path = write_fixed_output_model(tmp_path / "m.onnx", answer, document("density"))
    with pytest.raises(DetectorError, match=r"output heatmap holds nan"):
        Detector(path)(BLACK, GSD_M)


def octagon(steps: int) -> np.ndarray[Any, Any]:
    """What a point becomes after as many squares and crosses as `closed` takes, by SciPy."""
    squares = math.floor(steps * (math.sqrt(2) - 1))
    shape = np.zeros((2 * steps + 1, 2 * steps + 1), np.bool_)
    shape[steps, steps] = True
    for count, connectivity in ((squares, 2), (steps - squares, 1)):
        if count:
            cross = ndimage.generate_binary_structure(2, connectivity)
            shape = ndimage.binary_dilation(shape, cross, iterations=count)
    return shape


@settings(max_examples=40)
@given(
    hnp.arrays(np.float32, (18, 23), elements=st.sampled_from([0.0, 0.25, 0.5, 1.0])),
    st.integers(1, 5),
)
def test_closing_is_the_grey_closing_of_scipy(values: np.ndarray[Any, Any], steps: int) -> None:
    """Away from the border, where SciPy's idea of the outside does not matter."""
    ours = closed(values, np.full(values.shape, steps, np.float32))
    wide = np.pad(values, 3 * steps, constant_values=-1.0)
    theirs = ndimage.grey_closing(wide, footprint=octagon(steps))[
        3 * steps : -3 * steps, 3 * steps : -3 * steps
    ]
    inside = np.s_[2 * steps : -2 * steps or None, 2 * steps : -2 * steps or None]
    np.testing.assert_array_equal(ours[inside], theirs[inside])
    assert (ours >= values).all() and ours.max() == values.max()


def test_closing_fills_gaps_up_to_two_radii() -> None:
    values = np.zeros((21, 40), np.float32)
    values[:, :10] = values[:, 16:25] = values[:, 32:] = 0.9  # gaps of 6 and of 7 cells
    filled = closed(values, np.full(values.shape, 3.0, np.float32))
    assert (filled[:, 10:16] == np.float32(0.9)).all()
    assert (filled[:, 28] == 0.0).all()


def test_no_closing_changes_nothing() -> None:
    values = np.random.default_rng(5).random((9, 9), np.float32)
    np.testing.assert_array_equal(closed(values, np.zeros((9, 9), np.float32)), values)
