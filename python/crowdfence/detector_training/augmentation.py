"""Changes of appearance that leave the labels alone: light, colour, lens, sensor, weather.

A renderer shows one kind of world. What a crowd looks like under other light, in other clothes and through
another camera has to come from here; wide ranges of colour matter most, because colours are what differs most
between worlds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from crowdfence.detector_training.recolouring import recoloured

_LUMA = (0.299, 0.587, 0.114)


def varied(image: Tensor, rng: np.random.Generator, *, seasons: bool = False) -> Tensor:
    """Images [B, 3, H, W] in [0, 1], each changed in its own way; same shape and range.

    seasons: one material recoloured at a time, mist and dusk.
    """
    if seasons:
        image = recoloured(image, rng)
    image = _coloured(image, rng)
    image = _shaded(image, rng)
    image = _misty(image, rng) if seasons else _hazy(image, rng)
    image = _focused(image, rng)
    image = _noisy(image, rng)
    return image.clamp_(0.0, 1.0)


def _per_image(values: np.ndarray, like: Tensor) -> Tensor:
    return torch.from_numpy(values.astype(np.float32)).to(like.device)


def _coloured(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Gamma, then hue, saturation, white balance and contrast as one 3x3 matrix and an offset."""
    count = len(image)
    gamma = _per_image(np.exp(rng.normal(0.0, 0.25, (count, 1, 1, 1))), image)
    image = image.clamp_min(1e-4).pow(gamma)
    matrices = np.stack([_colour_matrix(rng) for _ in range(count)])
    contrast = np.exp(rng.normal(0.0, 0.2, (count, 1)))
    offset = 0.5 * (1.0 - contrast) + rng.normal(0.0, 0.06, (count, 1))
    mixed = torch.einsum("bij,bjhw->bihw", _per_image(matrices * contrast[:, :, None], image), image)
    return mixed + _per_image(np.repeat(offset, 3, axis=1)[:, :, None, None], image)


def _colour_matrix(rng: np.random.Generator) -> np.ndarray:
    """Rotation of the hue about grey, saturation, and a gain per channel."""
    hue = rng.normal(0.0, 0.25) if rng.random() < 0.88 else rng.uniform(-math.pi, math.pi)
    saturation = rng.uniform(0.0, 0.4) if rng.random() < 0.1 else math.exp(rng.normal(0.0, 0.3))
    grey = np.full((3, 3), 1.0 / 3.0)
    about_grey = np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]]) / math.sqrt(3.0)
    rotation = grey + math.cos(hue) * (np.eye(3) - grey) + math.sin(hue) * about_grey
    luma = np.tile(np.array(_LUMA), (3, 1))
    gain = np.exp(rng.normal(0.0, 0.08, 3))
    return np.asarray(gain[:, None] * ((luma + saturation * (np.eye(3) - luma)) @ rotation))


def _shaded(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Light that differs over the image: clouds, and shadows with an edge."""
    count = len(image)
    coarse = _per_image(rng.normal(0.0, 0.18, (count, 1, 4, 5)), image)
    smooth = functional.interpolate(coarse, image.shape[2:], mode="bicubic", align_corners=False)
    edged = _per_image((rng.random((count, 1, 1, 1)) < 0.25).astype(np.float32), image)
    shadow = torch.sigmoid(20.0 * (smooth - 0.1)) * 0.45 * edged
    return image * (torch.exp(smooth * (1.0 - edged)) - shadow)


def _hazy(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Haze that grows towards the upper edge, in one image of five."""
    count, rows = len(image), image.shape[2]
    strength = rng.uniform(0.1, 0.55, (count, 1, 1, 1)) * (rng.random((count, 1, 1, 1)) < 0.2)
    ramp = torch.linspace(1.0, 0.25, rows, device=image.device)[None, None, :, None]
    share = _per_image(strength, image) * ramp
    return image * (1.0 - share) + _per_image(rng.uniform(0.6, 0.9, (count, 1, 1, 1)), image) * share


def _misty(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Haze over one image in four, thicker towards the upper edge or as thick everywhere; bright by day, dark
    at dusk, a little coloured."""
    count, rows = len(image), image.shape[2]
    strength = rng.uniform(0.1, 0.6, (count, 1, 1, 1)) * (rng.random((count, 1, 1, 1)) < 0.25)
    below = _per_image(rng.uniform(0.2, 1.0, (count, 1, 1, 1)), image)
    down = torch.linspace(0.0, 1.0, rows, device=image.device)[None, None, :, None]
    share = _per_image(strength, image) * (1.0 + (below - 1.0) * down)
    colour = rng.uniform(0.25, 0.9, (count, 1, 1, 1)) + rng.normal(0.0, 0.05, (count, 3, 1, 1))
    return image * (1.0 - share) + _per_image(colour, image) * share


def _focused(image: Tensor, rng: np.random.Generator) -> Tensor:
    """One image in three sharpened, as cameras and renderers do; one in three softened by defocus, motion, or
    fewer pixels than the file claims."""
    for index in range(len(image)):
        one = image[index : index + 1]
        kind = rng.integers(9)
        if kind < 3:
            soft = _convolved(one, _gaussian(rng.uniform(0.5, 1.2)))
            one += float(rng.uniform(0.2, 1.6)) * (one - soft)
        elif kind == 3:
            one.copy_(_convolved(one, _gaussian(rng.uniform(0.4, 1.4))))
        elif kind == 4:
            one.copy_(_convolved(one, _streak(int(rng.integers(3, 8)), rng.uniform(0.0, math.pi))))
        elif kind == 5:
            fewer = [max(8, int(side / rng.uniform(1.2, 2.2))) for side in one.shape[2:]]
            one.copy_(_resized(_resized(one, fewer), one.shape[2:]))
    return image


def _resized(image: Tensor, size: Sequence[int]) -> Tensor:
    smaller = size[0] < image.shape[2]
    return functional.interpolate(image, list(size), mode="bilinear", align_corners=False, antialias=smaller)


def _gaussian(sigma: float) -> np.ndarray:
    offsets = np.arange(-3, 4)
    line = np.exp(-0.5 * (offsets / sigma) ** 2)
    return np.outer(line, line)


def _streak(length: int, angle: float) -> np.ndarray:
    kernel = np.zeros((9, 9))
    for step in np.linspace(-length / 2, length / 2, 4 * length):
        kernel[round(4 + step * math.sin(angle)), round(4 + step * math.cos(angle))] += 1.0
    return kernel


def _convolved(image: Tensor, kernel: np.ndarray) -> Tensor:
    weights = _per_image(kernel / kernel.sum(), image).expand(3, 1, *kernel.shape)
    padded = functional.pad(image, [kernel.shape[1] // 2] * 2 + [kernel.shape[0] // 2] * 2, mode="replicate")
    return functional.conv2d(padded, weights, groups=3)


def _noisy(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Sensor noise, from one field of standard noise that is shifted for every image (cheap and enough)."""
    rows, columns = image.shape[2:]
    field = _per_image(rng.standard_normal((3, rows, columns), np.float32), image)
    strength = rng.uniform(0.0, 0.05, len(image)) * (rng.random(len(image)) < 0.6)
    for index, sigma in enumerate(strength):
        if sigma > 0.0:
            shift = (int(rng.integers(rows)), int(rng.integers(columns)))
            image[index] += float(sigma) * torch.roll(field, shift, dims=(1, 2))
    return image
