"""One colour of a picture become another, and the others left alone.

A turn of all colours keeps what is green apart from what is red. Seasons do not: they recolour leaves and not
roads, as owners recolour roofs. A detector that takes the colours of its worlds for what things are learns
from it that any one material may have any.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

SHARE = 0.4
"""Of the pictures."""
WIDTHS = (0.3, 0.9)
"""How far hues may lie from the chosen one to turn with it, radians."""
_STRONGER = 0.7
"""Natural logarithm of how much stronger or paler the colour becomes at most."""

_COLOURLESS = 1e-4
"""Distance from grey up to which a hue is no more than the rounding of sums, which differs by processor:
it counts as 0."""

_AXES = torch.tensor([[1.0, 1.0, 1.0], [1.0, -1.0, 0.0], [1.0, 1.0, -2.0]])
_AXES /= _AXES.norm(dim=1, keepdim=True)
"""Grey, red against green, yellow against blue."""


def recoloured(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Images [B, 3, H, W] in [0, 1], two in five changed in place: the hue of one of its pixels turns by any
    angle, others less the further they are from it. Grey stays grey, and every pixel as bright as it was
    unless a channel ends."""
    chosen = torch.from_numpy(np.flatnonzero(rng.random(len(image)) < SHARE))
    if not len(chosen):
        return image
    axes = _AXES.to(image.device)
    grey, red_green, yellow_blue = torch.einsum("ij,bjhw->ibhw", axes, image[chosen])
    has_hue = torch.hypot(yellow_blue, red_green) > _COLOURLESS
    hue = torch.where(has_hue, torch.atan2(yellow_blue, red_green), 0.0)
    rows, columns = (torch.from_numpy(rng.integers(side, size=len(chosen))) for side in image.shape[2:])
    centre = hue[torch.arange(len(chosen)), rows, columns]

    def per_image(low: float, high: float) -> Tensor:
        return torch.from_numpy(rng.uniform(low, high, (len(chosen), 1, 1)).astype(np.float32)).to(hue)

    apart = torch.remainder(hue - centre[:, None, None] + math.pi, 2.0 * math.pi) - math.pi
    share = torch.exp(-((apart / per_image(*WIDTHS)) ** 2))
    turn = share * per_image(-math.pi, math.pi)
    stronger = 1.0 + share * (torch.exp(per_image(-_STRONGER, _STRONGER)) - 1.0)
    cosine, sine = stronger * torch.cos(turn), stronger * torch.sin(turn)
    turned = torch.stack(
        [grey, cosine * red_green - sine * yellow_blue, sine * red_green + cosine * yellow_blue]
    )
    image[chosen] = torch.einsum("ij,ibhw->bjhw", axes, turned).clamp_(0.0, 1.0)
    return image
