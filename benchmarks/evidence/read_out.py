"""What the neighbours of a place can say of it when the map is read: `python read_out.py MISSION.mcap...`.

The ground of a crowd has no gaps that a disc of 2 m cannot enter and is never smaller than three people's, so
closing the probability, opening it, or smoothing it might give the IoU what single voxels miss. All are done
on columns, with the largest log odds of each; ground that was never seen neither closes nor opens anything.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from curves import Contender, Curve, curves
from judge import FINE
from numpy.typing import NDArray
from scipy import ndimage
from seen import Mission, seen
from tuned import TUNED

FAR = 1.0
"""Ground closed for nothing, times the crowds' own, at which people in zones are counted."""
LOWEST, HIGHEST = -20.0, 20.0
"""Log odds of what is never called crowd, and of what always is."""

Filter = Callable[[NDArray[np.float64], NDArray[np.bool_], float], NDArray[np.float64]]
"""Log odds [i, j], seen [i, j], voxel size -> log odds [i, j]."""


def disc(radius_m: float, size_m: float) -> NDArray[np.bool_]:
    reach = int(np.ceil(radius_m / size_m))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return x**2 + y**2 <= (radius_m / size_m) ** 2 + 1e-9


def closed(
    log_odds: NDArray[np.float64], seen: NDArray[np.bool_], size_m: float, *, radius_m: float
) -> NDArray[np.float64]:
    part = disc(radius_m, size_m)
    grown = ndimage.maximum_filter(log_odds, footprint=part, mode="constant", cval=LOWEST)
    return ndimage.minimum_filter(grown, footprint=part, mode="constant", cval=HIGHEST)


def opened(
    log_odds: NDArray[np.float64], seen: NDArray[np.bool_], size_m: float, *, radius_m: float
) -> NDArray[np.float64]:
    part = disc(radius_m, size_m)
    held = np.where(seen, log_odds, HIGHEST)
    shrunk = ndimage.minimum_filter(held, footprint=part, mode="constant", cval=HIGHEST)
    shrunk = np.where(seen, shrunk, LOWEST)
    return ndimage.maximum_filter(shrunk, footprint=part, mode="constant", cval=LOWEST)


def smoothed(
    log_odds: NDArray[np.float64], seen: NDArray[np.bool_], size_m: float, *, sigma_m: float
) -> NDArray[np.float64]:
    blur = partial(ndimage.gaussian_filter, sigma=sigma_m / size_m, truncate=3.0, mode="constant")
    return blur(np.where(seen, log_odds, 0.0)) / np.maximum(blur(seen.astype(np.float64)), 1e-9)


FILTERS: dict[str, Filter | None] = {
    "as it is": None,
    **{f"closed by a disc of {r:g} m": partial(closed, radius_m=r) for r in (1.0, 2.0, 3.0)},
    **{f"opened by a disc of {r:g} m": partial(opened, radius_m=r) for r in (0.5, 1.0)},
    **{f"smoothed over {s:g} m": partial(smoothed, sigma_m=s) for s in (0.25, 0.5, 1.0, 2.0)},
}


def contender(name: str, mission: Mission) -> Contender:
    change = FILTERS[name]
    if change is None:
        return Contender(name, TUNED[0].method)
    terrain = mission.terrain

    def reading(ids: NDArray[np.int64], probability: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = terrain.voxel_indices(ids)[:, :2].astype(np.int64)
        at = tuple((columns - columns.min(axis=0)).T)
        own = np.log(probability) - np.log1p(-probability)
        grid = np.full([int(axis.max()) + 1 for axis in at], LOWEST)
        np.maximum.at(grid, at, own)
        found = change(grid, grid > LOWEST, terrain.voxel_size_m)[at]
        return 1.0 / (1.0 + np.exp(-found))

    return Contender(name, TUNED[0].method, reading)


def in_zones(curve: Curve) -> float:
    """Share of the people in range, where `FAR` is closed for nothing."""
    at = min(int(FAR * curve.own), len(curve.far) - 1)
    return float(np.mean(curve.people >= np.sort(curve.far)[::-1][at]))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("missions", type=Path, nargs="+")
    parser.add_argument("--every", type=int, default=1, help="Count the IoU at every so many instants.")
    arguments = parser.parse_args()
    found: dict[str, list[Curve]] = {name: [] for name in FILTERS}
    for path in arguments.missions:
        mission = seen(path)
        contenders = [contender(name, mission) for name in FILTERS]
        for name, curve in zip(FILTERS, curves(mission, contenders, every=arguments.every), strict=True):
            found[name].append(curve)
    print("| | mIoU, one threshold | best mIoU of each | people in range in a zone |\n|---|---|---|---|")
    for name, of in found.items():
        mean = np.mean([[one.sweep.at(float(at)).mean for at in FINE] for one in of], axis=0)
        best = np.mean([one.sweep.best()[1].mean for one in of])
        people = np.mean([in_zones(one) for one in of])
        print(f"| {name} | {mean.max():.3f} | {best:.3f} | {people:.3f} |", flush=True)


if __name__ == "__main__":
    sys.exit(main())
