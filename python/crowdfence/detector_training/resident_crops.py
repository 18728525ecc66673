"""The crops of `crops`, taken side by side from frames that lie in the memory of the device that learns.

A GPU learns a crop in a fraction of the time that a processor takes to make one. Where all frames fit into
its memory (7,000 of 640x480 with their labels are 9 GB), it makes its crops itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from crowdfence.detector_training.crops import Batch, CropPlan, CropSampler, affine, labelled_batch
from crowdfence.detector_training.frame_store import StoredMission
from crowdfence.detector_training.labels import LABEL_STRIDE

PLACES = 512
"""Crowd labels of a frame around which crops are put, drawn once where there are more."""
_KEPT_FREE = 0.5
"""Share of a device's memory that is left to the network and its crops."""


def crop_source(
    missions: Sequence[StoredMission], plan: CropPlan, device: torch.device
) -> CropSampler | ResidentCrops:
    """Whatever makes crops of these missions fastest."""
    if device.type == "cuda" and _can_be_resident(missions, plan):
        needed = sum(one.images.nbytes + one.crowd.nbytes + one.known.nbytes for one in missions)
        if needed < _KEPT_FREE * torch.cuda.mem_get_info(device)[0]:
            return ResidentCrops(missions, plan, device)
    return CropSampler(missions, plan, device)


def _can_be_resident(missions: Sequence[StoredMission], plan: CropPlan) -> bool:
    """Whether the frames are whole and of one size, and no crop shows them much smaller."""
    sizes = {mission.images.shape[1:3] for mission in missions}
    return len(sizes) == 1 and not plan.wide and all(mission.sizes is None for mission in missions)


class ResidentCrops:
    """Draws batches from all frames of all missions, which are whole, of one size, and equally likely."""

    def __init__(self, missions: Sequence[StoredMission], plan: CropPlan, device: torch.device) -> None:
        frames = sum(len(mission) for mission in missions)
        rows, columns = missions[0].images.shape[1:3]
        planes = 2 * missions[0].crowd.shape[1]
        self._plan, self._device = plan, device
        self._size = np.array([columns, rows], np.float64)
        self._images = torch.empty((frames, rows, columns, 3), dtype=torch.uint8, device=device)
        """[N, H, W, 3]."""
        self._labels = torch.empty(
            (frames, planes, rows // LABEL_STRIDE, columns // LABEL_STRIDE), dtype=torch.uint8, device=device
        )
        """[N, 2 T, h, w] crowd of each target, then what is known, times 255."""
        self._places: list[NDArray[np.int64]] = []
        """Of each frame: rows and columns of some of its crowd labels."""
        rng, first = np.random.default_rng(0), 0
        for mission in missions:
            some = slice(first, first + len(mission))
            self._images[some] = torch.from_numpy(np.array(mission.images)).to(device)
            known = mission.known.astype(np.uint8) * np.uint8(255)
            self._labels[some] = torch.from_numpy(np.concatenate([mission.crowd, known], axis=1)).to(device)
            for crowd in mission.crowd:
                places = np.argwhere(crowd.max(axis=0) > 127)
                if len(places) > PLACES:
                    places = rng.permutation(places)[:PLACES]
                self._places.append(places)
            first += len(mission)

    def __len__(self) -> int:
        return len(self._places)

    def draw(self, size: int, rng: np.random.Generator) -> Batch:
        """`size` crops of different frames, as far as there are that many."""
        chosen = rng.choice(len(self), size, replace=size > len(self))
        return self._cropped(chosen, self._frames_from_crops(chosen, rng))

    def _frames_from_crops(self, chosen: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.float64]:
        """[B, 2, 3] frame coordinates from coordinates about each crop's middle."""
        plan, count = self._plan, len(chosen)
        scale = np.exp(rng.uniform(math.log(plan.scale[0]), math.log(plan.scale[1]), count))
        span = np.array([plan.width, plan.height]) * scale[:, None]
        centre = rng.random((count, 2)) * self._size
        near, which = rng.uniform(-0.4, 0.4, (count, 2)) * span, rng.random(count)
        for one in np.flatnonzero(rng.random(count) < plan.on_crowd):
            places = self._places[chosen[one]]
            if len(places):
                row, column = places[int(which[one] * len(places))]
                centre[one] = np.array([column + 0.5, row + 0.5]) * LABEL_STRIDE + near[one]
        margin = np.minimum(0.5 * span, 0.5 * self._size)
        centre = np.clip(centre, margin, self._size - margin)
        turn = np.radians(rng.uniform(-plan.rotation_deg, plan.rotation_deg, count))
        mirror = np.where(rng.random(count) < 0.5, 1.0, -1.0)
        return affine(centre, scale, turn, mirror)

    def _cropped(self, chosen: NDArray[np.int64], frames_from_crops: NDArray[np.float64]) -> Batch:
        index = torch.from_numpy(chosen).to(self._device)
        images = self._images[index].permute(0, 3, 1, 2).float() / 255.0
        # Bilinear values would show the network softer pictures than those it will be used on.
        image = self._resampled(images, frames_from_crops, 1, "bicubic").clamp_(0.0, 1.0)
        labels = self._labels[index].float() / 255.0
        return labelled_batch(image, self._resampled(labels, frames_from_crops, LABEL_STRIDE, "bilinear"))

    def _resampled(
        self, values: Tensor, frames_from_crops: NDArray[np.float64], stride: int, mode: str
    ) -> Tensor:
        """Values of whole frames [B, C, h, w] at every `stride`th pixel of the crops; 0 outside."""
        plan = self._plan
        # `affine_grid` wants it from [-1, 1] of the crop to [-1, 1] of the frame.
        matrix = frames_from_crops * np.array([plan.width / 2, plan.height / 2, 1.0])
        matrix[:, :, 2] -= self._size / 2
        matrix *= (2.0 / self._size)[:, None]
        size = [len(matrix), 1, plan.height // stride, plan.width // stride]
        theta = torch.from_numpy(matrix.astype(np.float32)).to(self._device)
        at = functional.affine_grid(theta, size, align_corners=False)
        return functional.grid_sample(values, at, mode=mode, align_corners=False)
