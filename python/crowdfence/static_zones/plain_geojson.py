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
        geometry = feature["geometry"]
        if geometry is None or geometry["type"] not in ("Polygon", "MultiPolygon"):
            left_out.append(f"{name}: a {geometry and geometry['type']} closes no ground")
            continue
        polygons = geometry["coordinates"]
        band = band_between(
            float(properties.get("lower_m", 0.0)),
            float(properties.get("upper_m", NO_CEILING_M)),
            properties.get("datum", "AGL"),
            properties.get("datum", "AGL"),
        )
        for rings in [polygons] if geometry["type"] == "Polygon" else polygons:
            yield GivenZone(name, [ring_of(ring) for ring in rings], band)
