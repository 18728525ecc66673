"""Zones in local metres -> the shapes of a fence on Earth, which cover them and fit what a vehicle holds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from crowdfence.exports.geographic_circle import geographic_circle
from crowdfence.exports.geographic_outline import geographic_outline, polygons_of
from crowdfence.exports.ground_of_shapes import GroundOfShapes
from crowdfence.fence_sync.autopilot_capacity import Capacity
from crowdfence.fence_sync.fence_error import FenceError
from crowdfence.fence_sync.fence_item import (
    CIRCLE_EXCLUSION,
    CIRCLES,
    POLYGON_EXCLUSION,
    POLYGONS,
    FenceItem,
    FenceShape,
    items_of,
)
from crowdfence.georeference import Georeference
from crowdfence.zones import Zone
from crowdfence.zones.capacity import Fence, fitted
from crowdfence.zones.grow import grown

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

DECIMALS = 7
_STORED_MARGIN_M = 0.012
"""Some autopilots lose the last of the 7 decimals."""
_ANY_CORNER = 1e3
_BOX_MARGIN_M = 0.1
_POLE_E7 = 900_000_000
_ENDLESS_M = 1e5
"""For a circle of others without end: a plane is no map farther away."""


@dataclass(frozen=True, slots=True)
class PlacedFence:
    """Our part of a vehicle's fence."""

    shapes: tuple[FenceShape, ...]
    fence: Fence
    """The same in local metres."""

    @property
    def items(self) -> int:
        return len(items_of(self.shapes))


NOTHING = PlacedFence((), Fence((), (), 0.0, 0.0))


def placed(
    zones: Sequence[Zone], georeference: Georeference, capacity: Capacity, kept: Sequence[FenceShape] = ()
) -> PlacedFence:
    """All zones beside the shapes that are kept. FenceError where there is no room at all, ValueError for
    zones within one degree of a pole."""
    zones = [zone for zone in zones if not zone.polygon.is_empty]
    if not zones:
        return NOTHING
    most = capacity.free_items(kept)
    while most > 0:
        fence = fitted([zone.polygon for zone in zones], most)
        shapes = tuple(_shapes(fence, zones, georeference))
        if capacity.holds([*kept, *shapes]):
            return PlacedFence(shapes, fence)
        # A polygon costs more than its corners, or was cut in two at the antimeridian.
        most = min(most, fence.items) - max(1, most // 10)
    raise FenceError(
        f"the vehicle holds {capacity}, of which others take {len(items_of(kept))} items: there is no "
        "room for a zone; remove theirs (crowdfence fence clear --all) or give --capacity"
    )


def _shapes(fence: Fence, zones: Sequence[Zone], georeference: Georeference) -> Iterable[FenceShape]:
    ground = GroundOfShapes(zones)
    for polygon in fence.polygons:
        for part in polygons_of(_outline(ground.as_zone(polygon), georeference)):
            corners = np.round(np.asarray(part.exterior.coords)[:-1] * 10**DECIMALS).astype(int).tolist()
            yield tuple(
                FenceItem(POLYGON_EXCLUSION, float(len(corners)), north, east) for east, north in corners
            )
    for circle in fence.circles:
        lowest_m, highest_m = ground.between_m(circle.outline())
        east, north, radius_m = geographic_circle(circle, georeference, lowest_m, highest_m, DECIMALS)
        yield (FenceItem(CIRCLE_EXCLUSION, float32_above(radius_m), round(north * 1e7), round(east * 1e7)),)


def _outline(zone: Zone, georeference: Georeference) -> Polygon | MultiPolygon:
    """Longitude and latitude, without holes; convex, or a box, where an outline is too fine for the
    decimals."""
    import shapely

    shell = shapely.buffer(
        shapely.Polygon(zone.polygon.exterior), _STORED_MARGIN_M, join_style="mitre", mitre_limit=_ANY_CORNER
    )
    roomy = shapely.Polygon(shell.exterior)
    hull = shapely.convex_hull(roomy)
    box = shapely.envelope(shapely.buffer(hull, _BOX_MARGIN_M))
    for polygon in (roomy, hull):
        with suppress(ValueError):
            return _placed_outline(zone, polygon, georeference)
    return _placed_outline(zone, box, georeference)


def _placed_outline(zone: Zone, polygon: Polygon, georeference: Georeference) -> Polygon | MultiPolygon:
    whole = replace(zone, polygon=polygon)
    return geographic_outline(whole, georeference, max_edge_m=None, decimals=DECIMALS)


def float32_above(value: float) -> float:
    single = np.float32(value)
    return float(single if float(single) >= value else np.nextafter(single, np.float32(math.inf)))


def ground_of(shape: FenceShape, georeference: Georeference) -> Polygon | None:
    """What a shape closes, in local metres at the height of the anchor; None for one that closes nothing, as
    one of others that lies nowhere on Earth or is no number of metres wide."""
    import shapely

    first = shape[0]
    if any(abs(item.latitude_e7) > _POLE_E7 for item in shape) or math.isnan(first.param1):
        return None
    longitude = [item.longitude_e7 * 1e-7 for item in shape]
    latitude = [item.latitude_e7 * 1e-7 for item in shape]
    corners = georeference.local_from_geodetic(latitude, longitude, georeference.height_m)[:, :2]
    if first.command in POLYGONS and len(shape) >= 3:
        return shapely.convex_hull(bad) if not (bad := shapely.Polygon(corners)).is_valid else bad
    if first.command in CIRCLES:
        radius_m = first.param1 if math.isfinite(first.param1) else _ENDLESS_M
        return grown(shapely.Point(corners[0]), radius_m)
    return None
