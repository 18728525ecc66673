"""A stand-in for a crowd detector: the true crowd regions, seen through typical mistakes.

It makes the heatmaps of missions without pictures, with known rates; `picture_detector` makes the others.
It says nothing about how well a real detector does. The mistakes follow what was measured on a small one:
wrong cells lie mostly at the edges of regions, the rest at single people and at things that look alike.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from crowdfence.block_means import block_means
from crowdfence.simulation.random_streams import Stream, stream

STRIDE = 4
"""Image pixels per heatmap cell along each axis."""


@dataclass(frozen=True, slots=True)
class SimulatedDetector:
    """Logit of a cell = `gain` * (blurred share of crowd - 0.5) + `noise` * smooth noise, and `person_bias`
    where a person outside any crowd shows."""

    gain: float = 9.0
    blur_cells: float = 0.7
    noise: float = 1.6
    noise_cells: float = 2.0
    person_bias: float = 2.5

    def heatmap(
        self, regions: NDArray[np.integer], instances: NDArray[np.integer], seed: int, drone: int, frame: int
    ) -> NDArray[np.uint8]:
        """Heatmap [H / 4, W / 4] (value / 255) of one image from its crowd regions and person numbers [H, W].

        Equal for equal arguments. H and W must be multiples of 4.
        """
        crowd = _shares(regions > 0)
        alone = _shares((instances > 0) & (regions == 0))
        rng = stream(seed, Stream.DETECTOR, drone, frame)
        smooth = gaussian_filter(rng.normal(size=crowd.shape), self.noise_cells)
        smooth *= 2.0 * np.sqrt(np.pi) * self.noise_cells  # back to a standard deviation of 1
        logit = self.gain * (gaussian_filter(crowd, self.blur_cells) - 0.5) + self.noise * smooth
        logit += self.person_bias * np.sqrt(alone)
        return np.rint(255.0 / (1.0 + np.exp(-logit))).astype(np.uint8)

    def manifest(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {"made_by": "simulated detector: true regions with mistakes", "stride": STRIDE, **asdict(self)}


def _shares(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """[h, w] share of the pixels of every cell."""
    return block_means(mask, STRIDE).astype(np.float64)
