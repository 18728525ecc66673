"""How much ground was seen, from above: as an operator counts it, not as voxels do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.service.ground import Ground


class SeenColumns:
    """Counts the columns of which every standing place was seen. Walls and what is buried add none, and where
    nobody looked under a roof, the ground is not seen. It costs what is given to it, never the map."""

    def __init__(self, ground: Ground) -> None:
        """12 bytes a standing place and 4 a voxel."""
        self._place = np.full(ground.terrain.voxel_count, -1, dtype=np.int32)
        """Number of the standing place by voxel id; -1: nobody stands there."""
        self._place[ground.voxel_ids] = np.arange(len(ground.voxel_ids), dtype=np.int32)
        begins = np.concatenate([[True], ground.keys[1:] != ground.keys[:-1]])[: len(ground.keys)]
        self._column = (np.cumsum(begins) - 1).astype(np.int32)
        """By standing place; columns count from 0."""
        self._unseen = np.bincount(self._column).astype(np.int32)
        """Standing places left, by column."""
        self._is_seen = np.zeros(len(ground.voxel_ids), dtype=np.bool_)
        self.count = 0

    def add(self, voxel_ids: NDArray[np.int64]) -> None:
        """Voxels that were seen [N], each once; also such as were seen before."""
        places = self._place[voxel_ids]
        places = places[places >= 0]
        places = places[~self._is_seen[places]]
        self._is_seen[places] = True
        columns, counts = np.unique(self._column[places], return_counts=True)
        self._unseen[columns] -= counts.astype(np.int32)
        self.count += int(np.count_nonzero(self._unseen[columns] == 0))
