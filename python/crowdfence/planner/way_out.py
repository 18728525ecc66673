"""The nearest clear place, for a vehicle that a zone was drawn around."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.planner.corners import TURN_M
from crowdfence.zones.grow import grown

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon


def way_out(
    place: ArrayLike, closed: Sequence[Polygon | MultiPolygon], clearance_m: float = 0.0
) -> NDArray[np.float64]:
    """The nearest place [2] (local metres) that keeps `clearance_m` >= 0 from all outlines; `place` itself
    where it does. The way there is straight, and leaves what it is in by the shortest one."""
    import shapely

    point = shapely.Point(np.asarray(place, dtype=np.float64))
    around = shapely.union_all([grown(outline, clearance_m + TURN_M) for outline in closed])
    if not around.intersects(point):
        return np.asarray(point.coords[0])
    return np.asarray(shapely.shortest_line(around.boundary, point).coords[0])
