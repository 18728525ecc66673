"""Detectors that are Python functions, checked as models are."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from crowdfence import Detector, DetectorError
from crowdfence.detector.contract.crowd_rules import PeopleRule
from support.onnx_models import contract as document

BLACK = np.zeros((64, 96, 3), np.uint8)


def found(xyxy: Any, confidence: Any = None, class_id: Any = None) -> SimpleNamespace:
    """As `supervision.Detections` looks from outside."""
    return SimpleNamespace(xyxy=xyxy, confidence=confidence, class_id=class_id)


def test_a_function_gives_the_heatmap() -> None:
    detector = Detector.from_callable(lambda image: image[..., 0] / 255.0, name="red")
    image = BLACK.copy()
    image[3, 5, 0] = 51
    heatmap = detector(image)
    assert heatmap.dtype == np.float32 and heatmap.shape == (64, 96)
    assert heatmap[3, 5] == pytest.approx(0.2) and heatmap.sum() == pytest.approx(0.2)
    assert (detector.contract.name, detector.contract.output.stride) == ("red", 1)


def test_eight_bits_are_shares_of_255() -> None:
    detector = Detector.from_callable(lambda image: np.full((16, 24), 51, np.uint8), stride=4)
    assert detector(BLACK) == pytest.approx(np.full((16, 24), 0.2))


def test_a_batch_calls_the_function_for_each() -> None:
    detector = Detector.from_callable(lambda image: np.full(image.shape[:2], image.max() / 255.0))
    highest = [float(heatmap.max()) for heatmap in detector.batch([BLACK, BLACK + 255])]
    assert highest == [0.0, 1.0]


def test_a_function_may_write_every_answer_into_one_buffer() -> None:
    """As detectors with an output of their own do; the heatmaps of before stay as they were."""
    buffer = np.zeros((64, 96), np.float32)

    def brightest(image: np.ndarray) -> np.ndarray:
        buffer[:] = image.max() / np.float32(255.0)
        return buffer

    detector = Detector.from_callable(brightest)
    highest = [float(heatmap.max()) for heatmap in detector.batch([BLACK + 255, BLACK])]
    assert highest == [1.0, 0.0]


def test_a_contract_adds_rates_and_validity() -> None:
    given = document(validity={"gsd_m": [0.05, 0.1]}, target_height_m=1.5)
    detector = Detector.from_callable(lambda image: np.zeros((16, 24)), contract=given)
    assert detector.contract.target_height_m == 1.5
    assert detector(BLACK).shape == (16, 24)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (np.full((64, 96), np.nan), r"holds nan"),
        (np.full((64, 96), 2.0), r"holds 2.0 at \[0, 0\]"),
        (np.zeros((64, 95)), r"gave 95 columns for 96 pixels; stride 1 gives 96"),
        (np.zeros((96, 64)), r"gave 96 rows for 64 pixels"),
        (np.zeros((64, 96, 1)), r"gave float64 \[64, 96, 1\]; allowed: float \[h, w\]"),
        (np.zeros((64, 96), np.int32), r"gave int32"),
        (np.ma.masked_less(np.zeros((64, 96)), 0.5), r"masked cells.*give the function itself to `run`"),
        (None, r"gave object \[\]"),
    ],
)
def test_what_a_function_gives_is_checked(answer: Any, message: str) -> None:
    with pytest.raises(DetectorError, match=message) as caught:
        Detector.from_callable(lambda image: answer, name="mine")(BLACK)
    assert str(caught.value).startswith("mine: ")


def test_boxes_of_people_become_a_crowd() -> None:
    """Feet at (50, 34): cell (8, 12). Two of class 0 and one of class 2; class 7 is a car."""
    box = [40.0, 10.0, 60.0, 34.0]
    detections = found(np.array([box] * 4), np.array([1.0, 1.0, 0.9, 1.0]), np.array([0, 0, 2, 7]))
    detector = Detector.from_supervision(lambda image: detections, class_ids=(0, 2))
    assert detector(BLACK, gsd_m=0.25)[8, 12] == pytest.approx(1 / (1 + math.exp(-0.4 / 0.25)), abs=1e-6)
    assert detector.contract.needs_gsd
    everything = Detector.from_supervision(lambda image: detections, class_ids=None)
    assert everything(BLACK, gsd_m=0.25)[8, 12] > detector(BLACK, gsd_m=0.25)[8, 12]
    strict = Detector.from_supervision(
        lambda image: detections, class_ids=None, score_min=0.95, rule=PeopleRule(min_people=4)
    )
    assert strict(BLACK, gsd_m=0.25)[8, 12] == pytest.approx(1 / (1 + math.exp(0.5 / 0.25)), abs=1e-6)


@pytest.mark.parametrize("nothing", [np.empty((0, 4)), [], np.empty((0,))])
def test_nobody_is_no_crowd(nothing: Any) -> None:
    detector = Detector.from_supervision(
        lambda image: found(nothing, np.empty(0), np.empty(0)), class_ids=(0,)
    )
    assert detector(BLACK, gsd_m=0.25).max() < 1e-3


@pytest.mark.parametrize(
    ("detections", "message"),
    [
        (found(np.zeros((2, 3))), r"xyxy has shape \[2, 3\]; allowed: \[N, 4\]"),
        (found(None), r"the detections have no xyxy"),
        (object(), r"the detections have no xyxy"),
        (found("boxes"), r"xyxy is 'boxes'; allowed: an array of numbers"),
        (found(np.full((1, 4), np.nan)), r"xyxy holds nan"),
        (found(np.zeros((2, 4)), np.ones(3), np.zeros(2)), r"confidence has shape \[3\]; allowed: \[2\]"),
        (found(np.zeros((2, 4)), np.array([0.5, 1.5]), np.zeros(2)), r"confidence is 0.5 to 1.5"),
        (found(np.zeros((2, 4)), np.ones(2)), r"no class_id; pass class_ids=None if all are people"),
    ],
)
def test_detections_are_checked(detections: Any, message: str) -> None:
    with pytest.raises(DetectorError, match=message):
        Detector.from_supervision(lambda image: detections, class_ids=(0,))(BLACK, gsd_m=0.25)


@pytest.mark.parametrize(
    ("boxes", "message"),
    [
        (
            [[0.4, 0.2, 0.6, 0.5]] * 3,
            r"all 3 boxes of the detections lie within the first pixel: they are frac",
        ),
        # Of a picture three times as large.
        ([[120.0, 30.0, 180.0, 102.0]] * 3, r"3 of 3 boxes .* outside the picture of 96 x 64 pixels"),
        # x, y, width, height.
        ([[40.0, 30.0, 20.0, 24.0]] * 3, r"3 of 3 boxes of the detections end before they begin"),
    ],
)
def test_boxes_that_are_no_corners_in_the_picture_are_refused(boxes: Any, message: str) -> None:
    """They put a crowd into a corner of the picture, or nowhere."""
    detector = Detector.from_supervision(lambda image: found(np.array(boxes)), class_ids=None)
    with pytest.raises(DetectorError, match=message):
        detector(BLACK, gsd_m=0.25)


def test_one_box_beside_the_picture_takes_no_others_with_it() -> None:
    boxes = np.array([[40.0, 10.0, 60.0, 34.0]] * 3 + [[100.0, 10.0, 110.0, 34.0]])
    detector = Detector.from_supervision(lambda image: found(boxes), class_ids=None)
    assert detector(BLACK, gsd_m=0.25)[8, 12] == pytest.approx(1 / (1 + math.exp(-0.5 / 0.25)), abs=1e-6)


@pytest.mark.parametrize("score_min", [50, float("nan"), -0.1])
def test_scores_that_nobody_reaches_are_refused(score_min: float) -> None:
    """In percent, or no number at all: nobody would be found, ever."""
    with pytest.raises(DetectorError, match=r"output.score_min is .*; allowed: "):
        Detector.from_supervision(lambda image: image, class_ids=np.array([0]), score_min=score_min)


def test_strides_below_one_are_refused() -> None:
    with pytest.raises(ValueError, match="stride is 0"):
        Detector.from_callable(lambda image: image, stride=0)
    with pytest.raises(ValueError, match="stride is -1"):
        Detector.from_supervision(lambda image: image, class_ids=None, stride=-1)
