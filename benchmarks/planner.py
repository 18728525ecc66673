"""Questions of a planner: `ClearAir` beside plain shapely in the same run, microseconds of CPU time each.

Plain shapely is one point or one line against the union of all zones, prepared, in a loop and as one array:
no heights, no times, no name of the zone that is met. Of a clearance it is the distance of the union, and as
an array that of the nearest outline in a tree: 0 inside, however deep.
"""

import time
from collections.abc import Callable

import numpy as np
import shapely
from scene import machine

from crowdfence.planner import ClearAir
from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.history import ZoneHistory

SIDE_M = 2000.0
QUESTIONS = 10_000
LOOPED = 1_000
FEW = 20
REPEATS = 5
INSTANTS = 10
SECOND_NS = 1_000_000_000


def main() -> None:
    print(f"{QUESTIONS} questions over {INSTANTS} instants; fastest of {REPEATS}; {machine()}\n")
    print("| zones | point | plain: loop | array | leg of 30 m | loop | array | clearance | loop | array |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for count in (10, 100, 1_000, 10_000):
        _print_row(count, np.random.default_rng(count))


def _print_row(count: int, rng: np.random.Generator) -> None:
    outlines = [_ragged(*rng.uniform(0, SIDE_M, 2), rng) for _ in range(count)]
    zones = tuple(_zone(number, outline) for number, outline in enumerate(outlines))
    sets = [ZoneSet(zones, 0.5, 0.0, 0, 0.0)] * INSTANTS
    air = ClearAir(ZoneHistory([k * SECOND_NS for k in range(INSTANTS)], sets, None, {}))
    union = shapely.union_all(outlines)
    shapely.prepare(union)
    tree = shapely.STRtree(outlines)
    start = rng.uniform((0, 0, 20), (SIDE_M, SIDE_M, 80), (QUESTIONS, 3))
    end = start + rng.uniform(-21, 21, (QUESTIONS, 3))
    begin_ns = rng.integers(0, (INSTANTS - 1) * SECOND_NS, QUESTIONS)
    points = shapely.points(start[:, :2])
    lines = shapely.linestrings(np.stack([start[:, :2], end[:, :2]], axis=1))
    figures = (
        _each_us(lambda: air.is_clear(start, begin_ns), QUESTIONS),
        _each_us(lambda: [union.intersects(point) for point in points[:LOOPED]], LOOPED),
        _each_us(lambda: shapely.intersects(union, shapely.points(start[:, :2])), QUESTIONS),
        _each_us(lambda: air.legs_are_clear(start, end, begin_ns, begin_ns + SECOND_NS // 2), QUESTIONS),
        _each_us(lambda: [union.intersects(line) for line in lines[:LOOPED]], LOOPED),
        _each_us(
            lambda: shapely.intersects(
                union, shapely.linestrings(np.stack([start[:, :2], end[:, :2]], axis=1))
            ),
            QUESTIONS,
        ),
        _each_us(lambda: air.clearance_m(start, begin_ns), QUESTIONS),
        _each_us(lambda: [union.distance(point) for point in points[:FEW]], FEW),
        _each_us(lambda: tree.query_nearest(points, return_distance=True), QUESTIONS),
    )
    print(f"| {count} |", " | ".join(f"{figure:.2f}" for figure in figures), "|", flush=True)


def _each_us(ask: Callable[[], object], questions: int) -> float:
    ask()
    seconds = []
    for _ in range(REPEATS):
        started = time.process_time()
        ask()
        seconds.append(time.process_time() - started)
    return min(seconds) / questions * 1e6


def _ragged(x: float, y: float, rng: np.random.Generator) -> shapely.Polygon:
    """About 60 corners."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    reach_m = rng.uniform(2.0, 15.0) * rng.uniform(0.8, 1.2, len(angle))
    return shapely.Polygon(np.column_stack([x + reach_m * np.cos(angle), y + reach_m * np.sin(angle)]))


def _zone(number: int, outline: shapely.Polygon) -> Zone:
    return Zone(f"Z{number}", outline, 1, outline.area, 0.9, 0.9, 0.0, 5.0, 0, 0, ())


if __name__ == "__main__":
    main()
