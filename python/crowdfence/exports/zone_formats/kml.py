"""Zones as KML 2.2: extruded from the ground to their upper limit, with the time for which they hold.

Heights are above the ground, or above the sea where others bounded a zone above that or the ellipsoid. A
polygon of KML has no lower limit, so a zone that begins above the ground is drawn down to it.

`multidrone` is for the planners of the paper's authors (grvcTeam/multidrone_planning), which know a no-fly
zone by the name "2". They look for it in folders alone, read the outer boundary of one polygon of it, and
throw all of a file away of which one zone has none: every part of a zone stands by itself, without holes.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as xml

import numpy as np

from crowdfence.exports.geographic_outline import polygons_of
from crowdfence.exports.zone_formats.times import rfc3339
from crowdfence.exports.zone_formats.zone_export import ZoneExport
from crowdfence.zones import AltitudeBand, Zone

if TYPE_CHECKING:
    from shapely import Polygon

_NAMESPACE = "http://www.opengis.net/kml/2.2"
_STYLES = {
    "crowd": ("ff2608b4", "802608b4"),
    "unseen": ("ff808080", "60808080"),
    "static": ("ffb45a1e", "60b45a1e"),
}
"""Line and fill of each kind, as alpha, blue, green, red."""
_ALTITUDE_MODES = {"AGL": "relativeToGround", "AMSL": "absolute"}
_MULTIDRONE_NO_FLY = "2"
_NO_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters of names that no XML 1.0 can hold, escaped or not: with one of them no reader opens the file."""


def kml(export: ZoneExport, *, multidrone: bool = False) -> str:
    """A document with one placemark per zone; in a folder, and per part of a zone, for `multidrone`."""
    root = xml.Element("kml", xmlns=_NAMESPACE)
    document = _child(root, "Document")
    _child(document, "name", f"Crowd zones {export.mission}".strip())
    for kind, (line, fill) in _STYLES.items():
        style = xml.SubElement(document, "Style", id=kind)
        _child(_child(style, "LineStyle"), "color", line)
        _child(_child(style, "PolyStyle"), "color", fill)
    folder = _child(document, "Folder") if multidrone else document
    for zone in export.zones:
        parts = list(polygons_of(export.outline(zone)))
        if not multidrone:
            _placemark(folder, zone.id, export.name_of(zone), zone, parts, export)
            continue
        for number, part in enumerate(parts, 1):
            place = zone.id if number == 1 else f"{zone.id}.{number}"
            _placemark(folder, place, _MULTIDRONE_NO_FLY, zone, [_without_holes(part)], export)
    xml.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + xml.tostring(root, encoding="unicode") + "\n"


def _without_holes(part: Polygon) -> Polygon:
    import shapely

    return shapely.Polygon(part.exterior)


def _placemark(
    parent: Any, id: str, name: str, zone: Zone, parts: Sequence[Polygon], export: ZoneExport
) -> None:
    place = xml.SubElement(parent, "Placemark", id=id)
    _child(place, "name", name)
    span = _child(place, "TimeSpan")
    _child(span, "begin", rfc3339(export.start_ns(zone)))
    if zone.valid_until_ns is not None:
        _child(span, "end", rfc3339(zone.valid_until_ns, up=True))
    _child(place, "styleUrl", f"#{zone.kind}")
    data = _child(place, "ExtendedData")
    for key, value in _told(zone).items():
        _child(xml.SubElement(data, "Data", name=key), "value", value)
    geometry = place if len(parts) == 1 else _child(place, "MultiGeometry")
    band = zone.band if zone.band.datum == "AGL" else export.band(zone, "AMSL")
    for part in parts:
        _polygon(geometry, part, band)


def _told(zone: Zone) -> dict[str, str]:
    told = {"id": zone.id, "kind": zone.kind, "restriction": zone.restriction, "reason": zone.reason or ""}
    if zone.kind == "crowd":
        told |= {"probability_max": repr(float(zone.probability_max)), "seen_by": " ".join(zone.seen_by)}
    return told


def _polygon(parent: Any, part: Any, band: AltitudeBand) -> None:
    from shapely.geometry.polygon import orient

    polygon = _child(parent, "Polygon")
    _child(polygon, "extrude", "1")
    _child(polygon, "altitudeMode", _ALTITUDE_MODES[band.datum])
    oriented = orient(part, 1.0)
    for name, ring in [
        ("outerBoundaryIs", oriented.exterior),
        *(("innerBoundaryIs", hole) for hole in oriented.interiors),
    ]:
        corners = " ".join(f"{x!r},{y!r},{band.upper_m:.15g}" for x, y in np.asarray(ring.coords).tolist())
        _child(_child(_child(polygon, name), "LinearRing"), "coordinates", corners)


def _child(parent: Any, name: str, text: str | None = None) -> Any:
    element = xml.SubElement(parent, name)
    element.text = None if text is None else _NO_XML.sub("\ufffd", text)
    return element
