"""What is exported of the zones of one moment, and what the file has to know besides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdfence.exports.geographic_outline import ellipsoidal_heights, geographic_outline, polygons_of
from crowdfence.exports.zone_formats.geoid import geoid_heights_m
from crowdfence.georeference import Georeference
from crowdfence.zones import AltitudeBand, Zone
from crowdfence.zones.altitude_band import HIGHEST_GROUND_M, LOWEST_GROUND_M, Datum
from crowdfence.zones.zone import closed_of

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

SOFTWARE = "crowdfence"


@dataclass(frozen=True, slots=True)
class ZoneExport:
    """Zones, when and where they hold, and who says so."""

    zones: Sequence[Zone]
    """Of a `ZoneSet` all that it closes."""
    stamp_ns: int
    """Instant whose zones these are: they hold from here."""
    georeference: Georeference
    mission: str = ""
    method: str = ""
    threshold: float | None = None
    country: str | None = None
    """ISO 3166 alpha-3, for formats of authorities."""
    authority: str = "fleet operator"
    """Who is responsible for the zones."""
    contact: str | None = None
    """E-mail address of the authority."""
    datum: Datum = "AGL"
    """Of the heights that the file states."""
    max_items: int = 63
    """Capacity of an autopilot's fence, in corners and circles."""
    starts_ns: Mapping[str, int] = field(default_factory=dict)
    """From when on zones hold that hold later, by id."""

    def __post_init__(self) -> None:
        """ValueError for a contact that is no e-mail address, which the schema of ED-318 refuses."""
        object.__setattr__(self, "zones", closed_of(self.zones))
        if self.contact is not None:
            name, at, host = self.contact.partition("@")
            if not (name and at and host) or any(c.isspace() or c == "@" for c in name + host):
                raise ValueError(f"contact is {self.contact!r}; it must be an e-mail address")

    def country_code(self) -> str:
        """ValueError where no country is given, or it has no three letters."""
        code = self.country
        if code is None or len(code) != 3 or not (code.isascii() and code.isalpha() and code.isupper()):
            told = "no country is given" if code is None else f"country is {code!r}"
            raise ValueError(f"{told}; this format needs three letters of ISO 3166, such as country=GRC")
        return code

    @staticmethod
    def name_of(zone: Zone) -> str:
        """For people, at most 200 characters: the zone's own name, or its kind and id."""
        return (zone.name or f"{zone.kind.capitalize()} {zone.id}")[:200]

    def start_ns(self, zone: Zone) -> int:
        """From when on it holds."""
        return max(self.stamp_ns, self.starts_ns.get(zone.id, self.stamp_ns))

    def outline(self, zone: Zone, **options: Any) -> Polygon | MultiPolygon:
        """Longitude and latitude, see `geographic_outline`."""
        return geographic_outline(zone, self.georeference, **options)

    def band(self, zone: Zone, datum: Datum | None = None) -> AltitudeBand:
        """From which height to which, above `datum`, that of the export by default. A band above ground is as
        much thicker above another one as the ground is uneven; where the ground is not known it holds every
        ground on Earth. A band above the sea or the ellipsoid, of a zone of others, stays so where `datum` is
        the ground, and becomes thicker by all heights of the sea where it is the other one of the two.
        ValueError where the geoid is not known."""
        datum = self.datum if datum is None else datum
        if zone.band.datum == datum:
            return zone.band
        if zone.band.datum == "AMSL":
            return zone.band.above_ellipsoid() if datum == "WGS84" else zone.band
        if zone.band.datum == "WGS84":
            return zone.band.above_sea() if datum == "AMSL" else zone.band
        if not zone.ground_is_known:
            return zone.band.above(LOWEST_GROUND_M, HIGHEST_GROUND_M, datum)
        lower_m, upper_m = ellipsoidal_heights(zone, self.georeference)
        if datum == "AMSL":
            # Part by part: the antimeridian may lie between two, and all of the Earth between their bounds.
            parts = [geoid_heights_m(np.array(part.bounds)) for part in polygons_of(self.outline(zone))]
            lower_m, upper_m = lower_m - max(map(max, parts)), upper_m - min(map(min, parts))
        return zone.band.above(lower_m, upper_m, datum)
