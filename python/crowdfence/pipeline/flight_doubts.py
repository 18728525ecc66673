"""What is doubtful about the views of a flight, which only all of them tell: one list for all who fuse it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Observation, View
from crowdfence.pipeline.blind_drones import BlindDrones
from crowdfence.pipeline.close_look import CloseLook
from crowdfence.pipeline.crowds_apart import CrowdsApart
from crowdfence.pipeline.denied_crowd import DeniedCrowd
from crowdfence.pipeline.detect import HeatmapSource
from crowdfence.pipeline.heatmap_units import HeatmapUnits
from crowdfence.pipeline.nobody_shown import NobodyShown
from crowdfence.sources.layers import CROWD


class FlightDoubts:
    """Looks at views as they pass, and at what came of them."""

    def __init__(self, heatmaps: HeatmapSource, layer: str) -> None:
        """`heatmaps`: who makes them, of which `layer`."""
        self._units, self._denied, self._apart = HeatmapUnits(), DeniedCrowd(), CrowdsApart()
        self._nobody = NobodyShown() if heatmaps.kind != "model" and layer == CROWD else None
        self.blind = BlindDrones()

    def look(
        self, views: Sequence[View], observations: Sequence[Observation], shown_ids: NDArray[np.int64]
    ) -> None:
        """The views of one instant, what they say of the terrain, and the voxels that some look clearly
        shows as crowd after it."""
        for view in views:
            self._units.look(view)
            if self._nobody is not None:
                self._nobody.look(view)
        self.blind.look(views, observations)
        looks = [CloseLook(observation) for observation in observations]
        # What is settled, for which the crowd on the map counts, is asked of a fleet that flies.
        self._denied.look(looks, shown_ids, shown_ids)
        self._apart.look(looks, shown_ids)

    def warnings(self, drones: Sequence[str], max_range_m: float) -> list[str]:
        """Units of heatmaps, heatmaps of nobody, `drones` that saw nothing of the map, and those that saw
        nobody where others did, and crowds that two showed at two places, one sentence each."""
        nobody = [] if self._nobody is None else self._nobody.warnings
        of_heatmaps = [*self._units.warnings, *nobody]
        of_drones = [*self.blind.warnings(drones, max_range_m), *self._denied.warnings]
        return [*of_heatmaps, *of_drones, *self._apart.warnings]
