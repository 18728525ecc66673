"""Random crops of stored frames: position, scale, rotation and mirror image, with labels that follow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from crowdfence.detector_training.frame_store import StoredMission
from crowdfence.detector_training.labels import LABEL_STRIDE, LABELS_PER_CELL


class Batch(NamedTuple):
    """B crops with their labels."""

    image: Tensor
    """[B, 3, H, W] in [0, 1]."""
    crowd: Tensor
    """[B, T, h, w] 1 where at least half of the cell is crowd."""
    known: Tensor
    """[B, T, h, w] 0 outside the frame and where the truth is unknown."""


@dataclass(frozen=True, slots=True)
class CropPlan:
    """How crops are taken from frames."""

    height: int = 240
    width: int = 320
    scale: tuple[float, float] = (0.5, 1.6)
    """Pixels of the frame per pixel of the crop: below 1 the crop shows things larger."""
    rotation_deg: float = 15.0
    on_crowd: float = 0.6
    """Share of the crops that are put around a crowd cell, where the frame has one."""
    wide: float = 0.0
    """Share of the crops whose scale lies anywhere in `wide_scale`."""
    wide_scale: tuple[float, float] = (0.2, 4.0)
    """Its upper end is not reached where a crop would show more than the frame."""
    photographs: float = 0.0
    """Least share of the crops from labelled pictures, where there are some: a few of them would be lost
    among thousands of rendered frames."""


class CropSampler:
    """Draws batches from all frames of all missions, each as often as its pixels say."""

    def __init__(self, missions: Sequence[StoredMission], plan: CropPlan, device: torch.device) -> None:
        self._missions, self._plan, self._device = missions, plan, device
        self._where = [
            (mission, frame) for mission in range(len(missions)) for frame in range(len(missions[mission]))
        ]
        pixels = np.array(
            [math.prod(missions[mission].size_of(frame)) for mission, frame in self._where], float
        )
        photographs = np.array([missions[mission].photographs for mission, _ in self._where], bool)
        self._chance = _with_share(pixels / pixels.sum(), photographs, plan.photographs)

    def __len__(self) -> int:
        return len(self._where)

    def draw(self, size: int, rng: np.random.Generator) -> Batch:
        """`size` crops of different frames, as far as there are that many, on the device."""
        chosen = rng.choice(len(self._where), size, replace=size > len(self._where), p=self._chance)
        crops = [self._crop(*self._where[int(one)], rng) for one in chosen]
        return Batch(*(torch.cat(parts) for parts in zip(*crops, strict=True)))

    def _crop(self, mission: int, frame: int, rng: np.random.Generator) -> Batch:
        stored, plan, device = self._missions[mission], self._plan, self._device
        height, width = stored.size_of(frame)
        labelled = (frame, slice(None), slice(height // LABEL_STRIDE), slice(width // LABEL_STRIDE))
        crowd, known = stored.crowd[labelled], stored.known[labelled]
        scale = self._scale(height, width, rng)
        centre = self._centre(crowd, height, width, scale, rng)
        turn = math.radians(rng.uniform(-plan.rotation_deg, plan.rotation_deg))
        mirror = -1.0 if rng.random() < 0.5 else 1.0
        frame_from_crop = affine(centre, scale, turn, mirror)

        window = _window(frame_from_crop, plan.height, plan.width, height, width)
        image = torch.from_numpy(np.array(stored.images[frame][window])).to(device)
        image = image.permute(2, 0, 1)[None].float() / 255.0
        if plan.wide:
            image = _without_alias(image, scale)
        # Bilinear values would show the network softer pictures than those it will be used on.
        at = _cell_grid(frame_from_crop, plan, 1, window, device)
        image = _resampled(image, at, _span(window), "bicubic").clamp_(0.0, 1.0)
        planes = np.stack([crowd, known.astype(np.uint8) * np.uint8(255)]).reshape(-1, *crowd.shape[1:])
        labels = torch.from_numpy(planes).to(device)[None].float() / 255.0
        whole = (slice(0, height), slice(0, width))
        at = _cell_grid(frame_from_crop, plan, LABEL_STRIDE, whole, device)
        return labelled_batch(image, _resampled(labels, at, (height, width)))

    def _scale(self, height: int, width: int, rng: np.random.Generator) -> float:
        plan = self._plan
        low, high = plan.scale
        if plan.wide > 0.0 and rng.random() < plan.wide:
            low, high = plan.wide_scale
            high = max(low, min(high, height / plan.height, width / plan.width))
        return math.exp(rng.uniform(math.log(low), math.log(high)))

    def _centre(
        self, crowd: NDArray[np.uint8], height: int, width: int, scale: float, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Frame coordinates (u, v) of the middle of the crop; an unturned crop stays inside the frame if it
        can."""
        plan, size = self._plan, np.array([width, height], np.float64)
        centre = rng.random(2) * size
        if rng.random() < plan.on_crowd:
            rows, columns = np.nonzero(crowd.max(axis=0) > 127)
            if len(rows):
                one = rng.integers(len(rows))
                near = rng.uniform(-0.4, 0.4, 2) * (plan.width, plan.height) * scale
                centre = np.array([columns[one] + 0.5, rows[one] + 0.5]) * LABEL_STRIDE + near
        margin = np.minimum(0.5 * scale * np.array([plan.width, plan.height]), 0.5 * size)
        return np.clip(centre, margin, size - margin)


def _with_share(chance: NDArray[np.float64], chosen: NDArray[np.bool_], share: float) -> NDArray[np.float64]:
    """The chances such that those `chosen` make up `share` of all; as they are where they do, or are all or
    none."""
    now = float(chance[chosen].sum())
    if now >= share or not chosen.any() or chosen.all():
        return chance
    return np.where(chosen, chance * share / now, chance * (1.0 - share) / (1.0 - now))


def affine(
    centre: NDArray[np.float64],
    scale: float | NDArray[np.float64],
    turn: float | NDArray[np.float64],
    mirror: float | NDArray[np.float64],
) -> NDArray[np.float64]:
    """[..., 2, 3] frame coordinates from coordinates about the crop's middle, which lies at `centre`."""
    cosine, sine = scale * np.cos(turn), scale * np.sin(turn)
    u = np.stack([mirror * cosine, -sine, centre[..., 0]], axis=-1)
    v = np.stack([mirror * sine, cosine, centre[..., 1]], axis=-1)
    return np.stack([u, v], axis=-2)


def labelled_batch(image: Tensor, labels: Tensor) -> Batch:
    """Crops with their labels [B, 2 T, h, w] at `LABEL_STRIDE`: the share of crowd of each target, then of
    what is known."""
    crowd, known = functional.avg_pool2d(labels, LABELS_PER_CELL).chunk(2, dim=1)
    return Batch(image, (crowd >= 0.5).float(), (known > 0.5).float())


def _window(
    frame_from_crop: NDArray[np.float64], rows: int, columns: int, height: int, width: int
) -> tuple[slice, slice]:
    """The part of the frame that a crop can touch: less to convert. Never empty."""
    corners = np.array([[x, y] for x in (-columns / 2, columns / 2) for y in (-rows / 2, rows / 2)])
    points = corners @ frame_from_crop[:, :2].T + frame_from_crop[:, 2]
    low, high = np.floor(points.min(axis=0)) - 2, np.ceil(points.max(axis=0)) + 2
    left, top = (int(np.clip(one, 0, side - 2)) for one, side in zip(low, (width, height), strict=True))
    right = int(np.clip(high[0], left + 2, width))
    bottom = int(np.clip(high[1], top + 2, height))
    return slice(top, bottom), slice(left, right)


def _without_alias(image: Tensor, scale: float) -> Tensor:
    """The frame with fewer pixels for a crop that shows things much smaller; its corners stay its corners."""
    if scale <= 1.25:
        return image
    fewer = [max(2, round(side / scale)) for side in image.shape[2:]]
    return functional.interpolate(image, fewer, mode="bilinear", align_corners=False, antialias=True)


def _span(window: tuple[slice, slice]) -> tuple[int, int]:
    return window[0].stop - window[0].start, window[1].stop - window[1].start


def _cell_grid(
    frame_from_crop: NDArray[np.float64],
    plan: CropPlan,
    stride: int,
    window: tuple[slice, slice],
    device: torch.device,
) -> Tensor:
    """Frame coordinates [1, h, w, 2] of the centres of the crop's cells, counted from the window's corner."""
    matrix = torch.from_numpy(frame_from_crop.astype(np.float32)).to(device)
    x = (torch.arange(plan.width // stride, device=device) + 0.5) * stride - plan.width / 2
    y = (torch.arange(plan.height // stride, device=device) + 0.5) * stride - plan.height / 2
    u = matrix[0, 0] * x[None, :] + matrix[0, 1] * y[:, None] + matrix[0, 2] - window[1].start
    v = matrix[1, 0] * x[None, :] + matrix[1, 1] * y[:, None] + matrix[1, 2] - window[0].start
    return torch.stack([u, v], dim=-1)[None]


def _resampled(values: Tensor, at: Tensor, span: tuple[int, int], mode: str = "bilinear") -> Tensor:
    """Values [1, C, h, w] at coordinates that run over `span` = (height, width); 0 outside."""
    size = torch.tensor([span[1], span[0]], dtype=torch.float32, device=at.device)
    return functional.grid_sample(values, 2.0 * at / size - 1.0, mode=mode, align_corners=False)
