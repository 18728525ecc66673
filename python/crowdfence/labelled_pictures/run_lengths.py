"""Masks that COCO gives run by run (RLE) -> outlines.

    {"size": [height, width], "counts": [pixels outside, pixels inside, pixels outside, ...]}

Pixels are counted down the first column, then down the next. `counts` may be text: numbers in base 32, the
lowest digits first, each of which but the first three is the difference from the one two before it.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdfence.errors import quoted
from crowdfence.labelled_pictures.annotated_picture import AnnotationError, Polygon

if TYPE_CHECKING:
    from shapely import Polygon as Part

_DIGIT, _SIGN, _MORE = 0x1F, 0x10, 0x20
_LONGEST = 8
"""Digits of a number; one of more is damage."""


def mask_outlines(
    mask: Mapping[str, Any], width: int, height: int, where: str, *, filled: bool = True
) -> list[Polygon]:
    """The outlines of a mask of a picture. Its holes count as inside, which errs towards crowd, or where not
    `filled` lie in none of the outlines. AnnotationError for one of another size, or damaged."""
    import shapely

    size, counts = mask.get("size"), mask.get("counts")
    if size != [height, width]:
        raise AnnotationError(
            f"{where}.segmentation.size is {quoted(size)}; allowed: [{height}, {width}], height and width of "
            "its picture"
        )
    runs = _from_text(counts) if isinstance(counts, str) else _listed(counts)
    if runs is None or sum(runs) != width * height:
        raise AnnotationError(
            f"{where}.segmentation.counts is no sequence of runs of {width * height} pixels: {quoted(counts)}"
        )
    ends = np.cumsum(runs, dtype=np.int64)
    inside = [(int(begin), int(end)) for begin, end in list(pairwise(ends.tolist()))[::2] if end > begin]
    boxes = [box for begin, end in inside for box in _boxes(begin, end, height)]
    joined = shapely.union_all([shapely.box(*box) for box in boxes])
    parts = shapely.get_parts(joined).tolist()
    parts = parts if filled else [piece for part in parts for piece in _without_holes(part)]
    return [np.array(part.exterior.coords, np.float64)[:-1] for part in parts]


def _without_holes(part: Part) -> list[Part]:
    """The part, cut from top to bottom through its holes."""
    import shapely

    if not part.interiors:
        return [part]
    left, top, right, bottom = part.bounds
    across = float(np.median([hole.centroid.x for hole in part.interiors]))
    halves = shapely.box([left, across], top, [across, right], bottom)
    pieces = shapely.get_parts(shapely.intersection(part, halves)).tolist()
    return [whole for piece in pieces if piece.area for whole in _without_holes(piece)]


def _boxes(begin: int, end: int, height: int) -> list[tuple[int, int, int, int]]:
    """Left, top, right, bottom of the pixels from `begin` to before `end`: in one column, or its rest, whole
    columns, and the beginning of the last."""
    (first, top), (last, bottom) = divmod(begin, height), divmod(end, height)
    if first == last:
        return [(first, top, first + 1, bottom)]
    boxes = [(first, top, first + 1, height)]
    if last > first + 1:
        boxes.append((first + 1, 0, last, height))
    if bottom:
        boxes.append((last, 0, last + 1, bottom))
    return boxes


def _listed(counts: object) -> list[int] | None:
    """None for what is no list of numbers of pixels."""
    if not isinstance(counts, list) or not all(type(run) is int and run >= 0 for run in counts):
        return None
    return counts


def _from_text(text: str) -> list[int] | None:
    """None where it is damaged."""
    runs: list[int] = []
    value = digits = 0
    for character in text:
        code = ord(character) - 48
        if not 0 <= code < 64 or digits == _LONGEST:
            return None
        value |= (code & _DIGIT) << 5 * digits
        digits += 1
        if code & _MORE:
            continue
        if code & _SIGN:
            value -= 1 << 5 * digits
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
        value = digits = 0
    return None if digits or min(runs, default=0) < 0 else runs
