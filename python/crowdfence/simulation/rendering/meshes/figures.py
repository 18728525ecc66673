"""People: six kinds of body and clothing, with joints that the vertex shader moves."""

from dataclasses import dataclass

from crowdfence.simulation.rendering.meshes.shape import Limb, Shape, ball, box, joined, loft, tube

SKIN, HAIR, TOP, BOTTOM, SHOES, EXTRA = range(6)
"""Colour slots, in the order of `People.colours`."""

FIGURE_HEIGHT_M = 1.75


@dataclass(frozen=True, slots=True)
class FigureStyle:
    """What one kind of person wears."""

    long_sleeves: bool = False
    shorts: bool = False
    skirt: bool = False
    coat: bool = False
    cap: bool = False
    brim: bool = False
    backpack: bool = False
    long_hair: bool = False
    girth: float = 1.0


FIGURE_STYLES = (
    FigureStyle(),
    FigureStyle(shorts=True, cap=True),
    FigureStyle(skirt=True, long_hair=True, girth=0.92),
    FigureStyle(coat=True, long_sleeves=True, girth=1.05),
    FigureStyle(long_sleeves=True, backpack=True),
    FigureStyle(shorts=True, brim=True, girth=1.16),
)


def figure(style: FigureStyle, detail: int) -> Shape:
    """A standing person, 1.75 m tall; detail 2 for near, 1 for middle distance, 0 for far away."""
    sides = (4, 5, 8)[detail]
    parts = [*_trunk(style, sides, detail), *_head(style, sides, detail)]
    for side, leg, shin, arm, forearm in (
        (1.0, Limb.LEFT_LEG, Limb.LEFT_SHIN, Limb.LEFT_ARM, Limb.LEFT_FOREARM),
        (-1.0, Limb.RIGHT_LEG, Limb.RIGHT_SHIN, Limb.RIGHT_ARM, Limb.RIGHT_FOREARM),
    ):
        parts += _leg(style, side, sides, detail, leg, shin)
        parts += _arm(style, side, sides, detail, arm, forearm)
    return joined(parts)


def _trunk(style: FigureStyle, sides: int, detail: int) -> list[Shape]:
    g = style.girth
    chest = [
        (0.0, 0.0, 0.97, 0.105 * g, 0.155 * g),
        (0.01, 0.0, 1.10, 0.098 * g, 0.140 * g),
        (0.01, 0.0, 1.29, 0.122 * g, 0.178 * g),
        (0.0, 0.0, 1.42, 0.100 * g, 0.182 * g),
        (0.0, 0.0, 1.485, 0.055, 0.085),
    ]
    hips = [(0.0, 0.0, 0.82, 0.092 * g, 0.135 * g), (0.0, 0.0, 0.99, 0.108 * g, 0.158 * g)]
    if detail == 0:
        chest = [chest[0], chest[2], chest[3]]
    parts = [loft(chest, sides).painted(slot=TOP), loft(hips, sides).painted(slot=BOTTOM)]
    if style.skirt:
        skirt = [(0, 0, 0.52, 0.20, 0.24), (0, 0, 0.80, 0.15, 0.19), (0, 0, 1.04, 0.10, 0.145)]
        parts.append(loft(skirt, sides).painted(slot=BOTTOM))
    if style.coat:
        skirt = [(0, 0, 0.60, 0.16, 0.21), (0, 0, 0.85, 0.14, 0.19), (0, 0, 1.15, 0.115, 0.16)]
        parts.append(loft(skirt, sides).painted(slot=TOP))
    if style.backpack:
        pack = [(-0.19, 0, 1.02, 0.09, 0.13), (-0.20, 0, 1.25, 0.11, 0.15), (-0.17, 0, 1.44, 0.07, 0.11)]
        parts.append(loft(pack, sides).painted(slot=EXTRA))
    return parts


def _head(style: FigureStyle, sides: int, detail: int) -> list[Shape]:
    rings = (2, 3, 5)[detail]
    parts = [ball((0.015, 0, 1.625), (0.10, 0.078, 0.125), rings=rings, sides=sides).painted(slot=SKIN)]
    if detail:
        parts.append(tube((0, 0, 1.45), (0, 0, 1.56), 0.05, sides).painted(slot=SKIN))
    hair = ball((-0.018, 0, 1.655), (0.102, 0.09, 0.108), rings=rings, sides=sides).painted(slot=HAIR)
    parts.append(hair)
    if style.long_hair:
        fall = [(-0.07, 0, 1.38, 0.05, 0.09), (-0.06, 0, 1.55, 0.07, 0.10), (-0.04, 0, 1.68, 0.06, 0.08)]
        parts.append(loft(fall, sides).painted(slot=HAIR))
    if style.cap:
        crown = [(0, 0, 1.68, 0.118, 0.10), (0, 0, 1.74, 0.10, 0.085), (0, 0, 1.77, 0.05, 0.04)]
        parts.append(loft(crown, sides).painted(slot=EXTRA))
        if detail:
            parts.append(box((0.13, 0, 1.69), (0.12, 0.14, 0.015)).painted(slot=EXTRA))
    if style.brim:
        hat = [(0, 0, 1.69, 0.22, 0.20), (0, 0, 1.71, 0.11, 0.10), (0, 0, 1.79, 0.09, 0.08)]
        parts.append(loft(hat, sides).painted(slot=EXTRA))
    return parts


def _leg(style: FigureStyle, side: float, sides: int, detail: int, leg: Limb, shin: Limb) -> list[Shape]:
    y, g = 0.088 * side * style.girth, style.girth
    bare = style.shorts or style.skirt
    thigh = loft([(0, y, 0.47, 0.062 * g, 0.060 * g), (0, y, 0.90, 0.092 * g, 0.082 * g)], sides)
    calf = loft(
        [(0, y, 0.07, 0.040, 0.038), (-0.01, y, 0.33, 0.056, 0.052), (0, y, 0.49, 0.058, 0.055)], sides
    )
    parts = [
        thigh.painted(slot=SKIN if style.skirt else BOTTOM).on_limb(leg),
        calf.painted(slot=SKIN if bare else BOTTOM).on_limb(shin),
    ]
    if detail:
        shoe = loft(
            [(0.05, y, 0.0, 0.135, 0.05), (0.045, y, 0.05, 0.12, 0.045), (0, y, 0.1, 0.05, 0.04)], sides
        )
        parts.append(shoe.painted(slot=SHOES).on_limb(shin))
    return parts


def _arm(style: FigureStyle, side: float, sides: int, detail: int, arm: Limb, forearm: Limb) -> list[Shape]:
    y = 0.205 * side * style.girth
    upper = loft([(0, y * 1.08, 1.13, 0.042, 0.042), (0, y, 1.44, 0.056, 0.052)], sides)
    lower = loft([(0.01, y * 1.12, 0.87, 0.030, 0.030), (0, y * 1.08, 1.15, 0.041, 0.041)], sides)
    parts = [
        upper.painted(slot=TOP).on_limb(arm),
        lower.painted(slot=TOP if style.long_sleeves else SKIN).on_limb(forearm),
    ]
    if detail == 2:
        hand = ball((0.015, y * 1.12, 0.82), (0.035, 0.025, 0.06), rings=2, sides=5)
        parts.append(hand.painted(slot=SKIN).on_limb(forearm))
    return parts
