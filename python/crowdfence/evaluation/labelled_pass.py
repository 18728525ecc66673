"""One pass over labelled missions: heatmaps judged cell by cell, and voxel by voxel where there is a map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.inference.even_cells import cells_of_stride
from crowdfence.evaluation.cells.frame_context import cell_sampling, mission_groups
from crowdfence.evaluation.cells.quality import DetectorQuality, LabelledHeatmap, QualityReport
from crowdfence.evaluation.labelled_missions import LabelledMission, LabelledMissions, MeasurementPlan
from crowdfence.evaluation.voxels.labelled_projection import LabelledProjection
from crowdfence.evaluation.voxels.rates import ProjectionSettings, VoxelRateCounter, VoxelRates
from crowdfence.sources.recording import Frame

Heatmap = NDArray[Any]
OnFrame = Callable[[LabelledMission, Frame, Heatmap], None]


@dataclass(frozen=True, slots=True, eq=False)
class PassResult:
    """What one pass measured."""

    quality: QualityReport
    """Of the last heatmap of every frame."""
    rates: tuple[VoxelRates, ...]
    """One per heatmap of a frame; empty when no recording came with a map."""
    settings: ProjectionSettings | None
    """How the heatmaps were projected; None without a map."""
    without_map: tuple[str, ...]
    """Missions that could not be projected."""
    frames: int


def measure(
    missions: LabelledMissions,
    heatmaps_of: Callable[[LabelledMission, Frame], Sequence[Heatmap]],
    stride: int,
    *,
    on_heatmap: OnFrame | None = None,
) -> PassResult:
    """Judge the heatmaps of every frame, always equally many: such as raw and corrected. `stride` is that of
    the detector which made them.

    `on_heatmap` is called with the last heatmap of every frame that could be judged. ValueError when maps
    differ in voxel size, or nothing could be used.
    """
    plan, collected = missions.plan, DetectorQuality()
    counters: list[VoxelRateCounter] = []
    settings: ProjectionSettings | None = None
    without_map: list[str] = []
    frames = 0
    for mission in missions.opened(with_maps=True):
        projection: LabelledProjection | None = None
        if mission.terrain is None:
            without_map.append(mission.name)
        else:
            settings = _same_settings(settings, mission, plan)
            projection = _projection(missions, mission)

        def use(
            frame: Frame,
            mission: LabelledMission = mission,
            groups: dict[str, str] = mission_groups(mission.recording),  # noqa: B008
            projection: LabelledProjection | None = projection,
        ) -> None:
            mask, ignored = mission.mask_of(frame), mission.ignored(frame)
            heatmaps = heatmaps_of(mission, frame)
            judged, unit = judged_cells(heatmaps[-1], frame, stride), missions.unit(mission, frame)
            gsd_m = tilt_deg = None
            if projection is not None and mission.terrain is not None:
                gsd_m, tilt_deg = cell_sampling(frame, mission.terrain, judged.shape, plan.max_range_m)
                seen = [projection.observe(frame, heatmap) for heatmap in heatmaps]
                if not counters:
                    counters.extend(VoxelRateCounter(b_threshold=plan.b_threshold) for _ in heatmaps)
                for counter, observation in zip(counters, seen, strict=True):
                    counter.add(observation, mission.name, unit)
            collected.add(
                LabelledHeatmap(judged, mask, mission.name, ignored, gsd_m, tilt_deg, groups, unit, stride)
            )
            if on_heatmap is not None:
                on_heatmap(mission, frame, judged)

        frames += missions.over_frames(mission, use)
    rates = tuple(counter.result() for counter in counters)
    return PassResult(collected.report(), rates, settings, tuple(without_map), frames)


def measure_rates(
    missions: LabelledMissions, heatmap_of: Callable[[LabelledMission, Frame], Heatmap]
) -> tuple[VoxelRates, ProjectionSettings]:
    """The rates alone, which is a tenth of the work of `measure` on large pictures. ValueError for a mission
    without a map, when maps differ in voxel size, and where no crowd was seen."""
    plan = missions.plan
    counter, settings = VoxelRateCounter(b_threshold=plan.b_threshold), None
    for mission in missions.opened(with_maps=True):
        if mission.terrain is None:
            raise ValueError(f"{mission.name} comes without a map: rates per voxel need one")
        settings, projection = _same_settings(settings, mission, plan), _projection(missions, mission)

        def use(
            frame: Frame, mission: LabelledMission = mission, projection: LabelledProjection = projection
        ) -> None:
            seen = projection.observe(frame, heatmap_of(mission, frame))
            counter.add(seen, mission.name, missions.unit(mission, frame))

        missions.over_frames(mission, use)
    if settings is None:
        raise ValueError("there are no missions")
    return counter.result(), settings


def judged_cells(heatmap: Heatmap, frame: Frame, stride: int) -> Heatmap:
    """The cells of a frame's heatmap that are judged one by one: as many for a picture as a detector of that
    stride answers for, whatever its size is a multiple of."""
    return cells_of_stride(heatmap, stride, (frame.camera.height, frame.camera.width))


def _same_settings(
    before: ProjectionSettings | None, mission: LabelledMission, plan: MeasurementPlan
) -> ProjectionSettings:
    """ValueError for voxels of another size than in the missions before."""
    assert mission.terrain is not None
    size_m = mission.terrain.voxel_size_m
    if before is not None and not np.isclose(before.voxel_size_m, size_m):
        raise ValueError(
            f"the map of {mission.name} has voxels of {size_m:g} m, others have {before.voxel_size_m:g} m: "
            "rates per voxel hold for one size"
        )
    return ProjectionSettings(size_m, plan.target_height_m, plan.max_range_m, plan.coverage, plan.surface)


def _projection(missions: LabelledMissions, mission: LabelledMission) -> LabelledProjection:
    assert mission.terrain is not None
    plan = missions.plan
    projection = LabelledProjection(
        mission.recording,
        mission.terrain,
        target_height_m=plan.target_height_m,
        max_range_m=plan.max_range_m,
        coverage=plan.coverage,
        surface=plan.surface,
        truth=plan.truth,
        mask_of=mission.mask_of,
        ignore_of=mission.ignore_of,
    )
    missions.judged_by(mission, projection.truth)
    return projection
