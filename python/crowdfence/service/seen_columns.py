"""How much ground was seen, from above: as an operator counts it, not as voxels do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.zones.standing_columns import StandingColumns


class SeenColumns:
    """Counts the columns of which every standing place was seen. Walls and what is buried add none, and where
    nobody looked under a roof, the ground is not seen. It costs what is given to it, never the map."""

    def __init__(self, terrain: Terrain) -> None:
        """A byte a voxel and 4 a column more than `StandingColumns`."""
        self._standing = StandingColumns(terrain)
        self._is_seen = np.zeros(terrain.voxel_count, dtype=np.bool_)
        self.begin_anew()

    def begin_anew(self) -> None:
        """As if nothing had been seen."""
        self._is_seen[:] = False
        self._unseen = self._standing.places.copy()
        """Standing places left, by column."""
        self.count = 0

    def add(self, voxel_ids: NDArray[np.int64]) -> None:
        """Voxels that were seen [N], each once; also such as were seen before."""
        new = voxel_ids[~self._is_seen[voxel_ids]]
        self._is_seen[new] = True
        columns, counts = np.unique(self._standing.under(new), return_counts=True)
        self._unseen[columns] -= counts.astype(np.int32)
        self.count += int(np.count_nonzero(self._unseen[columns] == 0))
