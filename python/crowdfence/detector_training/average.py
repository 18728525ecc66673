"""Exponential moving average of a network's weights: steadier than the weights of any one step."""

from __future__ import annotations

import copy

import torch

from crowdfence.detector_training.network import CrowdNet


class WeightAverage:
    """Keeps `network` averaged over the last 1 / (1 - decay) steps or so; early on over fewer."""

    def __init__(self, network: CrowdNet, decay: float) -> None:
        self.network: CrowdNet = copy.deepcopy(network).eval().requires_grad_(False)
        self._decay = decay

    @torch.no_grad()
    def update(self, network: CrowdNet, step: int) -> None:
        decay = min(self._decay, (1 + step) / (10 + step))
        new = network.state_dict()
        for name, value in self.network.state_dict().items():
            if value.dtype.is_floating_point:
                value.lerp_(new[name].to(value.dtype), 1.0 - decay)
            else:
                value.copy_(new[name])
