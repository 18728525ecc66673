"""Where a way round outlines may turn, and which of these places see each other.

A shortest way turns at corners that stick out, and touches the outline there: its line leaves the corners
before and after on one side. Of pairs of corners one in a hundred is like that, and only these are looked
along.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

TURN_M = 0.05
"""Corners of the way lie so far outside the zones and their clearance."""
MOST_CORNERS = 350
"""All pairs of so many are looked along."""
MOST_TOUCHING = 20_000
"""Corners of which pairs are asked whether their line touches the outlines."""
MOST_PAIRS = 300_000
"""That are looked along because it does."""
_FIRST_TOLERANCE_M = 0.25
_SAME_SIDE = 1e-7
"""Radians: corners so near to a line lie on it, as those of cells in one row do."""


class TooManyCorners(Exception):
    """More than can be searched."""


class Corners(NamedTuple):
    """Places where a way may turn."""

    places: NDArray[np.float64]
    """[C, 2]"""
    back: NDArray[np.float64]
    """[C, 2] Direction of the corner before each, of length 1; 0 where a way may turn at any angle."""
    on: NDArray[np.float64]
    """[C, 2] Direction of the corner after it."""
    are_all: bool = True
    """False: they are those of coarser outlines, and the shortest way over them need not be the shortest."""

    @staticmethod
    def at_any_angle(places: NDArray[np.float64], *, are_all: bool = True) -> Corners:
        return Corners(places, np.zeros_like(places), np.zeros_like(places), are_all)

    @staticmethod
    def sticking_out(ring: NDArray[np.float64]) -> Corners:
        """Of a ring [N, 2] that has the inside on its left."""
        back, on = np.roll(ring, 1, axis=0) - ring, np.roll(ring, -1, axis=0) - ring
        return Corners(ring, _unit(back), _unit(on)).take(on[:, 0] * back[:, 1] - on[:, 1] * back[:, 0] > 0.0)

    def take(self, kept: NDArray[np.bool_]) -> Corners:
        return Corners(self.places[kept], self.back[kept], self.on[kept], self.are_all)


def joined(*corners: Corners) -> Corners:
    places, back, on, are_all = zip(*corners, strict=True)
    return Corners(np.concatenate(places), np.concatenate(back), np.concatenate(on), all(are_all))


def corners_round(closed: Any, within: Polygon | MultiPolygon | None, *, few: bool = False) -> Corners:
    """All that a shortest way round what is `closed`, within an area, can turn at. `few` are so many that all
    pairs can be looked along, for which they may be those of outlines around."""
    around, tolerance_m = _around(closed, within), 0.0
    corners = _corners(around, closed, tolerance_m, within)
    if not few:
        return corners
    while len(corners.places) > MOST_CORNERS:
        tolerance_m = max(_FIRST_TOLERANCE_M, 2.0 * tolerance_m)
        corners = _corners(around, closed, tolerance_m, within)
    return Corners.at_any_angle(corners.places, are_all=tolerance_m == 0.0)


def seen(
    corners: Corners, closed: Any, within: Polygon | MultiPolygon | None, *, few: bool = False
) -> NDArray[np.int64]:
    """[E, 2] Pairs of places that are to be looked along with nothing closed between them. TooManyCorners
    unless they are a `few`."""
    import shapely

    pairs = _to_look_along(corners, MOST_PAIRS if not few else None)
    lines = shapely.linestrings(corners.places[pairs])
    clear = ~shapely.intersects(closed, lines)
    if within is not None:
        clear &= shapely.covers(within, lines)
    return pairs[clear]


def _around(closed: Any, within: Polygon | MultiPolygon | None) -> Any:
    """What is closed, and a frame outside the area."""
    import shapely

    if within is None or within.is_empty:
        return closed
    frame = shapely.box(*within.bounds).buffer(1.0, join_style="mitre")
    return shapely.union(closed, shapely.difference(frame, within))


def _corners(
    around: Polygon | MultiPolygon,
    closed: Polygon | MultiPolygon,
    tolerance_m: float,
    within: Polygon | MultiPolygon | None,
) -> Corners:
    """Corners of what is gone `around` that a shortest way can turn at: those that stick out, a little
    outside, and are neither `closed` nor beyond the area."""
    import shapely

    # One by one: of all together GEOS takes many times as long.
    parts = shapely.get_parts(around)
    if tolerance_m:
        # Grown by the tolerance and simplified within it: coarser, and still around everything.
        larger = shapely.union_all(shapely.buffer(parts, tolerance_m, join_style="mitre", mitre_limit=5.0))
        parts = shapely.simplify(shapely.get_parts(larger), tolerance_m)
    beside = shapely.buffer(parts, TURN_M, join_style="mitre", mitre_limit=5.0)
    outside = [Corners.at_any_angle(np.empty((0, 2)))]
    for polygon in shapely.get_parts(beside).tolist():
        if not polygon.is_empty:
            oriented = shapely.geometry.polygon.orient(polygon, 1.0)
            rings = (oriented.exterior, *oriented.interiors)
            outside += [Corners.sticking_out(np.asarray(ring.coords)[:-1]) for ring in rings]
    corners = joined(*outside)
    points = shapely.points(corners.places)
    free = ~shapely.intersects(closed, points)
    if within is not None:
        free &= shapely.covers(within, points)
    return corners.take(free)


def _to_look_along(corners: Corners, most: int | None) -> NDArray[np.int64]:
    """[P, 2] Pairs of places whose line touches the outlines at both. A place without an outline may lie
    beside that of another, nearer than its corners: it is looked along to all. TooManyCorners."""
    places, back, on, _ = corners
    if most is not None and len(places) > MOST_TOUCHING:
        raise TooManyCorners
    by_itself = np.asarray(~(back.any(axis=1) | on.any(axis=1)))
    pairs, count = [np.empty((0, 2), dtype=np.int64)], 0
    for one in range(len(places) - 1):  # all at once are millions
        along = places[one + 1 :] - places[one]
        touches = _on_one_side(along, back[one], on[one])
        touches &= _on_one_side(along, back[one + 1 :], on[one + 1 :])
        others = one + 1 + np.flatnonzero(touches | by_itself[one] | by_itself[one + 1 :])
        pairs.append(np.stack([np.full_like(others, one), others], axis=1))
        count += len(others)
        if most is not None and count > most:
            raise TooManyCorners
    return np.concatenate(pairs)


def _on_one_side(
    along: NDArray[np.float64], back: NDArray[np.float64], on: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether two directions lie on one side of lines [N, 2]."""
    one, other = (along[:, 0] * side[..., 1] - along[:, 1] * side[..., 0] for side in (back, on))
    beside = _SAME_SIDE * np.abs(along).sum(axis=1)
    return np.asarray((np.minimum(one, other) >= -beside) | (np.maximum(one, other) <= beside))


def _unit(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(directions / np.where(length > 0.0, length, 1.0))
