"""Faces of many corners -> triangles that cover them and no more, by cutting off ears (Meisters 1975)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Triangle = tuple[int, int, int]
Array = NDArray[np.float64]

MOST_CORNERS = 1000
"""Of a face; cutting it up takes a second then, and four for twice as many."""
_CHUNK_CORNERS = 1 << 22


def triangles_of_faces(vertices: Array, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles [M, 3] of vertices, by their numbers, of simple polygons [N, K] of so many vertices.
    ValueError for one of more than `MOST_CORNERS` that is not convex."""
    corners = faces.shape[1]
    if corners == 3:
        return faces
    rows = max(1, _CHUNK_CORNERS // corners)
    parts = [_triangles_of_chunk(vertices, faces[row : row + rows]) for row in range(0, len(faces), rows)]
    return np.concatenate(parts) if parts else np.empty((0, 3), np.int64)


def _triangles_of_chunk(vertices: Array, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    corners = faces.shape[1]
    if corners == 4:
        second = fans_from_second(vertices[faces])
        return _fans(np.where(second[:, np.newaxis], np.roll(faces, -1, axis=1), faces))
    concave = (_turns(_plans(vertices[faces])) < 0.0).any(axis=1)
    if concave.any() and corners > MOST_CORNERS:
        raise ValueError(
            f"a face that is not convex has {corners} corners, the bound is {MOST_CORNERS}; write it with "
            "triangles alone"
        )
    cut = [face[triangles_of(vertices[face])] for face in faces[concave]]
    return np.concatenate([_fans(faces[~concave]), *cut])


def fans_from_second(corners: Array) -> NDArray[np.bool_]:
    """Which [N] of the quads [N, 4, 3] a fan from the first corner does not cover, but one from the second:
    those with a notch at the second or the fourth."""
    a, b, c, d = (corners[:, corner] for corner in range(4))
    normal = np.cross(c - a, d - b)
    at_second = (np.cross(b - a, c - a) * normal).sum(axis=1)
    at_fourth = (np.cross(c - a, d - a) * normal).sum(axis=1)
    notched = np.flatnonzero(np.minimum(at_second, at_fourth) < 0.0)
    deepest = np.argmin(_turns(_plans(corners[notched])), axis=1)
    result = np.zeros(len(corners), np.bool_)
    result[notched] = deepest % 2 == 1
    return result


def _fans(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.concatenate([faces[:, [0, at, at + 1]] for at in range(1, faces.shape[1] - 1)])


def triangles_of(corners: Array) -> list[Triangle]:
    """Triangles of corners, by their numbers, of the simple polygon through `corners` [N, 3], which lie about
    in one plane. A fan where it is convex, and for what is left where the polygon crosses itself."""
    plan = _plans(corners)
    left = list(range(len(plan)))
    triangles: list[Triangle] = []
    if (_turns(plan) >= 0.0).all():
        return _fan(left)
    while len(left) > 3:
        ear = _ear(plan[left])
        if ear is None:
            break
        before, at, after = left[ear - 1], left[ear], left[(ear + 1) % len(left)]
        triangles.append((before, at, after))
        del left[ear]
    return triangles + _fan(left)


def _fan(left: list[int]) -> list[Triangle]:
    return [(left[0], b, c) for b, c in pairwise(left[1:])]


def _plans(corners: Array) -> Array:
    """Polygons [..., N, 3] seen along the axis that each faces most, from where its corners turn left:
    [..., N, 2]."""
    away = corners - corners.mean(axis=-2, keepdims=True)
    normal = np.cross(away, np.roll(away, -1, axis=-2)).sum(axis=-2)
    axis = np.argmax(np.abs(normal), axis=-1)[..., np.newaxis]
    left = np.take_along_axis(normal, axis, axis=-1) >= 0.0
    seen = np.where(left, np.concatenate([axis + 1, axis + 2], -1), np.concatenate([axis + 2, axis + 1], -1))
    return np.take_along_axis(away, seen[..., np.newaxis, :] % 3, axis=-1)


def _turns(plan: Array) -> Array:
    """Twice the area [..., N] of the triangle of every corner and its neighbours, positive where it turns
    left."""
    before, after = np.roll(plan, 1, axis=-2), np.roll(plan, -1, axis=-2)
    return _twice_area(before, plan, after)


def _ear(plan: Array) -> int | None:
    """A corner whose triangle with its neighbours is inside the polygon and holds no other corner."""
    turns = _turns(plan)
    for corner in np.flatnonzero(turns >= 0.0).tolist():
        a, b, c = plan[corner - 1], plan[corner], plan[(corner + 1) % len(plan)]
        sides = ((a, b), (b, c), (c, a))
        inside = np.logical_and.reduce([_twice_area(*side, plan) >= 0.0 for side in sides])
        # Where a polygon goes round a hole, corners lie upon each other.
        own = (plan == a).all(axis=1) | (plan == b).all(axis=1) | (plan == c).all(axis=1)
        if turns[corner] == 0.0 or not (inside & ~own).any():
            return int(corner)
    return None


def _twice_area(a: Array, b: Array, c: Array) -> Array:
    return np.asarray(
        (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
    )
