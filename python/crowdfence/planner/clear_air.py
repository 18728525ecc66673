"""Points and paths in space and time against zones.

At a stamp counts what was known then: the zones of the last instant up to it. Later than the last instant
they stay closed, because forgetting is no evidence that people left; `expires` opens them at their
`valid_until`. Before the first instant nothing is known, and nothing is clear.

A zone closes its outline from its band above the lowest ground to its band above the highest, in local
heights. A zone of others, of which the ground is not known, is closed at every height.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.history import ZoneHistory

if TYPE_CHECKING:
    from shapely import STRtree

_BEFORE = -1
_FOREVER_NS = np.iinfo(np.int64).max


@dataclass(frozen=True, slots=True)
class Conflict:
    """Where a path enters what is closed."""

    leg: int
    """From waypoint `leg` to the next."""
    zone: str | None
    """Id of the zone; None: before the first instant, when nothing is known."""


class ClearAir:
    """Questions about the zones of a mission, or of one moment; vectorised."""

    def __init__(self, zones: ZoneHistory | ZoneSet, *, expires: bool = False) -> None:
        """A `ZoneSet` by itself holds at every stamp."""
        if isinstance(zones, ZoneHistory):
            self._stamps_ns = np.asarray(zones.stamps_ns, dtype=np.int64)
            self._sets: Sequence[ZoneSet] = zones.sets
        else:
            self._stamps_ns = np.array([np.iinfo(np.int64).min])
            self._sets = [zones]
        self._expires = expires
        self._closed: dict[int, _Closed] = {}

    def is_clear(self, points: ArrayLike, stamps_ns: ArrayLike) -> NDArray[np.bool_]:
        """Whether points [N, 3] (local metres) lie in no zone at their stamps, [N] or one for all."""
        points = _points(points)
        stamps_ns = _stamps(stamps_ns, points)
        clear = np.zeros(len(points), dtype=np.bool_)
        for number, members in self._by_set(stamps_ns):
            if number != _BEFORE:
                closed = self._of(number)
                point, zone = closed.tree.query(_shapes(points[members]), predicate="intersects")
                hit = closed.holds_height(zone, points[members[point], 2])
                hit &= self._alive(closed, zone, stamps_ns[members[point]])
                inside = np.zeros(len(members), dtype=np.bool_)
                inside[point[hit]] = True
                clear[members] = ~inside
        return clear

    def clearance_m(self, points: ArrayLike, stamps_ns: ArrayLike) -> NDArray[np.float64]:
        """Distance of points [N, 3] from the nearest zone in space, negative inside: how deep. inf where
        nothing is closed, -inf before the first instant."""
        points = _points(points)
        stamps_ns = _stamps(stamps_ns, points)
        clearance = np.full(len(points), -np.inf)
        for number, members in self._by_set(stamps_ns):
            if number != _BEFORE:
                clearance[members] = self._clearance(number, points[members], stamps_ns[members])
        return clearance

    def path_is_clear(self, waypoints: ArrayLike, stamps_ns: ArrayLike) -> bool:
        """Whether the straight legs between waypoints [N, 3], each flown evenly between its stamps [N], meet
        no zone that is known while it is flown."""
        return self.first_conflict(waypoints, stamps_ns) is None

    def first_conflict(self, waypoints: ArrayLike, stamps_ns: ArrayLike) -> Conflict | None:
        """The first leg that meets a zone; None where none does. ValueError for fewer than two waypoints and
        for stamps that go back."""
        import shapely

        points, stamps_ns = _points(waypoints), _stamps(stamps_ns, _points(waypoints))
        if len(points) < 2 or (np.diff(stamps_ns) < 0).any():
            raise ValueError("a path has at least two waypoints and stamps that do not go back")
        leg, start, end, begin_ns, number = self._pieces(points, stamps_ns)
        first: Conflict | None = None
        for one in np.unique(number):
            members = np.flatnonzero(number == one)
            if one == _BEFORE:
                found = [(int(leg[members[0]]), None)]
            else:
                closed = self._of(int(one))
                lines = shapely.linestrings(np.stack([start[members, :2], end[members, :2]], axis=1))
                piece, zone = closed.tree.query(lines, predicate="intersects")
                of = members[piece]
                hit = closed.meets_heights(zone, start[of, 2], end[of, 2])
                hit &= self._alive(closed, zone, begin_ns[of])
                found = [(int(leg[p]), closed.zones[z].id) for p, z in zip(of[hit], zone[hit], strict=True)]
            for at, name in found:
                if first is None or (at, name or "") < (first.leg, first.zone or ""):
                    first = Conflict(at, name)
        return first

    def _pieces(self, points: NDArray[np.float64], stamps_ns: NDArray[np.int64]) -> tuple[NDArray[Any], ...]:
        """Legs cut where a new set of zones begins: leg, start, end, first stamp, and which set."""
        pieces = []
        for leg in range(len(points) - 1):
            begin_ns, end_ns = stamps_ns[leg], stamps_ns[leg + 1]
            low, high = np.searchsorted(self._stamps_ns, [begin_ns, end_ns], "right")
            cuts = np.concatenate([[begin_ns], self._stamps_ns[low:high], [end_ns]])
            duration = max(int(end_ns - begin_ns), 1)
            share = (cuts - begin_ns) / duration
            share[-1] = 1.0
            places = points[leg] + share[:, None] * (points[leg + 1] - points[leg])
            for k in range(len(cuts) - 1):
                pieces.append((leg, places[k], places[k + 1], cuts[k], low - 1 + k))
        return tuple(np.array(column) for column in zip(*pieces, strict=True))

    def _clearance(
        self, number: int, points: NDArray[np.float64], stamps_ns: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        import shapely

        closed = self._of(number)
        if not closed.zones:
            return np.full(len(points), np.inf)
        shapes = _shapes(points)
        # The nearest outline is the nearest zone where the point is between its heights.
        (_, nearest), aside = closed.tree.query_nearest(shapes, return_distance=True, all_matches=False)
        exact = closed.holds_height(nearest, points[:, 2]) & (aside > 0.0)
        exact &= self._alive(closed, nearest, stamps_ns)
        result = np.where(exact, aside, np.inf)
        rest = np.flatnonzero(~exact)
        for zone in range(len(closed.zones) if len(rest) else 0):
            beside = shapely.distance(closed.outlines[zone], shapes[rest])
            over = np.maximum(closed.lower_m[zone] - points[rest, 2], points[rest, 2] - closed.upper_m[zone])
            apart = np.hypot(beside, np.maximum(over, 0.0))
            edge = shapely.distance(closed.outlines[zone].boundary, shapes[rest])
            depth = -np.minimum(edge, -over)
            inside = (beside == 0.0) & (over <= 0.0)
            alive = self._alive(closed, np.full(len(rest), zone), stamps_ns[rest])
            distance = np.where(alive, np.where(inside, depth, apart), np.inf)
            result[rest] = np.minimum(result[rest], distance)
        return result

    def _alive(
        self, closed: _Closed, zone: NDArray[np.int64], stamps_ns: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        if not self._expires:
            return np.ones(len(zone), dtype=np.bool_)
        return np.asarray(stamps_ns < closed.until_ns[zone])

    def _by_set(self, stamps_ns: NDArray[np.int64]) -> list[tuple[int, NDArray[np.int64]]]:
        number = np.searchsorted(self._stamps_ns, stamps_ns, "right") - 1
        return [(int(one), np.flatnonzero(number == one)) for one in np.unique(number)]

    def _of(self, number: int) -> _Closed:
        if number not in self._closed:
            self._closed[number] = _Closed(self._sets[number].closed)
        return self._closed[number]


class _Closed:
    """The zones of one moment, ready for questions."""

    def __init__(self, zones: Sequence[Zone]) -> None:
        import shapely

        self.zones = zones
        self.outlines = [zone.polygon for zone in zones]
        self.tree: STRtree = shapely.STRtree(self.outlines)
        self.lower_m, self.upper_m = np.array([_heights(zone) for zone in zones]).reshape(-1, 2).T
        self.until_ns = np.array(
            [_FOREVER_NS if zone.valid_until_ns is None else zone.valid_until_ns for zone in zones],
            dtype=np.int64,
        )

    def holds_height(self, zone: NDArray[np.int64], z_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        return np.asarray((z_m >= self.lower_m[zone]) & (z_m <= self.upper_m[zone]))

    def meets_heights(
        self, zone: NDArray[np.int64], start_m: NDArray[np.float64], end_m: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Whether a leg that meets the outline may do so between the zone's heights."""
        low, high = np.minimum(start_m, end_m), np.maximum(start_m, end_m)
        return np.asarray((high >= self.lower_m[zone]) & (low <= self.upper_m[zone]))


def _heights(zone: Zone) -> tuple[float, float]:
    """Local heights between which a zone is closed."""
    if zone.kind == "static" or zone.band.datum != "AGL":
        return -np.inf, np.inf
    # What closes from the ground closes what is below the ground too: nobody knows it that well.
    lower_m = -np.inf if zone.band.lower_m <= 0.0 else zone.lower_m + zone.band.lower_m
    return lower_m, zone.upper_m + zone.band.upper_m


def _points(points: ArrayLike) -> NDArray[np.float64]:
    array = np.atleast_2d(np.asarray(points, dtype=np.float64))
    if array.ndim != 2 or array.shape[1] != 3 or not np.isfinite(array).all():
        raise ValueError(f"points must be finite and [N, 3], got shape {list(np.shape(points))}")
    return array


def _stamps(stamps_ns: ArrayLike, points: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.broadcast_to(np.asarray(stamps_ns, dtype=np.int64), len(points))


def _shapes(points: NDArray[np.float64]) -> NDArray[Any]:
    import shapely

    return np.asarray(shapely.points(points[:, :2]))
