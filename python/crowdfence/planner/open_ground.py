"""A way through the triangles that open ground is cut into, where outlines have too many corners to look
along.

The corners of the triangles are those of the outlines. A way crosses the edges that two triangles share, and
is then drawn tight between their ends (the funnel algorithm; Lee and Preparata, 1984). It is found where
there is one, but it may pass a zone on the longer side.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.planner.corners import TURN_M

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

_ROUNDING_M = 1e-6
"""So far within its area a way stays, whatever is lost in rounding."""
_SAME_AREA = 1e-6
"""Of the ground that triangles must fill."""


def ground_round(closed: Any, places: NDArray[np.float64]) -> Polygon:
    """A box around what is closed and places [N, 2], which ways can go round in."""
    import shapely

    west, south, east, north = shapely.total_bounds([closed, shapely.MultiPoint(places)])
    return shapely.box(west - 1.0, south - 1.0, east + 1.0, north + 1.0)


def way_over_open_ground(
    ends: NDArray[np.float64], closed: Any, within: Polygon | MultiPolygon
) -> NDArray[np.float64] | None:
    """From one place to another [2, 2] past what is `closed`, within an area: places [N, 2]; None where none
    was found. Ways narrower than a hand are missed."""
    import shapely

    part = _part_between(ends, closed, within)
    if part is None:
        return None
    corners, triangles = _triangles(part)
    if not len(triangles):
        return None
    inner = [_nearest(part, end) for end in ends]
    gates = _gates_between(inner[0], inner[1], corners, triangles)
    if gates is None:
        return None
    tight = _tight(inner[0], inner[1], gates)
    way = np.vstack([ends[:1], tight, ends[1:]])
    way = way[np.append(True, (np.diff(way, axis=0) != 0.0).any(axis=1))]
    line = shapely.LineString(way if len(way) > 1 else ends)
    return way if not shapely.intersects(closed, line) and within.covers(line) else None


def _part_between(ends: NDArray[np.float64], closed: Any, within: Polygon | MultiPolygon) -> Polygon | None:
    """The open ground that both places lie in, a little away from everything; they may lie at its edge."""
    import shapely

    # One by one: of all together GEOS takes many times as long.
    beside = shapely.buffer(shapely.get_parts(closed), TURN_M, join_style="mitre", mitre_limit=5.0)
    area = shapely.buffer(within, -_ROUNDING_M, join_style="mitre")
    parts = shapely.get_parts(shapely.difference(area, shapely.union_all(beside)))
    both = np.maximum(*(shapely.distance(parts, place) for place in shapely.points(ends)))
    return parts[both.argmin()] if len(parts) and both.min() <= 2.0 * TURN_M else None


def _nearest(part: Polygon, place: NDArray[np.float64]) -> NDArray[np.float64]:
    import shapely

    point = shapely.Point(place)
    if part.intersects(point):
        return place
    return np.asarray(shapely.shortest_line(part, point).coords[0])


def _triangles(part: Polygon) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Corners [C, 2], and triangles of them [T, 3], counter-clockwise; none where they leave ground out."""
    import shapely

    cut = shapely.orient_polygons(shapely.get_parts(shapely.constrained_delaunay_triangles(part)))
    if not abs(shapely.area(cut).sum() - part.area) <= _SAME_AREA * part.area:
        return np.empty((0, 2)), np.empty((0, 3), dtype=np.int64)
    of_each = shapely.get_coordinates(cut).reshape(-1, 4, 2)[:, :3]
    corners, triangles = np.unique(of_each.reshape(-1, 2), axis=0, return_inverse=True)
    return corners, triangles.reshape(-1, 3)


def _gates_between(
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
    corners: NDArray[np.float64],
    triangles: NDArray[np.int64],
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]] | None:
    """The edges to cross, each with its end on the left hand and the one on the right; None where triangles
    do not join the places. Of all ways that over the middles of edges is the shortest."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)  # [T, 3, 2], counter-clockwise
    edges, edge_of = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    edge_of = edge_of.reshape(-1, 3)
    is_gate = np.bincount(edge_of.ravel(), minlength=len(edges)) == 2
    first, last = _triangle_at(start, corners, triangles), _triangle_at(goal, corners, triangles)
    if first == last:
        return []
    nodes = np.vstack([corners[edges].mean(axis=1), start, goal])
    links = [edge_of[:, [0, 1]], edge_of[:, [1, 2]], edge_of[:, [2, 0]]]
    for node, triangle in ((len(edges), first), (len(edges) + 1, last)):
        links.append(np.column_stack([edge_of[triangle], np.full(3, node)]))
    begin, end = np.concatenate(links).T
    is_open = np.append(is_gate, [True, True])
    kept = is_open[begin] & is_open[end]
    begin, end = begin[kept], end[kept]
    lengths = np.linalg.norm(nodes[begin] - nodes[end], axis=1) + _ROUNDING_M
    graph = coo_array((lengths, (begin, end)), shape=(len(nodes), len(nodes))).tocsr()
    reached, before = dijkstra(graph, directed=False, indices=len(edges), return_predecessors=True)
    if not np.isfinite(reached[-1]):
        return None
    crossed = [int(before[-1])]
    while before[crossed[-1]] != len(edges):
        crossed.append(int(before[crossed[-1]]))
    beside = np.argsort(edge_of.ravel(), kind="stable") // 3  # triangles in the order of their edges
    first_beside = np.searchsorted(np.sort(edge_of.ravel()), np.arange(len(edges)))
    gates, here = [], first
    for edge in reversed(crossed):
        (side,) = np.flatnonzero(edge_of[here] == edge)
        right, left = sides[here, side]
        gates.append((corners[left], corners[right]))
        one, other = beside[first_beside[edge] : first_beside[edge] + 2]
        here = other if one == here else one
    return gates


def _triangle_at(
    place: NDArray[np.float64], corners: NDArray[np.float64], triangles: NDArray[np.int64]
) -> int:
    """The one that a place lies in, or is nearest to."""
    ring = corners[triangles]
    along, to_place = np.roll(ring, -1, axis=1) - ring, place - ring
    beside = along[..., 0] * to_place[..., 1] - along[..., 1] * to_place[..., 0]
    return int((beside / np.linalg.norm(along, axis=2)).min(axis=1).argmax())


def _tight(
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
    gates: list[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> NDArray[np.float64]:
    """The shortest way [N, 2] through gates, whose ends are on the left and on the right."""
    gates = [*gates, (goal, goal)]
    way, apex = [start], start
    left, right, left_at, right_at = start, start, -1, -1
    at = 0
    while at < len(gates):
        next_left, next_right = gates[at]
        if _turn(apex, right, next_right) >= 0.0:
            if (apex == right).all() or _turn(apex, left, next_right) < 0.0:
                right, right_at = next_right, at
            else:  # the right side crosses the left one, whose end is a corner of the way
                apex = left
                way.append(apex)
                right, right_at, at = apex, left_at, left_at + 1
                continue
        if _turn(apex, left, next_left) <= 0.0:
            if (apex == left).all() or _turn(apex, right, next_left) > 0.0:
                left, left_at = next_left, at
            else:
                apex = right
                way.append(apex)
                left, left_at, at = apex, right_at, right_at + 1
                continue
        at += 1
    return np.array([*way, goal])


def _turn(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> float:
    """Above 0 where c lies left of the line from a to b."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
