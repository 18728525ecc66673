"""How well a network does on whole frames of missions that it is not trained on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from crowdfence.block_means import block_means
from crowdfence.detector_training.frame_store import StoredMission
from crowdfence.detector_training.labels import LABELS_PER_CELL, STRIDE, Target
from crowdfence.detector_training.loss import crowd_loss
from crowdfence.detector_training.network import CrowdNet, padded
from crowdfence.evaluation.cells.rates import Confusion

BATCH = 4


@dataclass(frozen=True, slots=True)
class ValidationScore:
    """Figures over all known cells of all validation frames, at threshold 0.5."""

    loss: float
    cells: dict[Target, Confusion]

    def iou(self, target: Target) -> float:
        """Pixel IoU; NaN when there is no crowd, neither called nor true."""
        of = self.cells[target]
        union = of.true_positives + of.false_positives + of.false_negatives
        return of.true_positives / union if union else float("nan")

    @property
    def mean_iou(self) -> float:
        """Over the targets: what decides which weights are kept."""
        return sum(self.iou(target) for target in self.cells) / len(self.cells)


@torch.no_grad()
def validate(
    network: CrowdNet, missions: Sequence[StoredMission], targets: Sequence[Target], device: torch.device
) -> ValidationScore:
    """Score `network` on every frame, each of its own size and padded as for use."""
    network.eval()
    counts = {target: Confusion(0, 0, 0, 0) for target in targets}
    loss_sum, frames = 0.0, 0
    for mission in missions:
        together = BATCH if mission.sizes is None else 1
        for first in range(0, len(mission), together):
            some = slice(first, first + together)
            height, width = mission.size_of(first)
            rows, columns = height // STRIDE, width // STRIDE
            image = torch.from_numpy(mission.images[some, :height, :width].copy()).to(device)
            logits = network(padded(image.permute(0, 3, 1, 2).float() / 255.0))[:, :, :rows, :columns]
            within = (some, slice(None), slice(rows * LABELS_PER_CELL), slice(columns * LABELS_PER_CELL))
            crowd = torch.from_numpy(block_means(mission.crowd[within], LABELS_PER_CELL) >= 127.5).to(device)
            known = torch.from_numpy(block_means(mission.known[within], LABELS_PER_CELL) > 0.5).to(device)
            loss_sum += len(image) * float(crowd_loss(logits, crowd.float(), known.float(), dice_weight=0.0))
            frames += len(image)
            for plane, target in enumerate(targets):
                kept = known[:, plane]
                called = logits[:, plane][kept] > 0.0
                counts[target] += Confusion.of(called.cpu().numpy(), crowd[:, plane][kept].cpu().numpy())
    return ValidationScore(loss_sum / frames, counts)
