"""What becomes a no-fly zone, and how long ground counts as known."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ZoneConfig:
    """Checked here and not where it is used: that is after the last frame. ValueError for a value out of
    bounds."""

    threshold: float | None = None
    """Probability from which ground is crowd, in (0, 1]; None: the method's own."""
    min_area_m2: float = 0.0
    """Smaller regions are dropped from the zones, and counted; finite and >= 0."""
    stale_after_s: float = 30.0
    """Empty ground not seen for longer is stale, >= 0: no evidence of absence any more."""

    def __post_init__(self) -> None:
        if self.threshold is not None and not 0.0 < self.threshold <= 1.0:
            raise ValueError(f"threshold is {self.threshold:g}; it must be in (0, 1]")
        if not 0.0 <= self.min_area_m2 < float("inf"):
            raise ValueError(f"min_area_m2 is {self.min_area_m2:g}; it must be finite and >= 0")
        if not self.stale_after_s >= 0.0:
            raise ValueError(f"stale_after_s is {self.stale_after_s:g}; it must be >= 0")
