"""Colours that no world has: what a detector learns from them is shape, not which colours a renderer uses.

Domain randomisation (Tobin et al., 2017). Of all that differs between renderers, and between them and the
world, the colours of plants, ground and clothes differ most.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.props import PropKind
from crowdfence.simulation.random_colours import rgb_of_hsv
from crowdfence.simulation.random_streams import Stream, stream
from crowdfence.simulation.rendering.season_palette import SeasonPalette

_TINT = 0.22
_CONTRAST = 0.25
_DARKEST, _LIGHTEST = 0.005, 0.95


class RandomPalette(SeasonPalette):
    """Those of a season, the ground tinted and many things in colours of their own; from the seed alone."""

    def __init__(self, season: str, seed: int) -> None:
        super().__init__(season)
        self._seed = seed

    def covers(self) -> NDArray[np.float32]:
        rng = stream(self._seed, Stream.COLOURS, 0)
        tones = super().covers().reshape(-1, 2, 3)  # dark and light
        tint = np.exp(rng.normal(0.0, _TINT, (len(tones), 1, 3)))
        apart = np.exp(rng.normal(0.0, _CONTRAST, (len(tones), 1, 1)) * np.array([[[-1.0], [1.0]]]))
        return np.clip(tones * tint * apart, _DARKEST, _LIGHTEST).reshape(-1, 3).astype(np.float32)

    def things(self, kind: PropKind, summer: NDArray[np.uint8]) -> NDArray[np.uint8]:
        count = len(summer)
        rng = stream(self._seed, Stream.COLOURS, 1, *kind.encode(), count)
        bold = rng.random(count) < rng.uniform(0.2, 0.9)
        hue = rng.choice(rng.random(4), count) + rng.normal(0.0, 0.03, count)
        own = rgb_of_hsv(hue, rng.uniform(0.4, 0.95, count), rng.uniform(0.3, 0.95, count))
        usual = super().things(kind, summer) * np.exp(rng.normal(0.0, 0.15, 3))
        return np.where(bold[:, None], own, usual).clip(0, 255).astype(np.uint8)
