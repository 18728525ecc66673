"""Light on bare ground that does not change during a mission: shadows of ridges, and how open the sky is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_PENUMBRA = 0.05  # of the distance: softer than the sun's disc, as haze makes it


def sun_reaches(
    height_m: NDArray[np.floating], step_m: float, sun_direction: tuple[float, float, float]
) -> NDArray[np.float32]:
    """Share of the sun [rows, columns] that each lattice point sees over the ground around it."""
    height = np.asarray(height_m, np.float32)
    east, north, up = sun_direction
    flat = max(float(np.hypot(east, north)), 1e-6)
    light = np.ones(height.shape, np.float32)
    relief = float(height.max() - height.min())
    reach = min(relief * flat / max(up, 0.05), 900.0) / step_m
    cells = np.unique(
        np.concatenate([np.arange(2, 24, 3), np.geomspace(24, max(reach, 25.0), 16)]).astype(int)
    )
    for distance in cells[cells <= max(reach, 2)]:
        d_row, d_column = round(north / flat * distance), round(east / flat * distance)
        towards = _shifted(height, d_row, d_column)
        clear = height + np.float32(up / flat * distance * step_m) - towards
        light = np.minimum(light, np.clip(clear / np.float32(_PENUMBRA * distance * step_m) + 1, 0, 1))
    return light


def openness(height_m: NDArray[np.floating], step_m: float) -> NDArray[np.float32]:
    """0.45 in hollows to 1 on tops [rows, columns], from the height over the mean within about 18 m."""
    from scipy.ndimage import uniform_filter

    height = np.asarray(height_m, np.float32)
    mean = uniform_filter(height, size=max(3, int(36 / step_m) | 1), mode="nearest")
    return np.asarray(np.clip(0.86 + 0.04 * (height - mean), 0.45, 1.0), dtype=np.float32)


def _shifted(values: NDArray[np.float32], d_row: int, d_column: int) -> NDArray[np.float32]:
    """values[row + d_row, column + d_column], the edge's value outside."""
    rows = np.clip(np.arange(values.shape[0]) + d_row, 0, values.shape[0] - 1)
    columns = np.clip(np.arange(values.shape[1]) + d_column, 0, values.shape[1] - 1)
    return values[np.ix_(rows, columns)]
