"""One colour map for every export: a state reads the same on the picture, in the OctoMap and in a GIS.

Below the threshold: pale green, turning paler towards it. Crowd: yellow to dark red, with lightness
falling all the way, so that the order survives every kind of colour blindness and a black-and-white print.
What was not seen has no hue at all and cannot be mistaken for either.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.voxel_state import VoxelState

Rgb = tuple[int, int, int]

STATE_COLOURS: dict[VoxelState, Rgb] = {
    VoxelState.NEVER_SEEN: (152, 152, 156),
    VoxelState.OCCLUDED: (84, 84, 90),
    VoxelState.EMPTY: (148, 208, 154),
    VoxelState.STALE: (112, 136, 194),
    VoxelState.CROWD: (214, 56, 30),
    VoxelState.NOT_CLEARED: (212, 174, 230),
}
"""Flat colour of a state, for legends and for exports that cannot show a ramp."""
CLOSED_COLOUR: Rgb = (142, 44, 106)
"""Of ground without crowd that a zone closes, where zones are no outlines but cells."""

_EMPTY_RAMP = np.array([(148, 208, 154), (232, 238, 196)], dtype=np.float64)
_CROWD_RAMP = np.array([(255, 214, 70), (250, 150, 40), (214, 56, 30), (112, 8, 38)], dtype=np.float64)


def probability_colours(probability: ArrayLike, threshold: float) -> NDArray[np.uint8]:
    """Colours [..., 3] of the probabilities [...] of seen ground.

    Raises ValueError for NaN: ground that was never seen has a state, not a probability.
    """
    values = np.asarray(probability, dtype=np.float64)
    if np.isnan(values).any():
        raise ValueError("NaN has no place on the probability ramp; colour unseen ground by its state")
    below = _ramp(_EMPTY_RAMP, values / threshold)
    above = _ramp(_CROWD_RAMP, (values - threshold) / max(1.0 - threshold, np.finfo(float).tiny))
    return np.where((values >= threshold)[..., None], above, below)


def state_colours(probability: ArrayLike, state: ArrayLike, threshold: float) -> NDArray[np.uint8]:
    """Colours [..., 3] of voxels or columns: EMPTY and CROWD by probability, the other states flat.

    probability [...] is read only where the state is EMPTY or CROWD; state [...] holds `VoxelState`.
    """
    states = np.asarray(state, dtype=np.uint8)
    table = np.array([STATE_COLOURS[known] for known in VoxelState], dtype=np.uint8)
    colours = table[states]
    ramped = (states == VoxelState.EMPTY) | (states == VoxelState.CROWD)
    colours[ramped] = probability_colours(np.asarray(probability)[ramped], threshold)
    return colours


def _ramp(stops: NDArray[np.float64], fraction: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Colours [..., 3] at `fraction` [...] (cut to [0, 1]) of evenly spaced stops [S, 3]."""
    at = np.linspace(0.0, 1.0, len(stops))
    channels = [np.interp(fraction, at, stops[:, channel]) for channel in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8)
