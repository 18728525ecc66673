"""A road cyclist: bicycle and bent rider; the vertex shader turns cranks and legs with the pedal phase."""

import numpy as np

from crowdfence.simulation.rendering.meshes.figures import BOTTOM, EXTRA, SHOES, SKIN, TOP
from crowdfence.simulation.rendering.meshes.shape import Limb, Shape, ball, joined, loft, shape_of, tube

# Joints that the vertex shader repeats: bottom bracket and hip, thigh and shin lengths.
BRACKET_Z_M, HIP_X_M, HIP_Z_M = 0.28, -0.16, 0.98
THIGH_M, SHIN_M, CRANK_M = 0.43, 0.44, 0.17
WHEEL_RADIUS_M = 0.34


def cyclist() -> Shape:
    """Rider on a road bicycle, front along +x. Legs hang down from the hip; the shader bends them."""
    return joined([*_bicycle(), *_rider()])


def _wheel(x: float) -> Shape:
    turns, sides = 20, 5
    around = np.arange(turns) * 2 * np.pi / turns
    section = np.arange(sides) * 2 * np.pi / sides
    radius = WHEEL_RADIUS_M - 0.02 + 0.02 * np.cos(section)
    points = np.stack(
        [
            x + np.outer(np.cos(around), radius),
            np.broadcast_to(0.016 * np.sin(section), (turns, sides)),
            WHEEL_RADIUS_M + np.outer(np.sin(around), radius),
        ],
        axis=-1,
    ).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(turns), np.arange(sides), indexing="ij")
    a, b = i * sides + j, ((i + 1) % turns) * sides + j
    c, d = ((i + 1) % turns) * sides + (j + 1) % sides, i * sides + (j + 1) % sides
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return shape_of(points, faces).painted((32, 32, 34))


def _bicycle() -> list[Shape]:
    seat, head, bracket = (-0.17, 0, 0.86), (0.36, 0, 0.84), (0.0, 0, BRACKET_Z_M)
    rear, front = (-0.50, 0, WHEEL_RADIUS_M), (0.52, 0, WHEEL_RADIUS_M)
    bars = [(seat, head), (seat, bracket), (bracket, head), (bracket, rear), (seat, rear), (head, front)]
    parts = [_wheel(-0.50), _wheel(0.52)]
    parts += [tube(a, b, 0.02, 5).painted(slot=EXTRA) for a, b in bars]
    parts.append(tube((0.40, -0.21, 0.93), (0.40, 0.21, 0.93), 0.014, 4).painted((30, 30, 30)))
    parts.append(loft([(-0.2, 0, 0.90, 0.13, 0.06), (-0.2, 0, 0.94, 0.13, 0.07)], 6).painted((25, 25, 25)))
    parts += [
        tube((0, y, BRACKET_Z_M), (0, y, BRACKET_Z_M + sign * CRANK_M), 0.012, 4)
        .painted((60, 60, 62))
        .on_limb(Limb.CRANK)
        for y, sign in ((0.09, -1.0), (-0.09, 1.0))
    ]
    return parts


def _rider() -> list[Shape]:
    back = loft(
        [
            (0, 0, 0, 0.10, 0.14),
            (0, 0, 0.22, 0.115, 0.15),
            (0, 0, 0.46, 0.09, 0.18),
            (0, 0, 0.54, 0.05, 0.08),
        ],
        8,
    )
    lean = np.radians(52.0)
    turn = [[np.cos(lean), 0, np.sin(lean)], [0, 1, 0], [-np.sin(lean), 0, np.cos(lean)]]
    parts = [
        back.turned(turn).moved((HIP_X_M, 0, HIP_Z_M - 0.02)).painted(slot=TOP),
        ball((HIP_X_M, 0, HIP_Z_M), (0.13, 0.15, 0.11), rings=3, sides=8).painted(slot=BOTTOM),
        ball((0.36, 0, 1.40), (0.105, 0.08, 0.12), rings=4, sides=8).painted(slot=SKIN),
        ball((0.345, 0, 1.45), (0.15, 0.10, 0.095), rings=4, sides=8).painted(slot=EXTRA),
    ]
    for side, leg, shin in ((1.0, Limb.LEFT_LEG, Limb.LEFT_SHIN), (-1.0, Limb.RIGHT_LEG, Limb.RIGHT_SHIN)):
        y = 0.1 * side
        knee_z, ankle_z = HIP_Z_M - THIGH_M, HIP_Z_M - THIGH_M - SHIN_M
        thigh = loft([(HIP_X_M, y, knee_z, 0.062, 0.058), (HIP_X_M, y, HIP_Z_M, 0.09, 0.08)], 7)
        calf = loft([(HIP_X_M, y, ankle_z, 0.036, 0.036), (HIP_X_M - 0.01, y, knee_z - 0.14, 0.056, 0.052),
                     (HIP_X_M, y, knee_z, 0.057, 0.054)], 7)  # fmt: skip
        shoe = ball((HIP_X_M + 0.06, y, ankle_z - 0.02), (0.13, 0.045, 0.04), rings=2, sides=6)
        parts += [
            thigh.painted(slot=BOTTOM).on_limb(leg),
            calf.painted(slot=SKIN).on_limb(shin),
            shoe.painted(slot=SHOES).on_limb(shin),
            tube((0.17, 0.17 * side, 1.32), (0.30, 0.20 * side, 1.10), 0.045, 6, end_radius=0.038).painted(
                slot=TOP
            ),
            tube((0.30, 0.20 * side, 1.10), (0.41, 0.19 * side, 0.95), 0.036, 6, end_radius=0.03).painted(
                slot=SKIN
            ),
        ]
    return parts
