"""Exact first hits of rays with the ground lattice and with triangles, in numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.ground import Ground

Array = NDArray[np.float64]

_MAX_STEPS = 400
_TOUCH_M = 1e-3
_BISECTIONS = 40


def steepest_slope(ground: Ground) -> float:
    """Largest rise over run of any ground triangle."""
    height = ground.height_m.astype(np.float64)
    east = np.abs(np.diff(height, axis=1)).max(initial=0.0)
    north = np.abs(np.diff(height, axis=0)).max(initial=0.0)
    return float(np.hypot(east, north)) / ground.lattice.step_m


def ground_hits(ground: Ground, origin: Array, rays: Array, start: Array, max_range: float) -> Array:
    """Ray parameter of the first hit [N] with the ground; inf = none before `max_range`.

    `start` [N] is a parameter before which the ray is known to be above the ground (inf = it never meets it).
    A step is never longer than the height above the ground allows at the steepest slope, so no ridge is
    jumped over; the hit itself is bisected."""
    hit = np.full(len(rays), np.inf)
    t = np.maximum(start - 1e-9, 0.0)
    active = np.flatnonzero(np.isfinite(start))
    closing = steepest_slope(ground) * np.linalg.norm(rays[:, :2], axis=1) - rays[:, 2]
    west, south, east, north = ground.lattice.extent_m
    for _ in range(_MAX_STEPS):
        if not len(active):
            break
        point = origin + t[active, None] * rays[active]
        above = point[:, 2] - ground.height_at(point[:, 0], point[:, 1])
        landed = above <= _TOUCH_M
        inside = (point[:, 0] > west) & (point[:, 0] < east) & (point[:, 1] > south) & (point[:, 1] < north)
        hit[active[landed & inside]] = t[active[landed & inside]]
        going = ~landed & (t[active] < max_range) & (closing[active] > 0.0)
        active, above = active[going], above[going]
        t[active] += np.maximum(above / closing[active], 2e-3)
    return _bisected(ground, origin, rays, hit)


def _bisected(ground: Ground, origin: Array, rays: Array, hit: Array) -> Array:
    found = np.flatnonzero(np.isfinite(hit))
    low, high = hit[found] - 0.05, hit[found] + 0.05
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        point = origin + middle[:, None] * rays[found]
        above = point[:, 2] > ground.height_at(point[:, 0], point[:, 1])
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    exact = hit.copy()
    exact[found] = (low + high) / 2
    return exact


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
    for center in (start, end):
        from_center = origin - center
        ball = _smallest_root(
            (rays**2).sum(axis=1), rays @ from_center, float(from_center @ from_center) - radius_m**2
        )
        nearest = np.minimum(nearest, ball)
    return nearest


def _smallest_root(a: Array, half_b: Array, c: float) -> Array:
    """Smaller root of a t^2 + 2 half_b t + c = 0, inf where there is none or it lies behind."""
    inside = half_b**2 - a * c
    with np.errstate(divide="ignore", invalid="ignore"):
        root = (-half_b - np.sqrt(inside)) / a
    return np.where((inside >= 0) & (root > 0), root, np.inf)
