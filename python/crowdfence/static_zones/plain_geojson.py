"""Polygons of any GeoJSON (RFC 7946), from the ground up without end; those of our files with their band."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from crowdfence.static_zones.given_zone import NO_CEILING_M, GivenZone, band_between, ring_of


def geojson_zones(document: Mapping[str, Any], left_out: list[str]) -> Iterator[GivenZone]:
    """ValueError or KeyError where something is missing."""
    if document.get("crs", {}) is None:
        raise ValueError("its coordinates are local metres, not longitude and latitude")
    if document["type"] == "FeatureCollection":
        features = document["features"]
    elif document["type"] == "Feature":
        features = [document]
    else:
        features = [{"geometry": document, "properties": {}}]
    for number, feature in enumerate(features, start=1):
        properties = feature.get("properties") or {}
        name = str(feature.get("id") or properties.get("id") or properties.get("name") or f"feature {number}")
        polygons: list[Any] = []
        for geometry in _geometries(feature["geometry"]):
            kind = geometry and geometry["type"]
            if kind not in ("Polygon", "MultiPolygon"):
                left_out.append(f"{name}: a {kind} closes no ground")
                continue
            shapes = geometry["coordinates"]
            polygons += [shapes] if kind == "Polygon" else shapes
        band = band_between(
            float(properties.get("lower_m", 0.0)),
            float(properties.get("upper_m", NO_CEILING_M)),
            properties.get("datum", "AGL"),
            properties.get("datum", "AGL"),
        )
        for rings in polygons:
            yield GivenZone(name, [ring_of(ring) for ring in rings], band)


def _geometries(geometry: Any) -> list[Any]:
    """Those of a collection, whatever collections are in it."""
    if not geometry or geometry["type"] != "GeometryCollection":
        return [geometry]
    return [one for part in geometry["geometries"] for one in _geometries(part)]
