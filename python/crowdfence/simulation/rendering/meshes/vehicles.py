"""Parked cars, vans and boats. Slot 0 is the paint."""

import numpy as np

from crowdfence.simulation.rendering.meshes.shape import Shape, box, joined, loft, shape_of, tube

GLASS = (30, 36, 44)
TYRE = (28, 28, 30)
PAINT = 0


def car(detail: int) -> Shape:
    """Saloon, 4.4 m x 1.8 m."""
    outline = [
        (-2.18, 0.45),
        (-2.2, 0.82),
        (-1.95, 0.98),
        (0.75, 0.98),
        (1.35, 0.92),
        (2.1, 0.78),
        (2.2, 0.45),
    ]
    cabin = [(-1.75, 0.96), (-1.3, 1.42), (0.2, 1.46), (0.95, 0.97)]
    return _road_vehicle(outline, cabin, 0.9, detail)


def van(detail: int) -> Shape:
    """Delivery van or camper, 5.4 m x 2 m."""
    outline = [
        (-2.68, 0.5),
        (-2.7, 2.25),
        (-2.55, 2.38),
        (1.1, 2.38),
        (1.5, 2.2),
        (1.9, 1.35),
        (2.6, 1.12),
        (2.7, 0.5),
    ]
    windows = [(-0.4, 1.45), (-0.4, 2.05), (1.3, 2.05), (1.8, 1.4)]
    return _road_vehicle(outline, windows, 1.0, detail, cabin_width=1.012)


def _road_vehicle(
    outline: list[tuple[float, float]],
    cabin: list[tuple[float, float]],
    half_width_m: float,
    detail: int,
    cabin_width: float = 0.86,
) -> Shape:
    body = _slab(outline, half_width_m).painted(slot=PAINT)
    glass = _slab(cabin, half_width_m * cabin_width).painted(GLASS)
    parts = [body, glass]
    if cabin_width < 1.0:
        roof = [(x * 0.98, z + 0.02) for x, z in cabin[1:3]]
        low = [(x, z - 0.06) for x, z in (roof[1], roof[0])]
        parts.append(
            _slab([low[1], roof[0], roof[1], low[0]], half_width_m * cabin_width * 0.97).painted(slot=PAINT)
        )
    front, rear = outline[-1][0], outline[0][0]
    parts += [
        tube((x, y, 0.33), (x, np.sign(y) * (half_width_m + 0.02), 0.33), 0.33, (6, 8, 12)[detail]).painted(
            TYRE
        )
        for x in (0.62 * rear, 0.62 * front)
        for y in (half_width_m - 0.24, -half_width_m + 0.24)
    ]
    if detail == 2:
        for y in (-0.62, 0.62):
            parts.append(box((front - 0.04, y, 0.66), (0.1, 0.3, 0.13)).painted((236, 234, 220)))
            parts.append(box((rear + 0.02, y, 0.72), (0.1, 0.3, 0.12)).painted((150, 20, 20)))
        parts.append(box((front - 0.02, 0, 0.42), (0.1, 1.5, 0.16)).painted((50, 50, 54)))
    return joined(parts)


def _slab(outline: list[tuple[float, float]], half_width_m: float) -> Shape:
    """Side view (x, z), clockwise from the rear bottom, extruded to both sides."""
    count = len(outline)
    x, z = np.array(outline).T
    left = np.stack([x, np.full(count, half_width_m), z], axis=-1)
    right = np.stack([x, np.full(count, -half_width_m), z], axis=-1)
    faces = []
    for k in range(count):
        after = (k + 1) % count
        faces += [(k, after, count + after), (k, count + after, count + k)]
    faces += [(0, k + 1, k) for k in range(1, count - 1)]
    faces += [(count, count + k, count + k + 1) for k in range(1, count - 1)]
    turned = [(a, c, b) for a, b, c in faces]
    return shape_of(np.concatenate([left, right]), turned, smooth=False)


def boat(detail: int) -> Shape:
    """Rowing boat on land, 4.6 m."""
    sides = (6, 8, 12)[detail]
    hull = loft([(0, 0, 0.0, 1.5, 0.35), (0, 0, 0.3, 2.1, 0.75), (0.1, 0, 0.62, 2.35, 0.88)], sides).painted(
        slot=0
    )
    inside = loft([(0.1, 0, 0.5, 2.1, 0.74), (0.1, 0, 0.635, 2.2, 0.78)], sides).painted((120, 92, 64))
    benches = [box((x, 0, 0.66), (0.25, 1.4, 0.05)).painted((150, 120, 84)) for x in (-0.9, 0.3)]
    return joined([hull, inside, *benches])
