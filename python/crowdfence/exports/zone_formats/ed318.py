"""Zones as ED-318 (EUROCAE, the JSON form of UAS geographical zones in the EU)."""

from __future__ import annotations

from typing import Any

from crowdfence.exports.geographic_outline import geojson_geometry
from crowdfence.exports.one_a_line import one_a_line
from crowdfence.exports.zone_formats.times import rfc3339
from crowdfence.exports.zone_formats.zone_export import SOFTWARE, ZoneExport
from crowdfence.zones import Zone

_TYPES = {"prohibited": "PROHIBITED", "no_sustained_flight": "CONDITIONAL"}
_CONDITION = "No sustained flight above the zone."


def ed318(export: ZoneExport) -> str:
    """A collection with one feature per zone. ValueError without a country."""
    export.country_code()  # also where there is no zone to name it
    start = rfc3339(export.stamp_ns)
    head = {
        "type": "FeatureCollection",
        "name": f"Crowd zones {export.mission}".strip()[:200],
        "metadata": {
            "issued": start,
            "validFrom": start,
            "provider": [_text(export.authority)],
            "description": [_text(f"No-fly zones of {SOFTWARE}. Ground outside is not known to be free.")],
        },
    }
    return one_a_line(head, "features", [_feature(zone, export) for zone in export.zones])


def _feature(zone: Zone, export: ZoneExport) -> dict[str, Any]:
    band = export.band(zone)
    layer = {
        "upper": band.upper_m,
        "upperReference": band.datum,
        "lower": band.lower_m,
        "lowerReference": band.datum,
        "uom": "m",
    }
    properties = {
        "identifier": zone.id,
        "country": export.country_code(),
        "name": [_text(export.name_of(zone))],
        "type": _TYPES[zone.restriction],
        "variant": "COMMON",
        "reason": ["POPULATION" if zone.kind == "crowd" else "OTHER"],
        "limitedApplicability": [_period(zone, export.start_ns(zone))],
        "zoneAuthority": [_authority(export)],
        "extendedProperties": _extended(zone),
    }
    if zone.kind != "crowd":
        properties["otherReasonInfo"] = [_text(f"{zone.kind} ground")]
    if zone.restriction == "no_sustained_flight":
        properties["restrictionConditions"] = _CONDITION
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {**geojson_geometry(export.outline(zone)), "layer": layer},
    }


def _period(zone: Zone, start_ns: int) -> dict[str, str]:
    end = {} if zone.valid_until_ns is None else {"endDateTime": rfc3339(zone.valid_until_ns, up=True)}
    return {"startDateTime": rfc3339(start_ns), **end}


def _authority(export: ZoneExport) -> dict[str, Any]:
    email = {} if export.contact is None else {"email": export.contact}
    return {"name": [_text(export.authority)], "purpose": "INFORMATION", **email}


def _extended(zone: Zone) -> dict[str, Any]:
    if zone.kind != "crowd":
        return {"kind": zone.kind}
    return {
        "kind": zone.kind,
        "crowdProbability": zone.probability_max,
        **({} if zone.interval is None else {"crowdProbabilityInterval": list(zone.interval)}),
        "crowdAreaM2": zone.area_m2,
        "seenBy": list(zone.seen_by),
        "lastSeen": rfc3339(zone.last_seen_ns),
        "reason": zone.reason,
    }


def _text(text: str) -> dict[str, str]:
    return {"text": text[:200], "lang": "en-GB"}
