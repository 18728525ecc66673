"""Crops laid upon one another: what lies around a crowd becomes other than anything that was rendered.

Pictures without crowds, photographs among them where there are some, replace or stain the ground of other
crops in soft patches; foliage and things made in rows are laid over them; never where somebody stands. A
dense and random background at the scale of the objects is what training on renderings needs most
(Hinterstoisser et al., 2019); pasted edges must not show (Dwibedi et al., 2017).
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from crowdfence.detector_training.crops import Batch
from crowdfence.detector_training.foliage import crowns
from crowdfence.detector_training.patterns import panels

SHARE = 0.5
"""Of the crops, where the batch holds one without crowd."""
LAID = ((crowns, 0.3), (panels, 0.2))
"""What else is laid upon which share of the crops."""
_AROUND_PEOPLE = 5
"""Cells across which nothing is laid around a cell with people."""


def free_of_people(batch: Batch) -> Tensor:
    """[B, 1, H, W] from 0, where people or unknown cells are near, to 1."""
    taken = torch.maximum(batch.crowd, 1.0 - batch.known).amax(dim=1, keepdim=True)
    near = functional.max_pool2d(taken, _AROUND_PEOPLE, 1, _AROUND_PEOPLE // 2)
    size = list(batch.image.shape[2:])
    return 1.0 - functional.interpolate(near, size, mode="bilinear", align_corners=False)


def cluttered(batch: Batch, free: Tensor, rng: np.random.Generator) -> Tensor:
    """Images [B, 3, H, W] of `batch`, some with parts of others in them where they are `free_of_people`; the
    labels stay true."""
    image, empty = batch.image.clone(), _empty(batch)
    for index in range(len(image)):
        others = empty[empty != index]
        if not len(others) or rng.random() >= SHARE:
            continue
        laid = batch.image[int(rng.choice(others))]
        if rng.random() < 0.5:
            laid = laid.flip(-1)
        share = free[index] * _patches(rng, laid)
        if rng.random() < 0.3:  # stains: the ground stays, in the light and shade of the other
            light = laid.mean(dim=0, keepdim=True) / laid.mean().clamp_min(0.05)
            laid = image[index] * light.clamp(0.2, 2.5)
        image[index] = image[index] * (1.0 - share) + laid.clamp(0.0, 1.0) * share
    return image


def furnished(batch: Batch, free: Tensor, rng: np.random.Generator) -> Tensor:
    """Images [B, 3, H, W] of `batch`, some with foliage or things in rows in them where they are
    `free_of_people`; the labels stay true."""
    image = batch.image.clone()
    for made, often in LAID:
        for index in np.flatnonzero(rng.random(len(image)) < often).tolist():
            laid, cover = made(rng, image[index])
            share = free[index] * cover
            image[index] = image[index] * (1.0 - share) + laid * share
    return image


def _empty(batch: Batch) -> np.ndarray:
    """Numbers of the crops without a crowd that lie in their frame for the most part."""
    crowd = batch.crowd.amax(dim=(1, 2, 3)) > 0.0
    whole = batch.known.mean(dim=(1, 2, 3)) > 0.9
    return np.flatnonzero((whole & ~crowd).cpu().numpy())


def _patches(rng: np.random.Generator, like: Tensor) -> Tensor:
    """[1, H, W] smooth patches of 0 and 1, of any size up to all, with edges of 1 to 20 pixels."""
    rows, columns = int(rng.integers(2, 12)), int(rng.integers(3, 16))
    coarse = rng.normal(rng.uniform(-0.8, 1.6), 1.0, (1, 1, rows, columns))
    field = torch.from_numpy(coarse.astype(np.float32)).to(like.device)
    smooth = functional.interpolate(field, like.shape[1:], mode="bicubic", align_corners=False)
    return torch.sigmoid(float(rng.uniform(4.0, 60.0)) * smooth[0])
