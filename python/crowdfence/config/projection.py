"""How views are projected onto the terrain."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from crowdfence.plain_values import make_plain

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract


@dataclass(frozen=True, slots=True)
class ProjectionConfig:
    """ValueError for a range that is not positive: it decides early whether cameras and terrain are apart.
    The core checks the other values when it takes them."""

    max_range_m: float = 300.0
    """Rays end here; > 0."""
    target_height_m: float | None = None
    """Height above ground at which people are marked, >= 0; None: the detector's own, or 0 (the paper)."""
    coverage: Literal["rays", "full"] = "full"
    """All ground in view, also between the pixels, or what the rays of pixels hit, as in the paper."""
    surface: Literal["planes", "voxels"] = "planes"
    """Rays meet the surface in the voxels, or the voxels as cubes, as in the paper."""

    def __post_init__(self) -> None:
        make_plain(self)
        if not 0.0 < self.max_range_m < float("inf"):
            raise ValueError(f"max_range_m is {self.max_range_m:g}; it must be finite and > 0")

    def with_detector(self, contract: Contract | None) -> ProjectionConfig:
        """The same with what is left to the detector filled in."""
        if self.target_height_m is not None:
            return self
        stated = None if contract is None else contract.target_height_m
        return replace(self, target_height_m=0.0 if stated is None else stated)
