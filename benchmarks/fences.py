"""Zones fitted into the fence of an autopilot: processor time, and what is closed for nothing."""

import time

import numpy as np
import shapely
from scene import machine

from crowdfence.zones.capacity import fitted

PX4_ITEMS = 63
SIDE_M = 5000.0
REPEATS = 3


def main() -> None:
    print(f"{PX4_ITEMS} items, processor time, fastest of {REPEATS}; {machine()}\n")
    print("| zones | outline | corners | fitted | zones close | the fence closes |")
    print("|---|---|---|---|---|---|")
    for count in (10, 100, 1000, 10_000):
        for name in ("boxes", "discs"):
            _print_row(name, _zones(name, count))


def _zones(name: str, count: int) -> list[shapely.Polygon]:
    """Boxes of 2 x 3 m in a square of 5 km; discs of 3 to 9 m in one of 2.5 km, which often meet."""
    corners = np.random.default_rng(4).uniform(0.0, SIDE_M, (count, 2))
    if name == "boxes":
        return [shapely.box(x, y, x + 2.0, y + 3.0) for x, y in corners]
    return [shapely.Point(x / 2, y / 2).buffer(3.0 + i % 7) for i, (x, y) in enumerate(corners)]


def _print_row(name: str, zones: list[shapely.Polygon]) -> None:
    times_s = []
    for _ in range(REPEATS):
        begin_s = time.process_time()
        fence = fitted(zones, PX4_ITEMS)
        times_s.append(time.process_time() - begin_s)
    corners = int(shapely.get_num_coordinates(zones).sum()) - len(zones)
    print(
        f"| {len(zones)} | {name} | {corners} | {min(times_s):.2f} s | {fence.zone_area_m2:.0f} m2 "
        f"| {fence.fence_area_m2:.0f} m2 |",
        flush=True,
    )


if __name__ == "__main__":
    main()
