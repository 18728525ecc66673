"""Columns of a terrain in which somebody can stand, and which voxels of them on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.zones.tracker import column_keys

_NOWHERE = -1


class StandingColumns:
    """Made once per terrain, .12 s a million voxels; 4 bytes a voxel and 12 a column."""

    def __init__(self, terrain: Terrain) -> None:
        ids = terrain.standing_places()
        keys = column_keys(terrain.voxel_indices(ids)[:, :2])
        begins = np.diff(keys, prepend=keys[:1] - 1) != 0
        self.keys = keys[begins]
        """The columns [C], sorted; see `column_keys`."""
        column = np.cumsum(begins, dtype=np.int32) - np.int32(1)
        self.places = np.bincount(column, minlength=len(self.keys)).astype(np.int32)
        """Voxels without a voxel on top of them in each column [C]."""
        self._column_of = np.full(terrain.voxel_count, _NOWHERE, np.int32)
        self._column_of[ids] = column

    def under(self, voxel_ids: NDArray[np.int64]) -> NDArray[np.int32]:
        """Position among `keys` of the column of each of the voxels [N] on which somebody can stand; the
        others are left out."""
        column = self._column_of[voxel_ids]
        return column[column != _NOWHERE]
