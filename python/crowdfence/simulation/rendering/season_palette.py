"""Colours of the ground and of leaves through the year."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.ground import Cover
from crowdfence.simulation.landscape.props import PropKind

_Tones = tuple[tuple[float, float, float], tuple[float, float, float]]

# Linear RGB albedo: dark and light tone of each cover.
_ALWAYS: dict[Cover, _Tones] = {
    Cover.GRASS: ((0.072, 0.116, 0.034), (0.168, 0.196, 0.068)),
    Cover.DIRT: ((0.150, 0.105, 0.062), (0.260, 0.190, 0.120)),
    Cover.ROCK: ((0.190, 0.180, 0.170), (0.330, 0.315, 0.300)),
    Cover.SNOW: ((0.720, 0.750, 0.800), (0.860, 0.880, 0.900)),
    Cover.SAND: ((0.330, 0.255, 0.155), (0.450, 0.360, 0.235)),
    Cover.PAVING: ((0.200, 0.193, 0.182), (0.285, 0.272, 0.252)),
    Cover.WATER: ((0.006, 0.050, 0.085), (0.060, 0.220, 0.230)),
    Cover.GRAVEL: ((0.240, 0.215, 0.180), (0.380, 0.350, 0.300)),
}
_SEASONS: dict[str, dict[Cover, _Tones]] = {
    "summer": {},
    "autumn": {
        Cover.GRASS: ((0.150, 0.120, 0.036), (0.270, 0.205, 0.065)),
        Cover.DIRT: ((0.135, 0.085, 0.048), (0.240, 0.150, 0.080)),
    },
    "winter": {
        Cover.GRASS: ((0.560, 0.590, 0.640), (0.830, 0.850, 0.880)),
        Cover.DIRT: ((0.290, 0.260, 0.230), (0.640, 0.640, 0.650)),
        Cover.GRAVEL: ((0.260, 0.250, 0.240), (0.560, 0.560, 0.570)),
        Cover.SAND: ((0.330, 0.280, 0.210), (0.560, 0.530, 0.470)),
    },
    "dry": {
        Cover.GRASS: ((0.260, 0.200, 0.082), (0.400, 0.320, 0.150)),
        Cover.DIRT: ((0.260, 0.175, 0.098), (0.390, 0.280, 0.170)),
    },
}
_SNOW_ON_THINGS = {"summer": 0.0, "autumn": 0.0, "winter": 0.75, "dry": 0.0}

_AUTUMN_LEAVES = np.array(
    [[176, 108, 40], [150, 70, 38], [186, 146, 54], [136, 114, 52], [112, 62, 42]], np.float64
)
_BARE_TWIGS = np.array([[112, 96, 82], [96, 84, 74]], np.float64)
_DRY_LEAVES = np.array([[126, 122, 58], [150, 132, 66], [104, 108, 54]], np.float64)


class SeasonPalette:
    """Colours as a season has them."""

    def __init__(self, season: str) -> None:
        self._season = season
        self.snow_on_things = _SNOW_ON_THINGS[season]
        """Share of a thing's upper side that is white."""

    def covers(self) -> NDArray[np.float32]:
        """[16, 3] linear RGB: dark and light tone of each `Cover`."""
        tones = {**_ALWAYS, **_SEASONS[self._season]}
        return np.array([tone for cover in Cover for tone in tones[cover]], np.float32)

    def things(self, kind: PropKind, summer: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Colours [N, 3] of things whose summer colours are given: leaves turn, needles keep theirs."""
        palette = {"autumn": _AUTUMN_LEAVES, "winter": _BARE_TWIGS, "dry": _DRY_LEAVES}.get(self._season)
        if palette is None or kind not in ("broadleaf", "birch", "bush"):
            return summer
        # Each plant turns by its own amount and towards its own colour, chosen by its summer shade.
        choice = summer.astype(np.int64).sum(axis=1)
        turned = palette[choice % len(palette)] * (0.85 + 0.3 * ((choice % 7) / 6.0))[:, None]
        least = {"autumn": 0.55, "winter": 1.0, "dry": 0.35}[self._season]
        share = least + (1.0 - least) * ((choice % 5) / 4.0)
        return np.asarray(np.clip(summer + share[:, None] * (turned - summer), 0, 255), dtype=np.uint8)
