"""Faces of many corners -> triangles that cover them and no more, by cutting off ears (Meisters 1975)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Triangle = tuple[int, int, int]
Array = NDArray[np.float64]


def triangles_of(corners: Array) -> list[Triangle]:
    """Triangles of corners, by their numbers, of the simple polygon through `corners` [N, 3], which lie about
    in one plane. A fan where it is convex, and for what is left where the polygon crosses itself."""
    plan = _plan(corners)
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


def _plan(corners: Array) -> Array:
    """The polygon [N, 2] seen along the axis that it faces most, from where its corners turn left."""
    after = np.roll(corners, -1, axis=0)
    middle = corners.mean(axis=0)
    normal = np.cross(corners - middle, after - middle).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    plan = corners[:, [(axis + 1) % 3, (axis + 2) % 3]] - middle[[(axis + 1) % 3, (axis + 2) % 3]]
    return plan if normal[axis] >= 0.0 else plan[:, ::-1]


def _turns(plan: Array) -> Array:
    """Twice the area [N] of the triangle of every corner and its neighbours, positive where it turns left."""
    before, after = np.roll(plan, 1, axis=0), np.roll(plan, -1, axis=0)
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
