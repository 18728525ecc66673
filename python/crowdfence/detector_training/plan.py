"""What decides the result of a training, besides the missions."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from crowdfence.detector_training.crops import CropPlan
from crowdfence.detector_training.labels import Target

SMALLEST_WIDTH = 1 / 16
"""One channel where crowdnet-s has 16, its fewest."""


@dataclass(frozen=True, slots=True)
class TrainingPlan:
    """Equal plans, missions and machines give equal weights."""

    targets: tuple[Target, ...] = ("ground",)
    width: float = 1.0
    """Scale of the channel counts; 1 is crowdnet-s."""
    steps: int = 16_000
    batch: int = 16
    learning_rate: float = 3e-3
    warm_up_steps: int = 200
    """At most a quarter of all: a short training reaches its rate too."""
    weight_decay: float = 1e-4
    dice_weight: float = 0.5
    calm_share: float = 0.2
    """Share of the steps at the end without Dice, which would leave the network too sure of itself."""
    average_decay: float = 0.998
    validate_every: int = 500
    patience: int = 8
    """Validations without improvement before training stops; counted outside the calm steps."""
    seed: int = 0
    seasons: bool = False
    """One material recoloured at a time, mist and dusk: `augmentation.varied`."""
    wide: bool = False
    """Beyond what was rendered: the clutter of `clutter`, the cameras of `photography`."""
    vibrance: float = 1.0
    """How vibrant pictures are shown, in training as in use; of the model that it starts from."""
    frozen_statistics: bool = False
    """Batch normalisation keeps the statistics that it starts with."""
    crops: CropPlan = field(default_factory=CropPlan)

    def __post_init__(self) -> None:
        for name in ("steps", "batch", "validate_every", "patience"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be at least 1")
        for name in ("width", "learning_rate"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name):g}; it must be above 0 and finite")
        if self.width < SMALLEST_WIDTH:
            raise ValueError(
                f"width is {self.width:g}; below {SMALLEST_WIDTH:g} a layer would have no channel"
            )
        if not self.targets or len(set(self.targets)) < len(self.targets):
            raise ValueError(f"targets are {self.targets}; name each wanted one once")

    @property
    def calm_from(self) -> int:
        """First step without Dice."""
        return self.steps - round(self.calm_share * self.steps)

    def learning_rate_at(self, step: int) -> float:
        """Linear warm-up, then a half cosine down to a hundredth."""
        warm_up = min(self.warm_up_steps, self.steps // 4)
        if step < warm_up:
            return self.learning_rate * (step + 1) / warm_up
        done = (step - warm_up) / max(1, self.steps - warm_up)
        return self.learning_rate * (0.01 + 0.99 * 0.5 * (1.0 + math.cos(math.pi * min(1.0, done))))
