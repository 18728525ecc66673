"""Outlines made larger: by a distance, by closing holes. Never smaller anywhere.

A round buffer is drawn with corners, and corners that lie on the circle cut off what lies between them. The
circle is therefore drawn larger, so that the edges touch the true one from outside.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

SEGMENTS_PER_QUARTER = 6
"""Of a circle around a corner, as GEOS is asked for them. It rounds their number: an arc of 1.5 segments may
be drawn as one, and none spans more."""
_WIDEST_SEGMENT = 1.5 * math.pi / (2 * SEGMENTS_PER_QUARTER)
_REACH = (1.0 + 1e-9) / math.cos(_WIDEST_SEGMENT / 2)
"""The middle of the widest segment is this much nearer than its ends, and coordinates are rounded: 2 % of the
distance too far at the corners, nowhere too near."""


def grown(outline: Polygon | MultiPolygon, distance_m: float) -> Polygon | MultiPolygon:
    """Everything within `distance_m` >= 0 of the outline, and at most 3 % of the distance more: 2 % along
    edges, and GEOS leaves out inward corners of less than a hundredth of the distance."""
    import shapely

    if distance_m == 0.0:
        return outline
    return shapely.buffer(outline, distance_m * _REACH, quad_segs=SEGMENTS_PER_QUARTER)


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
