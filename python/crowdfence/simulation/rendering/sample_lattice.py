"""Where colour, labels and depth are sampled, so that every pixel's centre ray is one of the samples.

With 1 or 3 samples per pixel and axis the pixel's centre is the middle sample. With 2 the lattice is laid so
that every second sample is a pixel centre and the ones between lie on pixel borders: the colour is a tent
filter over 3 x 3 samples, and the labels are still exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera

MAX_SAMPLES_PER_PIXEL = 3
_MAX_TANGENT = 6.0  # 161 degrees across: beyond that a flat image plane cannot hold the lens


@dataclass(frozen=True, slots=True)
class SampleLattice:
    """A pinhole image of samples that covers the camera's image."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    samples_per_pixel: int
    pixel_samples: NDArray[np.float32]
    """[H, W, 2] where each pixel's centre ray meets the lattice, in samples; sample k covers [k, k + 1)."""
    distorted: bool
    """Whether pixel centres fall between samples."""


def lattice_for(camera: Camera, samples_per_pixel: int) -> SampleLattice:
    """The lattice of a camera; ValueError for a lens that sees too wide or cannot be inverted."""
    if not 1 <= samples_per_pixel <= MAX_SAMPLES_PER_PIXEL:
        raise ValueError(f"supersample must be 1 to {MAX_SAMPLES_PER_PIXEL}, got {samples_per_pixel}")
    if camera.model == "pinhole":
        return _aligned(camera, samples_per_pixel)
    return _around_lens(camera, samples_per_pixel)


def _pixel_grid(camera: Camera) -> NDArray[np.float64]:
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    return np.stack([u, v], axis=-1)


def _aligned(camera: Camera, samples: int) -> SampleLattice:
    border = 0 if samples == 1 else 1
    extra = 1 if samples == 2 else 0
    at = samples * (_pixel_grid(camera) - 0.5) + border + 0.5
    return SampleLattice(
        samples * camera.width + extra,
        samples * camera.height + extra,
        samples * camera.fx,
        samples * camera.fy,
        samples * (camera.cx - 0.5) + border + 0.5,
        samples * (camera.cy - 0.5) + border + 0.5,
        samples,
        at.astype(np.float32),
        False,
    )


def _around_lens(camera: Camera, samples: int) -> SampleLattice:
    rays = camera.unproject(_pixel_grid(camera).reshape(-1, 2))
    with np.errstate(divide="ignore"):
        tangent = rays[:, :2] / rays[:, 2:]
    if (rays[:, 2] <= 0).any() or np.abs(tangent).max() > _MAX_TANGENT:
        raise ValueError("the lens sees more than 160 degrees: it cannot be rendered from one flat image")
    fx, fy = samples * camera.fx, samples * camera.fy
    low, high = tangent.min(axis=0), tangent.max(axis=0)
    margin = 2.0
    cx, cy = margin - fx * low[0], margin - fy * low[1]
    at = tangent * (fx, fy) + (cx, cy)
    width, height = np.ceil((high - low) * (fx, fy) + 2 * margin).astype(int)
    shape = (camera.height, camera.width, 2)
    return SampleLattice(
        int(width), int(height), fx, fy, cx, cy, samples, at.reshape(shape).astype(np.float32), True
    )
