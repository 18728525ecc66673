"""Colours drawn at random, for worlds that should differ in colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.random_streams import Stream, stream


def random_clothes(seed: int) -> NDArray[np.float64]:
    """The few colours [K, 3] that a mission's people wear: fans of one team, or everybody else."""
    rng = stream(seed, Stream.COLOURS, 2)
    count = int(rng.integers(3, 14))
    return rgb_of_hsv(rng.random(count), rng.random(count), rng.uniform(0.1, 1.0, count))


def rgb_of_hsv(
    hue: NDArray[np.float64], saturation: NDArray[np.float64], value: NDArray[np.float64]
) -> NDArray[np.float64]:
    """sRGB [N, 3] in 0 to 255 of hues [N] in turns, saturations and values [N] in [0, 1]."""
    sector = (np.array([5.0, 3.0, 1.0]) + 6.0 * hue[:, None]) % 6.0
    ramp = np.clip(np.minimum(sector, 4.0 - sector), 0.0, 1.0)
    return np.asarray(255.0 * value[:, None] * (1.0 - saturation[:, None] * ramp))
