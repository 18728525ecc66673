"""What a look says of voxels that matter, as those of a crowd: few of the hundred thousand that it sees."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Observation
from crowdfence.zones.sorted_keys import are_among

LEAST_VOXELS = 20
"""That somebody shows within a look, or it says nothing."""
NEARLY_ALL = 0.95
_SHARP_M = 0.3
"""Metres per pixel up to which nobody should be missed there."""
_NOBODY = 0.05
"""A smaller value shows nobody."""
_CROWD = 0.5
"""A larger value shows crowd."""


class Closely(NamedTuple):
    """What a look says of some voxels."""

    seen: NDArray[np.int64]
    """Those at which it would not have missed anybody."""
    empty: NDArray[np.int64]
    """Those of them that show nobody."""

    @property
    def is_denied(self) -> bool | None:
        """Whether nobody is there; None where too little of it is seen to say."""
        if len(self.seen) < LEAST_VOXELS:
            return None
        return len(self.empty) >= NEARLY_ALL * len(self.seen)


class CloseLook:
    """An observation, asked about voxels. Of every drone one is kept: ten bytes a voxel."""

    def __init__(self, observation: Observation) -> None:
        self.drone, self.stamp_ns = observation.drone, observation.stamp_ns
        self._voxel_ids, mean = observation.voxel_ids, observation.mean
        near = observation.range_m <= _SHARP_M * observation.focal_px
        self._closely = near & (observation.tilt_deg > 0.0)
        self._nobody = mean < _NOBODY
        self.crowd_ids: NDArray[np.int64] = self._voxel_ids[mean > _CROWD]
        """Voxels that it shows as crowd, sorted."""

    def __len__(self) -> int:
        return len(self._voxel_ids)

    def shows(self, shown_ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Those of them that some look clearly shows as crowd, sorted."""
        return self.crowd_ids[are_among(self.crowd_ids, shown_ids)]

    def seen(self, voxel_ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Which of the voxels it sees at all, in their order."""
        return np.asarray(self._voxel_ids[self._rows(voxel_ids)])

    def closely(self, voxel_ids: NDArray[np.int64]) -> Closely:
        """What it says of the voxels, in their order."""
        rows = self._rows(voxel_ids)
        rows = rows[self._closely[rows]]
        return Closely(self._voxel_ids[rows], self._voxel_ids[rows[self._nobody[rows]]])

    def _rows(self, voxel_ids: NDArray[np.int64]) -> NDArray[np.int64]:
        rows = np.searchsorted(self._voxel_ids, voxel_ids)
        within = rows < len(self)
        rows = rows[within]
        return np.asarray(rows[self._voxel_ids[rows] == voxel_ids[within]])
