"""Who stands in a zone: the people of crowds that a fleet has in view, and the ground that is closed for
them.

A zone is the ground that is closed, as a zone engine holds it, with a buffer around it: columns that the map
calls crowd, and those that it called crowd before and that no look has opened, in regions large enough for a
zone. People count by where they stand, on ground that some drone has seen by then, whether or not it could
have seen them there. The ground that is closed is set against the crowds' own: what they stand on, as far as
it was seen, with the same buffer.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap, Observation, Terrain
from crowdfence.config import ZoneConfig
from crowdfence.sources.recording import Instant, Recording
from crowdfence.truth.at_exposure import crowd_definition, crowd_ground_of, people_at, timed_frame
from crowdfence.truth.crowd_ground import crowds_of
from crowdfence.truth.recorded_people import require_people
from crowdfence.voxel_state import VoxelState
from crowdfence.zones.sorted_keys import are_among
from crowdfence.zones.tracker import column_keys, column_places

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Validity
    from crowdfence.pipeline.unheeded_crowd import NearClosed
    from crowdfence.zones.zone_ground import ZoneGround

BUFFERS_M = (0.0, 2.0, 5.0, 10.0)
EVERY_S = 1.0
"""People and ground are counted this often."""

Cells = NDArray[np.int64]
"""Columns of the voxel grid [N, 2], each once."""


@dataclass(frozen=True, slots=True, eq=False)
class CrowdsInView:
    """The crowds of one moment, as far as the fleet has had their ground in view."""

    people: Cells
    """Column of every person of a crowd [N, 2] who stands on ground that was seen."""
    in_range: NDArray[np.bool_]
    """[N] whether a look at that ground lay within the range that the detector was tested in."""
    ground_ids: NDArray[np.int64]
    """Voxels of the crowds' own ground that were seen."""
    ground: Cells
    """Their columns."""


class CrowdWatch:
    """Knows what was seen, in which range, and who stands there."""

    def __init__(self, recording: Recording, terrain: Terrain, tested: Validity | None) -> None:
        """`tested`: the range that the detector states; None = any look counts. ValueError when the
        recording does not hold people's positions."""
        require_people(recording)
        self._recording, self._terrain, self._tested = recording, terrain, tested
        self._seen = np.zeros(terrain.voxel_count, np.bool_)
        self._in_range = np.zeros(terrain.voxel_count, np.bool_)

    def saw(self, observations: Iterable[Observation]) -> None:
        """Take note of what was seen."""
        for observation in observations:
            ids = observation.voxel_ids
            self._seen[ids] = True
            self._in_range[ids[_in_range(observation, self._tested)]] = True

    def at(self, instant: Instant) -> CrowdsInView:
        """Who stands where at an instant. FrameError when nobody's position is recorded then, or damaged."""
        people = people_at(timed_frame(instant) or instant.frames[-1], self._recording)
        crowd = crowds_of(people.position, **crowd_definition(self._recording.manifest)) >= 0
        stood_on = crowd_ground_of(people, self._recording, self._terrain, "beside")
        ground = np.flatnonzero(stood_on & self._seen)
        seen, tested = self._columns(ground), self._columns(ground[self._in_range[ground]])
        origin = np.asarray(self._terrain.origin)[:2]
        feet = np.floor((people.position[crowd, :2] - origin) / self._terrain.voxel_size_m).astype(np.int64)
        feet = feet[_is_among(feet, seen)]
        return CrowdsInView(feet, _is_among(feet, tested), ground, seen)

    def _columns(self, ids: NDArray[np.int64]) -> Cells:
        return np.unique(self._terrain.voxel_indices(ids)[:, :2], axis=0)


@dataclass(slots=True)
class Safety:
    """Sums over the moments that were counted; the shares are properties. Arrays have one value per
    buffer."""

    moments: int = 0
    people: int = 0
    people_in_range: int = 0
    people_on_empty: int = 0
    """Who stand on ground that the map calls empty."""
    in_zone: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(BUFFERS_M), np.int64))
    in_zone_in_range: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(BUFFERS_M), np.int64))
    blocked_m2: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(BUFFERS_M)))
    own_m2: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(BUFFERS_M)))
    missed_m2: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(BUFFERS_M)))
    """Ground that crowds stand on, in view and in no zone."""

    def add(
        self,
        crowds: CrowdsInView,
        crowd_map: CrowdMap,
        stamp_ns: int,
        threshold: float,
        closed: Cells,
        stale_after_s: float = ZoneConfig().stale_after_s,
    ) -> None:
        """Count one moment of a map, and the columns that its zones hold closed [C, 2]
        (`ZoneGround.columns`); older looks leave nothing empty."""
        self.add_zone(crowds, closed, crowd_map.terrain.voxel_size_m)
        self.people_on_empty += _on_empty(crowds, crowd_map, stamp_ns, threshold, stale_after_s)

    def add_zone(self, crowds: CrowdsInView, zone: Cells, size_m: float) -> None:
        """The same for columns that are closed, without a word about what is called empty."""
        inside = distance_m(crowds.people, zone, size_m)[:, None] <= np.array(BUFFERS_M)
        self.moments += 1
        self.people += len(crowds.people)
        self.people_in_range += int(np.count_nonzero(crowds.in_range))
        self.in_zone += inside.sum(axis=0)
        self.in_zone_in_range += inside[crowds.in_range].sum(axis=0)
        self.blocked_m2 += areas_m2(zone, size_m)
        self.own_m2 += areas_m2(crowds.ground, size_m)
        outside = distance_m(crowds.ground, zone, size_m)[:, None] > np.array(BUFFERS_M)
        self.missed_m2 += outside.sum(axis=0) * size_m**2

    @property
    def share_in_zone(self) -> NDArray[np.float64]:
        """Of the people of crowds in view; NaN when there were none."""
        return _share(self.in_zone, self.people)

    @property
    def share_in_zone_in_range(self) -> NDArray[np.float64]:
        """Of those on ground that was seen within the tested range."""
        return _share(self.in_zone_in_range, self.people_in_range)

    @property
    def share_on_empty(self) -> float:
        """Of the people of crowds in view, those whose ground the map calls empty."""
        return self.people_on_empty / self.people if self.people else float("nan")

    @property
    def share_missed_m2(self) -> NDArray[np.float64]:
        """Of the ground that crowds stand on, in view; NaN when there was none."""
        return self.missed_m2 / np.where(self.own_m2[0] > 0.0, self.own_m2[0], np.nan)

    @property
    def blocked_per_own(self) -> NDArray[np.float64]:
        """Ground closed, as a multiple of the crowds' own."""
        return self.blocked_m2 / np.where(self.own_m2 > 0.0, self.own_m2, np.nan)

    @property
    def closed_m2(self) -> NDArray[np.float64]:
        """Ground closed at a moment, on the mean of all; NaN before there was one. Where no crowd was in view
        this is what was closed for nothing, of which `blocked_per_own` says nothing."""
        return self.blocked_m2 / (self.moments or np.nan)


def distance_m(places: Cells, zone: Cells, size_m: float) -> NDArray[np.float64]:
    """From the middle of each column of `places` [N] to the nearest column of `zone`: 0 inside, inf without
    one.

    To the column, not to its middle: somebody beside a zone is at its edge."""
    from scipy.spatial import cKDTree

    if len(zone) == 0 or len(places) == 0:
        return np.full(len(places), np.inf)
    count = min(_NEAREST, len(zone))
    _, nearest = cKDTree(zone).query(places, k=np.arange(1, count + 1))
    return np.asarray(to_column(zone[nearest] - places[:, None]).min(axis=1) * size_m)


def to_column(aside: NDArray[np.int64]) -> NDArray[np.float64]:
    """From places to columns whose middles lie so far aside [..., 2], 0 inside; in columns."""
    apart = np.maximum(np.abs(aside) - 0.5, 0.0)
    return np.asarray(np.hypot(apart[..., 0], apart[..., 1]))


def near_columns(ground: ZoneGround, size_m: float) -> NearClosed:
    """For `UnheededCrowd`, of ground that zones hold closed now."""
    return lambda columns, within_m: distance_m(columns, ground.columns, size_m) <= within_m


_NEAREST = 9
"""The column whose middle is nearest need not be the nearest column; it is among so many."""


def areas_m2(zone: Cells, size_m: float) -> NDArray[np.float64]:
    """Ground of the columns with each of `BUFFERS_M` around their edges, as `distance_m` counts people, by
    columns whose middle lies inside. Costs the zone and what is near it, not how far its parts are from each
    other."""
    from scipy.ndimage import distance_transform_edt

    margin = int(np.ceil(BUFFERS_M[-1] / size_m)) + 1
    inside = np.zeros(len(BUFFERS_M), np.int64)
    # Larger than the reach of a column to both sides, which then skips no tile.
    side = max(_TILE, 2 * margin + 1)
    for tile, near in _tiles(zone, side, margin):
        # All of the tile within reach of what is near, and as much around it as holds that.
        first = np.maximum(near.min(axis=0) - margin, tile)
        last = np.minimum(near.max(axis=0) + margin, tile + side - 1)
        corner = np.minimum(first, near.min(axis=0))
        # In half columns, odd ones are middles, and those of a column with its edges are three by three.
        free = np.ones(2 * (np.maximum(last, near.max(axis=0)) - corner + 1) + 1, np.bool_)
        for aside in product((0, 1, 2), repeat=2):
            free[tuple((2 * (near - corner) + aside).T)] = False
        apart_m = distance_transform_edt(free)[1::2, 1::2] * (size_m / 2)
        (west, south), (east, north) = first - corner, last - corner + 1
        within = apart_m[west:east, south:north]
        inside += [np.count_nonzero(within <= buffer_m) for buffer_m in BUFFERS_M]
    return np.asarray(inside * size_m**2)


_TILE = 512
"""Columns along the side of a part of the ground that is looked at at once."""


def _tiles(zone: Cells, side: int, margin: int) -> Iterator[tuple[NDArray[np.int64], Cells]]:
    """First column [2] of each tile that is within `margin` of columns of the zone, and these columns."""
    if not len(zone):
        return
    # Tiles begin where the zone does, so that a small one lies in one of them.
    begin = zone.min(axis=0) - margin
    zone = zone[np.argsort(zone[:, 0], kind="stable")]
    corners = [np.array([di, dj]) - begin for di in (-margin, margin) for dj in (-margin, margin)]
    reached = [np.unique(column_keys((zone + corner) // side)) for corner in corners]
    for tile in begin + column_places(np.unique(np.concatenate(reached))) * side:
        rows = slice(*np.searchsorted(zone[:, 0], [tile[0] - margin, tile[0] + side + margin]))
        north = zone[rows, 1]
        yield tile, zone[rows][(north >= tile[1] - margin) & (north < tile[1] + side + margin)]


def _on_empty(
    crowds: CrowdsInView, crowd_map: CrowdMap, stamp_ns: int, threshold: float, stale_after_s: float
) -> int:
    """How many stand where every voxel of the crowd's ground that was seen is called empty."""
    known = crowd_map.knowledge(crowds.ground_ids, stamp_ns, threshold=threshold, stale_after_s=stale_after_s)
    other = crowd_map.terrain.voxel_indices(crowds.ground_ids[known.state != VoxelState.EMPTY])
    return int(np.count_nonzero(~_is_among(crowds.people, other)))


def states_range(tested: Validity | None) -> bool:
    """Whether a detector states where it was tested; else any look counts as in range."""
    return tested is not None and (tested.gsd_m, tested.distance_m, tested.tilt_deg) != (None, None, None)


def _in_range(observation: Observation, tested: Validity | None) -> NDArray[np.bool_]:
    inside = np.ones(len(observation), np.bool_)
    if tested is None:
        return inside
    if tested.gsd_m is not None and observation.focal_px > 0.0:
        inside &= observation.range_m <= tested.gsd_m[1] * observation.focal_px
    elif tested.distance_m is not None:  # says less: the same distance looks another size to another lens
        inside &= observation.range_m <= tested.distance_m[1]
    if tested.tilt_deg is not None:
        inside &= observation.tilt_deg >= tested.tilt_deg[0]
    return inside


def _is_among(cells: Cells, others: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each of the columns is one of others [M, 2 or 3]."""
    return are_among(column_keys(cells), column_keys(others))


def _share(count: NDArray[np.int64], of: int) -> NDArray[np.float64]:
    return count / of if of else np.full(len(count), np.nan)
