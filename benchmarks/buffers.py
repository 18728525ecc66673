"""What a safety distance around a crowd costs: `grown`, and the same buffer by shapely of all corners.

Crowds with frayed edges in cells of 0.5 m, as fused views leave them: noise that was smoothed over a metre.
Processor time.
"""

import math
import time
from collections.abc import Callable

import numpy as np
import shapely
from scene import machine
from scipy import ndimage

from crowdfence.zones.grow import SEGMENTS_PER_QUARTER, grown

CELL_M = 0.5
SIDES_M = (20.0, 60.0)
DISTANCES_M = (2.0, 5.0, 20.0, 60.0)
REPEATS = 5


def main() -> None:
    print(f"cells of {CELL_M:g} m; fastest of {REPEATS}; {machine()}\n")
    print("| crowd | corners | distance | grown | shapely.buffer | ratio | more ground |")
    print("|---|---|---|---|---|---|---|")
    for side_m in SIDES_M:
        crowd = _crowd(side_m)
        for distance_m in DISTANCES_M:
            _print_row(side_m, crowd, distance_m)


def _print_row(side_m: float, crowd: shapely.MultiPolygon, distance_m: float) -> None:
    # As far as `grown` draws its circles, so that both cover the same.
    reach_m = distance_m / math.cos(1.5 * math.pi / (4 * SEGMENTS_PER_QUARTER))
    ours_s, ours = _fastest(lambda: grown(crowd, distance_m))
    theirs_s, theirs = _fastest(lambda: shapely.buffer(crowd, reach_m, quad_segs=SEGMENTS_PER_QUARTER))
    print(
        f"| {side_m:g} x {side_m:g} m | {shapely.get_num_coordinates(crowd)} | {distance_m:g} m "
        f"| {ours_s * 1e3:.1f} ms | {theirs_s * 1e3:.1f} ms | {theirs_s / ours_s:.1f} "
        f"| {100 * (ours.area / theirs.area - 1):.2f} % |"
    )


def _crowd(side_m: float) -> shapely.MultiPolygon:
    cells = round(side_m / CELL_M)
    noise = ndimage.gaussian_filter(np.random.default_rng(7).normal(size=(cells, cells)), 1.0 / CELL_M)
    west_m, south_m = CELL_M * np.argwhere(noise > -0.3 * noise.std()).T
    return shapely.union_all(shapely.box(west_m, south_m, west_m + CELL_M, south_m + CELL_M))


def _fastest(work: Callable[[], shapely.Geometry]) -> tuple[float, shapely.Geometry]:
    seconds = []
    for _ in range(REPEATS):
        began = time.process_time()
        result = work()
        seconds.append(time.process_time() - began)
    return min(seconds), result


if __name__ == "__main__":
    main()
