"""Polygons of a KML file, wherever in it they are, from the ground up without end."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree as xml

import numpy as np
from numpy.typing import NDArray

from crowdfence.static_zones.given_zone import NO_CEILING_M, GivenZone, ring_of
from crowdfence.zones import AltitudeBand


def kml_zones(data: bytes, left_out: list[str]) -> Iterator[GivenZone]:
    """ValueError for what is no KML, or a polygon without corners. Other files that it names are not read."""
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ValueError("it declares entities, which no KML needs")
    try:
        root = xml.fromstring(data)
    except xml.ParseError as error:
        raise ValueError(f"it is no XML: {error}") from error
    if _tag(root) != "kml":
        raise ValueError(f"it is no KML: it begins with {_tag(root)!r}")
    for place in root.iter():
        if _tag(place) not in ("Placemark", "NetworkLink"):
            continue
        name = next((child.text or "" for child in place if _tag(child) == "name"), "")
        if _tag(place) == "NetworkLink":
            left_out.append(f"{name}: links to another file, which is not read; give that too")
            continue
        polygons = [element for element in place.iter() if _tag(element) == "Polygon"]
        if not polygons:
            left_out.append(f"{name}: no polygon, closes no ground")
        for polygon in polygons:
            rings = [
                *_rings_of(polygon, "outerBoundaryIs", name),
                *_rings_of(polygon, "innerBoundaryIs", name),
            ]
            yield GivenZone(name, rings, AltitudeBand(0.0, NO_CEILING_M, "AGL"))


def _rings_of(polygon: Any, boundary: str, name: str) -> list[NDArray[np.float64]]:
    rings = []
    for element in polygon:
        if _tag(element) == boundary:
            text = next((e.text or "" for e in element.iter() if _tag(e) == "coordinates"), "")
            try:
                rings.append(ring_of([corner.split(",") for corner in text.split()]))
            except ValueError as error:
                raise ValueError(f"zone {name!r} has a corner that cannot be read: {error}") from error
    return rings


def _tag(element: Any) -> str:
    """Without the namespace, of which there are several."""
    return str(element.tag).rpartition("}")[2]
