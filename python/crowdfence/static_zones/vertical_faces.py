"""Airspace drawn as a body, with walls between its floor and its roof: they close what they stand around."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.static_zones.given_zone import MAX_LONGITUDE_DEG, GivenPolygon

if TYPE_CHECKING:
    from shapely import LineString, Polygon

_FLAT_DEG = 1e-9
"""Wide as a tenth of a millimetre a face has no ground."""
_BESIDE_DEG = 1e-6
"""Files round the corners of a floor and of the walls on it alike, but not always to the same digits."""


def ground_of(faces: Sequence[GivenPolygon]) -> Sequence[GivenPolygon]:
    """Faces of one body without its walls: these lie on the others' ground or, where they do not, give that
    which all of them stand around. All faces where that is none, or one of the others has none: walls are
    outlines that cross themselves."""
    import shapely

    lines = [_wall(face) for face in faces]
    walls = [line for line in lines if line is not None]
    level = [face for face, line in zip(faces, lines, strict=True) if line is None]
    if not walls or not all(map(_has_ground, level)):
        return faces
    standing = shapely.union_all(walls)
    ground = shapely.union_all([_polygon(face) for face in level])
    if standing.within(ground.buffer(_BESIDE_DEG)):
        return level
    enclosed = shapely.get_parts(shapely.polygonize([standing]))
    if not standing.within(shapely.union_all([ground, *enclosed]).buffer(_BESIDE_DEG)):
        return faces
    return [*level, *(GivenPolygon([np.array(part.exterior.coords)]) for part in enclosed)]


def _wall(face: GivenPolygon) -> LineString | None:
    """Where it stands, if it is one: all corners of its outline lie on a line. The area of an outline does
    not tell: that of one that crosses itself can be nothing too."""
    import shapely

    corners = np.unique(face.places, axis=0)
    if len(corners) < 2 or not _are_degrees(corners):
        return None
    hull = shapely.MultiPoint(corners).convex_hull
    return shapely.LineString(corners) if hull.area <= _FLAT_DEG * hull.length else None


def _polygon(face: GivenPolygon) -> Polygon:
    import shapely

    return shapely.Polygon(face.rings[0], face.rings[1:])


def _has_ground(face: GivenPolygon) -> bool:
    enough = bool(face.rings) and all(len(ring) > 2 and _are_degrees(ring) for ring in face.rings)
    return enough and bool(_polygon(face).is_valid)


def _are_degrees(corners: NDArray[np.float64]) -> bool:
    return bool((abs(corners) <= MAX_LONGITUDE_DEG).all())
