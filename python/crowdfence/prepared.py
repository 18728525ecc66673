"""Shapes that many others are asked of.

What makes that fast GEOS builds into the shape with the first questions, and where several threads ask at
once it destroys the memory of the process. A shape that others hold too, an area that a caller gave or the
outline of a zone, is therefore never prepared itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon


def prepared(shape: Polygon | MultiPolygon) -> Polygon | MultiPolygon:
    """A copy, prepared: for one thread."""
    import shapely

    own: Polygon | MultiPolygon = shapely.from_wkb(shapely.to_wkb(shape))
    shapely.prepare(own)
    return own
