"""A model, labelled missions -> the model calibrated, with what it is worth written into it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.calibration import Calibration, calibrate
from crowdfence.detector.calibration_fit import UNCHANGED, LogitMap
from crowdfence.detector.calibration_graph import bake
from crowdfence.detector.contract import Contract
from crowdfence.detector.contract_lookup import sidecar_path
from crowdfence.detector.logit_counts import logit_counts
from crowdfence.evaluation.calibrated_model import (
    calibrated_contract,
    output_kind,
    require_agreement,
    write_calibrated,
)
from crowdfence.evaluation.calibration_data import (
    BLOCK_S,
    CalibrationPlan,
    LabelledMission,
    LabelledMissions,
)
from crowdfence.evaluation.detector_quality import DetectorQuality, LabelledHeatmap, QualityReport
from crowdfence.evaluation.detector_rates import crowd_cells, heatmap_values
from crowdfence.evaluation.labelled_frames import cell_sampling, mission_groups
from crowdfence.evaluation.labelled_projection import LabelledProjection
from crowdfence.evaluation.voxel_rates import ProjectionSettings, VoxelRateCounter, VoxelRates
from crowdfence.sources.recording import Frame

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector

TARGET_HEIGHT_M = {"silhouettes": 0.9, "ground": 0.0}
"""Where neither caller nor contract says: the middle of a standing person, the ground."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelCalibration:
    """What was measured and written."""

    contract: Contract
    """Of the calibrated model."""
    plan: CalibrationPlan
    calibration: Calibration
    quality: QualityReport
    """Of the calibrated heatmaps. The few numbers of the correction were fitted on these very missions; the
    scores in `calibration` are of missions held out."""
    rates_before: VoxelRates | None
    """None: no recording came with a map."""
    rates: VoxelRates | None
    frames: int
    refused: tuple[str, ...]
    warnings: tuple[str, ...]


def plan_for(
    contract: Contract, plan: CalibrationPlan, *, target: bool = False, target_height_m: bool = False
) -> CalibrationPlan:
    """The plan with what the contract says about the heatmap, except where `target` or `target_height_m` say
    that the caller has chosen."""
    if not target and (contract.about or {}).get("marks") in TARGET_HEIGHT_M:
        plan = replace(plan, target=(contract.about or {})["marks"])
    if not target_height_m:
        stated = contract.target_height_m
        plan = replace(plan, target_height_m=TARGET_HEIGHT_M[plan.target] if stated is None else stated)
    return plan


def calibrate_model(
    detector: Detector,
    model: Path,
    data: list[Path],
    output: Path,
    plan: CalibrationPlan,
    *,
    on_frame: Callable[[], None] = lambda: None,
) -> ModelCalibration:
    """Run a detector, loaded from `model`, over labelled missions; fit and choose a correction of its logits;
    write it into the graph, and calibration, rates and range of validity into the metadata of `output`.

    Goes over the missions twice, one frame and one map in memory at a time; `on_frame` is called for every
    frame of both. Data are mission files, AirSim recordings or folders with truth that the model was not
    trained on.

    ModuleNotFoundError without the package onnx; DetectorError for a model whose output is neither one
    probability from a Sigmoid nor logits; ValueError for data without truth or without crowd.
    """
    import onnx

    from crowdfence.detector.detector import Detector

    contract = detector.contract
    graph = onnx.load(str(model))
    bake(graph, UNCHANGED, contract.output.name, output_kind(contract))  # what cannot be baked is said now
    if sidecar_path(output).exists():
        raise ValueError(f"{sidecar_path(output)} would hide the contract inside {output}: remove it first")
    missions = LabelledMissions(data, plan, on_frame)
    counts, frames = _count_logits(detector, missions)
    calibration = calibrate(counts)
    measured = _measure(detector, missions, calibration.chosen)
    completed = calibrated_contract(
        contract, calibration, measured.after, measured.settings, plan.target_height_m
    )
    write_calibrated(graph, calibration.chosen, contract, completed, output)
    require_agreement(detector, Detector(output), calibration.chosen, missions.some_image())
    return ModelCalibration(
        completed,
        plan,
        calibration,
        measured.quality.report(),
        measured.before,
        measured.after,
        frames,
        tuple(missions.refused),
        tuple(_warnings(calibration, measured, missions)),
    )


def _count_logits(
    detector: Detector, missions: LabelledMissions
) -> tuple[dict[str, NDArray[np.float64]], int]:
    """First pass: logits by truth of every mission, and the number of frames used."""
    counts: dict[str, NDArray[np.float64]] = {}
    frames = 0
    for mission in missions.opened(with_maps=False):

        def use(frame: Frame, mission: LabelledMission = mission) -> None:
            mask, ignored = mission.mask_of(frame), mission.ignored(frame)
            values = heatmap_values(detector(frame.image()))
            counted = None if ignored is None else ~crowd_cells(ignored, values.shape)
            added = logit_counts(values, crowd_cells(mask, values.shape), counted)
            counts[mission.name] = counts.get(mission.name, 0.0) + added

        frames += missions.over_frames(mission, use)
    return counts, frames


class _Measured:
    """Second pass: what is collected, and what came out."""

    def __init__(self) -> None:
        self.quality = DetectorQuality()
        self.before: VoxelRates | None = None
        self.after: VoxelRates | None = None
        self.settings: ProjectionSettings | None = None
        self.without_map: list[str] = []


def _measure(detector: Detector, missions: LabelledMissions, chosen: LogitMap) -> _Measured:
    """Quality of the corrected heatmaps, and rates per voxel observation before and after."""
    plan, measured = missions.plan, _Measured()
    counters = [VoxelRateCounter(b_threshold=plan.b_threshold) for _ in range(2)]
    for mission in missions.opened(with_maps=True):
        groups = mission_groups(mission.recording)
        projection = _projection(mission, plan, measured)

        def use(
            frame: Frame,
            mission: LabelledMission = mission,
            groups: dict[str, str] = groups,
            projection: LabelledProjection | None = projection,
        ) -> None:
            raw = detector(frame.image())
            corrected = chosen.probability(raw)
            unit = missions.unit(mission, frame)
            mask, ignored = mission.mask_of(frame), mission.ignored(frame)
            gsd_m = tilt_deg = None
            if projection is not None and mission.terrain is not None:
                gsd_m, tilt_deg = cell_sampling(frame, mission.terrain, corrected.shape, plan.max_range_m)
                seen = [projection.observe(frame, heatmap) for heatmap in (raw, corrected)]
                for counter, observation in zip(counters, seen, strict=True):
                    counter.add(observation, mission.name, unit)
            measured.quality.add(
                LabelledHeatmap(corrected, mask, mission.name, ignored, gsd_m, tilt_deg, groups, unit)
            )

        missions.over_frames(mission, use)
    if measured.settings is not None:
        measured.before, measured.after = (counter.result() for counter in counters)
    return measured


def _projection(
    mission: LabelledMission, plan: CalibrationPlan, measured: _Measured
) -> LabelledProjection | None:
    """None for a mission without a map. ValueError for voxels of another size than the missions before."""
    if mission.terrain is None:
        measured.without_map.append(mission.name)
        return None
    size_m = mission.terrain.voxel_size_m
    if measured.settings is not None and not np.isclose(measured.settings.voxel_size_m, size_m):
        raise ValueError(
            f"the map of {mission.name} has voxels of {size_m:g} m, others have "
            f"{measured.settings.voxel_size_m:g} m: rates per voxel hold for one size"
        )
    measured.settings = ProjectionSettings(size_m, plan.target_height_m, plan.max_range_m, plan.coverage)
    return LabelledProjection(
        mission.recording,
        mission.terrain,
        target_height_m=plan.target_height_m,
        max_range_m=plan.max_range_m,
        coverage=plan.coverage,
        truth=plan.truth,
        mask_of=mission.mask_of,
        ignore_of=mission.ignore_of,
    )


def _warnings(calibration: Calibration, measured: _Measured, missions: LabelledMissions) -> Iterator[str]:
    if calibration.after is None:
        yield (
            "crowd in fewer than two missions: only a temperature was fitted, and nothing held out says "
            "whether it helps"
        )
    if len(missions.paths) == 1:
        yield f"one mission only: intervals come from blocks of {BLOCK_S:g} s and do not cover other places"
    if measured.settings is None:
        yield "no recording comes with a map: no rates per voxel observation were measured"
    elif measured.without_map:
        yield f"without a map, not part of the rates: {', '.join(measured.without_map)}"
