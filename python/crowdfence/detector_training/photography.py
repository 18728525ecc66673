"""What a camera of today does to a picture: colour from a mosaic, noise with grain, sharpening with halos, a
tone curve, dusk, JPEG. A renderer does none of it."""

from __future__ import annotations

import io
import math

import numpy as np
import torch
from PIL import Image
from torch import Tensor
from torch.nn import functional

SHARE = 0.6
"""Of the pictures that pass through a camera."""
_SWAPPED = 0.12
_LUMA = torch.tensor([0.299, 0.587, 0.114])[:, None, None]


def photographed(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Images [B, 3, H, W] in [0, 1], some as a camera would have stored them; same shape and range."""
    image = with_swapped_amplitudes(image, rng)
    for index in range(len(image)):
        if rng.random() < SHARE:
            image[index] = _through_camera(image[index], rng)
    return image.clamp_(0.0, 1.0)


def with_swapped_amplitudes(image: Tensor, rng: np.random.Generator) -> Tensor:
    """A few images get the low frequencies' amplitudes of others and keep their own phases: light and colours
    of the one, things of the other (FDA, Yang and Soatto, 2020)."""
    chosen = np.flatnonzero(rng.random(len(image)) < _SWAPPED)
    if not len(chosen):
        return image
    givers = rng.integers(len(image), size=len(chosen))
    result = image.clone()
    for index, giver in zip(chosen.tolist(), givers.tolist(), strict=True):
        own, other = torch.fft.rfft2(image[index]), torch.fft.rfft2(image[giver])
        reach = max(1, round(float(rng.uniform(0.005, 0.04)) * image.shape[2]))
        for rows in (slice(0, reach + 1), slice(-reach, None)):
            low = own[:, rows, : reach + 1]
            own[:, rows, : reach + 1] = torch.polar(other[:, rows, : reach + 1].abs(), low.angle())
        result[index] = torch.fft.irfft2(own, image.shape[2:]).clamp(0.0, 1.0)
    return result


def _through_camera(image: Tensor, rng: np.random.Generator) -> Tensor:
    """One image [3, H, W]."""
    image = image[None]
    light = float(np.exp(rng.normal(0.0, 0.25)))
    grain = float(rng.uniform(0.0, 0.03))
    if rng.random() < 0.15:  # dusk: little light, much gain
        light, grain = float(rng.uniform(0.15, 0.6)), float(rng.uniform(0.02, 0.08))
        cast = np.exp(rng.normal(0.0, 0.15, (1, 3, 1, 1))).astype(np.float32)
        image = image * torch.from_numpy(cast).to(image.device)
    image = _demosaicked(image * light, rng)
    noise = torch.from_numpy(rng.standard_normal(image.shape, np.float32)).to(image.device)
    if rng.random() < 0.6:  # noise reduction leaves grain of more than a pixel
        noise = _softened(noise, rng.uniform(0.5, 1.2)) * 2.0
    image = image + grain * noise * (0.4 + image.clamp(0.0, 1.0).sqrt())
    if rng.random() < 0.7:
        soft = _softened(image, rng.uniform(0.6, 1.8))
        image = image + float(rng.uniform(0.2, 1.8)) * (image - soft)
    return _stored_as_jpeg(_toned(image, rng).clamp(0.0, 1.0)[0], rng)


def _demosaicked(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Brightness a little soft, colours much softer."""
    luma = (image * _LUMA.to(image.device)).sum(dim=1, keepdim=True)
    colour = _softened(image - luma, rng.uniform(0.6, 1.6))
    return _softened(luma, rng.uniform(0.3, 0.8)) + colour


def _softened(image: Tensor, sigma: float) -> Tensor:
    """Gaussian, one axis after the other, cut at 4 pixels."""
    line = torch.exp(-0.5 * (torch.arange(-4.0, 5.0, device=image.device) / sigma) ** 2)
    channels = image.shape[1]
    weights = (line / line.sum()).expand(channels, 1, -1)
    for kernel, pad in ((weights[:, :, None, :], [4, 4, 0, 0]), (weights[:, :, :, None], [0, 0, 4, 4])):
        image = functional.conv2d(functional.pad(image, pad, mode="replicate"), kernel, groups=channels)
    return image


def _toned(image: Tensor, rng: np.random.Generator) -> Tensor:
    """An S of a curve about the middle, steeper or flatter than a line, and lights that clip."""
    image = image.clamp(0.0, 1.2) * float(rng.uniform(0.9, 1.25))
    bend = float(rng.uniform(-0.6, 0.9))
    return image + bend * image * (1.0 - image) * (image - 0.5) * 2.0


def _stored_as_jpeg(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Written and read again, with any quality; colours at half the resolution more often than not."""
    pixels = (image.permute(1, 2, 0) * 255.0).round().to(torch.uint8).cpu().numpy()
    quality = round(100.0 - 80.0 * math.sqrt(rng.random()) * rng.random())
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, format="JPEG", quality=quality, subsampling=int(rng.choice([0, 2, 2])))
    read = np.asarray(Image.open(file)).astype(np.float32) / 255.0
    return torch.from_numpy(read).to(image.device).permute(2, 0, 1)
