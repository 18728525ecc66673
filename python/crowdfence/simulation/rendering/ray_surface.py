"""Exact first hits of rays with the ground lattice and with triangles, in numpy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.ground import Ground

Array = NDArray[np.float64]

_MAX_STEPS = 2000
_STEPS_BETWEEN_SKIPS = 6
_AHEAD = 1e-7  # of a cell: past the line that the last step ended on

Skip = Callable[[Array, Array], Array]
"""(points [N, 3], rays [N, 3]) -> parameter [N] up to which a ray is surely above ground; inf = for ever."""


def ground_hits(ground: Ground, origin: Array, rays: Array, skip: Skip) -> Array:
    """Ray parameter of the first hit [N] with the ground; inf = none.

    Between two lines of the lattice (rows, columns, diagonals) ground and ray are both straight, so the hit
    between two crossings is a linear interpolation, exact on the drawn triangles. `skip` shortens the way."""
    hit = np.full(len(rays), np.inf)
    t = skip(np.broadcast_to(origin, rays.shape), rays)
    active = np.flatnonzero(np.isfinite(t))
    above = _height_above(ground, origin + t[active, None] * rays[active])
    for step in range(1, _MAX_STEPS):
        if not len(active):
            break
        ahead = _next_line(ground, origin, rays[active], t[active])
        above_ahead = _height_above(ground, origin + ahead[:, None] * rays[active])
        landed = above_ahead <= 0.0
        share = above[landed] / np.maximum(above[landed] - above_ahead[landed], 1e-12)
        first = t[active[landed]]
        hit[active[landed]] = first + np.clip(share, 0.0, 1.0) * (ahead[landed] - first)
        t[active], above = ahead, above_ahead
        going = ~landed & _over(ground, origin + ahead[:, None] * rays[active])
        active, above = active[going], above[going]
        if step % _STEPS_BETWEEN_SKIPS == 0 and len(active):
            t[active] += skip(origin + t[active, None] * rays[active], rays[active])
            active = active[np.isfinite(t[active])]
            above = _height_above(ground, origin + t[active, None] * rays[active])
    return hit


def _height_above(ground: Ground, points: Array) -> Array:
    return points[:, 2] - ground.height_at(points[:, 0], points[:, 1])


def _over(ground: Ground, points: Array) -> NDArray[np.bool_]:
    west, south, east, north = ground.lattice.extent_m
    x, y = points[:, 0], points[:, 1]
    return np.asarray((x > west) & (x < east) & (y > south) & (y < north))


def _next_line(ground: Ground, origin: Array, rays: Array, t: Array) -> Array:
    """Parameter of the next crossing of a column, a row or a diagonal of the lattice."""
    lattice = ground.lattice
    start = (origin[:2] - (lattice.west_m, lattice.south_m)) / lattice.step_m
    pace = rays[:, :2] / lattice.step_m
    starts = np.array([start[0], start[1], start[0] - start[1]])
    paces = np.column_stack([pace, pace[:, 0] - pace[:, 1]])
    here = starts + t[:, None] * paces
    line = np.where(paces > 0, np.floor(here + _AHEAD) + 1.0, np.ceil(here - _AHEAD) - 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = np.where(paces == 0.0, np.inf, (line - starts) / paces)
    # A ray straight down meets the ground before the next line, wherever that is.
    far = t + 1e4 / np.maximum(np.abs(rays[:, 2]), 1e-6)
    return np.minimum(crossing.min(axis=1), far)


def triangle_hits(origin: Array, rays: Array, corners: Array) -> Array:
    """Ray parameter of the first hit [N] with triangles [M, 3, 3] (Moeller and Trumbore 1997); inf = none."""
    nearest = np.full(len(rays), np.inf)
    for a, b, c in corners:
        edge1, edge2, offset = b - a, c - a, origin - a
        across = np.cross(rays, edge2)
        determinant = across @ edge1
        with np.errstate(divide="ignore", invalid="ignore"):
            u = (across @ offset) / determinant
            around = np.cross(offset, edge1)
            v = (rays @ around) / determinant
            t = (edge2 @ around) / determinant
        good = (np.abs(determinant) > 1e-12) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < nearest)
        nearest[good] = t[good]
    return nearest


def box_candidates(origin: Array, rays: Array, low: Array, high: Array) -> NDArray[np.int64]:
    """Rays that meet the box between corners `low` and `high`."""
    with np.errstate(divide="ignore", invalid="ignore"):
        to_low, to_high = (low - origin) / rays, (high - origin) / rays
    enter = np.nanmax(np.minimum(to_low, to_high), axis=1)
    leave = np.nanmin(np.maximum(to_low, to_high), axis=1)
    return np.flatnonzero((leave >= enter) & (leave > 0))


def capsule_hits(origin: Array, rays: Array, start: Array, end: Array, radius_m: float) -> Array:
    """Ray parameter of the first hit [N] with everything within `radius_m` of a segment; inf = none.

    The first hit is the nearest of the open cylinder around the segment and the balls at its ends."""
    axis = end - start
    length = float(np.linalg.norm(axis))
    axis = axis / length
    offset = origin - start
    along_ray, along_offset = rays @ axis, float(offset @ axis)
    ray_across = rays - along_ray[:, None] * axis
    offset_across = offset - along_offset * axis
    t = _smallest_root(
        (ray_across**2).sum(axis=1),
        ray_across @ offset_across,
        float(offset_across @ offset_across) - radius_m**2,
    )
    with np.errstate(invalid="ignore"):
        at = along_offset + t * along_ray
    nearest = np.where((at >= 0) & (at <= length), t, np.inf)
    for centre in (start, end):
        from_centre = origin - centre
        ball = _smallest_root(
            (rays**2).sum(axis=1), rays @ from_centre, float(from_centre @ from_centre) - radius_m**2
        )
        nearest = np.minimum(nearest, ball)
    return nearest


def _smallest_root(a: Array, half_b: Array, c: float) -> Array:
    """Smaller root of a t^2 + 2 half_b t + c = 0, inf where there is none or it lies behind."""
    inside = half_b**2 - a * c
    with np.errstate(divide="ignore", invalid="ignore"):
        root = (-half_b - np.sqrt(inside)) / a
    return np.where((inside >= 0) & (root > 0), root, np.inf)
