"""How closely to look at a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class InspectionOptions:
    """How closely to look."""

    tolerance_ms: float = 100.0
    """Frames of different drones this close in time form one instant."""
    max_range_m: float = 300.0
    """Views end here."""
    sampled_instants: int = 12
    """Instants, evenly spread, whose views are projected onto the terrain."""
    quick: bool = False
    """Leave out what takes seconds: the landing prior of a map, the overlap of views."""
    check_pixels: bool = False
    """Read the heatmap, image and truth of every frame; what cannot be read, or shows nothing, is reported
    as damaged, and heatmaps in the wrong units as doubtful."""
    terrain_options: Mapping[str, Any] = field(default_factory=dict)
    """Options of the map's reader, see `crowdfence.maps.open_terrain`."""
    source_options: Mapping[str, Any] = field(default_factory=dict)
    """Options of the recording's reader, see `crowdfence.open_recording`."""

    def __post_init__(self) -> None:
        if not (0.0 < self.max_range_m < float("inf")):
            raise ValueError(f"max_range_m is {self.max_range_m}, must be finite and > 0")
        if self.sampled_instants < 1:
            raise ValueError(f"sampled_instants is {self.sampled_instants}, must be at least 1")
