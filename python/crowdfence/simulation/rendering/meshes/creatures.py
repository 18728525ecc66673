"""Animals and statues: as large as people, but not people."""

from crowdfence.simulation.rendering.meshes.figures import FigureStyle, figure
from crowdfence.simulation.rendering.meshes.shape import Shape, ball, box, joined, loft, tube


def cow(detail: int) -> Shape:
    """Grazing cow, 2.3 m long. Slot 0 is the coat."""
    sides = (5, 6, 9)[detail]
    rings = [(-0.95, 0.24, 0.2), (-0.7, 0.36, 0.32), (0.2, 0.40, 0.36), (0.75, 0.34, 0.28), (0.95, 0.2, 0.16)]
    body = loft([(0, 0, *ring) for ring in rings], sides)
    along = body.turned([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]).moved((0, 0, 1.0)).painted(slot=0)
    neck = tube((0.8, 0, 1.1), (1.25, 0, 0.75), 0.2, sides, end_radius=0.13).painted(slot=0)
    head = ball((1.38, 0, 0.58), (0.2, 0.13, 0.26), rings=3, sides=sides).painted(slot=0)
    legs = [tube((x, y, 0), (x, y, 0.9), 0.06, 4, end_radius=0.12).painted((220, 220, 220), 0)
            for x in (-0.7, 0.65) for y in (-0.2, 0.2)]  # fmt: skip
    patch = ball((0.1, 0.05, 1.2), (0.45, 0.36, 0.24), rings=3, sides=sides).painted((236, 230, 220))
    return joined([along, neck, head, *legs, patch])


def statue(detail: int) -> Shape:
    """Stone figure on a plinth, 3 m in all. Slot 0 is the stone."""
    body = figure(FigureStyle(coat=True, long_sleeves=True), detail).painted(slot=0).scaled(1.15)
    still = Shape(body.position, body.normal, body.colour, body.limb * 0, body.triangles)
    plinth = joined([box((0, 0, 0.45), (1.0, 1.0, 0.9)), box((0, 0, 0.95), (1.2, 1.2, 0.12))])
    return joined([plinth.painted((200, 200, 200), 0), still.moved((0, 0, 1.0))])
