"""Where the pixels of an image go in a model's input, and which part of the answer counts.

Large images are cut into overlapping tiles. Each tile answers for its own part, up to the middle of every
overlap. Cropping there and not blending keeps two things: a model that looks no further than half an overlap
gives exactly what it would have given on the whole image, and no cell is a mean of two answers, which would
undo the calibration of both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise, product
from math import lcm

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.contract.model_input import ModelInput
from crowdfence.errors import DetectorError

TILE_PX = 1024
"""Side of the tiles of a model that takes any size."""
OVERLAP_PX = 128
"""Overlap of two tiles, at most a quarter of a tile."""
MAX_UNTILED_PIXELS = 4_000_000
"""Larger images are tiled: crowdnet-s holds some 30 bytes a pixel while it runs."""


@dataclass(frozen=True, slots=True)
class Span:
    """One axis of a patch, in pixels."""

    start: int
    """First image pixel that is cut out."""
    stop: int
    model: int
    """Side of the model's input."""
    low: float
    """Where the cut-out lies in the model's input: [low, low + (stop - start) * scale)."""
    scale: float
    own_start: int
    """Image pixels that this patch answers for."""
    own_stop: int

    def to_image(self, model_px: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.start + (model_px - self.low) / self.scale


@dataclass(frozen=True, slots=True)
class Patch:
    rows: Span
    columns: Span

    @property
    def is_native(self) -> bool:
        """Pixels as they are, from the corner of the model's input."""
        return self.rows.scale == self.columns.scale == 1.0 and self.rows.low == self.columns.low == 0.0


def patches(height: int, width: int, model: ModelInput, stride: int) -> Iterator[Patch]:
    """Patches that answer for every pixel of an image once.

    Raises DetectorError when the model takes another size and the contract says not to resize.
    """
    if model.resize == "stretch":
        assert model.size is not None
        yield Patch(_stretched(height, model.size[1]), _stretched(width, model.size[0]))
    elif model.resize == "letterbox":
        assert model.size is not None
        yield _letterboxed(height, width, *model.size)
    else:
        unit = lcm(model.multiple_of, stride)
        tile_width, tile_height = _tile_size(height, width, model, unit)
        for rows, columns in product(
            _cuts(height, tile_height, unit, stride), _cuts(width, tile_width, unit, stride)
        ):
            yield Patch(rows, columns)


def _tile_size(height: int, width: int, model: ModelInput, unit: int) -> tuple[int, int]:
    """Width and height of the tiles; those of the padded image where it need not be cut."""
    if model.size is not None:
        if model.resize == "none" and (width, height) != model.size:
            raise DetectorError(
                f"the image is {width} x {height} and the model takes {model.size[0]} x {model.size[1]}; "
                "input.resize 'tile', 'letterbox' or 'stretch' would adapt it"
            )
        return model.size
    whole = _rounded_up(width, unit), _rounded_up(height, unit)
    if model.resize == "none" and height * width <= MAX_UNTILED_PIXELS:
        return whole
    side = _rounded_up(TILE_PX, unit)
    return min(side, whole[0]), min(side, whole[1])


def _rounded_up(pixels: int, unit: int) -> int:
    return -(-pixels // unit) * unit


def _stretched(pixels: int, model: int) -> Span:
    return Span(0, pixels, model, 0.0, model / pixels, 0, pixels)


def _letterboxed(height: int, width: int, model_width: int, model_height: int) -> Patch:
    """The whole image at one scale in the middle of the input, grey around it, as YOLO models expect."""
    scale = min(model_width / width, model_height / height)
    spans = []
    for pixels, model in ((height, model_height), (width, model_width)):
        inside = min(model, max(1, round(pixels * scale)))
        spans.append(Span(0, pixels, model, float((model - inside) // 2), inside / pixels, 0, pixels))
    return Patch(*spans)


def _cuts(pixels: int, tile: int, unit: int, stride: int) -> list[Span]:
    """Tiles along one axis; every start is a multiple of `unit`, every seam a whole number of cells."""
    step = max(unit, (tile - min(OVERLAP_PX, tile // 4)) // unit * unit)
    last = _rounded_up(max(0, pixels - tile), unit)
    starts = [*range(0, last, step), last]
    seams = [(before + tile + after) // 2 // stride * stride for before, after in pairwise(starts)]
    owns = pairwise([0, *seams, pixels])
    return [
        Span(start, min(start + tile, pixels), tile, 0.0, 1.0, *own)
        for start, own in zip(starts, owns, strict=True)
    ]
