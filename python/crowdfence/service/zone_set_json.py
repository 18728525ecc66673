"""All zones of a moment for JSON. Those of others may be thousands, a national file, and no step changes
them: they are made once, and left out for whoever has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from crowdfence.service.stamps import moment_json
from crowdfence.service.timeline import Moment
from crowdfence.service.zone_json import zone_json
from crowdfence.zones import Zone
from crowdfence.zones.history import zones_digest
from crowdfence.zones.zone import are_same

ANY_VERSION = "*"
"""For whoever asks for the zones of others where it lacks those of a version."""


@dataclass(frozen=True, slots=True, eq=False)
class _Static:
    """Zones of others as they are told."""

    zones: tuple[Zone, ...]
    told: tuple[dict[str, Any], ...]
    version: str | None
    """The same for the same zones, in another process too; None for no zone."""

    @staticmethod
    def of(zones: Sequence[Zone]) -> _Static:
        told = tuple(zone_json(zone, {}) for zone in zones)
        return _Static(tuple(zones), told, zones_digest(zones)[:16] if told else None)


class ZoneSetJson:
    """Makes it, from any thread."""

    def __init__(self) -> None:
        self._static = _Static.of(())

    def of(self, moment: Moment, without_static: str | None = None) -> dict[str, Any]:
        """The zones of others last, and not of the version that `without_static` names, or of any."""
        static = self._of_others(moment.of_others)
        left_out = static.version is not None and without_static in (static.version, ANY_VERSION)
        return {
            **moment_json("stamp", moment.stamp_ns),
            "threshold": moment.zones.threshold,
            "dropped_m2": moment.zones.dropped_area_m2,
            "static_version": static.version,
            "static_left_out": left_out,
            "zones": [
                *(zone_json(zone, moment.marks.get(zone.id, {})) for zone in moment.own.closed),
                *(() if left_out else static.told),
            ],
        }

    def _of_others(self, zones: Sequence[Zone]) -> _Static:
        known = self._static
        if are_same(zones, known.zones):
            return known
        self._static = made = _Static.of(zones)
        return made
