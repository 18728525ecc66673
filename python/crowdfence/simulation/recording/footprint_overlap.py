"""How much ground several drones see at the same time, over a whole mission."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera

CELL_M = 2.0
MAX_RANGE_M = 150.0
"""Beyond it people are a few pixels high in a 640 x 480 image."""

OVERLAPPING_SHARE = 0.25
"""An instant counts as overlapping from this share of the smaller footprint on."""

_PIXELS_ACROSS = 160
_CELLS_PER_AXIS = 1 << 20


def footprint_cells(
    depth_m: NDArray[np.floating],
    camera: Camera,
    world_from_camera: NDArray[np.float64],
    *,
    max_range_m: float = MAX_RANGE_M,
) -> NDArray[np.int64]:
    """Sorted numbers of the ground cells of `CELL_M` that an image shows, from its depth [H, W] along z
    (inf = sky). Of large images a grid of about 160 pixels across is looked at."""
    height, width = depth_m.shape
    step = max(1, width // _PIXELS_ACROSS)
    row, column = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    depth = np.asarray(depth_m[row, column], np.float64).ravel()
    rays = camera.unproject(np.stack([column.ravel() + 0.5, row.ravel() + 0.5], axis=-1))
    distance = depth / rays[:, 2]
    near = np.isfinite(distance) & (distance <= max_range_m)
    points = (rays[near] * distance[near, None]) @ world_from_camera[:3, :3].T + world_from_camera[:3, 3]
    cell = np.floor(points[:, :2] / CELL_M).astype(np.int64) + _CELLS_PER_AXIS // 2
    return np.unique(cell[:, 0] * _CELLS_PER_AXIS + cell[:, 1])


@dataclass(slots=True)
class OverlapStatistics:
    """Shares of common ground per pair of drones, collected instant by instant."""

    drones: int
    shares: dict[tuple[int, int], list[float]] = field(default_factory=dict)
    t_s: list[float] = field(default_factory=list)
    most: list[float] = field(default_factory=list)
    """Largest share of any pair per instant."""

    def add(self, t_s: float, footprints: dict[int, NDArray[np.int64]]) -> None:
        """Footprints of the drones that are there at `t_s`."""
        found = [0.0]
        for pair in combinations(sorted(footprints), 2):
            first, second = (footprints[drone] for drone in pair)
            smaller = min(len(first), len(second))
            common = len(np.intersect1d(first, second, assume_unique=True))
            found.append(common / smaller if smaller else 0.0)
            self.shares.setdefault(pair, []).append(found[-1])
        self.t_s.append(t_s)
        self.most.append(max(found))

    def spans_s(self) -> list[tuple[float, float]]:
        """Spans of time [start, end] in which some pair overlaps by at least `OVERLAPPING_SHARE`."""
        spans: list[tuple[float, float]] = []
        open_since: float | None = None
        last = 0.0
        for t_s, share in zip(self.t_s, self.most, strict=True):
            if share >= OVERLAPPING_SHARE:
                open_since, last = (t_s if open_since is None else open_since), t_s
            elif open_since is not None:
                spans.append((open_since, last))
                open_since = None
        return spans if open_since is None else [*spans, (open_since, last)]

    def manifest(self) -> dict[str, Any]:
        """Ready for JSON."""
        overlapping = np.array(self.most) >= OVERLAPPING_SHARE
        return {
            "cell_m": CELL_M,
            "max_range_m": MAX_RANGE_M,
            "instants": len(self.most),
            "overlapping_share_of_instants": float(overlapping.mean()) if len(self.most) else None,
            "overlapping_from": OVERLAPPING_SHARE,
            "spans_s": self.spans_s(),
            "pairs": [
                {
                    "drones": list(pair),
                    "mean_share_of_smaller": float(np.mean(values)),
                    "overlapping_share_of_instants": float((np.array(values) >= OVERLAPPING_SHARE).mean()),
                }
                for pair, values in sorted(self.shares.items())
            ],
        }
