"""The metadata that the QGIS plugin Deepness reads -> a contract.

Values are JSON: model_type, class_names, resolution (centimetres per pixel), tiles_size, seg_thresh,
det_type, det_conf, det_iou_thresh, standardization_mean and _std. The graph wants float32 RGB [N, 3, H, W]:
pixel / 255, then standardised. A Segmentor answers with probabilities; what the numbers of a Regressor mean
is stated nowhere, so it is refused.
"""

from __future__ import annotations

from typing import Any

from crowdfence.detector.contract.json_section import is_number
from crowdfence.detector.contract.metadata_values import (
    CROWD_NAMES,
    PEOPLE_NAMES,
    class_names,
    classes_named,
    fixed,
    literal,
    only_image_input,
)
from crowdfence.detector.contract.model_face import ModelFace
from crowdfence.errors import DetectorError, quoted

NAME = "Deepness"

_DETECTORS: dict[str, dict[str, str]] = {
    "YOLO_v5_or_v7_default": {"layout": "NDC", "row": "objectness_class_scores"},
    "YOLO_v9": {"layout": "NCD", "row": "class_scores"},
    "YOLO_Ultralytics": {"layout": "NCD", "row": "class_scores"},
    "YOLO_Ultralytics_segmentation": {"layout": "NCD", "row": "class_scores"},
}


def applies(face: ModelFace) -> bool:
    return "model_type" in face.metadata


def document(face: ModelFace) -> dict[str, Any]:
    """The contract as JSON. DetectorError when the metadata are incomplete or ambiguous."""
    outputs = {"segmentor": _segmentor, "detector": _detector}
    kind = literal(face.metadata, "model_type")
    if not isinstance(kind, str) or kind.lower() not in outputs:
        raise DetectorError(f"model_type is {quoted(kind)}; allowed: Segmentor, Detector")
    image = only_image_input(face)
    width, height = _tile_size(face)
    return {
        "schema": 1,
        "name": face.path.stem,
        "input": {
            "name": image.name,
            "layout": "NCHW",
            "dtype": "float32",
            "color": "RGB",
            "scale": 1.0 / 255.0,
            "mean": _value(face, "standardization_mean"),
            "std": _value(face, "standardization_std"),
            "size": [width, height],
            "resize": "tile",
        },
        "output": {"name": face.outputs[0].name, **outputs[kind.lower()](face, (width, height))},
        "validity": _validity(face),
        "about": {"seg_thresh": _value(face, "seg_thresh")} if "seg_thresh" in face.metadata else None,
    }


def _segmentor(face: ModelFace, size: tuple[int, int]) -> dict[str, Any]:
    shape = face.outputs[0].shape
    channels, height, width = (fixed(side) for side in shape[1:]) if len(shape) == 4 else (None, None, None)
    if not channels or not height or not width or size[0] / width != size[1] / height or size[0] % width:
        raise DetectorError(
            f"the output is {face.outputs[0]} for tiles of {size[0]} x {size[1]} pixels; allowed: "
            "[N, classes, rows, columns] with all but N fixed and one whole stride"
        )
    # Of one channel too: that of roads would be taken for crowd, and people be nowhere.
    several = classes_named(_class_names(face), PEOPLE_NAMES | CROWD_NAMES, "class_names")
    if len(several) > 1:
        raise DetectorError(f"class_names has several classes of people: {several}; allowed: 1")
    found = several[0] if channels > 1 else None
    return {"kind": "probability", "layout": "NCHW", "stride": size[0] // width, "class_index": found}


def _detector(face: ModelFace, _size: tuple[int, int]) -> dict[str, Any]:
    kind = _value(face, "det_type")
    if kind not in _DETECTORS:
        raise DetectorError(f"det_type is {quoted(kind)}; allowed: {', '.join(_DETECTORS)}")
    names = _class_names(face)
    return {
        "kind": "boxes",
        "box_format": "cxcywh",
        "class_index": classes_named(names, PEOPLE_NAMES, "class_names"),
        "coordinates": "pixels",
        "score_min": _value(face, "det_conf"),
        "iou_max": _value(face, "det_iou_thresh"),
        **_DETECTORS[kind],
    }


def _class_names(face: ModelFace) -> dict[int, str]:
    if "class_names" not in face.metadata:
        raise DetectorError("class_names are missing: which class is people or crowd?")
    return class_names(face.metadata, "class_names")


def _tile_size(face: ModelFace) -> tuple[int, int]:
    height, width = (fixed(side) for side in face.inputs[0].shape[2:])
    if height is not None and width is not None:
        return width, height
    side = _value(face, "tiles_size")
    if type(side) is not int:
        raise DetectorError(f"tiles_size is {quoted(side)}; allowed: a whole number of pixels")
    return side, side


def _validity(face: ModelFace) -> dict[str, Any] | None:
    resolution_cm = _value(face, "resolution")
    if resolution_cm is None:
        return None
    if not is_number(resolution_cm) or resolution_cm <= 0:
        raise DetectorError(f"resolution is {quoted(resolution_cm)}; allowed: centimetres per pixel above 0")
    return {"gsd_m": [resolution_cm / 100.0, resolution_cm / 100.0]}


def _value(face: ModelFace, key: str) -> Any:
    return literal(face.metadata, key) if key in face.metadata else None
