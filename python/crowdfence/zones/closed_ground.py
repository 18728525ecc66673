"""Which voxels are closed as crowd, from instant to instant, and the ground they lie on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap
from crowdfence.zones.belief import ColumnBelief, column_belief, forgets_to_unknown
from crowdfence.zones.sorted_keys import united
from crowdfence.zones.tracker import column_keys


class ClosedGround:
    """Voxels that a crowd map calls crowd, and those that were closed before and that no look has opened.

    Ground is opened by a look, not by forgetting: where a method forgets crowd towards what is not known, a
    voxel that was crowd at its last look is closed, however late that look came, and stays so until somebody
    looks at it again, finds less than the threshold, and sees nothing that speaks for crowd. A look at the
    roof opens nothing below it. Nor does one that could not have shown anybody: what is remembered of looks
    must outweigh the method's doubt, or it is forgetting that brought the ground below the threshold.

    What one look by itself shows is closed while it stands (`CrowdMap.shown_ids`), whatever the other drones
    see there at the time, since one of them may be blind, and beyond that until somebody looks again. Looks
    may come in any order: one that is older than what is known of its place opens nothing.
    """

    def __init__(
        self, crowd_map: CrowdMap, threshold: float, off_threshold: float, opening_looks: int = 1
    ) -> None:
        """A voxel is closed from `threshold` on and stays so down to `off_threshold`, at most as high. Where
        ground is opened by looks, so many in a row must find it below."""
        self._crowd_map = crowd_map
        self._threshold, self._off_threshold = threshold, off_threshold
        self._opening_looks = opening_looks
        self._doubt = float(crowd_map.method.parameters.get("doubt", 0.0))
        self.voxel_ids = np.empty(0, dtype=np.int64)
        """What is closed as of the last step, sorted."""
        self.below = np.empty(0, dtype=np.int64)
        """How many looks in a row, up to the last one, found each of them below the off threshold."""
        self.shown_ids = np.empty(0, dtype=np.int64)
        """What is closed of it because one look shows it by itself, as of the last step, sorted."""
        self.looked_ns = np.empty(0, dtype=np.int64)
        """When each of what is closed had last been looked at then. A look that came late is one all the
        same, where it is newer than those before it at that place."""
        self.forgets_to_unknown = forgets_to_unknown(crowd_map)
        """Whether ground can be closed that is below both thresholds."""

    @property
    def columns(self) -> NDArray[np.int64]:
        """(i, j) of what is closed as of the last step [C, 2]."""
        return np.unique(self._crowd_map.terrain.voxel_indices(self.voxel_ids)[:, :2], axis=0)

    def step(self, stamp_ns: int) -> tuple[ColumnBelief, NDArray[np.int64]]:
        """At the newest instant, or later if nothing came: columns that are closed, and their keys. After
        every instant, in order."""
        crowd_map = self._crowd_map
        crowd = self._crowd(stamp_ns)
        stays = ~np.isin(self.voxel_ids, crowd, assume_unique=True)
        held, below, looked_ns = self.voxel_ids[stays], self.below[stays], self.looked_ns[stays]
        if self.forgets_to_unknown:
            looked = crowd_map.last_seen_ns(held) > looked_ns
            opens, below = self._opened_by_looks(held, looked, below, stamp_ns)
        else:
            opens = crowd_map.probability(stamp_ns, held) < self._off_threshold
        ids = np.concatenate([crowd, held[~opens]])
        order = np.argsort(ids)
        self.voxel_ids = ids[order]
        self.below = np.concatenate([np.zeros(len(crowd), dtype=np.int64), below[~opens]])[order]
        self.looked_ns = crowd_map.last_seen_ns(self.voxel_ids)
        belief = column_belief(crowd_map, stamp_ns, self.voxel_ids, self._off_threshold)
        return belief, column_keys(belief.columns.indices)

    def restore(
        self,
        voxel_ids: NDArray[np.int64],
        looked_ns: NDArray[np.int64],
        below: NDArray[np.int64] | None = None,
    ) -> None:
        """Go on from there."""
        self.voxel_ids, self.looked_ns = voxel_ids, looked_ns
        self.below = np.zeros(len(voxel_ids), dtype=np.int64) if below is None else below

    def _crowd(self, stamp_ns: int) -> NDArray[np.int64]:
        """Voxels that are closed whether they were before or not, sorted."""
        crowd_map, threshold = self._crowd_map, self._threshold
        if not self.forgets_to_unknown:
            return crowd_map.crowd_ids(stamp_ns, threshold=threshold)
        self.shown_ids = crowd_map.shown_ids(stamp_ns, threshold=threshold)
        # All that is shown now is among what was shown at the last looks.
        shown = crowd_map.shown_ids_at_last_looks(threshold=threshold)
        return united(crowd_map.crowd_ids_at_last_looks(threshold=threshold), shown)

    def _opened_by_looks(
        self,
        held: NDArray[np.int64],
        looked: NDArray[np.bool_],
        below: NDArray[np.int64],
        stamp_ns: int,
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Of voxels that were closed [N], of which some were `looked` at since the last step: which that
        opens, and how many looks in a row now found each below."""
        crowd_map = self._crowd_map
        still = crowd_map.crowd_ids_at_last_looks(threshold=self._off_threshold)
        is_below = ~np.isin(held, still, assume_unique=True) & ~crowd_map.spoke_for_crowd(held)
        below = np.where(looked, np.where(is_below, below + 1, 0), below)
        opens = looked & is_below & (below >= self._opening_looks)
        opens[opens] = self._outweighs_doubt(held[opens], stamp_ns)
        return opens, below

    def _outweighs_doubt(self, ids: NDArray[np.int64], stamp_ns: int) -> NDArray[np.bool_]:
        """Of voxels [N]: where the looks at them weigh more than the doubt. A method that counts no looks has
        none."""
        if self._doubt == 0.0 or not len(ids):
            return np.ones(len(ids), dtype=np.bool_)
        return self._crowd_map.knowledge(ids, stamp_ns).looks >= self._doubt
