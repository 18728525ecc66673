"""Outlines made larger: by a distance, by closing holes. Never smaller anywhere.

A round buffer is drawn with corners, and corners that lie on the circle cut off what lies between them. The
circle is therefore drawn larger, so that the edges touch the true one from outside.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from shapely import LinearRing, MultiPolygon, Polygon

SEGMENTS_PER_QUARTER = 6
"""Of a circle around a corner, as GEOS is asked for them. It rounds their number: an arc of 1.5 segments may
be drawn as one, and none spans more, but for what it leaves out."""
_LEFT_OUT = 1e-4
"""Of the distance. A corner of the buffer that is so near the one before it GEOS leaves out: the arc of a
corner right behind another one begins that much early."""
_WIDEST_SEGMENT = 1.5 * math.pi / (2 * SEGMENTS_PER_QUARTER) + 2.0 * _LEFT_OUT
_REACH = (1.0 + 1e-9) / math.cos(_WIDEST_SEGMENT / 2)
"""The middle of the widest segment is this much nearer than its ends, and coordinates are rounded: 2 % of the
distance too far at the corners, nowhere too near."""


WIDEST_NOTCH = 0.36
"""Of the distance. From so far away a notch between two corners that are so near each other is hardly one:
who is within the distance of the line between them is within 1.017 times it of a corner."""
_FEW_CORNERS = 24
"""So many cost less than leaving some out."""
_LEAST_M = 0.001
"""Of circles that drown in the rounding of coordinates GEOS makes no ground at all."""


def grown(outline: Polygon | MultiPolygon, distance_m: float) -> Polygon | MultiPolygon:
    """Everything within `distance_m` >= 0 of the outline, and at most 5 % of the distance more: 2 % along
    edges, 1.7 % over notches, and GEOS leaves out inward corners of less than a hundredth of the
    distance. Less than a millimetre is one."""
    import shapely

    if distance_m == 0.0:
        return outline
    distance_m = max(distance_m, _LEAST_M)
    ground = _without_notches(outline, distance_m)
    return shapely.buffer(ground, distance_m * _REACH, quad_segs=SEGMENTS_PER_QUARTER)


def _without_notches(outline: Polygon | MultiPolygon, distance_m: float) -> Polygon | MultiPolygon:
    """The outline without notches and holes that a buffer fills anyway. The arcs around the steps of an edge
    of cells all cross each other, which is what buffers cost.

    Rings may cross themselves afterwards, where two notches share ground. Leaving out an inward corner only
    adds ground, so that it is inside then more than once, and for GEOS that is inside.
    """
    import shapely

    if shapely.get_num_coordinates(outline) <= _FEW_CORNERS:
        return outline
    widest_m = WIDEST_NOTCH * distance_m
    parts = []
    for part in shapely.get_parts(shapely.orient_polygons(outline)):
        wide = [hole for hole in part.interiors if _width(hole) > 2.0 * distance_m]
        holes = [_without_inward_corners(hole, widest_m) for hole in wide]
        # What is left of a wedge with two corners so near each other are its ends.
        holes = [hole for hole in holes if len(hole) > 2]
        parts.append(shapely.Polygon(_without_inward_corners(part.exterior, widest_m), holes))
    return parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)


def _without_inward_corners(ring: LinearRing, widest_m: float) -> NDArray[np.float64]:
    """Corners of a ring that has the inside on its left [N, 2], without straight ones and those inward ones
    whose neighbours are at most `widest_m` apart: never two beside each other, until none is left."""
    import shapely

    corners = shapely.get_coordinates(ring)[:-1]
    while True:
        into, out_of = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
        turn = into[:, 0] * out_of[:, 1] - into[:, 1] * out_of[:, 0]
        goes = (turn < 0.0) & (np.hypot(*(into + out_of).T) <= widest_m) | (turn == 0.0)
        goes &= ~np.roll(goes, 1)
        if not goes.any():
            return corners
        corners = corners[~goes]


def _width(ring: LinearRing) -> float:
    """Of the narrower side of its bounds."""
    west, south, east, north = ring.bounds
    return float(min(east - west, north - south))


def without_small_holes(outline: Polygon | MultiPolygon, max_hole_m2: float) -> Polygon | MultiPolygon:
    """Ground that crowd encloses is closed too where it is at most `max_hole_m2` (inf: always)."""
    import shapely

    if max_hole_m2 <= 0.0:
        return outline
    parts = list(getattr(outline, "geoms", [outline]))
    filled = [
        shapely.Polygon(
            part.exterior, [ring for ring in part.interiors if shapely.Polygon(ring).area > max_hole_m2]
        )
        for part in parts
    ]
    if all(len(new.interiors) == len(old.interiors) for new, old in zip(filled, parts, strict=True)):
        return outline
    # A part inside a hole of another is swallowed with the hole.
    return filled[0] if len(filled) == 1 else shapely.union_all(filled)
