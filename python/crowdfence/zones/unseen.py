"""Ground that is not known to be empty: never seen, hidden, stale, or what else a method does not clear, and
holes of the map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap, Terrain
from crowdfence.voxel_state import VoxelState
from crowdfence.zones.map_holes import hole_columns
from crowdfence.zones.sorted_keys import are_among, united
from crowdfence.zones.tracker import column_keys, column_places


class StandingPlaces:
    """The voxels of a terrain on which somebody can stand (no voxel lies on top), by column. Made once per
    terrain, see `Terrain.standing_places`."""

    def __init__(self, terrain: Terrain) -> None:
        self._ids = terrain.standing_places()
        keys = column_keys(terrain.voxel_indices(self._ids)[:, :2])
        self._first = np.flatnonzero(np.diff(keys, prepend=keys[:1] - 1))
        self.columns = keys[self._first]
        """Keys of the columns [C], sorted."""
        self._holes = column_keys(hole_columns(column_places(self.columns)))

    @property
    def has_holes(self) -> bool:
        """Whether the map lacks columns inside of itself, of which nobody knows how high the ground lies."""
        return len(self._holes) > 0

    def unknown(
        self,
        crowd_map: CrowdMap,
        stamp_ns: int,
        threshold: float,
        stale_after_s: float,
        in_zones: NDArray[np.int64],
    ) -> NDArray[np.int64]:
        """Keys of the columns with a place that is neither empty nor crowd, or that is crowd while the column
        is none of those `in_zones` (keys), and of those that the map lacks inside of itself, sorted. Whatever
        state a method may invent is unknown here."""
        if not len(self.columns):
            return self.columns
        state = crowd_map.state(stamp_ns, threshold=threshold, stale_after_s=stale_after_s)
        state = state[self._ids]
        unknown = (state != VoxelState.EMPTY) & (state != VoxelState.CROWD)
        is_unknown = np.logical_or.reduceat(unknown, self._first)
        # What the map calls crowd is no zone by that alone.
        places = np.flatnonzero(state == VoxelState.CROWD)
        crowd = np.searchsorted(self._first, places, "right") - 1
        is_unknown[crowd[~are_among(self.columns[crowd], in_zones)]] = True
        return united(self.columns[is_unknown], self._holes)
