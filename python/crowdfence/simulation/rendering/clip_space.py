"""Matrices from the world to OpenGL's clip space, and what lies inside them.

The image's row 0 is at y = -1, so that rows come back from the driver top first; triangles that face the
camera then turn clockwise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.simulation.rendering.sample_lattice import SampleLattice

Array = NDArray[np.float64]

NEAR_M, FAR_M = 0.6, 9000.0


def rigid_inverse(transform: Array) -> Array:
    """Inverse of a rotation and translation [4, 4]."""
    inverse = np.eye(4)
    inverse[:3, :3] = transform[:3, :3].T
    inverse[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return inverse


def clip_from_camera(lattice: SampleLattice) -> Array:
    """Projection of a pinhole with OpenCV axes; w is the distance along the optical axis."""
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[0, 2] = 2.0 * lattice.fx / lattice.width, 2.0 * lattice.cx / lattice.width - 1.0
    matrix[1, 1], matrix[1, 2] = 2.0 * lattice.fy / lattice.height, 2.0 * lattice.cy / lattice.height - 1.0
    matrix[2, 2] = (FAR_M + NEAR_M) / (FAR_M - NEAR_M)
    matrix[2, 3] = -2.0 * FAR_M * NEAR_M / (FAR_M - NEAR_M)
    matrix[3, 2] = 1.0
    return matrix


def side_planes(clip_from_world: Array) -> Array:
    """Left, right, top, bottom and near plane [5, 4]; positive inside, in metres."""
    x, y, z, w = clip_from_world
    planes = np.stack([w + x, w - x, w + y, w - y, w + z])
    return np.asarray(planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True))


def inside(planes: Array, centre: Array, radius_m: ArrayLike) -> NDArray[np.bool_]:
    """Which spheres (centre [N, 3], radius) reach into the planes' intersection."""
    distance = centre @ planes[:, :3].T + planes[:, 3]
    return np.asarray((distance > -np.asarray(radius_m)[..., None]).all(axis=1))


def light_from_world(
    sun_direction: ArrayLike, focus: Array, radius_m: float, texels: int, depth_m: float
) -> Array:
    """Orthographic clip space along the sun's rays: a disc of `radius_m` around `focus`, +-`depth_m` deep.

    The focus is snapped to whole texels so that shadows do not crawl when it moves."""
    sun = np.asarray(sun_direction, np.float64)
    side = np.cross([0.0, 0.0, 1.0] if abs(sun[2]) < 0.999 else [1.0, 0.0, 0.0], sun)
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(sun, side), -sun])
    centre = axes @ focus
    texel = 2.0 * radius_m / texels
    centre[:2] = np.round(centre[:2] / texel) * texel
    matrix = np.eye(4)
    scale = np.array([1.0 / radius_m, 1.0 / radius_m, 1.0 / depth_m])
    matrix[:3, :3] = axes * scale[:, None]
    matrix[:3, 3] = -centre * scale
    return matrix


def texture_from_clip(bias_m: float, depth_m: float) -> Array:
    """Clip space -> [0, 1] texture space, with depths moved `bias_m` towards the light."""
    matrix = np.diag([0.5, 0.5, 0.5, 1.0])
    matrix[:3, 3] = 0.5
    matrix[2, 3] -= 0.5 * bias_m / depth_m
    return matrix


def checked_pose(world_from_camera: ArrayLike) -> Array:
    """The transform [4, 4] as float64; ValueError when it is none."""
    pose = np.asarray(world_from_camera, np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ValueError(f"world_from_camera must be a finite [4, 4] transform, got shape {pose.shape}")
    return pose


def ray_from_clip(projection: Array, pose: Array) -> Array:
    """Clip x, y (w = 1) -> ray in the world, by the lattice's pinhole."""
    ray = np.zeros((4, 4))
    ray[0, 0], ray[0, 3] = 1.0 / projection[0, 0], -projection[0, 2] / projection[0, 0]
    ray[1, 1], ray[1, 3] = 1.0 / projection[1, 1], -projection[1, 2] / projection[1, 1]
    ray[2, 3] = 1.0
    turn = np.eye(4)
    turn[:3, :3] = pose[:3, :3]
    return np.asarray(turn @ ray)
