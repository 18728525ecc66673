"""Output of a points or boxes model -> where people stand in the model's input, with scores."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.contract.two_corners import are_two_corners
from crowdfence.detector.inference.map_output import ROUNDING
from crowdfence.detector.inference.overlap_removal import strongest_boxes
from crowdfence.errors import DetectorError

MAX_DETECTIONS = 10_000
"""Of one run of the model, above `score_min`. More is a wrong contract, not a crowd."""
_CLASS_ROUNDING = 0.01
"""By which the number of a class may miss a whole one."""

Rows = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class People:
    """Foot points in pixels (x to the right, y down), scores in [0, 1], and sizes of the boxes, [N] each."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    score: NDArray[np.float64]
    width: NDArray[np.float64]
    """In pixels, as the height; 0 for people who are found as points."""
    height: NDArray[np.float64]

    @staticmethod
    def at(x: Rows, y: Rows, score: Rows) -> People:
        """People as points."""
        return People(x, y, score, np.zeros(len(x)), np.zeros(len(x)))

    @staticmethod
    def in_boxes(boxes: Rows, score: Rows) -> People:
        """Of boxes x1, y1, x2, y2 [N, 4]: people stand on the middle of the lower edge."""
        x, y = foot_points(boxes)
        return People(x, y, score, boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1])

    @staticmethod
    def joined(parts: list[People]) -> People:
        return People(*(np.concatenate([getattr(part, name) for part in parts]) for name in People.__slots__))

    @property
    def boxes(self) -> Rows:
        """x1, y1, x2, y2 [N, 4]."""
        left = self.x - self.width / 2.0
        return np.stack([left, self.y - self.height, left + self.width, self.y], axis=1)

    def chosen(self, which: NDArray[Any]) -> People:
        """Those of a mask, or of indices."""
        return People(*(getattr(self, name)[which] for name in People.__slots__))

    def moved(self, x: Rows, y: Rows, scale_x: float, scale_y: float) -> People:
        """The same people in another picture, where they stand at x, y and are that much larger."""
        return People(x, y, self.score, self.width * scale_x, self.height * scale_y)


def people_in(raw: NDArray[np.generic], contract: Contract, model_shape: tuple[int, int]) -> People:
    """Raw output of one image -> people in pixels of the model's input (height, width).

    DetectorError for another shape than the contract says, NaN, infinity, and scores outside [0, 1].
    """
    output = contract.output
    rows = _rows(raw, contract)
    if output.coordinates == "grid":
        rows = in_pixels(rows, output.grid_strides, model_shape)
    scores = _scores(rows, contract)
    score_min = output.score_min or 0.0
    chosen = (scores >= score_min) & (scores > 0.0)
    if chosen.sum() > MAX_DETECTIONS:
        raise DetectorError(
            f"output {output.name} holds {chosen.sum():,} people of score {score_min:g} and more; "
            f"allowed: {MAX_DETECTIONS:,}; is output.score_min right?"
        )
    rows, scores = rows[chosen], scores[chosen]
    if output.kind == "points":
        people = People.at(rows[:, 0], rows[:, 1], scores)
    else:
        boxes = _corners(rows[:, :4], contract, model_shape)
        if output.iou_max is not None:
            kept = strongest_boxes(boxes, scores, output.iou_max)
            boxes, scores = boxes[kept], scores[kept]
        people = People.in_boxes(boxes, scores)
    if output.coordinates == "fraction":
        height, width = model_shape
        people = people.moved(people.x * width, people.y * height, width, height)
    _require_in_place(people, contract, model_shape)
    return people


def _require_in_place(people: People, contract: Contract, model_shape: tuple[int, int]) -> None:
    """Coordinates in other units than the contract says put everybody into one corner or beyond the picture,
    where no crowd is seen any more."""
    output, count, (height, width) = contract.output, len(people.x), model_shape
    if count == 0:
        return
    left, top, right, bottom = people.boxes.T
    # Points may miss the input by more than a little, of a box some lies in it.
    over_x, over_y = (width, height) if output.kind == "points" else (0, 0)
    beyond = (left > width + over_x) | (top > height + over_y) | (right < -over_x) | (bottom < -over_y)
    if 2 * np.count_nonzero(beyond) > count:
        raise DetectorError(
            f"output {output.name}: {np.count_nonzero(beyond)} of {count} people lie beyond the input of "
            f"{width} x {height} pixels; is output.coordinates {output.coordinates!r} right?"
        )
    extent = max(float(np.abs(values).max()) for values in (people.x, people.y, people.width, people.height))
    if output.coordinates == "pixels" and count > 1 and extent <= 1.0:
        raise DetectorError(
            f"output {output.name}: all of {count} people lie within the first pixel; is output.coordinates "
            "'fraction'?"
        )


def foot_points(boxes: Rows) -> tuple[Rows, Rows]:
    """Middle of the lower edge of boxes x1, y1, x2, y2 [N, 4]: where the person stands."""
    return (boxes[:, 0] + boxes[:, 2]) / 2.0, boxes[:, 3]


def in_pixels(rows: Rows, strides: tuple[int, ...], model_shape: tuple[int, int]) -> Rows:
    """Raw rows of YOLOX -> cx, cy, width, height in pixels of the input, and what follows them.

    One row for each cell of the grids of these strides, grid after grid, row by row; cx and cy count cells
    from the corner of the row's own cell, width and height are logarithms of cells (Ge et al. 2021, arXiv
    2107.08430). DetectorError for another number of rows.
    """
    height, width = model_shape
    grids = [(stride, height // stride, width // stride) for stride in strides]
    cells = sum(down * across for _, down, across in grids)
    if len(rows) != cells:
        raise DetectorError(
            f"the output holds {len(rows)} detections; grids of strides {list(strides)} on {width} x "
            f"{height} pixels have {cells} cells"
        )
    corner = np.concatenate(
        [
            np.stack(np.meshgrid(np.arange(across), np.arange(down)), -1).reshape(-1, 2)
            for _, down, across in grids
        ]
    )
    stride = np.repeat([stride for stride, *_ in grids], [down * across for _, down, across in grids])[
        :, None
    ]
    largest = np.log(max(model_shape))
    placed = rows.copy()
    placed[:, :2] = (rows[:, :2] + corner) * stride
    placed[:, 2:4] = np.exp(np.minimum(rows[:, 2:4], largest)) * stride
    return placed


def _rows(raw: NDArray[np.generic], contract: Contract) -> Rows:
    """One detection a row [D, values]."""
    output = contract.output
    if raw.ndim != 3 or raw.shape[0] != 1:
        raise DetectorError(
            f"output {output.name} has shape {list(raw.shape)}; the contract says {output.layout}, N = 1"
        )
    rows = np.asarray(raw[0] if output.layout == "NDC" else raw[0].T, np.float64)
    needed = _values_needed(contract)
    if rows.shape[1] < needed:
        raise DetectorError(
            f"output {output.name} has {rows.shape[1]} values a detection; {output.kind} with row "
            f"{output.row!r} and class {list(output.classes)} need {needed} and more"
        )
    if not np.isfinite(rows).all():
        at = np.argwhere(~np.isfinite(rows))[0]
        raise DetectorError(
            f"output {output.name} holds {rows[tuple(at)]} in value {at[1]} of detection {at[0]}; "
            "allowed: finite numbers"
        )
    return rows


def _values_needed(contract: Contract) -> int:
    output = contract.output
    extra = {"none": 0, "score": 1, "score_class": 2}.get(output.row or "none")
    if extra is None:
        extra = (output.row == "objectness_class_scores") + max(output.classes) + 1
    return _coordinates(contract) + extra


def _coordinates(contract: Contract) -> int:
    return 2 if contract.output.kind == "points" else 4


def _scores(rows: Rows, contract: Contract) -> Rows:
    """One score a detection: that of the wanted class, 0 for other classes."""
    output, first = contract.output, _coordinates(contract)
    wanted = list(output.classes)
    if output.row == "none":
        return np.ones(len(rows))
    if output.row == "class_scores":
        return _in_unit_range(rows[:, [first + index for index in wanted]], output.name).max(axis=1)
    if output.row == "objectness_class_scores":
        # Each by itself: the product of two logits of nobody is above 0.
        columns = [first, *(first + 1 + index for index in wanted)]
        objectness, *of_class = _in_unit_range(rows[:, columns], output.name).T
        return np.asarray(objectness * np.max(of_class, axis=0))
    scores = rows[:, first]
    if output.row == "score_class":
        scores = np.where(np.isin(_whole_classes(rows[:, first + 1], output.name), wanted), scores, 0.0)
    return _in_unit_range(scores[:, None], output.name)[:, 0]


def _in_unit_range(scores: Rows, name: str) -> Rows:
    """Scores [N, K]; a negative one is a logit, and so are those beside it that lie in [0, 1]."""
    wrong = (scores < -ROUNDING) | (scores > 1.0 + ROUNDING)
    if wrong.any():
        at, of = np.argwhere(wrong)[0]
        raise DetectorError(
            f"output {name} gives detection {at} the score {scores[at, of]:g}; allowed: 0 to 1"
        )
    return scores.clip(0.0, 1.0)


def _whole_classes(classes: Rows, name: str) -> Rows:
    """Numbers of classes [N]. Of a score that stands in their place, people's class 0 would be the score, and
    nobody be found."""
    whole = np.rint(classes)
    wrong = np.abs(classes - whole) > _CLASS_ROUNDING
    if wrong.any():
        at = int(np.flatnonzero(wrong)[0])
        raise DetectorError(
            f"output {name} gives detection {at} the class {classes[at]:g}; allowed: whole numbers; does the "
            "class stand before the score?"
        )
    return whole


def _corners(boxes: Rows, contract: Contract, model_shape: tuple[int, int]) -> Rows:
    """x1, y1, x2, y2 [N, 4]."""
    if contract.output.box_format == "xyxy":
        turned = (boxes[:, 2:] < boxes[:, :2]).any(axis=1)
        if 2 * np.count_nonzero(turned) > len(boxes):
            raise DetectorError(
                f"output {contract.output.name}: {np.count_nonzero(turned)} of {len(boxes)} boxes end before "
                "they begin; is output.box_format 'cxcywh'?"
            )
        return boxes
    middle, size = boxes[:, :2], boxes[:, 2:]
    height, width = (1, 1) if contract.output.coordinates == "fraction" else model_shape
    if are_two_corners(middle, size, (width, height)):
        raise DetectorError(
            f"output {contract.output.name}: all of {len(boxes)} boxes are as wide and as high as they are "
            "away from the upper left corner; is output.box_format 'xyxy'?"
        )
    return np.concatenate([middle - size / 2.0, middle + size / 2.0], axis=1)
