"""The metadata that Ultralytics writes into exported detectors -> a contract of kind "boxes".

task, stride, imgsz [height, width] and names {0: 'person', ...} are text. The graph wants float32 RGB / 255,
letterboxed, and answers in pixels of its input with either

    [N, 4 + classes (+ mask coefficients), anchors]   cx, cy, w, h, class scores; overlaps still to be removed
    [N, detections, 6 (+ mask coefficients)]          x1, y1, x2, y2, score, class; overlaps removed

Of instance segmentation only the boxes are used: people are drawn on the ground, not by their silhouette.
"""

from __future__ import annotations

from typing import Any

from crowdfence.detector.contract.metadata_values import (
    PEOPLE_NAMES,
    class_names,
    classes_named,
    fixed,
    literal,
    only_image_input,
)
from crowdfence.detector.contract.model_face import ModelFace
from crowdfence.errors import DetectorError, quoted

NAME = "Ultralytics"
SCORE_MIN, IOU_MAX = 0.25, 0.7
"""What Ultralytics itself predicts with by default."""

_TASKS = ("detect", "segment")
_MASK_COEFFICIENTS = 32


def applies(face: ModelFace) -> bool:
    return {"task", "stride", "names"} <= face.metadata.keys()


def document(face: ModelFace) -> dict[str, Any]:
    """The contract as JSON. DetectorError when the metadata are incomplete or ambiguous."""
    task = face.metadata["task"]
    if task not in _TASKS:
        raise DetectorError(f"task is {quoted(task)}; allowed: {', '.join(_TASKS)}")
    names = class_names(face.metadata, "names")
    image = only_image_input(face)
    width, height = _size(face)
    return {
        "schema": 1,
        "name": face.path.stem,
        "version": face.metadata.get("version"),
        "licence": face.metadata.get("license"),
        "input": {
            "name": image.name,
            "layout": "NCHW",
            "dtype": "float32",
            "color": "RGB",
            "scale": 1.0 / 255.0,
            "size": [width, height],
            "resize": "letterbox",
        },
        "output": {
            "name": face.outputs[0].name,
            "kind": "boxes",
            "class_index": classes_named(names, PEOPLE_NAMES, "names"),
            "coordinates": "pixels",
            "score_min": SCORE_MIN,
            **_boxes(face, len(names), task),
        },
    }


def _size(face: ModelFace) -> tuple[int, int]:
    height, width = (fixed(side) for side in face.inputs[0].shape[2:])
    if height is not None and width is not None:
        return width, height
    value = literal(face.metadata, "imgsz") if "imgsz" in face.metadata else None
    if not isinstance(value, list) or len(value) != 2 or not all(type(side) is int for side in value):
        raise DetectorError(f"imgsz is {quoted(value)}; allowed: [height, width]")
    return value[1], value[0]


def _boxes(face: ModelFace, classes: int, task: str) -> dict[str, Any]:
    shape = face.outputs[0].shape
    masks = _MASK_COEFFICIENTS if task == "segment" else 0
    raw = len(shape) == 3 and shape[1] == 4 + classes + masks
    final = len(shape) == 3 and shape[2] == 6 + masks
    if raw and not final:
        return {"layout": "NCD", "box_format": "cxcywh", "row": "class_scores", "iou_max": IOU_MAX}
    if final and not raw:
        return {"layout": "NDC", "box_format": "xyxy", "row": "score_class"}
    raise DetectorError(
        f"the output is {face.outputs[0]}; allowed: either [N, {4 + classes + masks}, anchors] "
        f"or [N, detections, {6 + masks}]"
    )
