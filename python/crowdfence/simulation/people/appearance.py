"""What people look like: build, clothes and colours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

KINDS = 6
"""Shirt, cap, skirt, coat, backpack, long sleeves."""

_SKIN = np.array(
    [[244, 208, 177], [231, 180, 143], [208, 150, 108], [165, 109, 72], [115, 73, 49], [72, 47, 36]],
    np.float64,
)
_HAIR = np.array(
    [[30, 24, 20], [62, 42, 28], [106, 76, 45], [168, 132, 82], [150, 150, 148], [120, 52, 30]], np.float64
)
_CLOTHES = np.array(
    [
        [232, 232, 228], [40, 42, 46], [98, 101, 104], [44, 62, 110], [88, 128, 176], [168, 38, 40],
        [214, 96, 40], [222, 186, 62], [54, 98, 62], [118, 140, 92], [128, 88, 58], [198, 180, 148],
        [110, 64, 116], [206, 128, 148], [56, 130, 138], [70, 60, 54],
    ],
    np.float64,
)  # fmt: skip
_TROUSERS = np.array(
    [[38, 44, 62], [62, 78, 112], [34, 34, 36], [92, 84, 72], [140, 124, 98], [78, 86, 78], [170, 168, 162]],
    np.float64,
)
_SHOES = np.array([[36, 32, 30], [92, 66, 46], [200, 198, 194], [66, 70, 78]], np.float64)


@dataclass(frozen=True, slots=True)
class Appearance:
    """`kind` uint8 [P] below `KINDS`; `colours` uint8 [P, 6, 3]: skin, hair, top, bottom, shoes, extra;
    `height_m` [P]."""

    kind: NDArray[np.uint8]
    colours: NDArray[np.uint8]
    height_m: NDArray[np.float64]


def appearance(
    people: int, rng: np.random.Generator, clothes: NDArray[np.float64] | None = None
) -> Appearance:
    """Independent looks of `people` people, in usual colours or in those of `clothes` [K, 3]."""
    tops = _CLOTHES if clothes is None else clothes
    trousers = _TROUSERS if clothes is None else np.concatenate([_TROUSERS, clothes])
    palettes = (_SKIN, _HAIR, tops, trousers, _SHOES, tops)
    parts = [palette[rng.integers(len(palette), size=people)] for palette in palettes]
    shade = rng.normal(1.0, 0.08, (people, len(parts), 1)) * rng.normal(1.0, 0.03, (people, len(parts), 3))
    child = rng.random(people) < 0.08
    height = np.where(child, rng.normal(1.25, 0.12, people), rng.normal(1.72, 0.09, people))
    return Appearance(
        rng.integers(KINDS, size=people).astype(np.uint8),
        np.clip(np.stack(parts, axis=1) * shade, 0, 255).astype(np.uint8),
        np.clip(height, 0.95, 2.05),
    )
