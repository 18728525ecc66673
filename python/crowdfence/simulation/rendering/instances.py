"""Instances of meshes as the vertex shader reads them: one row of 20 floats each (shaders/thing.glsl)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

COLUMNS = 20
PLACE, TURN, POSE, COLOURS, LABEL = slice(0, 4), slice(4, 8), slice(8, 12), slice(12, 18), slice(18, 20)
LAYOUT = "4f 4f 4f 4f 2f 2f/i"
NAMES = ("in_place", "in_turn", "in_pose", "in_colours_a", "in_colours_b", "in_label")

Rows = NDArray[np.float32]


def instance_rows(count: int) -> Rows:
    """Rows [count, 20] with scale 1 and everything else 0."""
    rows = np.zeros((count, COLUMNS), np.float32)
    rows[:, 3] = 1.0
    return rows


def packed_colours(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """sRGB triples [..., 3] as one float each; exact, because 24 bits fit a float's mantissa."""
    parts = rgb.astype(np.int64)
    return np.asarray(parts[..., 0] + 256 * parts[..., 1] + 65536 * parts[..., 2], dtype=np.float32)


def seeds(count: int) -> NDArray[np.float32]:
    """A number in [0, 1) per instance, spread evenly (golden ratio), for stripes and the like."""
    return np.asarray((np.arange(count) * 0.6180339887498949) % 1.0, dtype=np.float32)
