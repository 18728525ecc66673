"""What the zones of an instant cost after a small view, in maps of 1, 4 and 16 times the area, all seen
before.

One crowd stands in view; `zones` is a step of the engine with all its figures, `core` the part of it that
asks the map for columns of crowd. `everything` asks for them at a threshold that nobody asked for before,
so that every voxel that was ever seen is read, as it was at every instant. Processor time.
"""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scene import machine

from crowdfence import CrowdMap, Observation, Terrain
from crowdfence.config import EvidenceConfig, ZoneConfig
from crowdfence.zones import ZoneEngine

SIDES_M = (250.0, 500.0, 1000.0)
VOXEL_SIZE_M = 0.5
VIEW_M = 60.0
CROWD_M = 20.0
REPEATS = 15
SECOND_NS = 1_000_000_000
START_NS = 1_767_225_600 * SECOND_NS


def main() -> None:
    print(f"{VIEW_M:g} x {VIEW_M:g} m seen at every instant; fastest of {REPEATS}; {machine()}\n")
    print("| map | seen before | by the view | closed columns | zones | core | everything | unseen closed |")
    print("|---|---|---|---|---|---|---|---|")
    for side_m in SIDES_M:
        _print_row(side_m)


def _print_row(side_m: float) -> None:
    cells = round(side_m / VOXEL_SIZE_M)
    heights_m = 3.0 * np.sin(np.arange(cells) / 40.0)[:, None] * np.ones(cells)
    terrain = Terrain.from_height_map(heights_m, VOXEL_SIZE_M)
    crowd_map = CrowdMap(terrain, EvidenceConfig().fusion_method(terrain, drones=2))
    threshold = crowd_map.default_threshold()
    engine = ZoneEngine(crowd_map, ZoneConfig(buffer_m=5.0).rules(threshold))
    closing = ZoneEngine(crowd_map, ZoneConfig(buffer_m=5.0, close_unseen=True).rules(threshold))
    everywhere = np.arange(terrain.voxel_count)
    place_m = terrain.voxel_centers(everywhere)[:, :2] - side_m / 2
    view = np.flatnonzero((np.abs(place_m) < VIEW_M / 2).all(axis=1))
    crowd = np.hypot(*place_m[view].T) < CROWD_M / 2
    _look(crowd_map, "high", START_NS, everywhere, np.zeros(len(everywhere)))
    engine.step(START_NS)
    times: dict[str, list[float]] = {"zones": [], "core": [], "everything": [], "unseen": []}
    columns = 0
    for number in range(1, REPEATS + 1):
        stamp_ns = START_NS + number * SECOND_NS
        seen = _look(crowd_map, "low", stamp_ns, view, np.where(crowd, 0.95, 0.0))
        times["zones"].append(_seconds(lambda: engine.step(stamp_ns, [seen])))  # noqa: B023
        _look(crowd_map, "other", stamp_ns + 1, view, np.where(crowd, 0.95, 0.0))
        times["core"].append(_seconds(lambda: crowd_map.crowd_columns(stamp_ns + 1)))  # noqa: B023
        other = threshold * (1.0 + 1e-9 * number)
        times["everything"].append(
            _seconds(lambda: crowd_map.crowd_columns(stamp_ns + 1, threshold=other))  # noqa: B023
        )
        times["unseen"].append(_seconds(lambda: closing.step(stamp_ns + 1)))  # noqa: B023
        columns = len(crowd_map.crowd_columns(stamp_ns + 1))
    figures = " | ".join(f"{min(one) * 1e3:.2f} ms" for one in times.values())
    print(f"| {side_m:g} m | {terrain.voxel_count} | {len(view)} | {columns} | {figures} |", flush=True)


def _look(
    crowd_map: CrowdMap, drone: str, stamp_ns: int, ids: NDArray[np.int64], mean: NDArray[np.float64]
) -> Observation:
    count = len(ids)
    observation = Observation(
        crowd_map.terrain,
        drone,
        stamp_ns,
        voxel_ids=ids,
        mean=mean,
        pixel_count=np.ones(count, dtype=int),
        range_m=np.full(count, 40.0),
        tilt_deg=np.full(count, 60.0),
        occluded_ids=[],
    )
    crowd_map.integrate_observations([observation], stamp_ns)
    return observation


def _seconds(call: Callable[[], object]) -> float:
    start = time.process_time()
    call()
    return time.process_time() - start


if __name__ == "__main__":
    main()
