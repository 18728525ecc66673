"""Tents, barriers, flags, lamps and what else people put up. Slot 0 is the cloth or paint."""

import numpy as np

from crowdfence.simulation.rendering.meshes.shape import (
    Limb,
    Shape,
    ball,
    box,
    joined,
    loft,
    shape_of,
    tube,
)

METAL = (150, 154, 160)
POLE = (196, 198, 200)
CLOTH = 0


def tent(detail: int) -> Shape:
    """Ridge tent for two, 2.6 m x 2 m, 1.3 m high."""
    ridge = [(-1.0, 0, 1.15), (0.9, 0, 1.3)]
    floor = [(-1.35, 1.0, 0), (-1.35, -1.0, 0), (1.3, -1.05, 0), (1.3, 1.05, 0)]
    points = [*ridge, *floor]
    roof = shape_of(points, [(0, 5, 2), (0, 1, 5), (1, 0, 3), (1, 3, 4), (0, 2, 3)], smooth=False)
    door = shape_of(points, [(1, 4, 5)], smooth=False)
    return joined([roof.painted(slot=CLOTH), door.painted((110, 110, 110), CLOTH)])


def marquee(detail: int) -> Shape:
    """Open pavilion 6 m x 6 m with a pointed roof."""
    eaves, half = 2.3, 3.0
    posts = [
        tube((x, y, 0), (x, y, eaves), 0.05, 4).painted(POLE) for x in (-half, half) for y in (-half, half)
    ]
    rim = [(-half, -half, eaves), (half, -half, eaves), (half, half, eaves), (-half, half, eaves)]
    top = shape_of([*rim, (0, 0, 4.2)], [(k, (k + 1) % 4, 4) for k in range(4)], smooth=False)
    inner = shape_of([*rim, (0, 0, 4.15)], [((k + 1) % 4, k, 4) for k in range(4)], smooth=False)
    valance = [
        box((x, y, eaves - 0.15), (0.02 if x else 2 * half, 0.02 if y else 2 * half, 0.35))
        for x, y in ((half, 0), (-half, 0), (0, half), (0, -half))
    ]
    table = box((0, -1.6, 0.75), (3.2, 0.8, 0.06)).painted((230, 226, 216))
    cloth = [top.painted(slot=CLOTH), *(part.painted((255, 255, 255), CLOTH) for part in valance)]
    return joined([*posts, *cloth, inner.painted((150, 150, 150), CLOTH), table])


def barrier(detail: int) -> Shape:
    """Crowd barrier, 2.3 m long, 1.1 m high, along +x."""
    half = 1.13
    rails = [tube((-half, 0, z), (half, 0, z), 0.024, 4) for z in (0.18, 1.08)]
    ends = [tube((x, 0, 0.0), (x, 0, 1.1), 0.024, 4) for x in (-half, half)]
    feet = [tube((x, -0.28, 0.03), (x, 0.28, 0.03), 0.02, 4) for x in (-0.8, 0.8)]
    bars = [
        tube((x, 0, 0.18), (x, 0, 1.08), 0.010, 3) for x in np.linspace(-half, half, (5, 9, 15)[detail])[1:-1]
    ]
    return joined([part.painted(slot=0) for part in (*rails, *ends, *feet, *bars)])


def flag(detail: int) -> Shape:
    """Flag 1.5 m x 1 m on a 4.5 m pole; the cloth flutters."""
    pole = tube((0, 0, 0), (0, 0, 4.5), 0.035, 4, end_radius=0.02).painted(POLE)
    columns = (2, 4, 8)[detail]
    x, z = np.meshgrid(np.linspace(0.03, 1.55, columns + 1), np.linspace(3.4, 4.42, 3))
    points = np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3)
    faces = []
    for row in range(2):
        for column in range(columns):
            a = row * (columns + 1) + column
            faces += [(a, a + 1, a + columns + 2), (a, a + columns + 2, a + columns + 1)]
    cloth = shape_of(points, faces).on_limb(Limb.CLOTH).painted(slot=CLOTH)
    band = np.where(np.abs(points[:, 2] - 3.91) < 0.2, 1.0, 0.82)
    return joined([pole, cloth.shaded(band)])


def post(detail: int) -> Shape:
    """Delineator post at the edge of a road, 1.1 m."""
    body = box((0, 0, 0.5), (0.09, 0.12, 1.0)).painted(slot=0)
    band = box((0, 0, 0.82), (0.1, 0.13, 0.2)).painted((30, 30, 30))
    return joined([body, band, box((0.051, 0, 0.82), (0.01, 0.06, 0.13)).painted((230, 120, 40))])


def lamp(detail: int) -> Shape:
    """Street lamp, 6 m."""
    column = tube((0, 0, 0), (0, 0, 5.8), 0.07, 5, end_radius=0.045).painted((70, 74, 78))
    arm = tube((0, 0, 5.75), (1.2, 0, 6.0), 0.035, 4).painted((70, 74, 78))
    return joined([column, arm, box((1.3, 0, 5.98), (0.6, 0.2, 0.1)).painted((210, 210, 205))])


def parasol(detail: int) -> Shape:
    """Beach parasol 2.4 m wide, in white and coloured segments."""
    segments = (6, 8, 8)[detail]
    angle = np.arange(segments) * 2 * np.pi / segments
    rim = np.stack([1.25 * np.cos(angle), 1.25 * np.sin(angle), np.full(segments, 1.95)], axis=-1)
    parts = [tube((0, 0, 0), (0, 0, 2.35), 0.03, 4).painted(POLE)]
    for k in range(segments):
        after = (k + 1) % segments
        piece = shape_of(
            [rim[k], rim[after], (0, 0, 2.4), (0, 0, 2.36)], [(0, 1, 2), (1, 0, 3)], smooth=False
        )
        parts.append(piece.painted(slot=CLOTH) if k % 2 == 0 else piece.painted((238, 234, 226)))
    return joined(parts)


def towel(detail: int) -> Shape:
    """Beach towel 1.9 m x 0.9 m with stripes."""
    parts = [box((0, 0, 0.03), (1.9, 0.9, 0.04)).painted(slot=CLOTH)]
    parts += [box((x, 0, 0.035), (0.16, 0.88, 0.045)).painted((240, 238, 230)) for x in (-0.6, 0.0, 0.6)]
    return joined(parts)


def stage(detail: int) -> Shape:
    """Concert stage 14 m x 10 m with a roof on trusses; its open side faces +x."""
    half_x, half_y, top = 5.0, 7.0, 6.5
    deck = box((0, 0, 0.7), (2 * half_x, 2 * half_y, 1.4)).painted((52, 52, 56))
    trusses = [
        box((x, y, top / 2), (0.35, 0.35, top)).painted(METAL) for x in (-4.7, 4.7) for y in (-6.7, 6.7)
    ]
    roof = loft([(0, 0, top, 7.6, 10.4), (0, 0, top + 1.2, 5.2, 7.4)], 4, smooth=False).painted(slot=CLOTH)
    screen = box((-4.6, 0, 3.9), (0.2, 9.0, 4.2)).painted((40, 70, 120))
    towers = [box((4.4, y, 2.8), (1.0, 1.2, 2.8)).painted((24, 24, 26)) for y in (-5.6, 5.6)]
    return joined([deck, *trusses, roof, screen, *towers])


def bale(detail: int) -> Shape:
    """Round bale of hay, 1.4 m."""
    roll = tube((0, -0.65, 0.7), (0, 0.65, 0.7), 0.72, (6, 8, 14)[detail])
    return roll.painted((196, 168, 98))


def scarecrow(detail: int) -> Shape:
    """Coat and hat on a cross of sticks: the size of a person and the colours of one."""
    coat = loft([(0, 0, 0.75, 0.16, 0.26), (0, 0, 1.1, 0.12, 0.19), (0, 0, 1.45, 0.1, 0.2)], 6).painted(
        slot=CLOTH
    )
    sleeves = tube((0, -0.75, 1.38), (0, 0.75, 1.38), 0.085, 5).painted(slot=CLOTH)
    head = ball((0, 0, 1.62), (0.12, 0.11, 0.15), rings=3, sides=6).painted((206, 180, 128))
    hat = loft([(0, 0, 1.70, 0.24, 0.22), (0, 0, 1.72, 0.12, 0.11), (0, 0, 1.86, 0.08, 0.07)], 6).painted(
        (96, 70, 40)
    )
    return joined([tube((0, 0, 0), (0, 0, 1.6), 0.035, 4).painted((120, 96, 66)), coat, sleeves, head, hat])
