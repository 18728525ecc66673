"""Zones as GeoJSON (RFC 7946).

With a georeference the coordinates are WGS84 longitude and latitude. Every outline is grown by a margin of
about a millimetre before it is written, which outweighs everything that writing takes away, so that no part
of a crowd cell is ever cut off:

- rounding to 9 decimals of a degree: below 0.08 mm;
- edges of at most 25 m that are straight on the ground but bow in longitude and latitude: below
  25^2 tan(latitude) / (8 * 6378 km), 0.7 mm at 89 degrees, where the writer stops;
- the height at which the outline is placed, half way up the zone's ground: local verticals are parallel, real
  ones are not, so ground dz above or below moves by dz * distance from the anchor / 6357 km. This one is
  added to the margin (1 mm for 10 m at 640 m).

Without a georeference there is no longitude and latitude to write. The coordinates are then local metres, the
file says so ("crs": null, which readers take as "no CRS", and "coordinate_frame"), and it is not RFC 7946.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import write_bytes
from crowdfence.exports.map_description import MapDescription
from crowdfence.georeference import Georeference
from crowdfence.iso_time import iso_utc
from crowdfence.zones import Zone, ZoneSet

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

DECIMALS = 9
MARGIN_M = 0.001
MAX_EDGE_M = 25.0
MAX_LATITUDE_DEG = 89.0

_SMALLEST_EARTH_RADIUS_M = 6.356e6
_ABSENCE = (
    "Ground outside the zones is not known to be free: it may never have been seen. "
    "The state band of the map says which."
)
_LOCAL_FRAME = {
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
    """Write one Feature per zone, and what was left out, as a FeatureCollection.

    Raises ValueError when a zone lies within one degree of a pole, OSError when the file cannot be written.
    """
    head: dict[str, Any] = {"type": "FeatureCollection", "crowdfence": _collection(zones, description)}
    if georeference is None:
        head |= {"crs": None, "coordinate_frame": _LOCAL_FRAME}
    features = [_feature(zone, zones, description, georeference) for zone in zones]
    write_bytes(path, _one_feature_per_line(head, features).encode())


def _one_feature_per_line(head: dict[str, Any], features: list[dict[str, Any]]) -> str:
    """Readable in an editor and small in a difference between two files."""
    lines = ",\n".join(_json(feature) for feature in features)
    return f'{_json(head)[:-1]}, "features": [\n{lines}\n]}}\n'


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


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
    outline = zone.polygon if georeference is None else _geographic_outline(zone, georeference)
    heights = {} if georeference is None else _ellipsoidal_heights(zone, georeference)
    return {
        "type": "Feature",
        "id": zone.id,
        "geometry": _geometry(outline),
        "properties": {
            "id": zone.id,
            "kind": "crowd",
            **_what_and_when(zones, description),
            "area_m2": zone.area_m2,
            "probability_max": zone.probability_max,
            "probability_mean": zone.probability_mean,
            "ground_lower_m": zone.lower_m,
            "ground_upper_m": zone.upper_m,
            **heights,
            **_evidence(zone, description),
        },
    }


def _evidence(zone: Zone, description: MapDescription) -> dict[str, Any]:
    return {
        "cells": zone.cell_count,
        "seen_by": list(zone.seen_by),
        **_stamp("last_seen", zone.last_seen_ns),
        "last_seen_age_s": _age_s(zone.last_seen_ns, description.stamp_ns),
        **_stamp("oldest_look", zone.oldest_look_ns),
        "oldest_look_age_s": _age_s(zone.oldest_look_ns, description.stamp_ns),
    }


def _age_s(look_ns: int, stamp_ns: int) -> float:
    return (stamp_ns - look_ns) / 1e9


def _ellipsoidal_heights(zone: Zone, georeference: Georeference) -> dict[str, float]:
    """Lowest and highest ground above the WGS84 ellipsoid; local height 0 leaves it with the distance."""
    import shapely

    corners = shapely.get_coordinates(zone.polygon)
    heights = [
        georeference.geodetic_from_local(_at_height(corners, level))[2]
        for level in (zone.lower_m, zone.upper_m)
    ]
    return {
        "ground_lower_wgs84_m": float(np.floor(heights[0].min() * 1e3) / 1e3),
        "ground_upper_wgs84_m": float(np.ceil(heights[1].max() * 1e3) / 1e3),
    }


def _at_height(corners: NDArray[np.float64], height_m: float) -> NDArray[np.float64]:
    return np.column_stack([corners, np.full(len(corners), height_m)])


def _geographic_outline(zone: Zone, georeference: Georeference) -> Polygon | MultiPolygon:
    """Longitude and latitude outline that covers the zone; see the head of this file."""
    import shapely

    # Mitre joins keep the square corners of the cells square.
    grown = shapely.buffer(zone.polygon, _margin_m(zone), join_style="mitre", mitre_limit=2.0)
    middle_m = (zone.lower_m + zone.upper_m) / 2

    def longitude_latitude(corners: NDArray[np.float64]) -> NDArray[np.float64]:
        latitude, longitude, _ = georeference.geodetic_from_local(_at_height(corners, middle_m))
        if np.abs(latitude).max() > MAX_LATITUDE_DEG:
            raise ValueError(
                f"zone {zone.id} reaches latitude {latitude[np.argmax(np.abs(latitude))]:.4f}; GeoJSON is "
                f"written up to {MAX_LATITUDE_DEG} degrees, because longitude loses its meaning at the poles"
            )
        # One branch of longitude around the anchor, so that no ring jumps across the antimeridian.
        offset = (longitude - georeference.longitude_deg + 180.0) % 360.0 - 180.0
        return np.column_stack([georeference.longitude_deg + offset, latitude])

    unwrapped = shapely.transform(shapely.segmentize(grown, MAX_EDGE_M), longitude_latitude)
    rounded = shapely.transform(_cut_at_antimeridian(unwrapped), lambda degrees: degrees.round(DECIMALS))
    if not rounded.is_valid:
        raise ValueError(f"zone {zone.id} is too fine for {DECIMALS} decimals of a degree; use larger voxels")
    return rounded


def _margin_m(zone: Zone) -> float:
    west, south, east, north = zone.polygon.bounds
    reach_m = float(np.hypot(max(abs(west), abs(east)), max(abs(south), abs(north))))
    return MARGIN_M + reach_m * (zone.upper_m - zone.lower_m) / 2 / _SMALLEST_EARTH_RADIUS_M


def _cut_at_antimeridian(outline: Polygon | MultiPolygon) -> Polygon | MultiPolygon:
    """RFC 7946, 3.1.9: an outline that crosses the antimeridian is cut there, into parts within +-180."""
    import shapely

    west, _, east, _ = outline.bounds
    if west >= -180.0 and east <= 180.0:
        return outline
    turns = (-360.0, 0.0, 360.0)
    parts = [
        shapely.transform(
            shapely.intersection(outline, shapely.box(-180.0 + turn, -90.0, 180.0 + turn, 90.0)),
            lambda degrees, turn=turn: degrees - (turn, 0.0),
        )
        for turn in turns
    ]
    return shapely.MultiPolygon([polygon for part in parts for polygon in _polygons(part)])


def _polygons(geometry: Any) -> Iterator[Polygon]:
    for part in getattr(geometry, "geoms", [geometry]):
        if part.geom_type == "Polygon" and not part.is_empty:
            yield part


def _geometry(outline: Polygon | MultiPolygon) -> dict[str, Any]:
    """Exterior rings counter-clockwise, holes clockwise (RFC 7946, 3.1.6)."""
    from shapely.geometry.polygon import orient

    polygons = [_rings(orient(polygon, 1.0)) for polygon in _polygons(outline)]
    if len(polygons) == 1:
        return {"type": "Polygon", "coordinates": polygons[0]}
    return {"type": "MultiPolygon", "coordinates": polygons}


def _rings(polygon: Polygon) -> list[list[list[float]]]:
    return [np.asarray(ring.coords).tolist() for ring in (polygon.exterior, *polygon.interiors)]
