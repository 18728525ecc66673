"""Places for things: random points with a density, kept apart and off the road."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Acceptance = Callable[[Points, Points], NDArray[np.floating]]


def scatter(
    count: int,
    extent_m: tuple[float, float, float, float],
    rng: np.random.Generator,
    acceptance: Acceptance | None = None,
) -> tuple[Points, Points]:
    """Up to `count` points x, y in (west, south, east, north); each is kept with
    probability `acceptance(x, y)`.

    Gives up, with fewer points, after drawing 60 times as many: there may be no room for more."""
    west, south, east, north = extent_m
    kept_x: list[Points] = []
    kept_y: list[Points] = []
    found = 0
    for _ in range(30):
        if found >= count:
            break
        x, y = rng.uniform(west, east, 2 * count), rng.uniform(south, north, 2 * count)
        chance = rng.uniform(0.0, 1.0, 2 * count)
        keep = np.ones(2 * count, bool) if acceptance is None else chance < acceptance(x, y)
        kept_x.append(x[keep])
        kept_y.append(y[keep])
        found += int(keep.sum())
    if not kept_x:
        return np.zeros(0), np.zeros(0)
    return np.concatenate(kept_x)[:count], np.concatenate(kept_y)[:count]
