"""Crowd on the map that every look at its ground shows, and that becomes none there. A false alarm that does
not last is none of it; every crowd is, where a threshold or setting is out of reach."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Observation, Terrain
from crowdfence.zones import Zone
from crowdfence.zones.sorted_keys import are_among
from crowdfence.zones.square_metres import square_metres
from crowdfence.zones.tracker import column_keys, column_places

LEAST_LOOKS = 5
"""In a row. No method with its defaults needs more to call crowd what a detector is sure of."""
LEAST_S = 3.0
"""From the first of them to the last."""
_RIM_M = 2.0
"""Around closed ground, or two voxels: the rim of a crowd is shown fainter than its middle."""
_ROW = np.dtype(
    [("voxel", "<i8"), ("first_ns", "<i8"), ("last_ns", "<i8"), ("looks", "<i4"), ("drone", "<i4")]
)


class Unheeded(NamedTuple):
    """Of a fleet, now."""

    area_m2: float
    text: str


class UnheededCrowd:
    """Follows the voxels that were shown as crowd and are none, until a look shows none there. Safe to read
    while others add."""

    def __init__(self, terrain: Terrain, shows_crowd: float) -> None:
        """`shows_crowd`: a larger value says that a drone saw crowd."""
        self._terrain, self._shows_crowd = terrain, shows_crowd
        self._rows = np.empty(0, _ROW)
        self._drones: list[str] = []
        """By their number in the rows."""
        self._span_ns: tuple[int, int] | None = None
        self._lock = Lock()

    def add(self, observations: Sequence[Observation], crowd_ids: NDArray[np.int64]) -> None:
        """What was taken in together, and all voxels that are crowd after it."""
        with self._lock:
            for one in observations:
                self._look(one)
            self._rows = self._rows[~are_among(self._rows["voxel"], crowd_ids)]

    def _look(self, one: Observation) -> None:
        first_ns, last_ns = self._span_ns or (one.stamp_ns, one.stamp_ns)
        self._span_ns = min(first_ns, one.stamp_ns), max(last_ns, one.stamp_ns)
        if one.drone not in self._drones:
            self._drones.append(one.drone)
        voxel_ids, is_shown = one.voxel_ids, one.mean > self._shows_crowd
        if not len(self._rows) and not is_shown.any():
            return
        rows, shown = self._rows, voxel_ids[is_shown]
        if len(rows) and len(voxel_ids):
            at = np.searchsorted(voxel_ids, rows["voxel"]).clip(max=len(voxel_ids) - 1)
            # From below its top the side of a place is seen, which clears nothing.
            clears = ~is_shown[at] & (one.tilt_deg[at] > 0.0)
            rows = rows[~(clears & (voxel_ids[at] == rows["voxel"]))]
        again, number = are_among(rows["voxel"], shown), self._drones.index(one.drone)
        rows["looks"][again] += 1
        rows["last_ns"][again] = np.maximum(rows["last_ns"][again], one.stamp_ns)
        rows["drone"][again] = number
        new_ids = shown[~are_among(shown, rows["voxel"])]
        new = np.empty(len(new_ids), _ROW)
        new["voxel"], new["first_ns"], new["last_ns"] = new_ids, one.stamp_ns, one.stamp_ns
        new["looks"], new["drone"] = 1, number
        self._rows = np.concatenate([rows, new])

    @property
    def has_begun(self) -> bool:
        """Whether it has seen for long enough to say anything."""
        with self._lock:
            return self._span_ns is not None and self._span_ns[1] - self._span_ns[0] >= LEAST_S * 1e9

    def beside(self, closed: Sequence[Zone], threshold: float, least_m2: float) -> Unheeded | None:
        """What is told of it, and how much it is, apart from ground that is closed for whatever reason; None
        for nothing, and for less than becomes a zone. `threshold` is that from which the map calls ground
        crowd."""
        with self._lock:
            rows, drones = self._rows, tuple(self._drones)
        lasts = rows["last_ns"] - rows["first_ns"] >= LEAST_S * 1e9
        rows = rows[lasts & (rows["looks"] >= LEAST_LOOKS)]
        keys = column_keys(self._terrain.voxel_indices(rows["voxel"])[:, :2])
        columns, first = np.unique(keys, return_index=True)
        is_open = ~self._are_in(columns, closed)
        area_m2 = float(np.count_nonzero(is_open)) * self._terrain.voxel_size_m**2
        if not is_open.any() or area_m2 < least_m2:
            return None
        names = sorted({drones[number] for number in rows["drone"][first][is_open]})
        east_m, north_m = np.median(self._middles(columns[is_open]), axis=0)
        text = (
            f"every look of {', '.join(names)} shows crowd on {square_metres(area_m2)} of the map, around "
            f"{east_m:.0f} m east and {north_m:.0f} m north, and none of it reaches P >= {threshold:.3g}: "
            "nothing is closed for it. False alarms, or a threshold or setting out of reach?"
        )
        return Unheeded(area_m2, text)

    def _middles(self, columns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Of columns [C], local metres [C, 2]."""
        middles = (column_places(columns) + 0.5) * self._terrain.voxel_size_m
        return np.asarray(middles + self._terrain.origin[:2])

    def _are_in(self, columns: NDArray[np.int64], closed: Sequence[Zone]) -> NDArray[np.bool_]:
        import shapely

        if not len(columns) or not closed:
            return np.zeros(len(columns), dtype=np.bool_)
        rim_m = max(_RIM_M, 2.0 * self._terrain.voxel_size_m)
        ground = shapely.buffer(shapely.union_all([zone.polygon for zone in closed]), rim_m)
        shapely.prepare(ground)
        return np.asarray(shapely.contains_xy(ground, *self._middles(columns).T))
