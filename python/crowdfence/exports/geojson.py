"""Zones as GeoJSON (RFC 7946).

With a georeference the coordinates are WGS84 longitude and latitude (`geographic_outline`).

Without a georeference there is no longitude and latitude to write. The coordinates are then local metres, the
file says so ("crs": null, which readers take as "no CRS", and "coordinate_frame"), and it is not RFC 7946.
"""

from __future__ import annotations

from dataclasses import asdict
from os import PathLike
from typing import Any

from crowdfence.atomic_file import write_bytes
from crowdfence.exports.geographic_outline import ellipsoidal_heights, geographic_outline, geojson_geometry
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.one_a_line import one_a_line
from crowdfence.georeference import Georeference
from crowdfence.iso_time import iso_utc
from crowdfence.zones import Zone, ZoneSet

_ABSENCE = (
    "Ground outside the zones is not known to be free: it may never have been seen. "
    "The state band of the map says which."
)
LOCAL_FRAME = {
    "name": "local east-north-up metres",
    "axes": ["east", "north"],
    "unit": "metre",
    "georeferenced": False,
    "note": "The recording has no georeference: these are local metres, not longitude and latitude.",
}


def write_geojson(
    path: str | PathLike[str],
    zones: ZoneSet,
    description: MapDescription,
    georeference: Georeference | None,
) -> None:
    """Write what `zones_geojson` gives. OSError when the file cannot be written."""
    write_bytes(path, zones_geojson(zones, description, georeference).encode())


def zones_geojson(zones: ZoneSet, description: MapDescription, georeference: Georeference | None) -> str:
    """One Feature per zone, those of unseen ground and of others too, and what was left out, as a
    FeatureCollection. ValueError when a zone lies within one degree of a pole."""
    head: dict[str, Any] = {"type": "FeatureCollection", "crowdfence": _collection(zones, description)}
    if georeference is None:
        head |= {"crs": None, "coordinate_frame": LOCAL_FRAME}
    features = [_feature(zone, zones, description, georeference) for zone in zones.closed]
    return one_a_line(head, "features", features)


def _collection(zones: ZoneSet, description: MapDescription) -> dict[str, Any]:
    return {
        **_what_and_when(zones, description),
        "parameters": dict(description.parameters),
        "mission": description.mission,
        "drones": list(description.drones),
        **_stamp("first_instant", description.first_stamp_ns),
        "zones": len(zones),
        "zones_area_m2": zones.area_m2,
        "min_area_m2": zones.min_area_m2,
        "dropped_regions": zones.dropped_count,
        "dropped_area_m2": zones.dropped_area_m2,
        "outside": _ABSENCE,
    }


def _what_and_when(zones: ZoneSet, description: MapDescription) -> dict[str, Any]:
    return {
        "method": description.method,
        "threshold": zones.threshold,
        **_stamp("stamp", description.stamp_ns),
    }


def _stamp(name: str, stamp_ns: int | None) -> dict[str, Any]:
    # Text keeps the nanoseconds for readers whose numbers are doubles (JavaScript).
    return {f"{name}_utc": None if stamp_ns is None else iso_utc(stamp_ns), f"{name}_ns": stamp_ns}


def _feature(
    zone: Zone, zones: ZoneSet, description: MapDescription, georeference: Georeference | None
) -> dict[str, Any]:
    outline = zone.polygon if georeference is None else geographic_outline(zone, georeference)
    return {
        "type": "Feature",
        "id": zone.id,
        "geometry": geojson_geometry(outline),
        "properties": {
            "id": zone.id,
            "kind": zone.kind,
            **({} if zone.name is None else {"name": zone.name}),
            "restriction": zone.restriction,
            "reason": zone.reason,
            **_what_and_when(zones, description),
            **_stamp("valid_until", zone.valid_until_ns),
            **_stamp("forgotten_at", zone.forgotten_ns),
            "closed_m2": zone.polygon.area,
            "lower_m": zone.band.lower_m,
            "upper_m": zone.band.upper_m,
            "datum": zone.band.datum,
            **({} if zone.kind == "static" else _ground(zone, georeference)),
            **(_crowd(zone, description) if zone.kind == "crowd" else {}),
        },
    }


def _ground(zone: Zone, georeference: Georeference | None) -> dict[str, float]:
    heights = {} if georeference is None else _heights(zone, georeference)
    known = {"ground_is_known": zone.ground_is_known}
    return {"ground_lower_m": zone.lower_m, "ground_upper_m": zone.upper_m, **heights, **known}


def _crowd(zone: Zone, description: MapDescription) -> dict[str, Any]:
    return {
        "area_m2": zone.area_m2,
        "probability_max": zone.probability_max,
        "probability_mean": zone.probability_mean,
        "probability_interval": None if zone.interval is None else list(zone.interval),
        **_stamp("created", zone.created_ns),
        "evidence": [asdict(look) for look in zone.evidence],
        "cells": zone.cell_count,
        "seen_by": list(zone.seen_by),
        **_stamp("last_seen", zone.last_seen_ns),
        "last_seen_age_s": _age_s(zone.last_seen_ns, description.stamp_ns),
        **_stamp("oldest_look", zone.oldest_look_ns),
        "oldest_look_age_s": _age_s(zone.oldest_look_ns, description.stamp_ns),
    }


def _age_s(look_ns: int, stamp_ns: int) -> float:
    return (stamp_ns - look_ns) / 1e9


def _heights(zone: Zone, georeference: Georeference) -> dict[str, float]:
    lower_m, upper_m = ellipsoidal_heights(zone, georeference)
    return {"ground_lower_wgs84_m": lower_m, "ground_upper_wgs84_m": upper_m}
