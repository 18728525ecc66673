"""Polygons of a KML file, wherever in it they are, from the ground up without end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any
from xml.etree import ElementTree as xml

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import quoted
from crowdfence.static_zones.given_zone import NO_CEILING_M, GivenPolygon, GivenZone, ring_of
from crowdfence.static_zones.vertical_faces import ground_of
from crowdfence.zones import AltitudeBand

_LINES = ("LineString", "LinearRing")
"""Drawn beside a polygon they may be meant to close ground."""
_MOST_VALUES = 3
"""Of a corner."""


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
    placed: set[int] = set()
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
        else:
            in_polygons = {id(part) for polygon in polygons for part in polygon.iter()}
            left_out += [
                f"{name}: a {_tag(line)} closes no ground"
                for line in place.iter()
                if _tag(line) in _LINES and id(line) not in in_polygons
            ]
        placed.update(map(id, polygons))
        if polygons:
            yield _zone(polygons, name)
    # Where no Placemark is around them, as in old files that call theirs otherwise.
    for polygon in root.iter():
        if _tag(polygon) == "Polygon" and id(polygon) not in placed:
            yield _zone([polygon], "")


def _zone(polygons: Iterable[Any], name: str) -> GivenZone:
    parts = [part for polygon in polygons for part in _parts_of(polygon, name)]
    return GivenZone(name, ground_of(parts), AltitudeBand(0.0, NO_CEILING_M, "AGL"))


def _parts_of(polygon: Any, name: str) -> Iterator[GivenPolygon]:
    """One, or one for each outer ring where there are several: what is a hole of which is not known then."""
    outer = [ring for rings in _rings_of(polygon, "outerBoundaryIs", name) for ring in rings]
    if len(outer) > 1:
        for ring in outer:
            yield GivenPolygon([ring])
    else:
        # A hole has one ring; of more, the others open nothing.
        holes = [ring for rings in _rings_of(polygon, "innerBoundaryIs", name) for ring in rings[:1]]
        yield GivenPolygon([*outer, *holes])


def _rings_of(polygon: Any, boundary: str, name: str) -> list[list[NDArray[np.float64]]]:
    """Of each such boundary."""
    try:
        return [
            [
                ring_of([_corner(corner) for corner in (text.text or "").split()])
                for text in element.iter()
                if _tag(text) == "coordinates"
            ]
            for element in polygon
            if _tag(element) == boundary
        ]
    except ValueError as error:
        raise ValueError(f"zone {name!r} has a corner that cannot be read: {error}") from error


def _corner(text: str) -> list[str]:
    """Longitude, latitude and often a height. Two corners without a space between them are none: the second
    would be lost, and with it ground."""
    values = text.rstrip(",").split(",")
    if len(values) > _MOST_VALUES:
        raise ValueError(f"{quoted(text)} has more than longitude, latitude and height; is a space missing?")
    return values


def _tag(element: Any) -> str:
    """Without the namespace, of which there are several."""
    return str(element.tag).rpartition("}")[2]
