"""Trees, bushes and rocks for any landscape: where a density allows them."""

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.furnishing import Furnishing
from crowdfence.simulation.landscape.props import PropKind
from crowdfence.simulation.landscape.scatter import Acceptance, scatter

LEAVES = np.array([[74, 104, 44], [96, 120, 50], [62, 92, 48], [84, 112, 60]], np.uint8)
NEEDLES = np.array([[40, 68, 44], [34, 58, 42], [52, 78, 46]], np.uint8)
SHRUBS = np.array([[70, 98, 42], [92, 110, 48], [58, 84, 48], [112, 116, 58]], np.uint8)
STONES = np.array([[136, 132, 126], [116, 112, 108], [150, 142, 130]], np.uint8)

Extent = tuple[float, float, float, float]


def plant_trees(
    things: Furnishing,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    *,
    shares: tuple[float, float, float],
    size: float = 1.0,
) -> None:
    """Trees at points x, y: shares of conifers, broadleaf trees and birches."""
    rng = things.rng
    species = rng.choice(3, len(x), p=shares)
    kinds: tuple[tuple[PropKind, NDArray[np.uint8], float], ...] = (
        ("conifer", NEEDLES, 0.0),
        ("broadleaf", LEAVES, -0.05),
        ("birch", LEAVES, -0.1),
    )
    for index, (kind, palette, log_scale) in enumerate(kinds):
        mine = species == index
        count = int(mine.sum())
        scale = size * rng.lognormal(log_scale, 0.26, count)
        things.place(kind, x[mine], y[mine], scale=scale, colour=things.choose(palette, count), sink_m=0.15)


def plant_bushes(things: Furnishing, count: int, extent: Extent, where: Acceptance) -> None:
    """Up to `count` bushes where `where` allows them and nothing else stands."""
    x, y = scatter(count, extent, things.rng, where)
    good = things.free(x, y, 0.6)
    x, y = x[good], y[good]
    scale = things.rng.lognormal(-0.15, 0.35, len(x))
    things.place("bush", x, y, scale=scale, colour=things.choose(SHRUBS, len(x)))


def strew_rocks(things: Furnishing, count: int, extent: Extent, where: Acceptance) -> None:
    """Up to `count` rocks, most of them small."""
    x, y = scatter(count, extent, things.rng, where)
    good = things.free(x, y, 0.6)
    x, y = x[good], y[good]
    size = np.clip(things.rng.lognormal(-0.5, 0.6, len(x)), 0.2, 3.0)
    things.place("rock", x, y, scale=size, colour=things.choose(STONES, len(x)), sink_m=0.1)


def stand_look_alikes(
    things: Furnishing, sculptures: int, animals: int, extent: Extent, where: Acceptance
) -> None:
    """Statues, scarecrows and cows: as large as people, but not people."""
    rng = things.rng
    x, y = scatter(sculptures, extent, rng, where)
    good = things.free(x, y, 1.5)
    x, y = x[good], y[good]
    stone = np.arange(len(x)) % 2 == 0
    things.place("statue", x[stone], y[stone], colour=things.choose(STONES, int(stone.sum())))
    coats = np.array([[120, 60, 50], [60, 70, 110], [150, 130, 80], [70, 90, 60]], np.uint8)
    things.place("scarecrow", x[~stone], y[~stone], colour=things.choose(coats, int((~stone).sum())))
    herd_x, herd_y = scatter(max(1, animals // 8), extent, rng, where)
    if not animals or not len(herd_x):
        return
    herd = rng.integers(0, len(herd_x), animals)
    x = herd_x[herd] + rng.normal(0.0, 8.0, animals)
    y = herd_y[herd] + rng.normal(0.0, 8.0, animals)
    good = things.free(x, y, 1.5) & (where(x, y) > 0.0)
    hides = np.array([[96, 62, 42], [180, 170, 158], [60, 48, 42]], np.uint8)
    things.place("cow", x[good], y[good], colour=things.choose(hides, int(good.sum())))
