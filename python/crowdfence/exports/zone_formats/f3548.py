"""Zones as constraints of ASTM F3548-21 (UTM between service suppliers).

Its limits are kept: at most 1000 corners in all volumes of a constraint (parts of a zone with more grow, by
as little ground as it takes), at most 24 h, at least 10 min, so that a zone which ends sooner is kept longer,
and one without an end has to be published again within a day. Its altitudes end 8 km below and 100 km above
the ellipsoid. Volumes have no holes: those of zones are closed.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdfence.exports.geographic_outline import polygons_of
from crowdfence.exports.one_a_line import one_a_line
from crowdfence.exports.zone_formats.times import floor_ms, rfc3339
from crowdfence.exports.zone_formats.zone_export import ZoneExport
from crowdfence.zones import Zone
from crowdfence.zones.capacity import fitted

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

MAX_VERTICES = 1000
MAX_DURATION_NS = 24 * 3600 * 10**9
LEAST_DURATION_NS = 10 * 60 * 10**9
LOWEST_M, HIGHEST_M = -8000.0, 100_000.0
_NAMESPACE = uuid.UUID("8d4f7a52-6a3a-5ad0-9d35-8f1f3f1f6b58")
"""Of the ids: the same zone of the same mission has the same one, missions elsewhere others, whatever their
name."""
_MOST_VERSION = (1 << 31) - 1
"""Versions have 32 bits: seconds until the year 2038."""


def f3548(export: ZoneExport) -> str:
    """A list of constraints, as `{"reference": ..., "details": ...}` each."""
    constraints = [_constraint(zone, export) for zone in export.zones]
    return one_a_line({}, "constraints", constraints)


def _constraint(zone: Zone, export: ZoneExport) -> dict[str, Any]:
    start, end = _times(zone, export.start_ns(zone))
    reference = {
        "id": _id(zone, export),
        "manager": export.authority,
        "uss_availability": "Unknown",
        "version": _version(export.stamp_ns),
        "time_start": start,
        "time_end": end,
        "uss_base_url": "",
    }
    return {
        "reference": reference,
        "details": {"type": f"crowdfence.{zone.kind}.{zone.restriction}", "volumes": _volumes(zone, export)},
    }


def _id(zone: Zone, export: ZoneExport) -> str:
    anchor = export.georeference
    place = f"{anchor.latitude_deg:.6f},{anchor.longitude_deg:.6f}"
    return str(uuid.uuid5(_NAMESPACE, f"{export.mission}/{place}/{zone.id}"))


def _version(stamp_ns: int) -> int:
    """Larger at a later second: who has seen a version does not read its outline again."""
    return min(max(stamp_ns // 1_000_000_000, 1), _MOST_VERSION)


def _volumes(zone: Zone, export: ZoneExport) -> list[dict[str, Any]]:
    band = export.band(zone, "WGS84")
    start, end = _times(zone, export.start_ns(zone))
    return [
        {
            "volume": {
                "outline_polygon": {"vertices": _vertices(part)},
                "altitude_lower": _altitude(band.lower_m),
                "altitude_upper": _altitude(band.upper_m),
            },
            "time_start": start,
            "time_end": end,
        }
        for part in _parts(zone, export)
    ]


def _parts(zone: Zone, export: ZoneExport) -> list[Polygon]:
    """In longitude and latitude, with no more corners than a constraint may have."""
    return _outlined(zone, shapes_in_constraint(zone, export), export)


def shapes_in_constraint(zone: Zone, export: ZoneExport) -> list[Polygon | MultiPolygon]:
    """In local metres: the zone, or shapes around it with no more corners. Their holes are closed."""
    shapes, budget = [zone.polygon], MAX_VERTICES
    over = _over(zone, shapes, export)
    while over > 0:
        shapes = list(fitted([zone.polygon], budget, circles=False).polygons)
        over = _over(zone, shapes, export)
        # What the antimeridian cuts has more, up to twice as many.
        budget = min(budget - 1, budget * MAX_VERTICES // (MAX_VERTICES + over))
    return shapes


def _over(zone: Zone, shapes: Iterable[Polygon | MultiPolygon], export: ZoneExport) -> int:
    """Corners more than a constraint may have."""
    return sum(map(_corners, _outlined(zone, shapes, export))) - MAX_VERTICES


def _outlined(zone: Zone, shapes: Iterable[Polygon | MultiPolygon], export: ZoneExport) -> list[Polygon]:
    outlines = (export.outline(replace(zone, polygon=shape), max_edge_m=None) for shape in shapes)
    return [part for outline in outlines for part in polygons_of(outline)]


def _corners(part: Polygon) -> int:
    """Without those of holes, which are closed."""
    return len(part.exterior.coords) - 1


def cut_short_ns(export: ZoneExport) -> list[int]:
    """When those zones end in the file that stand longer: they are open then to whoever reads it."""
    ends_ns = [(zone, _between_ns(zone, export.start_ns(zone))[1]) for zone in export.zones]
    return [end_ns for zone, end_ns in ends_ns if zone.valid_until_ns is None or zone.valid_until_ns > end_ns]


def _between_ns(zone: Zone, start_ns: int) -> tuple[int, int]:
    start_ns = floor_ms(start_ns)  # as it is written: of a later one a day ends a millisecond late
    last_ns = start_ns + MAX_DURATION_NS
    end_ns = last_ns if zone.valid_until_ns is None else zone.valid_until_ns
    return start_ns, min(max(end_ns, start_ns + LEAST_DURATION_NS), last_ns)


def _times(zone: Zone, start_ns: int) -> tuple[dict[str, str], dict[str, str]]:
    start_ns, end_ns = _between_ns(zone, start_ns)
    return (
        {"value": rfc3339(start_ns), "format": "RFC3339"},
        {"value": rfc3339(end_ns, up=True), "format": "RFC3339"},
    )


def _vertices(part: Any) -> list[dict[str, float]]:
    """Without the closing one, counter-clockwise; holes are closed."""
    from shapely.geometry.polygon import orient

    ring = np.asarray(orient(part, 1.0).exterior.coords)[:-1]
    return [{"lat": latitude, "lng": longitude} for longitude, latitude in ring.tolist()]


def _altitude(height_m: float) -> dict[str, Any]:
    return {"value": min(max(height_m, LOWEST_M), HIGHEST_M), "reference": "W84", "units": "M"}
