"""Ground that is not known to be empty: never seen, hidden, stale, or what else a method does not clear, and
holes of the map.

Nearly all of a large map may be unknown. So it is kept as runs of columns, and what is known is cut out of
them: that costs what was seen, not the map.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap, Terrain
from crowdfence.zones.map_holes import hole_columns
from crowdfence.zones.regions import Runs
from crowdfence.zones.sorted_keys import are_among, united
from crowdfence.zones.standing_columns import StandingColumns
from crowdfence.zones.tracker import column_keys, column_places


class UnseenGround:
    """Made once per terrain."""

    def __init__(self, terrain: Terrain) -> None:
        self._standing = StandingColumns(terrain)
        keys = self._standing.keys
        holes = column_keys(hole_columns(column_places(keys)))
        self._all = Runs.of(column_places(united(keys, holes)))
        self.has_holes = len(holes) > 0
        """Whether the map lacks columns inside of itself, of which nobody knows how high the ground lies."""

    def at(
        self,
        crowd_map: CrowdMap,
        stamp_ns: int,
        threshold: float,
        stale_after_s: float,
        in_zones: NDArray[np.int64],
        in_no_zone: NDArray[np.int64],
    ) -> Runs:
        """The columns with a place that is neither empty nor crowd, or that is crowd while the column is none
        of those `in_zones` (sorted keys), those `in_no_zone` (the same), and those that the map lacks inside
        of itself. Whatever state a method may invent is unknown here."""
        keys, places = self._standing.keys, self._standing.places
        empty_ids = crowd_map.empty_ids(stamp_ns, threshold=threshold, stale_after_s=stale_after_s)
        empty = self._standing.under(empty_ids)
        crowd = self._standing.under(crowd_map.crowd_ids(stamp_ns, threshold=threshold))
        column, count = np.unique(np.append(empty, crowd), return_counts=True)
        known = keys[column[count == places[column]]]
        # What the map calls crowd is no zone by that alone.
        of_crowd = keys[np.unique(crowd)]
        not_closed = united(of_crowd[~are_among(of_crowd, in_zones)], in_no_zone)
        return self._all.without(column_places(known[~are_among(known, not_closed)]))
