"""The output tensor of a model: of which kind it is, and how it becomes a heatmap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from crowdfence.detector.contract.crowd_rules import DensityRule, PeopleRule
from crowdfence.detector.contract.json_section import JsonSection
from crowdfence.errors import DetectorError

MAP_KINDS = ("probability", "logits", "class_logits", "density")
PEOPLE_KINDS = ("points", "boxes")

Kind = Literal["probability", "logits", "class_logits", "density", "points", "boxes"]
Row = Literal["none", "score", "score_class", "class_scores", "objectness_class_scores"]
_ROWS = ("none", "score", "score_class", "class_scores", "objectness_class_scores")
_MOST_CLASSES = 100_000


@dataclass(frozen=True, slots=True)
class ModelOutput:
    """The output tensor and how it becomes a heatmap."""

    name: str
    kind: Kind
    layout: str
    """Maps: NCHW, NHWC or NHW. Points and boxes: NDC (one detection a row) or NCD (one a column)."""
    stride: int
    """Input pixels per heatmap cell. Points and boxes: the grid that they are drawn on."""
    class_index: int | tuple[int, ...] | None = None
    """The class that is people or crowd; several, [0, 1], for points and boxes only."""
    box_format: Literal["xyxy", "cxcywh"] | None = None
    row: Row | None = None
    """Points and boxes: what follows the coordinates of a detection."""
    coordinates: Literal["pixels", "fraction", "grid"] | None = None
    """Points and boxes: pixels of the model's input, or fractions of its width and height. Boxes also: cells
    of grids, as YOLOX leaves them."""
    grid_strides: tuple[int, ...] = ()
    """Coordinates "grid": input pixels per cell of each grid, in the order of the output."""
    score_min: float | None = None
    """Points and boxes: weaker detections are left out."""
    iou_max: float | None = None
    """Boxes: of two that overlap more, the weaker is left out; None: the model has done that."""
    count_scale: float | None = None
    """Density: sum(output) * count_scale = people."""
    rule: PeopleRule | DensityRule | None = None
    """When people are a crowd; None for kinds that say so themselves."""

    @property
    def classes(self) -> tuple[int, ...]:
        if self.class_index is None:
            return ()
        return (self.class_index,) if isinstance(self.class_index, int) else self.class_index


def output_from_json(section: JsonSection) -> ModelOutput:
    kind: Kind = section.choice("kind", MAP_KINDS + PEOPLE_KINDS)
    people, boxes, density = kind in PEOPLE_KINDS, kind == "boxes", kind == "density"
    value = ModelOutput(
        name=section.text("name"),
        kind=kind,
        layout=section.choice("layout", ("NDC", "NCD") if people else ("NCHW", "NHWC", "NHW")),
        stride=section.integer("stride", 1, 1024, *((4,) if people else ())),
        class_index=_class_index(section, several=people),
        box_format=section.choice("box_format", ("xyxy", "cxcywh"), *(() if boxes else (None,))),
        row=section.choice("row", _ROWS, *(() if people else (None,))),
        coordinates=section.choice(
            "coordinates", ("pixels", "fraction", "grid"), "pixels" if people else None
        ),
        grid_strides=_grid_strides(section),
        score_min=section.number("score_min", 0.0, None),
        iou_max=section.number("iou_max", 0.0, None, above=True),
        count_scale=section.number("count_scale", 0.0, *(() if density else (None,)), above=True),
        rule=_rule(section, kind),
    )
    section.done()
    _refuse_misplaced(section, value)
    return value


def _class_index(section: JsonSection, *, several: bool) -> int | tuple[int, ...] | None:
    value = section.raw("class_index")
    if several and isinstance(value, (list, tuple)) and value:
        if all(type(item) is int and 0 <= item <= _MOST_CLASSES for item in value):
            return tuple(value)
        raise section.refuse("class_index", f"whole numbers from 0 to {_MOST_CLASSES}")
    index: int | None = section.integer("class_index", 0, _MOST_CLASSES, None)
    return index


def _grid_strides(section: JsonSection) -> tuple[int, ...]:
    value = section.raw("grid_strides")
    if value is None or (isinstance(value, (list, tuple)) and not value):
        return ()
    whole = isinstance(value, (list, tuple)) and all(
        type(stride) is int and 1 <= stride <= 1024 for stride in value
    )
    if not whole:
        raise section.refuse("grid_strides", "a list of whole numbers from 1 to 1024")
    return tuple(value)


def _rule(section: JsonSection, kind: Kind) -> PeopleRule | DensityRule | None:
    rule = section.section("rule")
    if kind in PEOPLE_KINDS:
        return PeopleRule.from_json(rule)
    if kind == "density":
        return DensityRule.from_json(rule)
    if rule is not None:
        raise DetectorError(f"{section.key('rule')} goes with density, points and boxes, not with {kind}")
    return None


def _refuse_misplaced(section: JsonSection, output: ModelOutput) -> None:
    """Keys of another kind, and keys that this one cannot do without."""
    homes: dict[str, tuple[str, ...]] = {
        "box_format": ("boxes",),
        "iou_max": ("boxes",),
        "row": PEOPLE_KINDS,
        "coordinates": PEOPLE_KINDS,
        "score_min": PEOPLE_KINDS,
        "count_scale": ("density",),
    }
    for name, kinds in homes.items():
        if getattr(output, name) is not None and output.kind not in kinds:
            raise DetectorError(
                f"{section.key(name)} goes with {' and '.join(kinds)}, not with {output.kind}; leave it out"
            )
    if (output.coordinates == "grid") != bool(output.grid_strides):
        raise DetectorError(f"{section.key('grid_strides')} go with coordinates 'grid', and that with them")
    if output.coordinates == "grid" and (output.kind, output.box_format) != ("boxes", "cxcywh"):
        raise DetectorError(f"{section.key('coordinates')} 'grid' go with boxes of format 'cxcywh'")
    if output.iou_max is not None and output.iou_max > 1.0:
        raise section.refuse("iou_max", "null or a number above 0 and at most 1")
    if output.score_min is not None and output.score_min > 1.0:
        raise section.refuse("score_min", "null or a number from 0 to 1")
    if (
        output.row in ("score_class", "class_scores", "objectness_class_scores")
        and output.class_index is None
    ):
        raise DetectorError(
            f"{section.key('class_index')} is missing: rows of {output.row} tell people by their class"
        )
