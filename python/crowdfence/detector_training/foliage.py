"""Crowns, bushes and flower beds to lay upon crops: leaves by the thousand, which renderings lack.

On photographs, leafy crowns in the colours of autumn were most of what a network that knew renderings alone
took for crowds. Here every crown is a dead-leaves picture of one plant: nearest-seed cells as leaves, two
hues that mingle in clumps, light from above, dark gaps. A crowd has the spots, but not one plant's colours.
"""

from __future__ import annotations

from functools import cache
from threading import Lock

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, zoom
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn import functional

TEXTURES = 48
_HEIGHT, _WIDTH = 300, 400
_GROWING = Lock()
"""Batches are made by several threads, and the bank takes seconds."""


def crowns(rng: np.random.Generator, like: Tensor) -> tuple[Tensor, Tensor]:
    """Leaves [3, H, W] for an image of that shape, and the share [1, H, W] that they cover."""
    with _GROWING:
        bank = _bank()
    texture = bank[int(rng.integers(len(bank)))].to(like.device)
    span = rng.uniform(0.4, 1.0)
    rows, columns = int(span * _HEIGHT), int(span * _WIDTH)
    top, left = int(rng.integers(_HEIGHT - rows + 1)), int(rng.integers(_WIDTH - columns + 1))
    part = texture[:, top : top + rows, left : left + columns]
    if rng.random() < 0.5:
        part = part.flip(-1)
    height, width = like.shape[1:]
    leaves = functional.interpolate(part[None], (height, width), mode="bilinear", align_corners=False)[0]
    cover, lit = (torch.from_numpy(one).to(like.device) for one in _crown_shapes(rng, height, width))
    light = float(np.exp(rng.normal(0.0, 0.3)))
    return (leaves * lit * light).clamp(0.0, 1.0), cover


def _crown_shapes(
    rng: np.random.Generator, height: int, width: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Cover and light [1, H, W] of one to five ragged discs of 10 to 150 pixels, shaded below."""
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    ragged = sum(
        _noise(rng, height, width, cell) * part for cell, part in ((40, 0.25), (12, 0.15), (5, 0.12))
    )
    cover, lit = np.zeros((height, width), np.float32), np.ones((height, width), np.float32)
    for _ in range(int(rng.integers(1, 6))):
        radius = float(np.exp(rng.uniform(np.log(10.0), np.log(150.0))))
        flat = float(rng.uniform(0.6, 1.4))
        x, y = rng.uniform(0, width), rng.uniform(0, height)
        across, down = (u - x) / radius, (v - y) / (radius * flat)
        inside = 1.0 - np.hypot(across, down) + ragged
        crown = np.clip(inside * radius / 2.0 + 0.5, 0.0, 1.0)
        shade = np.clip(1.0 - 0.45 * down - 0.2 * across, 0.35, 1.4)
        lit = crown * shade + (1.0 - crown) * lit
        cover = np.maximum(cover, crown)
    return cover[None].astype(np.float32), lit[None].astype(np.float32)


@cache
def _bank() -> tuple[Tensor, ...]:
    """The same in every training."""
    rng = np.random.default_rng(0)
    return tuple(torch.from_numpy(_leaves(rng).transpose(2, 0, 1).copy()) for _ in range(TEXTURES))


def _leaves(rng: np.random.Generator) -> NDArray[np.float32]:
    """[H, W, 3] of one plant: leaves of 1.5 to 5 pixels on boughs of some leaves each."""
    size = float(np.exp(rng.uniform(np.log(1.5), np.log(5.0))))
    seeds, leaf, rim = _cells(rng, size)
    # Greens as they are most of the year, yellows and rusts where they turn.
    first, second = (
        rng.uniform(0.18, 0.36) if rng.random() < 0.55 else rng.uniform(0.02, 0.18) for _ in range(2)
    )
    clump = _noise(rng, _HEIGHT, _WIDTH, int(rng.integers(20, 90)))
    row, column = seeds.astype(int).T
    turned = clump[row, column] + rng.normal(0.0, 0.4, len(seeds)) > rng.normal(0.0, 0.6)
    hue = np.where(turned, second, first) + rng.normal(0.0, 0.015, len(seeds))
    saturation = rng.uniform(0.2, 0.75) + rng.normal(0.0, 0.08, len(seeds))
    value = rng.uniform(0.3, 0.75) * np.exp(rng.normal(0.0, rng.uniform(0.15, 0.4), len(seeds)))
    if rng.random() < 0.15:  # in flower
        bloom = rng.random(len(seeds)) < rng.uniform(0.03, 0.3)
        hue, value = np.where(bloom, rng.random(), hue), np.where(bloom, rng.uniform(0.6, 1.0), value)
    gap = rng.random(len(seeds)) < rng.uniform(0.0, 0.4)
    value = np.clip(np.where(gap, 0.3 * value, value), 0.02, 1.0)
    colours = _rgb(hue, np.clip(saturation, 0.05, 0.95), value)
    boughs, bough, edge = _cells(rng, size * float(rng.uniform(4.0, 9.0)))
    depth = np.exp(rng.normal(0.0, 0.25, len(boughs)))[bough] * (0.5 + 0.5 * edge)
    shade = depth * (0.5 + 0.5 * rim) * np.clip(1.0 + 0.3 * _noise(rng, _HEIGHT, _WIDTH, 40), 0.3, 1.6)
    picture = np.clip(colours[leaf] * shade[..., None], 0.0, 1.0)
    return gaussian_filter(picture, (0.5, 0.5, 0.0)).astype(np.float32)


def _cells(
    rng: np.random.Generator, size: float
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Random seeds [N, 2] about `size` pixels apart, the nearest of each pixel [H, W], and how far from its
    cell's border the pixel lies, up to 1."""
    seeds = rng.uniform(0.0, 1.0, (round(_HEIGHT * _WIDTH / size**2), 2)) * (_HEIGHT, _WIDTH)
    pixels = np.moveaxis(np.mgrid[0:_HEIGHT, 0:_WIDTH], 0, -1)
    distance, nearest = cKDTree(seeds).query(pixels, k=2)
    return seeds, nearest[..., 0], np.clip((distance[..., 1] - distance[..., 0]) / (0.4 * size), 0.0, 1.0)


def _rgb(
    hue: NDArray[np.float64], saturation: NDArray[np.float64], value: NDArray[np.float64]
) -> NDArray[np.float64]:
    """[N, 3] of hues in turns."""
    turn = (np.array([5.0, 3.0, 1.0]) + 6.0 * hue[:, None]) % 6.0
    return value[:, None] * (1.0 - saturation[:, None] * np.clip(np.minimum(turn, 4.0 - turn), 0.0, 1.0))


def _noise(rng: np.random.Generator, height: int, width: int, cell: int) -> NDArray[np.float32]:
    """Smooth values of about unit spread that change over `cell` pixels."""
    coarse = rng.standard_normal((height // cell + 3, width // cell + 3)).astype(np.float32)
    fine: NDArray[np.float32] = zoom(coarse, cell, order=1)
    return fine[:height, :width]
