"""Zones, and where on Earth their local frame lies."""

from __future__ import annotations

from dataclasses import dataclass

from crowdfence.georeference import Georeference
from crowdfence.zones import Zone


@dataclass(frozen=True, slots=True)
class PlacedZones:
    """What is to be closed."""

    zones: tuple[Zone, ...]
    georeference: Georeference
    begun_ns: int | None = None
    """The first instant of the mission that they are of, where it is told."""
    stamp_ns: int | None = None
    """The instant that they are of, where it is told."""

    def at(self, stamp_ns: int) -> tuple[Zone, ...]:
        """Without those that ended before a stamp by themselves."""
        return tuple(
            zone for zone in self.zones if zone.valid_until_ns is None or zone.valid_until_ns > stamp_ns
        )
