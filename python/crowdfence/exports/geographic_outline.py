"""Zones on Earth: outlines in longitude and latitude that cover what they closed in local metres.

Every outline is grown by a margin of about a millimetre before it is written, which outweighs everything that
writing takes away, so that no part of a crowd cell is ever cut off:

- rounding to 9 decimals of a degree: below 0.08 mm;
- edges of at most 25 m that are straight on the ground but bow in longitude and latitude: below
  1.09 * 25^2 tan(latitude) / (8 * 6378 km), 0.8 mm at 89 degrees, where the writer stops;
- the height at which the outline is placed, half way up the zone's ground: local verticals are parallel, real
  ones are not, so ground dz above or below moves by dz * distance from the anchor / 6357 km. This one is
  added to the margin (1 mm for 10 m at 640 m).

Zones of others whose ground nobody knows stand at the anchor's height above the ellipsoid, as they were laid
out (`static_zones`), however far away they lie: 100 km from the anchor the local plane is 785 m above that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.georeference import MAX_LATITUDE_DEG, Georeference
from crowdfence.zones import Zone

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

DECIMALS = 9
MARGIN_M = 0.001
MAX_EDGE_M = 25.0

_STRAIGHT_M = 3e-4
"""Zones of others are straight in longitude and latitude, and got corners every 100 m to be so in the local
plane: those that lie so near the line between others, in degrees, are not written, and the margin is as much
wider. A national file was a hundred times as large with them."""
_SMALLEST_EARTH_RADIUS_M = 6.356e6
_LARGEST_EARTH_RADIUS_M = 6.42e6
"""Of curvature, at the poles, 20 km up."""
_ANY_CORNER = 1e3
DEGREE_M = 111_700.0
"""The longest there is, of latitude at the poles."""
_SMALL_M = 1e-4
"""Of height, which moves nothing within 60 degrees by more than 0.2 mm."""
_MOST_STEPS = 60
_STEP_ON = 1.01
"""Times what an edge bows: enough for what it is longer with it, where no corner is sharp."""
_MOST_BOW = 0.2
"""Of the longest edge."""
_BOW = 1.1
"""A hundredth for the zone's extent, on the 1.089 of an edge 55 degrees off north, which bows most: a line in
longitude and latitude turns by sin(azimuth) (1 + cos(azimuth)^2) tan(latitude) / R."""


def ellipsoidal_heights(zone: Zone, georeference: Georeference) -> tuple[float, float]:
    """Lowest and highest ground above the WGS84 ellipsoid, rounded down and up to millimetres. The local
    plane leaves the ellipsoid to all sides: it is highest above it at a corner, and lowest where the zone
    comes nearest to the anchor, on an edge or inside too."""
    import shapely

    corners = _at_height(shapely.get_coordinates(zone.polygon), zone.upper_m)
    highest_m = georeference.geodetic_from_local(corners)[2].max()
    nearest_m = shapely.distance(zone.polygon, shapely.Point(0.0, 0.0))
    # Below any sphere through it that is larger than the Earth is curved anywhere.
    lowest_m = georeference.height_m + zone.lower_m + nearest_m**2 / (2 * _LARGEST_EARTH_RADIUS_M)
    return float(np.floor(lowest_m * 1e3) / 1e3), float(np.ceil(highest_m * 1e3) / 1e3)


def _at_height(corners: NDArray[np.float64], height_m: float) -> NDArray[np.float64]:
    return np.column_stack([corners, np.full(len(corners), height_m)])


def _on_ground(corners: NDArray[np.float64], zone: Zone, georeference: Georeference) -> NDArray[np.float64]:
    """Where corners [C, 2] stand, local metres [C, 3]."""
    places = _at_height(corners, (zone.lower_m + zone.upper_m) / 2)
    if zone.lower_m < zone.upper_m:
        return places
    # A step leaves 1 - cos(angle between the verticals) of the error: half of it at most, 60 degrees away.
    for _ in range(_MOST_STEPS):
        above_m = georeference.geodetic_from_local(places)[2] - georeference.height_m
        places[:, 2] -= above_m
        if np.abs(above_m).max() < _SMALL_M:
            break
    return places


def geographic_outline(
    zone: Zone, georeference: Georeference, *, max_edge_m: float | None = MAX_EDGE_M, decimals: int = DECIMALS
) -> Polygon | MultiPolygon:
    """Longitude and latitude outline that covers what the zone closes; see the head of this file.

    max_edge_m  longer edges get corners between their ends; None where corners are counted: the outline is
                then grown by as much as its longest edge bows
    decimals    of a degree, for formats that keep fewer

    ValueError for a zone within one degree of a pole, and where corners are counted for one too fine for the
    decimals.
    """
    import shapely

    margin_m = _margin_m(zone) + DEGREE_M * 10.0**-decimals
    straight_m = _STRAIGHT_M if max_edge_m is not None and zone.kind == "static" else 0.0
    margin_m += straight_m
    if max_edge_m is None:
        grown = _grown_by_bow(zone, margin_m, georeference)
    else:
        # Mitre joins keep the square corners of the cells square.
        grown = shapely.buffer(zone.polygon, margin_m, join_style="mitre", mitre_limit=2.0)
        grown = shapely.segmentize(grown, max_edge_m)

    def on_ground(corners: NDArray[np.float64]) -> NDArray[np.float64]:
        return _on_ground(corners, zone, georeference)

    what = f"zone {zone.id}"
    rounded = in_degrees(
        grown, on_ground, georeference, decimals, what, straight_m, snapped=max_edge_m is not None
    )
    if not rounded.is_valid:
        raise ValueError(f"zone {zone.id} is too fine for {decimals} decimals of a degree; use larger voxels")
    return rounded


def in_degrees(
    outline: Polygon | MultiPolygon,
    on_ground: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    georeference: Georeference,
    decimals: int,
    what: str,
    straight_m: float = 0.0,
    *,
    snapped: bool = False,
) -> Polygon | MultiPolygon:
    """An outline in longitude and latitude, rounded, and cut at the antimeridian. `on_ground` takes corners
    [C, 2] to local metres [C, 3]; `straight_m`: so far corners may lie from a straight line that takes their
    place; `snapped`: edges that would cross for the rounding get further corners. ValueError that says `what`
    reaches a pole."""
    import shapely

    def longitude_latitude(corners: NDArray[np.float64]) -> NDArray[np.float64]:
        latitude, longitude, _ = georeference.geodetic_from_local(on_ground(corners))
        if np.abs(latitude).max() > MAX_LATITUDE_DEG:
            raise ValueError(
                f"{what} reaches latitude {latitude[np.argmax(np.abs(latitude))]:.4f}; zones are "
                f"written up to {MAX_LATITUDE_DEG} degrees, because longitude loses its meaning at the poles"
            )
        # One branch of longitude around the anchor, so that no ring jumps across the antimeridian.
        offset = (longitude - georeference.longitude_deg + 180.0) % 360.0 - 180.0
        return np.column_stack([georeference.longitude_deg + offset, latitude])

    unwrapped = shapely.transform(outline, longitude_latitude)
    if straight_m > 0.0:
        unwrapped = _without_straight_corners(unwrapped, straight_m)
    cut = _cut_at_antimeridian(unwrapped)
    rounded = shapely.transform(cut, lambda degrees: degrees.round(decimals))
    if snapped and not rounded.is_valid:
        # Corners of needles may pass the edge beside them. Snapped to the grid, no edge moves by more than a
        # corner that is rounded does.
        on_grid = shapely.set_precision(cut, 10.0**-decimals)
        rounded = shapely.transform(on_grid, lambda degrees: degrees.round(decimals))
    return rounded


def _without_straight_corners(outline: Polygon | MultiPolygon, straight_m: float) -> Polygon | MultiPolygon:
    """With degrees of longitude as short as where they are longest in the outline: straight lines stay so."""
    import shapely

    _, south, _, north = outline.bounds
    nearest_deg = 0.0 if south < 0.0 < north else min(abs(south), abs(north))
    scale = (np.cos(np.deg2rad(nearest_deg)), 1.0)
    even = shapely.simplify(
        shapely.transform(outline, lambda degrees: degrees * scale), straight_m / DEGREE_M
    )
    return shapely.transform(even, lambda degrees: degrees / scale)


def _grown_by_bow(zone: Zone, margin_m: float, georeference: Georeference) -> Polygon | MultiPolygon:
    """Larger by a margin and by as much as the longest edge bows, every corner still one; a box around it
    where that has no end. Sharp corners move far out for it, which makes their edges longer, and these bow
    more."""
    import shapely

    for outline in (zone.polygon, shapely.envelope(zone.polygon)):
        grown, bow_m, most_m = outline, 0.0, _MOST_BOW * _longest_edge_m(outline)
        while (needed_m := _bow_m(_longest_edge_m(grown), georeference)) <= most_m:
            if bow_m >= needed_m:
                return grown
            bow_m = needed_m * _STEP_ON
            grown = shapely.buffer(outline, margin_m + bow_m, join_style="mitre", mitre_limit=_ANY_CORNER)
    raise ValueError(f"zone {zone.id} is too large to be drawn in degrees by its own corners")


def _longest_edge_m(outline: Polygon | MultiPolygon) -> float:
    import shapely

    rings = shapely.get_rings(shapely.get_parts(outline))
    corners = [shapely.get_coordinates(ring) for ring in rings]
    return max(float(np.linalg.norm(np.diff(ring, axis=0), axis=1).max()) for ring in corners)


def _bow_m(edge_m: float, georeference: Georeference) -> float:
    """How far a straight edge bows in longitude and latitude."""
    latitude_deg = min(abs(georeference.latitude_deg) + 1.0, MAX_LATITUDE_DEG)
    return _BOW * edge_m**2 * float(np.tan(np.deg2rad(latitude_deg))) / (8 * _SMALLEST_EARTH_RADIUS_M)


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
    return shapely.MultiPolygon([polygon for part in parts for polygon in polygons_of(part)])


def polygons_of(geometry: Any) -> Iterator[Polygon]:
    for part in getattr(geometry, "geoms", [geometry]):
        if part.geom_type == "Polygon" and not part.is_empty:
            yield part


def geojson_geometry(outline: Polygon | MultiPolygon) -> dict[str, Any]:
    """Exterior rings counter-clockwise, holes clockwise (RFC 7946, 3.1.6)."""
    from shapely.geometry.polygon import orient

    polygons = [_rings(orient(polygon, 1.0)) for polygon in polygons_of(outline)]
    if len(polygons) == 1:
        return {"type": "Polygon", "coordinates": polygons[0]}
    return {"type": "MultiPolygon", "coordinates": polygons}


def _rings(polygon: Polygon) -> list[list[list[float]]]:
    return [np.asarray(ring.coords).tolist() for ring in (polygon.exterior, *polygon.interiors)]
