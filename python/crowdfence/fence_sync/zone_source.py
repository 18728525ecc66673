"""What a fence is made of: zones of a file or a live service, those of others that stay closed beside them,
and the ground in which a vehicle halts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from crowdfence.fence_sync.placed_zones import PlacedZones, ground_heights
from crowdfence.static_zones import read_static_zones
from crowdfence.zones import Zone
from crowdfence.zones.grow import grown


class ZonePlace(Protocol):
    """Where zones come from: `ZoneFile`, `ServiceZones`."""

    def read(self) -> PlacedZones: ...

    def has_changed(self) -> bool: ...


class ZoneSource:
    """A place of zones, files of others and a margin."""

    def __init__(self, place: ZonePlace, static_zones: Sequence[Path] = (), margin_m: float = 0.0) -> None:
        """`static_zones` are read once. `margin_m` is closed around all of them: in it a vehicle halts that
        acts once it is in its fence."""
        self._place = place
        self._margin_m = margin_m
        self._wider: dict[int, tuple[Zone, Zone]] = {}
        self._static = list(static_zones)
        self._others: PlacedZones | None = None
        self._is_unread = False
        """Whether the files of others could not be read."""
        self.left_out: list[str] = []
        """What the files of others hold and closes nothing, and why."""

    def read(self) -> PlacedZones:
        """What is there now, and the zones of others. OSError, or ValueError that names the file."""
        placed = self._place.read()
        zones = (*placed.zones, *self._others_beside(placed))
        return replace(placed, zones=self._with_margins(zones) if self._margin_m > 0.0 else zones)

    def has_changed(self) -> bool:
        """Whether `read` gives something else than the last time, or may do so where it failed."""
        return self._is_unread or self._place.has_changed()

    def _others_beside(self, placed: PlacedZones) -> tuple[Zone, ...]:
        """In the same local frame."""
        if self._others is None or self._others.georeference != placed.georeference:
            taken = {zone.id for zone in placed.zones}
            try:
                zones, self.left_out = read_static_zones(self._static, placed.georeference, taken)
            except OSError:
                self._is_unread = True  # and may be readable later
                raise
            self._is_unread = False
            self._others = PlacedZones(zones, placed.georeference)
        return self._others.zones

    def _with_margins(self, zones: Sequence[Zone]) -> tuple[Zone, ...]:
        """Of zones that are those of the last time, as those of others, what was worked out then."""
        # With the zone itself, so that nothing else comes to have its number.
        self._wider = {id(zone): self._wider.get(id(zone)) or (zone, self._wide(zone)) for zone in zones}
        return tuple(self._wider[id(zone)][1] for zone in zones)

    def _wide(self, zone: Zone) -> Zone:
        """With all ground within the margin, at the heights to which it falls away from the local plane."""
        if zone.polygon.is_empty:
            return zone
        wider = grown(zone.polygon, self._margin_m)
        (low_m, high_m), (lower_m, upper_m) = ground_heights(zone.polygon), ground_heights(wider)
        return replace(
            zone,
            polygon=wider,
            lower_m=zone.lower_m + lower_m - low_m,
            upper_m=zone.upper_m + upper_m - high_m,
        )
