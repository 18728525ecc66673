"""A model on labelled missions that it was not trained on: quality, rates per voxel, example pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.evaluation.cells.example_page import ExamplePage
from crowdfence.evaluation.cells.frame_context import cell_sampling
from crowdfence.evaluation.cells.people_found import PeopleFound
from crowdfence.evaluation.cells.picture_figures import PictureFigures
from crowdfence.evaluation.cells.quality import QualityReport
from crowdfence.evaluation.cells.rates import crowd_cells
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
    pictures: PictureFigures
    people: PeopleFound
    """Where people are recorded and a map is there."""
    warnings: tuple[str, ...]
    """What is doubtful about the recordings and their maps, and what the intervals do not cover."""

    def to_json(self) -> dict[str, Any]:
        """Ready for JSON; unknown is null."""
        rates = self.rates
        return {
            "marks": self.plan.target,
            "target_height_m": self.plan.target_height_m,
            "frames": self.frames,
            "refused": list(self.refused),
            "warnings": list(self.warnings),
            "quality": self.quality.to_json(),
            "pictures": self.pictures.to_json(),
            "people": self.people.to_json(),
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
    pictures, people = PictureFigures(), PeopleFound()
    validity, stride = detector.contract.validity, detector.contract.output.stride

    def keep(mission: LabelledMission, frame: Frame, heatmap: NDArray[Any]) -> None:
        mask, ignored = mission.mask_of(frame), mission.ignored(frame)
        of = frame.drone if mission.is_pictures else mission.name
        page.offer(of, frame.image(), heatmap, mask, ignored, stride)
        crowd = crowd_cells(mask, heatmap.shape, stride)
        known = np.ones(crowd.shape, np.bool_)
        if ignored is not None:
            known = ~crowd_cells(ignored, crowd.shape, stride)
        pictures.add(heatmap, crowd, known)
        if mission.terrain is not None:
            gsd_m, _ = cell_sampling(frame, mission.terrain, heatmap.shape, plan.max_range_m)
            tested_m = None if validity is None else validity.gsd_m
            people.add(frame, heatmap, crowd, np.where(known, gsd_m, np.nan), tested_m, stride)

    def heatmaps_of(mission: LabelledMission, frame: Frame) -> tuple[NDArray[Any]]:
        return (mission.heatmap(detector, frame, plan.max_range_m),)

    result = measure(missions, heatmaps_of, stride, on_heatmap=keep)
    return ModelQuality(
        plan,
        result.quality,
        result.rates[0] if result.rates else None,
        result.frames,
        tuple(missions.refused),
        page.picture(),
        pictures,
        people,
        (*missions.doubts, *missions.interval_warnings(result.quality.overall.units)),
    )
