"""Zones as ED-269 (EUROCAE, the older JSON form of UAS geographical zones).

Longitude comes before latitude, as national files have it (the samples of the Swiss authority), although a
package of types says otherwise. Limits are whole metres, rounded outward. Readers do not agree what rings
beyond the first are, holes or areas of their own: none are written, holes are closed. It knows heights above
the ground and the sea alone, not above the ellipsoid.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from crowdfence.exports.geographic_outline import polygons_of
from crowdfence.exports.one_a_line import one_a_line
from crowdfence.exports.zone_formats.times import rfc3339
from crowdfence.exports.zone_formats.zone_export import ZoneExport
from crowdfence.zones import Zone

_RESTRICTIONS = {"prohibited": "PROHIBITED", "no_sustained_flight": "CONDITIONAL"}
_MESSAGES = {"no_sustained_flight": {"message": "No sustained flight above the zone."}}
"""For people: of `restrictionConditions` readers do not agree whether it is a text or a list."""


def ed269(export: ZoneExport, *, as_list: bool = False) -> str:
    """A document with the zones under "features" or, `as_list`, "UASZoneList"; both are in use. ValueError
    for heights above the ellipsoid."""
    export.country_code()  # also where there is no zone to name it
    if export.datum == "WGS84":
        raise ValueError("ED-269 knows no heights above the ellipsoid (WGS84); use AGL or AMSL, or ED-318")
    zones = [_zone(zone, export) for zone in export.zones]
    if as_list:
        head = {"formatVersion": "1.0.0", "createdAt": rfc3339(export.stamp_ns)}
        return one_a_line(head, "UASZoneList", zones)
    return one_a_line({"title": f"Crowd zones {export.mission}".strip()}, "features", zones)


def _zone(zone: Zone, export: ZoneExport) -> dict[str, Any]:
    end = {} if zone.valid_until_ns is None else {"endDateTime": rfc3339(zone.valid_until_ns, up=True)}
    email = {} if export.contact is None else {"email": export.contact}
    other = {} if zone.kind == "crowd" else {"otherReasonInfo": f"{zone.kind} ground"}
    return {
        "identifier": zone.id,
        "country": export.country_code(),
        "name": export.name_of(zone),
        "type": "COMMON",
        "restriction": _RESTRICTIONS[zone.restriction],
        "reason": ["POPULATION" if zone.kind == "crowd" else "OTHER"],
        **other,
        **_MESSAGES.get(zone.restriction, {}),
        "applicability": [{"permanent": "NO", "startDateTime": rfc3339(export.start_ns(zone)), **end}],
        "zoneAuthority": [{"name": export.authority[:200], "purpose": "INFORMATION", **email}],
        "geometry": [_geometry(part, zone, export) for part in polygons_of(export.outline(zone))],
    }


def _geometry(part: Any, zone: Zone, export: ZoneExport) -> dict[str, Any]:
    from shapely.geometry.polygon import orient

    # One of others above the ellipsoid stays so where heights are above the ground.
    band = export.band(zone, "AMSL" if zone.band.datum == "WGS84" else None)
    return {
        "uomDimensions": "M",
        "lowerLimit": math.floor(band.lower_m),
        "lowerVerticalReference": band.datum,
        "upperLimit": math.ceil(band.upper_m),
        "upperVerticalReference": band.datum,
        "horizontalProjection": {
            "type": "Polygon",
            "coordinates": [np.asarray(orient(part, 1.0).exterior.coords).tolist()],
        },
    }
