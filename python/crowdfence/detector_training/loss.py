"""What training minimises."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def crowd_loss(logits: Tensor, crowd: Tensor, known: Tensor, *, dice_weight: float) -> Tensor:
    """Cross-entropy per known cell plus `dice_weight` times one minus Dice, both per target and averaged.

    logits, crowd, known [B, T, h, w]. Dice lifts the few crowd cells above the many empty ones and so brings
    IoU, at the price of too much certainty: end a training with `dice_weight` 0.
    """
    entropy = functional.binary_cross_entropy_with_logits(logits, crowd, weight=known, reduction="sum")
    loss = entropy / known.sum().clamp_min(1.0)
    if dice_weight > 0.0:
        loss = loss + dice_weight * (1.0 - _dice(torch.sigmoid(logits) * known, crowd * known)).mean()
    return loss


def _dice(probability: Tensor, crowd: Tensor) -> Tensor:
    """[T], over the whole batch: a crop without crowd has none of its own."""
    both = (probability * crowd).sum(dim=(0, 2, 3))
    total = probability.sum(dim=(0, 2, 3)) + crowd.sum(dim=(0, 2, 3))
    return (2.0 * both + 1.0) / (total + 1.0)
