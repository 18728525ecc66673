"""Crowd on the map that every look at its ground shows, and that becomes none there. A false alarm that does
not last is none of it; every crowd is, where a threshold or setting is out of reach, and one that walks on
before its looks outweigh those that saw the ground empty."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMass, Observation, Terrain
from crowdfence.pipeline.lost_crowd import unheeded_crowd_warning
from crowdfence.zones import Zone
from crowdfence.zones.regions import TOGETHER_WITHIN_M
from crowdfence.zones.rules import CONTINUES_WITHIN_M
from crowdfence.zones.sorted_keys import are_among
from crowdfence.zones.square_metres import square_metres
from crowdfence.zones.tracker import column_keys, column_places

LEAST_LOOKS = 5
"""In a row. No method with its defaults needs more to call crowd what a detector is sure of."""
LEAST_S = 3.0
"""From the first of them to the last."""
_SHOWN = 0.5
"""A larger value shows crowd, whatever a method takes for one: its own threshold may be what is out of
reach."""
_EVERY_NS = 1_000_000_000
"""Over a flight it is looked for so often: what is told lasts for seconds."""
NearClosed = Callable[[NDArray[np.int64], float], NDArray[np.bool_]]
"""Which of columns (i, j) [C, 2] have their middle within so many metres of closed ground."""
_RIM_M = 2.0
"""Around closed ground, or two voxels: the rim of a crowd is shown fainter than its middle."""
_WALKS_MPS = 3.0
"""Who runs; as far as a zone may move and keep its name, at most."""
_ROW = np.dtype(
    [("voxel", "<i8"), ("first_ns", "<i8"), ("last_ns", "<i8"), ("looks", "<i4"), ("drone", "<i4")]
)


class Unheeded(NamedTuple):
    """Of a fleet, now."""

    area_m2: float
    text: str


class UnheededCrowd:
    """Follows the voxels that were shown as crowd and are none, until a look shows none there nor as far from
    there as a crowd walks. Safe to read while others add."""

    def __init__(self, terrain: Terrain, shows_crowd: float) -> None:
        """`shows_crowd`: a larger value says to the method that a drone saw crowd."""
        self._terrain, self._shows_crowd = terrain, min(shows_crowd, _SHOWN)
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
        before = rows = self._rows
        shown = voxel_ids[is_shown]
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
        self._walk(before, new)
        self._rows = np.concatenate([rows, new])

    def _walk(self, before: NDArray[Any], new: NDArray[Any]) -> None:
        """Counts the looks at what was shown `before` for the `new` places that it may have walked to."""
        from scipy.spatial import cKDTree

        if not len(before) or not len(new):
            return
        size_m = self._terrain.voxel_size_m
        places, there = (self._terrain.voxel_indices(rows["voxel"])[:, :2] * size_m for rows in (new, before))
        apart_m, nearest = cKDTree(there).query(places, distance_upper_bound=CONTINUES_WITHIN_M)
        near = np.flatnonzero(np.isfinite(apart_m))
        of = before[nearest[near]]
        walked_m = _WALKS_MPS * (new["last_ns"][near] - of["last_ns"]) / 1e9
        came = apart_m[near] <= np.maximum(walked_m, TOGETHER_WITHIN_M)
        to, of = near[came], of[came]
        new["first_ns"][to] = np.minimum(new["first_ns"][to], of["first_ns"])
        new["looks"][to] += of["looks"]

    @property
    def has_begun(self) -> bool:
        """Whether it has seen for long enough to say anything."""
        with self._lock:
            return self._span_ns is not None and self._span_ns[1] - self._span_ns[0] >= LEAST_S * 1e9

    def to_json(self) -> dict[str, Any]:
        """All that is told of it later depends on."""
        with self._lock:
            rows = base64.b64encode(self._rows.tobytes()).decode("ascii")  # as many as a picture has pixels
            return {"rows": rows, "drones": list(self._drones), "span_ns": self._span_ns}

    def restore(self, state: Mapping[str, Any]) -> None:
        """What `to_json` gave."""
        rows = np.frombuffer(base64.b64decode(state["rows"], validate=True), _ROW).copy()
        span_ns = state["span_ns"]
        with self._lock:
            self._rows, self._drones = rows, list(state["drones"])
            self._span_ns = None if span_ns is None else (span_ns[0], span_ns[1])

    def beside(self, closed: Sequence[Zone], threshold: float, least_m2: float) -> Unheeded | None:
        """What is told of it, and how much it is, apart from ground that is closed for whatever reason; None
        for nothing, and for less than becomes a zone. `threshold` is that from which the map calls ground
        crowd."""
        return self.beside_ground(near_zones(closed, self._terrain), threshold, least_m2)

    def beside_ground(self, is_near: NearClosed, threshold: float, least_m2: float) -> Unheeded | None:
        """The same where closed ground is no zones."""
        with self._lock:
            rows, drones = self._rows, tuple(self._drones)
        lasts = rows["last_ns"] - rows["first_ns"] >= LEAST_S * 1e9
        rows = rows[lasts & (rows["looks"] >= LEAST_LOOKS)]
        keys = column_keys(self._terrain.voxel_indices(rows["voxel"])[:, :2])
        columns, first = np.unique(keys, return_index=True)
        if not len(columns):
            return None
        rim_m = max(_RIM_M, 2.0 * self._terrain.voxel_size_m)
        is_open = ~is_near(column_places(columns), rim_m)
        area_m2 = float(np.count_nonzero(is_open)) * self._terrain.voxel_size_m**2
        if area_m2 == 0.0 or area_m2 < least_m2:
            return None
        names = sorted({drones[number] for number in rows["drone"][first][is_open]})
        east_m, north_m = np.median(_middles(column_places(columns[is_open]), self._terrain), axis=0)
        text = (
            f"every look of {', '.join(names)} shows crowd on {square_metres(area_m2)} of the map, around "
            f"{east_m:.0f} m east and {north_m:.0f} m north, and none of it reaches P >= {threshold:.3g}: "
            "nothing is closed for it. False alarms, a crowd that walks on before enough looks agree, or a "
            "threshold or setting out of reach?"
        )
        return Unheeded(area_m2, text)


class UnheededInFlight:
    """The most ground at any time of a flight that every look showed as crowd, and that nothing closed."""

    def __init__(
        self, terrain: Terrain, shows_crowd: float, threshold: float, *, least_m2: float = 0.0
    ) -> None:
        """`shows_crowd` as for `UnheededCrowd`; from `threshold` on the map calls ground crowd; regions below
        `least_m2` are not closed."""
        self._followed = UnheededCrowd(terrain, shows_crowd)
        self._threshold, self._least_m2 = threshold, least_m2
        self._most: tuple[int, Unheeded] | None = None
        """When, and what."""
        self._first_ns: int | None = None
        self._next_ns = 0
        self._was_closed = False
        """Whether the map or a look by itself ever called ground crowd, which closes it."""

    def look(
        self,
        stamp_ns: int,
        observations: Sequence[Observation],
        crowd_ids: NDArray[np.int64],
        shown_ids: NDArray[np.int64],
        is_near: NearClosed,
    ) -> None:
        """One instant: what was taken in, all voxels that are crowd after it, those that some look clearly
        shows as crowd by itself, and what is closed."""
        self._first_ns = stamp_ns if self._first_ns is None else self._first_ns
        self._was_closed |= len(crowd_ids) > 0 or len(shown_ids) > 0
        self._followed.add(observations, crowd_ids)
        if stamp_ns < self._next_ns:
            return
        self._next_ns = stamp_ns + _EVERY_NS
        found = self._followed.beside_ground(is_near, self._threshold, self._least_m2)
        if found is not None and (self._most is None or found.area_m2 > self._most[1].area_m2):
            self._most = stamp_ns, found

    def warnings(self, crowd_mass: Mapping[str, CrowdMass]) -> tuple[str, ...]:
        """At most one sentence; `crowd_mass` is that of each drone over the flight."""
        if self._first_ns is None:
            return ()
        if self._most is not None:
            stamp_ns, found = self._most
            return (f"{(stamp_ns - self._first_ns) / 1e9:.1f} s after the first instant {found.text}",)
        if self._was_closed:
            return ()
        # Too few looks for what is told of a place.
        never = unheeded_crowd_warning(crowd_mass, self._threshold)
        return () if never is None else (never,)


def near_zones(closed: Sequence[Zone], terrain: Terrain) -> NearClosed:
    """Of zones, whatever they were closed for."""

    def is_near(columns: NDArray[np.int64], within_m: float) -> NDArray[np.bool_]:
        import shapely

        if not len(columns) or not closed:
            return np.zeros(len(columns), dtype=np.bool_)
        ground = shapely.buffer(shapely.union_all([zone.polygon for zone in closed]), within_m)
        shapely.prepare(ground)
        return np.asarray(shapely.contains_xy(ground, *_middles(columns, terrain).T))

    return is_near


def _middles(columns: NDArray[np.int64], terrain: Terrain) -> NDArray[np.float64]:
    """Of columns (i, j) [C, 2], local metres [C, 2]."""
    return np.asarray((columns + 0.5) * terrain.voxel_size_m + np.asarray(terrain.origin)[:2])
