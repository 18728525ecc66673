"""All zones in the few items that an autopilot's fence holds, nothing uncovered.

A polygon costs an item per corner and has no holes, a circle costs one. While there are too many items, the
move is made that adds least ground per item saved: fewer corners, a circle instead, or one shape around two
neighbours. What that closes for nothing is counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.zones.simplify import LEAST_VERTICES, MOST_CORNERS, FewerCorners, vertex_count

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

MARGIN_M = 1e-3
"""Of circles, which are stored with a rounded radius."""
_NO_WIDTH_M = 1e-6
"""On the mean. A union with such a needle may leave it out."""
MOST_PAIRED = 150
"""Shapes between which the best pair is searched; more are first put together by their places."""
_NEIGHBOURS = 4
_CORNERS_PER_ITEM = 8
"""An outline of more corners, and of more than `MOST_CORNERS`, as of coasts and parks, is made coarser at
once first."""
_FIRST_TOLERANCE = 1e-4
"""Of the longer side of the bounds."""
_MOST_TOLERANCES = 12


@dataclass(frozen=True, slots=True)
class Circle:
    """In local metres."""

    east_m: float
    north_m: float
    radius_m: float

    @property
    def area_m2(self) -> float:
        return float(np.pi * self.radius_m**2)

    def outline(self) -> Polygon:
        """With corners on the circle, to draw or to ask."""
        import shapely

        return shapely.Point(self.east_m, self.north_m).buffer(self.radius_m, 64)


@dataclass(frozen=True, slots=True)
class Fence:
    """Shapes that together cover all zones."""

    polygons: tuple[Polygon, ...]
    """Without holes."""
    circles: tuple[Circle, ...]
    zone_area_m2: float
    """Ground that the zones close."""
    fence_area_m2: float
    """Ground that the fence closes; circles are counted as they are."""

    @property
    def items(self) -> int:
        return sum(vertex_count(polygon) for polygon in self.polygons) + len(self.circles)

    @property
    def over_coverage_m2(self) -> float:
        """Ground that is closed because there is no room to leave it open."""
        return max(0.0, self.fence_area_m2 - self.zone_area_m2)


def fitted(outlines: Sequence[Polygon | MultiPolygon], max_items: int, *, circles: bool = True) -> Fence:
    """The outlines in at most `max_items` items; without `circles` every shape is a polygon.

    An outline that crosses itself, or has no width, is closed with everything between its corners. ValueError
    where not even one shape fits, and for a corner that is not finite.
    """
    import shapely

    least = 1 if circles else LEAST_VERTICES
    if max_items < least:
        raise ValueError(f"a fence of {max_items} items holds no zone; it takes {least}")
    union = _covering_union(_whole_parts(outlines))
    most_corners = max(MOST_CORNERS, _CORNERS_PER_ITEM * max_items)
    shapes = [
        _Shape(_coarser(shapely.Polygon(part.exterior), most_corners), circles)
        for part in shapely.get_parts(union).tolist()
        if not part.is_empty
    ]
    most = max(1, min(MOST_PAIRED, max_items // least))
    if len(shapes) > most:
        shapes = [_around(group, circles) for group in _groups(shapes, most)]
    _reduce(shapes, max_items, circles)
    polygons = tuple(shape.shape for shape in shapes if not isinstance(shape.shape, Circle))
    rounds = tuple(shape.shape for shape in shapes if isinstance(shape.shape, Circle))
    drawn = [*polygons, *(circle.outline() for circle in rounds)]
    return Fence(polygons, rounds, float(union.area), float(_union(np.array(drawn, dtype=object)).area))


def _coarser(outline: Polygon, most: int) -> Polygon:
    """An outline of at most so many corners that covers another one: grown by a tolerance and simplified
    within it."""
    import shapely

    if vertex_count(outline) <= most:
        return outline
    west, south, east, north = outline.bounds
    tolerance_m = _FIRST_TOLERANCE * max(east - west, north - south)
    for _ in range(_MOST_TOLERANCES):
        larger = shapely.buffer(outline, tolerance_m, join_style="mitre", mitre_limit=2.0)
        coarser = shapely.simplify(shapely.Polygon(larger.exterior), tolerance_m)
        if vertex_count(coarser) <= most and coarser.is_valid and coarser.covers(outline):
            return coarser
        tolerance_m *= 2.0
    return shapely.convex_hull(outline)


def _whole_parts(outlines: Sequence[Polygon | MultiPolygon]) -> NDArray[Any]:
    """The polygons of all outlines. What a ring that crosses itself means to close is not known."""
    import shapely

    parts = shapely.get_parts(np.array(outlines, dtype=object))
    parts = parts[~shapely.is_empty(parts)]
    if not np.isfinite(shapely.get_coordinates(parts)).all():
        raise ValueError("an outline has a corner that is not finite")
    is_needle = 2.0 * shapely.area(parts) <= _NO_WIDTH_M * shapely.length(parts)
    broken = ~shapely.is_valid(parts) | is_needle
    parts[broken] = shapely.buffer(shapely.convex_hull(parts[broken]), MARGIN_M, join_style="mitre")
    return np.asarray(parts)


def _covering_union(parts: NDArray[Any]) -> Polygon | MultiPolygon:
    """The union, which leaves out a spike without width, also one that is part of a wider outline: such an
    outline is closed with everything between its corners."""
    import shapely

    union = _union(parts)
    corners, of = shapely.get_coordinates(parts, return_index=True)
    shapely.prepare(union)
    out = np.flatnonzero(~shapely.intersects_xy(union, corners))
    lost = np.unique(of[out[~shapely.dwithin(shapely.points(corners[out]), union, MARGIN_M)]])
    if len(lost):
        parts[lost] = shapely.convex_hull(parts[lost])
        union = _union(parts)
    return union


def _union(parts: NDArray[Any]) -> Polygon | MultiPolygon:
    """Most zones of many touch no other: where GEOS can (3.12), only those that do are put together."""
    import shapely

    if shapely.geos_version >= (3, 12, 0) and hasattr(shapely, "disjoint_subset_union_all"):
        return shapely.disjoint_subset_union_all(parts)
    return shapely.union_all(parts)


class _Shape:
    """What must be covered, and the shape that covers it for now."""

    def __init__(self, covered: Polygon, circles: bool) -> None:
        self.covered = covered
        self._circles = circles
        self._fewer = FewerCorners(covered)
        self.draw(covered)

    def draw(self, shape: Polygon | Circle) -> None:
        self.shape = shape
        self.items = 1 if isinstance(shape, Circle) else vertex_count(shape)
        self.area_m2 = shape.area_m2 if isinstance(shape, Circle) else float(shape.area)
        self._next: tuple[Polygon | Circle, float] | bool | None = False

    @property
    def next(self) -> tuple[Polygon | Circle, float] | None:
        """The best smaller shape and what it adds per item saved; None where there is none."""
        if isinstance(self._next, bool):
            candidates = list(self._smaller())
            self._next = min(candidates, key=lambda one: one[1], default=None)
        return self._next

    def _smaller(self) -> list[tuple[Polygon | Circle, float]]:
        found: list[tuple[Polygon | Circle, float]] = []
        items, area_m2 = self.items, self.area_m2
        if items > LEAST_VERTICES:
            fewer = self._fewer.within(max(LEAST_VERTICES, items - max(1, items // 6)))
            found.append((fewer, (fewer.area - area_m2) / (items - vertex_count(fewer))))
        if self._circles and items > 1:
            circle = circle_around(self.covered)
            found.append((circle, (circle.area_m2 - area_m2) / (items - 1)))
        return found

    def take(self) -> None:
        assert self.next is not None
        self.draw(self.next[0])


_Joins = dict[tuple[_Shape, _Shape], _Shape]
"""Shapes around two others, by these."""


def circle_around(outline: Polygon | MultiPolygon) -> Circle:
    """The smallest circle that covers an outline, a little larger."""
    import shapely

    middle = shapely.centroid(shapely.minimum_bounding_circle(outline))
    corners = shapely.get_coordinates(outline)
    radius_m = float(np.linalg.norm(corners - (middle.x, middle.y), axis=1).max())
    return Circle(float(middle.x), float(middle.y), radius_m + MARGIN_M)


def _reduce(shapes: list[_Shape], max_items: int, circles: bool) -> None:
    """Make the cheapest moves, in place, until the shapes fit."""
    known: _Joins = {}
    neighbours = _neighbours(shapes)
    while sum(shape.items for shape in shapes) > max_items:
        moves = [(shape.next[1], 0, number, number) for number, shape in enumerate(shapes) if shape.next]
        for first, second in neighbours:
            joined = _joined(shapes[first], shapes[second], circles, known)
            items, area_m2 = shapes[first].items + shapes[second].items, _area_m2(shapes, first, second)
            if joined.items < items:
                moves.append(((joined.area_m2 - area_m2) / (items - joined.items), 1, first, second))
        _, is_join, first, second = min(moves)
        if is_join:
            shapes[first] = _joined(shapes[first], shapes[second], circles, known)
            del shapes[second]
            neighbours = _neighbours(shapes)
        else:
            shapes[first].take()


def _neighbours(shapes: Sequence[_Shape]) -> list[tuple[int, int]]:
    """Positions of shapes that lie next to each other."""
    from scipy.spatial import cKDTree

    if len(shapes) < 2:
        return []
    places = _places(shapes)
    _, near = cKDTree(places).query(places, k=min(len(shapes), _NEIGHBOURS + 1))
    return sorted({(min(a, b), max(a, b)) for a, row in enumerate(near.tolist()) for b in row if a != b})


def _joined(first: _Shape, second: _Shape, circles: bool, known: _Joins) -> _Shape:
    """One shape around two; a circle where the convex one would save nothing."""
    if (first, second) not in known:
        joined = _around([first, second], circles)
        if circles and joined.items >= first.items + second.items:
            joined.draw(circle_around(joined.covered))
        known[first, second] = joined
    joined = known[first, second]
    if circles and joined.items >= first.items + second.items:  # they became smaller since
        joined.draw(circle_around(joined.covered))
    return joined


def _area_m2(shapes: Sequence[_Shape], first: int, second: int) -> float:
    return shapes[first].area_m2 + shapes[second].area_m2


def _around(group: Sequence[_Shape], circles: bool) -> _Shape:
    """One convex shape around several."""
    import shapely

    return _Shape(
        shapely.convex_hull(shapely.geometrycollections([shape.covered for shape in group])), circles
    )


def _groups(shapes: Sequence[_Shape], count: int) -> list[list[_Shape]]:
    """Neighbours together: halved along the longer side until there are `count`, the largest group first."""
    groups = [list(shapes)]
    while len(groups) < count:
        groups.sort(key=len)
        largest = groups.pop()
        places = _places(largest)
        order = np.argsort(places[:, int(np.argmax(np.ptp(places, axis=0)))], kind="stable")
        half = len(order) // 2
        groups += [[largest[i] for i in order[:half]], [largest[i] for i in order[half:]]]
    return groups


def _places(shapes: Sequence[_Shape]) -> NDArray[np.float64]:
    """Middle of the bounds of each [N, 2]."""
    bounds = np.array([shape.covered.bounds for shape in shapes])
    return (bounds[:, :2] + bounds[:, 2:]) / 2
