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
_REACH = 4
"""Pixels from the middle of a kernel to its edge."""


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
    contrast = np.exp(rng.normal(0.0, 0.2, (count, 1, 1)))
    matrices = _per_image(_colour_matrices(count, rng) * contrast, image)
    offset = 0.5 * (1.0 - contrast) + rng.normal(0.0, 0.06, (count, 1, 1))
    mixed = torch.einsum("bij,bjhw->bihw", matrices, image)
    return mixed + _per_image(offset[..., None], image)


def _colour_matrices(count: int, rng: np.random.Generator) -> np.ndarray:
    """[count, 3, 3] rotation of the hue about grey, saturation, and a gain per channel."""

    def each(often: float, others: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.where(rng.random(count) < often, others, values)[:, None, None]

    hue = each(0.12, rng.uniform(-math.pi, math.pi, count), rng.normal(0.0, 0.25, count))
    saturation = each(0.1, rng.uniform(0.0, 0.4, count), np.exp(rng.normal(0.0, 0.3, count)))
    grey = np.full((3, 3), 1.0 / 3.0)
    about_grey = np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]]) / math.sqrt(3.0)
    rotation = grey + np.cos(hue) * (np.eye(3) - grey) + np.sin(hue) * about_grey
    luma = np.tile(np.array(_LUMA), (3, 1))
    gain = np.exp(rng.normal(0.0, 0.08, (count, 3, 1)))
    return np.asarray(gain * ((luma + saturation * (np.eye(3) - luma)) @ rotation))


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
    kind = rng.integers(9, size=len(image))
    sharpened, defocused, moved, enlarged = map(np.flatnonzero, (kind < 3, kind == 3, kind == 4, kind == 5))
    kernels = [_sharpening(rng.uniform(0.5, 1.2), rng.uniform(0.2, 1.6)) for _ in sharpened]
    kernels += [_gaussian(rng.uniform(0.4, 1.4)) for _ in defocused]
    kernels += [_streak(int(rng.integers(3, 8)), rng.uniform(0.0, math.pi)) for _ in moved]
    if kernels:
        some = torch.from_numpy(np.concatenate([sharpened, defocused, moved])).to(image.device)
        image[some] = _convolved(image[some], np.stack(kernels))
    for index in enlarged:
        one = image[index : index + 1]
        fewer = [max(8, int(side / rng.uniform(1.2, 2.2))) for side in one.shape[2:]]
        one.copy_(_resized(_resized(one, fewer), one.shape[2:]))
    return image


def _resized(image: Tensor, size: Sequence[int]) -> Tensor:
    smaller = size[0] < image.shape[2]
    return functional.interpolate(image, list(size), mode="bilinear", align_corners=False, antialias=smaller)


def _sharpening(sigma: float, strength: float) -> np.ndarray:
    kernel = -strength * _gaussian(sigma)
    kernel[_REACH, _REACH] += 1.0 + strength
    return kernel


def _gaussian(sigma: float) -> np.ndarray:
    line = np.exp(-0.5 * (np.arange(-_REACH, _REACH + 1) / sigma) ** 2)
    line[[0, -1]] = 0.0  # of 7 pixels
    kernel = np.outer(line, line)
    return kernel / kernel.sum()


def _streak(length: int, angle: float) -> np.ndarray:
    kernel = np.zeros((2 * _REACH + 1,) * 2)
    for step in np.linspace(-length / 2, length / 2, 4 * length):
        kernel[round(_REACH + step * math.sin(angle)), round(_REACH + step * math.cos(angle))] += 1.0
    return kernel / kernel.sum()


def _convolved(image: Tensor, kernels: np.ndarray) -> Tensor:
    """Each of B images [B, 3, H, W] with its own kernel of [B, k, k]."""
    count, channels, *size = image.shape
    weights = _per_image(kernels, image).repeat_interleave(channels, 0)[:, None]
    padded = functional.pad(image, [_REACH] * 4, mode="replicate").reshape(
        1, count * channels, *(side + 2 * _REACH for side in size)
    )
    return functional.conv2d(padded, weights, groups=count * channels).reshape(image.shape)


def _noisy(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Sensor noise, from one field of standard noise that is shifted for every image (cheap and enough)."""
    rows, columns = image.shape[2:]
    field = _per_image(rng.standard_normal((3, rows, columns), np.float32), image)
    strength = rng.uniform(0.0, 0.05, len(image)) * (rng.random(len(image)) < 0.6)
    shifts = zip(rng.integers(rows, size=len(image)), rng.integers(columns, size=len(image)), strict=True)
    for one, sigma, (down, right) in zip(image, strength, shifts, strict=True):
        if sigma > 0.0:
            one += float(sigma) * torch.roll(field, (int(down), int(right)), dims=(1, 2))
    return image
