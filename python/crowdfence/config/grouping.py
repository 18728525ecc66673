"""Which frames of different drones count as simultaneous."""

from __future__ import annotations

from dataclasses import dataclass

from crowdfence.plain_values import make_plain


@dataclass(frozen=True, slots=True)
class GroupingConfig:
    """ValueError for a tolerance that is negative or not finite."""

    tolerance_ms: float = 100.0
    """Frames of different drones this close in time form one instant."""

    def __post_init__(self) -> None:
        make_plain(self)
        if not 0.0 <= self.tolerance_ms < float("inf"):
            raise ValueError(f"tolerance_ms is {self.tolerance_ms:g}; it must be finite and not negative")
