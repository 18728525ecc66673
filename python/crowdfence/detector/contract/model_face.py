"""What the graph of a model says about itself: its tensors and its metadata."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

Dimension = int | str | None


@dataclass(frozen=True, slots=True)
class Tensor:
    name: str
    dtype: str
    """As numpy writes it: uint8, float32 ..."""
    shape: tuple[Dimension, ...]
    """A number where the model fixes it, else a name or None."""

    def __str__(self) -> str:
        return f"{self.name} {self.dtype} [{', '.join(str(side or '?') for side in self.shape)}]"


@dataclass(frozen=True, slots=True)
class ModelFace:
    path: Path
    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]
    metadata: Mapping[str, str] = field(hash=False)
