"""Outlines with fewer corners that cover everything the old ones did.

Two moves, each of which adds a triangle outside: an inward corner is left out, or an outward edge is removed
and its neighbours are drawn on until they meet. The cheapest move comes first, while it stays within a
tolerance or until a budget of corners is kept. Whatever rounding does, the result is compared with what it
must cover before it is returned.
"""

from __future__ import annotations

import heapq
import math
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

MARGIN_M = 1e-6
"""Added all around an outline that was changed: outweighs the rounding of corners that are computed, and of
those who ask whether an edge runs past a corner."""
LEAST_VERTICES = 3
MOST_CORNERS = 2500
"""Of an outline whose corners are left out one by one, which takes time with their square: 20,000 took two
minutes."""
_MITRE_LIMIT = 1e3  # every corner stays one corner
_STRAIGHT = 1e-9
_TURN = 2 * math.pi
_NEEDLE = 5e-3


def vertex_count(outline: Polygon | MultiPolygon) -> int:
    """Corners of all rings, the closing ones left out."""
    import shapely

    rings = shapely.get_rings(shapely.get_parts(outline))
    return int(shapely.get_num_coordinates(rings).sum() - len(rings))


def simplified(
    outline: Polygon | MultiPolygon, *, tolerance_m: float = 0.0, max_vertices: int | None = None
) -> Polygon | MultiPolygon:
    """An outline that covers `outline` and reaches at most `tolerance_m` beyond it, with few corners; where
    `max_vertices` asks for fewer, it reaches as far as it takes.

    A budget may close holes, join parts and end in a triangle. ValueError for a budget below 3 and for an
    outline that is empty or invalid.
    """
    if outline.is_empty or not outline.is_valid:
        raise ValueError(f"an outline must be a valid polygon that is not empty, got {outline.wkt[:60]}")
    if max_vertices is not None and max_vertices < LEAST_VERTICES:
        raise ValueError(f"max_vertices is {max_vertices}; a polygon has at least {LEAST_VERTICES}")
    result = _covering(outline, _each_part(outline, tolerance_m)) if tolerance_m > 0.0 else outline
    if max_vertices is None or vertex_count(result) <= max_vertices:
        return result
    return _within_budget(result, max_vertices)


def _each_part(outline: Polygon | MultiPolygon, tolerance_m: float) -> Polygon | MultiPolygon:
    import shapely

    parts = [_fewer(part, tolerance_m, LEAST_VERTICES) for part in getattr(outline, "geoms", [outline])]
    return parts[0] if len(parts) == 1 else shapely.union_all(parts)


def _within_budget(outline: Polygon | MultiPolygon, budget: int) -> Polygon | MultiPolygon:
    """The first that keeps the budget: as it is, without holes, as one convex shape, as a triangle. Parts
    that are too many for it, or take long, are one at once."""
    import shapely

    parts = shapely.get_parts(outline)
    shapes = []
    if len(parts) == 1 or (LEAST_VERTICES * len(parts) <= budget and vertex_count(outline) <= MOST_CORNERS):
        shapes = [outline]
        if shapely.get_num_interior_rings(parts).any():
            shapes.append(shapely.union_all(shapely.polygons(shapely.get_exterior_ring(parts))))
    for shape in shapes:
        result = _covering(outline, _fewer(shape, np.inf, budget))
        if vertex_count(result) <= budget:
            return result
    hull = _fewer(shapely.convex_hull(outline), np.inf, budget)
    for shape in (hull, shapely.oriented_envelope(outline), _triangle_around(outline)):
        result = _covering(outline, shape)
        if vertex_count(result) <= budget:
            return result
    raise AssertionError("a triangle has three corners")


def _covering(outline: Polygon | MultiPolygon, shape: Polygon | MultiPolygon) -> Polygon | MultiPolygon:
    """A little more than `shape`, which covers the outline; the outline where it does not, or has no fewer
    corners."""
    import shapely

    if vertex_count(shape) >= vertex_count(outline):
        return outline
    for margin_m in (MARGIN_M, 1e3 * MARGIN_M):
        result = shapely.buffer(shape, margin_m, join_style="mitre", mitre_limit=_MITRE_LIMIT)
        if result.is_valid and result.covers(outline):
            return result
    return outline


def _triangle_around(outline: Polygon | MultiPolygon) -> Polygon:
    """Twice the sides of the smallest rectangle: its far corner lies on the third side. That of a needle is
    made wider, because a mitre as long as its point is has more corners than one. Counted from a corner of
    the bounds: of coordinates like those of UTM the rectangle of GEOS is centimetres too small."""
    import shapely

    west, south, east, north = outline.bounds
    origin = np.array([west, south])
    outline = shapely.transform(outline, lambda corners: corners - origin)
    length_m = float(np.hypot(east - west, north - south))
    is_needle = shapely.oriented_envelope(outline).area < _NEEDLE * length_m**2
    around = shapely.buffer(outline, _NEEDLE * length_m if is_needle else MARGIN_M)
    corners = np.asarray(shapely.oriented_envelope(around).exterior.coords) + origin
    corner, along, _, across = corners[:4]
    return shapely.Polygon([corner, 2 * along - corner, 2 * across - corner])


def _fewer(outline: Polygon | MultiPolygon, tolerance_m: float, budget: int) -> Polygon | MultiPolygon:
    """By the cheapest moves of all rings, until none is within the tolerance or the budget is kept."""
    corners = _corners_of(outline)
    corners.simplify(tolerance_m, budget)
    return corners.outline()


def _corners_of(outline: Polygon | MultiPolygon) -> _Corners:
    from shapely.geometry.polygon import orient

    # The ground that is closed lies to the left of every edge.
    parts = [orient(part, 1.0) for part in getattr(outline, "geoms", [outline])]
    rings = [[part.exterior, *part.interiors] for part in parts]
    return _Corners([[np.asarray(ring.coords)[:-1] for ring in of_part] for of_part in rings])


def _turns_left(ring: NDArray[np.float64]) -> bool:
    """Whether a ring is convex: no corner of it turns right, and it goes round once."""
    edges = np.roll(ring, -1, axis=0) - ring
    after = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
    return bool((turns > 0.0).all()) and bool(
        np.isclose(np.arctan2(turns, (edges * after).sum(1)).sum(), _TURN)
    )


class FewerCorners:
    """One outline within ever smaller budgets, as `simplified` gives it, for little more than the last."""

    def __init__(self, outline: Polygon) -> None:
        self._outline = outline
        self._corners: _Corners | None = None

    def within(self, max_vertices: int) -> Polygon | MultiPolygon:
        """At most so many corners; not more than when it was asked before."""
        if vertex_count(self._outline) <= max_vertices:
            return self._outline
        if not self._outline.interiors:
            if self._corners is None:
                self._corners = _corners_of(self._outline)
            self._corners.simplify(np.inf, max_vertices)
            result = _covering(self._outline, self._corners.outline())
            if vertex_count(result) <= max_vertices:
                return result
        return simplified(self._outline, max_vertices=max_vertices)


_Place = tuple[float, float]
_Move = tuple[float, _Place | None, float]
"""Area added; where the neighbours meet, or None where the corner is left out; how far beyond the outline the
new edges may reach."""


class _Corners:
    """The corners of an outline's rings as linked lists, and the moves that take one away."""

    def __init__(self, parts: list[list[NDArray[np.float64]]]) -> None:
        """Of each part the shell, then its holes."""
        rings = [ring for of_part in parts for ring in of_part]
        self._rings_of_parts = [len(of_part) for of_part in parts]
        self.points = np.concatenate(rings)
        self._places: list[_Place] = [(x, y) for x, y in self.points.tolist()]
        """The same as plain numbers: moves are worked out one at a time."""
        sizes = [len(ring) for ring in rings]
        starts = np.cumsum([0, *sizes[:-1]])
        count = len(self.points)
        self.next = np.arange(1, count + 1)
        self.before = np.arange(-1, count - 1)
        for start, size in zip(starts.tolist(), sizes, strict=True):
            self.next[start + size - 1], self.before[start] = start, start + size - 1
        self.alive = np.ones(count, dtype=np.bool_)
        self.ring = np.repeat(np.arange(len(rings)), sizes)
        self.ring_size = list(sizes)
        self.beyond_m = [0.0] * count
        """How far the edge that begins at a corner may reach beyond the outline."""
        self.version = np.zeros(count, dtype=np.int64)
        self.left = count
        """Corners."""
        self._queue: list[tuple[float, int, int]] | None = None
        self._is_convex = len(rings) == 1 and _turns_left(rings[0])
        """Then it stays so, and no move makes it cross itself."""

    def rings(self) -> list[NDArray[np.float64]]:
        kept = []
        for ring in range(len(self.ring_size)):
            members = np.flatnonzero(self.alive & (self.ring == ring))
            order: list[int] = []
            at = int(members[0]) if len(members) else -1
            while len(order) < len(members):
                order.append(at)
                at = int(self.next[at])
            kept.append(self.points[order])
        return kept

    def outline(self) -> Polygon | MultiPolygon:
        import shapely

        rings = iter(self.rings())
        parts = []
        for count in self._rings_of_parts:
            shell, *holes = islice(rings, count)
            parts.append(shapely.Polygon(shell, [hole for hole in holes if len(hole) >= LEAST_VERTICES]))
        return parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)

    def simplify(self, tolerance_m: float, budget: int) -> None:
        """May be called again with the same tolerance and a smaller budget: it goes on where it stopped."""
        if self._queue is None:
            self._queue = []
            for corner in range(len(self.points)):
                self._offer(self._queue, corner, tolerance_m)
        queue = self._queue
        while queue and self.left > budget:
            _, corner, version = heapq.heappop(queue)
            if not self.alive[corner] or version != self.version[corner]:
                continue
            move = self._move(corner, tolerance_m)
            if move is None or (not self._is_convex and self._is_blocked(corner, move)):
                continue
            for changed in self._take(corner, move):
                self.version[changed] += 1
                self._offer(queue, changed, tolerance_m)
            self.left -= 1

    def _offer(self, queue: list[tuple[float, int, int]], corner: int, tolerance_m: float) -> None:
        move = self._move(corner, tolerance_m)
        if move is not None:
            heapq.heappush(queue, (move[0], corner, int(self.version[corner])))

    def _move(self, corner: int, tolerance_m: float) -> _Move | None:
        """The cheapest one that takes a corner away; None where there is none."""
        if self.ring_size[self.ring[corner]] <= LEAST_VERTICES:
            return None
        a, b = int(self.before[corner]), int(self.next[corner])
        (px, py), (vx, vy), (qx, qy) = self._places[a], self._places[corner], self._places[b]
        area = ((vx - px) * (qy - vy) - (vy - py) * (qx - vx)) / 2
        if area <= 0.0:
            length_m = math.hypot(qx - px, qy - py)
            height_m = -2 * area / length_m if length_m > 0.0 else 0.0
            beyond_m = height_m + max(self.beyond_m[a], self.beyond_m[corner])
            return (-area, None, beyond_m) if beyond_m <= tolerance_m else None
        return self._extension(corner, tolerance_m)

    def _extension(self, corner: int, tolerance_m: float) -> _Move | None:
        """The edge from a corner to the next one removed, where both turn outward."""
        a, b = int(self.before[corner]), int(self.next[corner])
        (px, py), (vx, vy) = self._places[a], self._places[corner]
        (wx, wy), (qx, qy) = self._places[b], self._places[int(self.next[b])]
        along_x, along_y = vx - px, vy - py
        edge_x, edge_y = wx - vx, wy - vy
        on_x, on_y = qx - wx, qy - wy
        turn_b = edge_x * on_y - edge_y * on_x
        if turn_b <= 0.0:
            return None
        turn = along_x * on_y - along_y * on_x
        if turn <= _STRAIGHT * math.hypot(along_x, along_y) * math.hypot(on_x, on_y):
            return None  # the neighbours do not meet
        reach = turn_b / turn
        beyond_x, beyond_y = along_x * reach, along_y * reach
        meeting = (vx + beyond_x, vy + beyond_y)
        area = (edge_x * (meeting[1] - vy) - edge_y * (meeting[0] - vx)) / -2
        if not area >= 0.0 or (edge_x == 0.0 and edge_y == 0.0):
            return None
        # Every point of the triangle is nearer to the old edge than its tip is to the edge's nearer end.
        reach_m = min(
            math.hypot(meeting[0] - vx, meeting[1] - vy), math.hypot(meeting[0] - wx, meeting[1] - wy)
        )
        beyond_m = reach_m + max(self.beyond_m[a], self.beyond_m[corner], self.beyond_m[b])
        return (area, meeting, beyond_m) if beyond_m <= tolerance_m else None

    def _is_blocked(self, corner: int, move: _Move) -> bool:
        """Whether the triangle that a move adds meets another edge: the outline would cross itself."""
        a, b = int(self.before[corner]), int(self.next[corner])
        if move[1] is None:
            triangle = self.points[[a, corner, b]]
            own = {a, corner, b}
        else:
            triangle = np.array([self.points[corner], move[1], self.points[b]])
            own = {corner, b}
        starts = np.flatnonzero(self.alive)
        near = _boxes_meet(self.points[starts], self.points[self.next[starts]], triangle)
        for start in starts[near].tolist():
            end = int(self.next[start])
            if start in own and end in own:
                continue
            if move[1] is not None and (end == corner or start == b):
                continue  # the neighbours that are drawn on
            if _meets(self.points[start], self.points[end], triangle, start in own, end in own):
                return True
        return False

    def _take(self, corner: int, move: _Move) -> tuple[int, ...]:
        """Make the move; the corners whose own moves it changes."""
        _, meeting, beyond_m = move
        a, b = int(self.before[corner]), int(self.next[corner])
        self.alive[corner] = False
        self.next[a], self.before[b] = b, a
        self.ring_size[self.ring[corner]] -= 1
        self.beyond_m[a] = beyond_m
        if meeting is not None:
            self.points[b] = self._places[b] = meeting
            self.beyond_m[b] = beyond_m
        behind, ahead = int(self.before[a]), int(self.next[b])
        return tuple(dict.fromkeys((behind, a, b, ahead)))


def _boxes_meet(
    starts: NDArray[np.float64], ends: NDArray[np.float64], triangle: NDArray[np.float64]
) -> NDArray[np.bool_]:
    low, high = triangle.min(axis=0), triangle.max(axis=0)
    return np.asarray(((np.minimum(starts, ends) <= high) & (np.maximum(starts, ends) >= low)).all(axis=1))


def _meets(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    triangle: NDArray[np.float64],
    start_is_corner: bool,
    end_is_corner: bool,
) -> bool:
    """Whether an edge has more in common with a triangle than a corner of both."""
    import shapely

    edge, area = shapely.LineString([start, end]), shapely.Polygon(triangle)
    if not shapely.intersects(edge, area):
        return False
    shared = shapely.intersection(edge, area)
    return not ((start_is_corner or end_is_corner) and shared.length <= _STRAIGHT)
