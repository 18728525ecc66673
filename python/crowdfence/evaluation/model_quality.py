"""A model on labelled missions that it was not trained on: quality, rates per voxel, example pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.evaluation.cells.example_page import ExamplePage
from crowdfence.evaluation.cells.quality import QualityReport
from crowdfence.evaluation.labelled_missions import LabelledMission, LabelledMissions, MeasurementPlan
from crowdfence.evaluation.labelled_pass import measure
from crowdfence.evaluation.voxels.rates import VoxelRates
from crowdfence.sources.recording import Frame

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector


@dataclass(frozen=True, slots=True, eq=False)
class ModelQuality:
    """What was measured."""

    plan: MeasurementPlan
    quality: QualityReport
    rates: VoxelRates | None
    """None: no recording came with a map."""
    frames: int
    refused: tuple[str, ...]
    examples: NDArray[np.uint8]
    """A page of pictures [H, W, 3], see `ExamplePage`."""

    def to_json(self) -> dict[str, Any]:
        """Ready for JSON; unknown is null."""
        rates = self.rates
        return {
            "marks": self.plan.target,
            "target_height_m": self.plan.target_height_m,
            "frames": self.frames,
            "refused": list(self.refused),
            "quality": self.quality.to_json(),
            "rates": None if rates is None else rates.rates.to_json(),
            "rates_away_from_edges": None if rates is None else rates.away_from_edges.to_json(),
        }


def model_quality(
    detector: Detector,
    data: list[Path],
    plan: MeasurementPlan,
    *,
    on_frame: Callable[[], None] = lambda: None,
) -> ModelQuality:
    """Run a detector over labelled missions, one frame and one map in memory at a time.

    ValueError for data without truth; what single frames lack is in `refused`.
    """
    missions, page = LabelledMissions(data, plan, on_frame), ExamplePage()

    def keep(mission: LabelledMission, frame: Frame, heatmap: NDArray[Any]) -> None:
        page.offer(mission.name, frame.image(), heatmap, mission.mask_of(frame), mission.ignored(frame))

    result = measure(missions, lambda frame: (detector(frame.image()),), on_heatmap=keep)
    return ModelQuality(
        plan,
        result.quality,
        result.rates[0] if result.rates else None,
        result.frames,
        tuple(missions.refused),
        page.picture(),
    )
