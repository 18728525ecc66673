"""Detectors that are Python functions: image -> heatmap, or image -> boxes in the manner of supervision."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.detector.contract.contract import Contract, contract_of
from crowdfence.detector.contract.crowd_rules import PeopleRule
from crowdfence.detector.contract.model_input import ModelInput
from crowdfence.detector.contract.model_output import ModelOutput
from crowdfence.detector.ground_scale import GroundScale, Gsd
from crowdfence.detector.inference.image_tensor import Image
from crowdfence.detector.inference.map_output import Map, in_unit_range
from crowdfence.detector.inference.people_map import crowd_from_people
from crowdfence.detector.inference.people_output import People
from crowdfence.errors import DetectorError, quoted

_PIXELS = ModelInput(name="image", layout="NHWC", dtype="uint8")


class HeatmapFunction:
    """`function(image)` gives the heatmap; what it gives is checked as a model's output is."""

    def __init__(self, function: Callable[[Image], ArrayLike], contract: Contract) -> None:
        self._function = function
        self._stride = contract.output.stride

    def heatmap(self, image: Image, gsd_m: Gsd | None, *, as_it_is: bool = False) -> Map:
        answer = self._function(image)
        if np.ma.is_masked(answer):
            raise DetectorError(
                "the function masked cells, and a detector answers for all of them: give the function itself "
                "to `run`, to which masked cells were not looked at"
            )
        given = np.asarray(answer)
        if given.dtype == np.uint8:
            given = given.astype(np.float32) / np.float32(255.0)
        if given.ndim != 2 or given.dtype.kind != "f" or given.size == 0:
            raise DetectorError(f"the function gave {given.dtype} {list(given.shape)}; allowed: float [h, w]")
        for cells, pixels, axis in zip(given.shape, image.shape[:2], ("rows", "columns"), strict=True):
            if not pixels // self._stride <= cells <= -(-pixels // self._stride):
                raise DetectorError(
                    f"the function gave {cells} {axis} for {pixels} pixels; stride {self._stride} gives "
                    f"{-(-pixels // self._stride)}"
                )
        # A copy: functions that write every answer into one buffer would change this one with the next.
        return np.array(in_unit_range(given, "the function's heatmap"), np.float32)

    def heatmaps(
        self, images: Sequence[Image], gsd_m: Sequence[Gsd | None], *, as_it_is: bool = False
    ) -> list[Map]:
        return [self.heatmap(image, gsd) for image, gsd in zip(images, gsd_m, strict=True)]


class BoxesFunction:
    """`function(image)` gives an object with xyxy [N, 4], confidence [N] or None, class_id [N] or None."""

    def __init__(self, function: Callable[[Image], Any], contract: Contract) -> None:
        self._function = function
        self._output = contract.output

    def heatmap(self, image: Image, gsd_m: Gsd | None, *, as_it_is: bool = False) -> Map:
        output = self._output
        cells = (-(-image.shape[0] // output.stride), -(-image.shape[1] // output.stride))
        scale = GroundScale.of(gsd_m, cells, "boxes")
        rule = output.rule
        assert isinstance(rule, PeopleRule)
        people = self._people(self._function(image), image.shape[:2])
        return crowd_from_people(people, scale, rule, output.stride)

    def heatmaps(
        self, images: Sequence[Image], gsd_m: Sequence[Gsd | None], *, as_it_is: bool = False
    ) -> list[Map]:
        return [self.heatmap(image, gsd) for image, gsd in zip(images, gsd_m, strict=True)]

    def _people(self, detections: Any, shape: tuple[int, int]) -> People:
        boxes = _boxes(detections)
        score = _column(detections, "confidence", len(boxes))
        if score is None:
            score = np.ones(len(boxes))
        if ((score < 0.0) | (score > 1.0)).any():
            raise DetectorError(
                f"the detections' confidence is {score.min():g} to {score.max():g}; allowed: 0 to 1"
            )
        kept = score >= (self._output.score_min or 0.0)
        if self._output.classes:
            class_id = _column(detections, "class_id", len(boxes))
            if class_id is None:
                raise DetectorError("the detections have no class_id; pass class_ids=None if all are people")
            kept &= np.isin(class_id, self._output.classes)
        _require_in_picture(boxes[kept], shape)
        return People.in_boxes(boxes[kept], score[kept])


def heatmap_contract(name: str, stride: int) -> Contract:
    if stride < 1:
        raise ValueError(f"stride is {stride}; allowed: 1 and more")
    return Contract(name, _PIXELS, ModelOutput("heatmap", "probability", "NHW", stride))


def boxes_contract(
    name: str, class_ids: Sequence[int] | None, stride: int, score_min: float | None, rule: PeopleRule | None
) -> Contract:
    if stride < 1:
        raise ValueError(f"stride is {stride}; allowed: 1 and more")
    output = ModelOutput(
        "detections",
        "boxes",
        "NDC",
        stride,
        class_index=None if class_ids is None else tuple(int(one) for one in class_ids),
        box_format="xyxy",
        row="score" if class_ids is None else "score_class",
        coordinates="pixels",
        score_min=score_min,
        rule=rule or PeopleRule(),
    )
    return contract_of(Contract(name, _PIXELS, output).to_json(), name)


def _boxes(detections: Any) -> NDArray[np.float64]:
    value = getattr(detections, "xyxy", None)
    if value is None:
        raise DetectorError(f"the detections have no xyxy: {quoted(detections)}")
    boxes = _finite(value, "xyxy")
    if boxes.size == 0:
        return np.empty((0, 4))
    if boxes.ndim != 2 or boxes.shape[1] != 4:
        raise DetectorError(f"the detections' xyxy has shape {list(boxes.shape)}; allowed: [N, 4]")
    return boxes


def _require_in_picture(boxes: NDArray[np.float64], shape: tuple[int, int]) -> None:
    """Boxes [N, 4] that are no corners in pixels of the picture put everybody into one corner of it or beyond
    it, where no crowd is seen any more. A few beyond its edges are mistakes of a model."""
    (height, width), count = shape, len(boxes)
    if count == 0:
        return
    left, top, right, bottom = boxes.T
    outside = np.count_nonzero((left > width) | (top > height) | (right < 0.0) | (bottom < 0.0))
    turned = np.count_nonzero((right < left) | (bottom < top))
    if 2 * turned > count:
        raise DetectorError(
            f"{turned} of {count} boxes of the detections end before they begin; allowed: xyxy, two corners"
        )
    if 2 * outside > count:
        raise DetectorError(
            f"{outside} of {count} boxes of the detections lie outside the picture of {width} x {height} "
            "pixels: they are of another size of it"
        )
    if count > 1 and np.abs(boxes).max() <= 1.0:
        raise DetectorError(
            f"all {count} boxes of the detections lie within the first pixel: they are fractions of the "
            "picture's sides; allowed: pixels"
        )


def _column(detections: Any, name: str, rows: int) -> NDArray[np.float64] | None:
    value = getattr(detections, name, None)
    if value is None:
        return None
    column = _finite(value, name)
    if column.shape != (rows,):
        raise DetectorError(f"the detections' {name} has shape {list(column.shape)}; allowed: [{rows}]")
    return column


def _finite(value: Any, name: str) -> NDArray[np.float64]:
    try:
        numbers = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise DetectorError(
            f"the detections' {name} is {quoted(value)}; allowed: an array of numbers"
        ) from None
    if not np.isfinite(numbers).all():
        wrong = numbers[~np.isfinite(numbers)][0]
        raise DetectorError(f"the detections' {name} holds {wrong}; allowed: finite numbers")
    return numbers
