"""Scattered ground points -> a surface without gaps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

GAP = 2.0
"""Of points that lie at random, one disc in 300,000 is as large."""


def triangulate(points: NDArray[np.float64], max_hole_m: float) -> NDArray[np.int64]:
    """Triangles [M, 3] over ground points [N, 3]: Delaunay in plan, so gaps are bridged by flat pieces.

    Triangles with a side longer than `max_hole_m` in plan are left out: beyond that the ground is not known.
    Empty when the points lie on one line.
    """
    from scipy.spatial import Delaunay, QhullError

    if len(points) < 3:
        return np.empty((0, 3), np.int64)
    plan = points[:, :2] - points[:, :2].mean(axis=0)  # Qhull's tolerance follows the largest coordinate
    try:
        triangles = Delaunay(plan).simplices
    except QhullError:
        return np.empty((0, 3), np.int64)
    corners = plan[triangles]
    sides_m = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    return np.asarray(triangles[(sides_m <= max_hole_m).all(axis=1)], np.int64)


def unmeasured(columns: NDArray[np.int64], measured: NDArray[np.int64]) -> NDArray[np.int64]:
    """Those of a surface's columns (i, j) [C, 2] that lie in its gaps: where a disc fits between the columns
    that hold a point [M, 2] whose radius is `GAP` times the mean distance of points."""
    from scipy.spatial import cKDTree

    reach = GAP * float(np.sqrt(len(columns) / len(measured)))
    to_point, _ = cKDTree(measured).query(columns, distance_upper_bound=reach)
    middles = columns[np.isinf(to_point)]
    if not len(middles):
        return middles
    to_middle, _ = cKDTree(middles).query(columns, distance_upper_bound=reach)
    return columns[np.isfinite(to_middle) & (to_point > 0)]
