"""People per image pixel and metres per pixel -> people per square metre -> P(crowd)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.contract.crowd_rules import DensityRule
from crowdfence.detector.ground_scale import GroundScale
from crowdfence.detector.inference.map_output import Map, sigmoid


def crowd_from_density(people_per_px: Map, scale: GroundScale, rule: DensityRule, stride: int) -> Map:
    """P [h, w] of cells of `stride` x `stride` pixels.

    Density is the number of people in the window divided by the ground in the window, both cut at the border
    of the image, so that a crowd at the border is as dense as one in the middle.
    """
    cell_px = float(stride * stride)
    people = people_per_px * cell_px
    ground_m2 = scale.right_m * scale.down_m * np.float32(cell_px)
    half_rows = _half_window(rule.window_m, scale.down_m, stride)
    half_columns = _half_window(rule.window_m, scale.right_m, stride)
    density = _window_sum(people, half_rows, half_columns) / _window_sum(ground_m2, half_rows, half_columns)
    return sigmoid((density - rule.people_per_m2) / rule.softness_per_m2).astype(np.float32)


def _half_window(window_m: float, metres_per_px: Map, stride: int) -> NDArray[np.intp]:
    """Whole cells on each side of the middle one, so that the window is `window_m` wide to within a cell."""
    cells = window_m / (metres_per_px * stride)
    return np.minimum(np.rint((cells - 1.0) / 2.0).clip(0.0), max(metres_per_px.shape)).astype(np.intp)


def _window_sum(
    values: Map, half_rows: NDArray[np.intp], half_columns: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Sum over each cell's own window, by a summed-area table: the cost does not grow with the window."""
    height, width = values.shape
    table = np.zeros((height + 1, width + 1))
    np.cumsum(np.cumsum(values, axis=0, dtype=np.float64), axis=1, out=table[1:, 1:])
    row, column = np.arange(height)[:, None], np.arange(width)
    top, bottom = np.maximum(row - half_rows, 0), np.minimum(row + half_rows + 1, height)
    left, right = np.maximum(column - half_columns, 0), np.minimum(column + half_columns + 1, width)
    total = table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]
    return np.asarray(np.maximum(total, 0.0))  # differences of large sums may miss zero by a rounding
