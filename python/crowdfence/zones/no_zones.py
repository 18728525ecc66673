"""What stands in for a zone engine where nothing is closed: on the map of a class that is no danger."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from crowdfence._core import CrowdMap, Observation
from crowdfence.zones.rules import ZoneRules
from crowdfence.zones.zone import Zone, ZoneSet, closed_of


class NoZones:
    """Finds what is of the class at every instant, and closes nothing but what somebody else closed."""

    def __init__(self, crowd_map: CrowdMap, rules: ZoneRules, static: Sequence[Zone] = ()) -> None:
        self.rules = rules
        self._crowd_map = crowd_map
        self._zones = ZoneSet((), rules.threshold, rules.min_area_m2, 0, 0.0, static=closed_of(static))
        self.crowd_voxel_ids = np.empty(0, dtype=np.int64)
        """Voxels at or above the threshold at the last step, sorted."""
        self.shown_ids = np.empty(0, dtype=np.int64)
        """None, as nothing has to be closed."""

    def step(self, stamp_ns: int, observations: Iterable[Observation] = ()) -> ZoneSet:
        found = self._crowd_map.crowd_columns(stamp_ns, threshold=self.rules.threshold)
        self.crowd_voxel_ids = np.sort(found.voxel_ids)
        return self._zones

    def to_bytes(self) -> bytes:
        """Nothing: the next step depends on the map alone."""
        return b""

    def restore(self, data: bytes) -> None:
        """ValueError for what `to_bytes` never gave."""
        if data:
            raise ValueError("a map whose class closes nothing keeps no zones")
