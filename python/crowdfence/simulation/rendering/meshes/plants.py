"""Trees and bushes: soft clouds of leaves and tiers of needles. Slot 0 is the foliage colour."""

import numpy as np

from crowdfence.simulation.rendering.meshes.shape import Shape, ball, joined, shape_of, tube

BARK = (92, 72, 56)
BIRCH_BARK = (214, 210, 202)
FOLIAGE = 0


def conifer(detail: int, seed: int) -> Shape:
    """Spruce, about 10 m: ragged tiers of drooping branches."""
    rng = np.random.default_rng([seed, 31])
    tiers = (3, 6, 9)[detail]
    points = (5, 8, 11)[detail]
    parts = [tube((0, 0, -0.3), (0, 0, 5.0), 0.2, 5, end_radius=0.09).painted(BARK)]
    for tier in range(tiers):
        share = tier / tiers
        base, radius = 0.9 + 8.3 * share, 2.35 * (1.0 - share) ** 0.85 + 0.18
        height = (9.2 / tiers) * (1.75 - 0.3 * share)
        parts.append(_needle_tier(base, radius, height, points, rng, light=0.66 + 0.4 * share))
    return joined(parts)


def _needle_tier(
    base_m: float, radius_m: float, height_m: float, points: int, rng: np.random.Generator, light: float
) -> Shape:
    corners = 2 * points
    angle = np.arange(corners) * np.pi / points + rng.uniform(0, 2 * np.pi)
    out = np.where(np.arange(corners) % 2 == 0, 1.0, 0.62) * rng.uniform(0.8, 1.12, corners) * radius_m
    droop = np.where(np.arange(corners) % 2 == 0, -0.16, 0.10) * radius_m + rng.uniform(-0.08, 0.08, corners)
    rim = np.stack([out * np.cos(angle), out * np.sin(angle), base_m + droop], axis=-1)
    tip = np.array([[rng.uniform(-0.06, 0.06), rng.uniform(-0.06, 0.06), base_m + height_m]])
    following = (np.arange(corners) + 1) % corners
    faces = np.stack([np.arange(corners), following, np.full(corners, corners)], axis=-1)
    cone = shape_of(np.concatenate([rim, tip]), faces).painted(slot=FOLIAGE)
    # Bright tips, dark inside: what the sky lights and what the branches above hide.
    return cone.shaded(np.append(np.where(np.arange(corners) % 2 == 0, 1.08, 0.72), 0.62) * light)


def _crown(
    blobs: int,
    low_m: float,
    high_m: float,
    radius_m: float,
    blob_m: float,
    detail: int,
    rng: np.random.Generator,
) -> list[Shape]:
    """Leaf clouds in an egg between two heights; normals lean outwards so that the crown reads as one."""
    middle = np.array([0.0, 0.0, (low_m + high_m) / 2])
    half = np.array([radius_m, radius_m, (high_m - low_m) / 2])
    parts = []
    for blob in range(blobs):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        at = middle + direction * half * (0.62 if blob else 0.0)
        size = blob_m * rng.uniform(0.8, 1.2) * (1.25 if blob == 0 else 1.0)
        rings, sides = ((2, 5), (3, 6), (4, 8))[detail]
        cloud = ball(at, (size, size, 0.85 * size), rings=rings, sides=sides, roughness=0.16, rng=rng)
        outwards = (cloud.position - middle) / half
        normal = cloud.normal + 0.8 * outwards / np.maximum(
            np.linalg.norm(outwards, axis=1, keepdims=True), 1e-6
        )
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        light = 0.62 + 0.42 * np.clip((cloud.position[:, 2] - low_m) / (high_m - low_m), 0, 1)
        light *= 0.9 + 0.1 * np.clip(np.linalg.norm(outwards, axis=1), 0, 1.3)
        cloud = Shape(cloud.position, normal, cloud.colour, cloud.limb, cloud.triangles)
        parts.append(cloud.painted(slot=FOLIAGE).shaded(light * rng.uniform(0.92, 1.06)))
    return parts


def broadleaf(detail: int, seed: int) -> Shape:
    """Maple or beech, about 8 m."""
    rng = np.random.default_rng([seed, 32])
    trunk = tube((0, 0, -0.3), (0.1, 0, 3.6), 0.24, 6, end_radius=0.14).painted(BARK)
    limbs = [
        tube((0.06, 0, 2.2), (1.1 * np.cos(a), 1.1 * np.sin(a), 4.2), 0.11, 4, end_radius=0.05).painted(BARK)
        for a in rng.uniform(0, 2 * np.pi, 3)
    ]
    crown = _crown((4, 8, 13)[detail], 2.2, 8.2, 2.5, (2.1, 1.6, 1.35)[detail], detail, rng)
    return joined([trunk, *(limbs if detail else []), *crown])


def birch(detail: int, seed: int) -> Shape:
    """Slender birch, about 9 m."""
    rng = np.random.default_rng([seed, 33])
    trunk = tube((0, 0, -0.3), (0.15, 0, 6.5), 0.13, 5, end_radius=0.05).painted(BIRCH_BARK)
    crown = _crown((3, 7, 11)[detail], 3.0, 9.2, 1.45, (1.5, 1.1, 0.92)[detail], detail, rng)
    return joined([trunk, *crown])


def bush(detail: int, seed: int) -> Shape:
    """Shrub, about 1.3 m high and 2 m wide."""
    rng = np.random.default_rng([seed, 34])
    return joined(_crown((2, 4, 7)[detail], 0.05, 1.3, 0.85, (0.75, 0.62, 0.5)[detail], detail, rng))
