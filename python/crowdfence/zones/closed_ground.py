"""Which columns are closed as crowd, from instant to instant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap
from crowdfence.zones.belief import ColumnBelief, column_belief, forgotten_probability
from crowdfence.zones.tracker import column_keys, column_places

NEVER_NS = -1
_LEAST = float(np.finfo(np.float64).tiny)


class ClosedGround:
    """Columns that a crowd map calls crowd, and those that were closed before and that no look has opened.

    Ground is opened by a look, not by forgetting: where a method forgets crowd towards what is not known, its
    ground stays closed until somebody looks again.
    """

    def __init__(
        self, crowd_map: CrowdMap, threshold: float, off_threshold: float, opening_looks: int = 1
    ) -> None:
        """A column is closed from `threshold` on and stays so down to `off_threshold`, at most as high. Where
        ground is opened by looks, so many in a row must find it below."""
        self._crowd_map = crowd_map
        self._threshold, self._off_threshold = threshold, off_threshold
        self._opening_looks = opening_looks
        self.keys = np.empty(0, dtype=np.int64)
        """Of the columns that are closed as of the last step, sorted."""
        self.below = np.empty(0, dtype=np.int64)
        """How many looks in a row, up to the last one, found each of them below the off threshold."""
        self.stepped_ns = NEVER_NS
        """When that was."""
        forgotten = forgotten_probability(crowd_map)
        # A hair below, so that what is forgotten to the last bit is found.
        self._forgotten = None if forgotten is None else min(forgotten * (1.0 - 1e-9), off_threshold)

    @property
    def forgets_to_unknown(self) -> bool:
        """Whether ground can be closed that is below both thresholds."""
        return self._forgotten is not None

    @property
    def columns(self) -> NDArray[np.int64]:
        """(i, j) of what is closed as of the last step [C, 2]."""
        return column_places(self.keys)

    def step(self, stamp_ns: int) -> tuple[ColumnBelief, NDArray[np.int64], NDArray[np.bool_]]:
        """At the newest instant, or later if nothing came: columns that can be closed, their keys, and which
        of them are. After every instant, in order."""
        belief = column_belief(
            self._crowd_map,
            stamp_ns,
            self.columns,
            threshold=self._threshold,
            off_threshold=self._off_threshold,
            least=self._least,
        )
        columns = belief.columns
        keys = column_keys(columns.indices)
        was_closed = np.isin(keys, self.keys, assume_unique=True)
        is_below = columns.probability < self._off_threshold
        if self._forgotten is None:
            count = np.zeros(len(keys), dtype=np.int64)
            opens = is_below
        else:
            looked = columns.last_seen_ns > self.stepped_ns
            count = np.zeros(len(keys), dtype=np.int64)
            count[was_closed] = self.below[np.isin(self.keys, keys, assume_unique=True)]
            count = np.where(looked, np.where(is_below, count + 1, 0), count)
            opens = looked & is_below & (count >= self._opening_looks)
        is_closed = (columns.probability >= self._threshold) | (was_closed & ~opens)
        self.keys, self.below, self.stepped_ns = keys[is_closed], count[is_closed], stamp_ns
        return belief, keys, is_closed

    def restore(
        self, keys: NDArray[np.int64], stepped_ns: int, below: NDArray[np.int64] | None = None
    ) -> None:
        """Go on from there."""
        self.keys, self.stepped_ns = keys, stepped_ns
        self.below = np.zeros(len(keys), dtype=np.int64) if below is None else below

    @property
    def _least(self) -> float:
        """Probability down to which closed columns are read."""
        if self._forgotten is None:
            return self._off_threshold
        # One look below opens nothing yet, however far below it is.
        return self._forgotten if self._opening_looks == 1 else _LEAST
