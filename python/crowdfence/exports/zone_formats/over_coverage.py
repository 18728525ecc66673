"""What formats without holes close beside the zones."""

from __future__ import annotations

from crowdfence.exports.geographic_outline import polygons_of
from crowdfence.exports.zone_formats.f3548 import shapes_in_constraint
from crowdfence.exports.zone_formats.zone_export import ZoneExport

WITHOUT_HOLES = {
    "ed269": "holes of zones are closed",
    "ed269-list": "holes of zones are closed",
    "multidrone": "holes of zones are closed",
    "f3548": "holes of zones are closed, and a zone has at most 1000 corners",
}
"""What makes a file of these close more than its zones."""


def over_coverage_m2(name: str, export: ZoneExport) -> float:
    """Ground that a file of a format `WITHOUT_HOLES` closes beside the zones."""
    import shapely

    shapes = [
        shape
        for zone in export.zones
        for shape in (shapes_in_constraint(zone, export) if name == "f3548" else [zone.polygon])
    ]
    shells = [shapely.Polygon(part.exterior) for shape in shapes for part in polygons_of(shape)]
    zones = shapely.union_all([zone.polygon for zone in export.zones])
    return max(0.0, float(shapely.union_all(shells).area - zones.area))
