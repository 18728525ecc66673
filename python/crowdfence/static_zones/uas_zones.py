"""Geographical zones of authorities: ED-318 (GeoJSON with layers) and ED-269, in both of its outer forms.

Both have longitude before latitude. Times and schedules are not looked at: a zone that holds at times is
closed always. Zones that ask for an authorisation, or have conditions, are closed like those that prohibit.

Rings of ED-269 beyond the first are areas of their own, as InterUSS reads them: others take them for holes,
and a hole that may be none opens nothing. ED-318 is GeoJSON and has holes.

Where ED-269 gives heights in feet, national files give the radius of a circle in metres all the same (5 NM is
9260 there), and so do most programs; InterUSS takes feet for both. It is taken for metres, the larger one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from crowdfence.static_zones.given_zone import (
    GivenCircle,
    GivenPolygon,
    GivenZone,
    band_of,
    in_one,
    metres,
    naming,
    ring_of,
)

OPEN_TYPES = ("NO_RESTRICTION", "USPACE")
"""What does not keep anybody out by itself."""


def is_ed318(document: Mapping[str, Any]) -> bool:
    """By any feature: the schema lets the first be without properties."""
    told = (feature.get("properties") for feature in document.get("features") or [])
    return any(isinstance(one, dict) and "variant" in one and "identifier" in one for one in told)


def is_ed269(document: Mapping[str, Any]) -> bool:
    if "UASZoneList" in document:
        return True
    features = document.get("features")
    if features == []:  # a file of no zones, which is no GeoJSON either
        return "type" not in document
    first = (features or [{}])[0]
    return "identifier" in first and "geometry" in first


def ed318_zones(document: Mapping[str, Any], left_out: list[str]) -> Iterator[GivenZone]:
    """ValueError or KeyError where something is missing."""
    for number, feature in enumerate(document["features"], start=1):
        properties = feature["properties"]
        if properties is None:  # nothing says that it keeps nobody out
            properties = {"identifier": f"feature {number}", "type": None}
        name = str(properties["identifier"])
        with naming(name):
            if properties["type"] in OPEN_TYPES:
                left_out.append(f"{name}: {properties['type']} keeps nobody out")
            elif feature["geometry"] is None:
                left_out.append(f"{name}: no geometry, closes no ground")
            else:
                title = _text(properties.get("name"))
                yield from in_one(_layered(name, title, feature["geometry"], left_out))


def _text(name: Any) -> str:
    """ED-318 gives texts in several languages, ED-269 one; the first."""
    first = name[0] if isinstance(name, list) and name else name
    text = first.get("text") if isinstance(first, dict) else first
    return text.strip() if isinstance(text, str) else ""


def _layered(name: str, title: str, geometry: Mapping[str, Any], left_out: list[str]) -> Iterator[GivenZone]:
    if geometry["type"] == "GeometryCollection":
        if not geometry["geometries"]:
            left_out.append(f"{name}: no geometry, closes no ground")
        for part in geometry["geometries"]:
            yield from _layered(name, title, part, left_out)
        return
    layer = geometry.get("layer") or {}
    band = band_of(
        name,
        (layer.get("lower"), layer.get("upper")),
        layer.get("uom", "m"),
        (layer.get("lowerReference", "AGL"), layer.get("upperReference", "AGL")),
    )
    if geometry["type"] == "Point":
        circle = GivenCircle(ring_of([geometry["coordinates"]]), float(geometry["extent"]["radius"]))
        yield GivenZone(name, [circle], band, title=title)
    elif geometry["type"] in ("Polygon", "MultiPolygon"):
        shapes = geometry["coordinates"]
        parts = [
            GivenPolygon([ring_of(ring) for ring in rings])
            for rings in ([shapes] if geometry["type"] == "Polygon" else shapes)
        ]
        yield GivenZone(name, parts, band, title=title)
    else:
        raise ValueError(f"zone {name!r} has a {geometry['type']}, which closes no ground")


def ed269_zones(document: Mapping[str, Any], left_out: list[str]) -> Iterator[GivenZone]:
    """ValueError or KeyError where something is missing."""
    for zone in document["UASZoneList"] if "UASZoneList" in document else document["features"]:
        name, title = str(zone["identifier"]), _text(zone.get("name"))
        with naming(name):
            if zone["restriction"] in OPEN_TYPES:
                left_out.append(f"{name}: {zone['restriction']} keeps nobody out")
                continue
            if not zone["geometry"]:
                left_out.append(f"{name}: no geometry, closes no ground")
            yield from in_one(_volume(name, title, geometry) for geometry in zone["geometry"])


def _volume(name: str, title: str, geometry: Mapping[str, Any]) -> GivenZone:
    unit = geometry["uomDimensions"]
    band = band_of(
        name,
        (geometry.get("lowerLimit"), geometry.get("upperLimit")),
        unit,
        (geometry["lowerVerticalReference"], geometry["upperVerticalReference"]),
    )
    projection = geometry["horizontalProjection"]
    if projection["type"] == "Circle":
        radius = float(projection["radius"] or 0.0)
        circle = GivenCircle(ring_of([projection["center"]]), max(radius, metres(radius, unit) or 0.0))
        return GivenZone(name, [circle], band, title=title)
    rings = projection["coordinates"] or [[]]
    return GivenZone(name, [GivenPolygon([ring_of(ring)]) for ring in rings], band, title=title)
