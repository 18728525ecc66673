"""What a report shows beside IoU and safety, of one method on one recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence.evaluation.closing_cost import ClosingCost
from crowdfence.evaluation.probability_quality import ProbabilityQuality
from crowdfence.evaluation.route_safety import RouteSafety
from crowdfence.evaluation.safety import Cells, CrowdsInView
from crowdfence.evaluation.zone_delay import ZoneDelay

if TYPE_CHECKING:
    from crowdfence._core import Terrain

ROUTES_EVERY = 3
"""Moments between two in which ways are asked for."""
LOWEST_SCORE = 1e-3
"""Zones at thresholds below this are not asked for."""


class SeenVoxels(NamedTuple):
    """All that somebody has seen so far, arrays [S]."""

    ids: NDArray[np.int64]
    probability: NDArray[np.float64]
    score: NDArray[np.float64]
    """What a threshold of the method is set on: the probability, or for `or` the highest mean value."""
    crowd: NDArray[np.bool_]
    """Whether it is crowd now."""


@dataclass(slots=True)
class Measures:
    """Sums over moments, once a second."""

    quality: ProbabilityQuality = field(default_factory=ProbabilityQuality)
    cost: ClosingCost = field(default_factory=ClosingCost)
    delay: ZoneDelay = field(default_factory=ZoneDelay)
    routes: RouteSafety = field(default_factory=RouteSafety)
    moments: int = 0

    def add(
        self,
        crowds: CrowdsInView,
        closed: Cells,
        terrain: Terrain,
        seen: SeenVoxels,
        stamp_ns: int,
    ) -> None:
        """One moment: who stands where, the columns that are closed [C, 2], and all voxels seen so far."""
        size_m = terrain.voxel_size_m
        self.quality.add(seen.probability, seen.crowd, seen.score)
        shown = seen.score >= LOWEST_SCORE
        columns, highest = _by_column(terrain.voxel_indices(seen.ids[shown])[:, :2], seen.score[shown])
        self.cost.add(crowds, columns, highest, size_m)
        self.delay.add(crowds, closed, size_m, stamp_ns)
        if self.moments % ROUTES_EVERY == 0:
            self.routes.add(crowds, closed, terrain)
        self.moments += 1

    def to_json(self) -> dict[str, Any]:
        """Every figure by its name; None where it is not known."""
        at_five, at_one = self.cost.curve(np.array([0.05, 0.01])).tolist()
        mark, clear = self.delay.to_mark, self.delay.to_clear
        figures = {
            "average_precision": self.quality.average_precision,
            "brier": self.quality.brier,
            "calibration_error": self.quality.calibration_error,
            "closed_for_nothing_at_5_percent_missed": at_five,
            "closed_for_nothing_at_1_percent_missed": at_one,
            "median_s_to_mark": mark.median_s,
            "share_never_marked": mark.never,
            "median_s_to_clear": clear.median_s,
            "share_never_cleared": clear.never,
            "share_of_ways_over_a_crowd": self.routes.share_crossing,
        }
        return {name: None if value != value else value for name, value in figures.items()}


def _by_column(places: Cells, score: NDArray[np.float64]) -> tuple[Cells, NDArray[np.float64]]:
    """Each column once [C, 2] with its highest score [C]."""
    columns, inverse = np.unique(places, axis=0, return_inverse=True)
    highest = np.zeros(len(columns))
    np.maximum.at(highest, inverse.reshape(-1), score)
    return columns, highest
