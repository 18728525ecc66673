"""A model, labelled missions -> the model calibrated, with its measured rates written into it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.calibration.choice import Calibration, calibrate
from crowdfence.calibration.correction import UNCHANGED, LogitMap
from crowdfence.calibration.graph import bake, float_type
from crowdfence.calibration.logit_counts import logit_counts
from crowdfence.calibration.model_file import (
    calibrated_contract,
    output_kind,
    require_agreement,
    write_calibrated,
)
from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.contract.lookup import sidecar_path
from crowdfence.detector.picture_statistics import picture_statistics, range_of_missions
from crowdfence.evaluation.cells.quality import QualityReport
from crowdfence.evaluation.cells.rates import crowd_cells, heatmap_values
from crowdfence.evaluation.cells.scores import Quality
from crowdfence.evaluation.labelled_missions import LabelledMission, LabelledMissions, MeasurementPlan
from crowdfence.evaluation.labelled_pass import Heatmap, PassResult, judged_cells, measure
from crowdfence.evaluation.voxels.likelihood_ratio import BORROWED
from crowdfence.evaluation.voxels.rates import VoxelRates
from crowdfence.sources.recording import Frame
from crowdfence.truth.frame_labels import TARGET_HEIGHT_M

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector


NOTABLE_LOSS = 0.005
"""Share of the crowd cells whose loss at one half is told."""
NOTABLE_LIFT = 0.02
"""Of the way from chance to all cells ranked right; what lies below is told."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelCalibration:
    """What was measured and written."""

    contract: Contract
    """Of the calibrated model."""
    plan: MeasurementPlan
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
    contract: Contract, plan: MeasurementPlan, *, target: bool = False, target_height_m: bool = False
) -> MeasurementPlan:
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
    plan: MeasurementPlan,
    *,
    on_frame: Callable[[], None] = lambda: None,
) -> ModelCalibration:
    """Run a detector, loaded from `model`, over labelled missions; fit and choose a correction of its logits;
    write it into the graph, and calibration, rates and range of validity into the metadata of `output`.

    Goes over the missions twice, one frame and one map in memory at a time; `on_frame` is called for every
    frame of both. Nothing is written where the corrected graph does not do what was fitted. Data are mission
    files, AirSim recordings or folders with truth that the model was not trained on.

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
    statistics: dict[str, list[NDArray[np.float64]]] = {}
    counts, frames, scaled = _count_logits(detector, missions, statistics)
    # What joins the maps of several sizes follows the graph's correction only where that is a line.
    combines = contract.sizes is not None and contract.sizes.weights is not None
    calibration = calibrate(counts, lines_only=combines and not scaled)
    with TemporaryDirectory() as folder:
        corrected = Path(folder) / "corrected.onnx"
        unmeasured = calibrated_contract(contract, calibration, None, None, plan.target_height_m)
        write_calibrated(graph, calibration.chosen, contract, unmeasured, corrected)
        written, half = Detector(corrected), float_type(graph.graph, contract.output.name) is np.float16
        require_agreement(detector, written, calibration.chosen, missions.some_image(), half=half)
        measured = measure(
            missions,
            partial(_before_and_after, detector, written, calibration.chosen, plan),
            contract.output.stride,
        )
    before, after = measured.rates or (None, None)
    completed = calibrated_contract(contract, calibration, after, measured.settings, plan.target_height_m)
    seen = range_of_missions({name: np.array(of_one) for name, of_one in statistics.items()})
    completed = replace(completed, pictures=seen)
    write_calibrated(graph, calibration.chosen, contract, completed, output)
    return ModelCalibration(
        completed,
        plan,
        calibration,
        measured.quality,
        before,
        after,
        frames,
        tuple(missions.refused),
        tuple(_warnings(contract, completed, calibration, measured, missions)),
    )


def _count_logits(
    detector: Detector, missions: LabelledMissions, statistics: dict[str, list[NDArray[np.float64]]]
) -> tuple[dict[str, NDArray[np.float64]], int, bool]:
    """First pass: logits by truth of every mission, the number of frames used, and whether a map told the
    scale of all; into `statistics` what the pictures of every mission look like."""
    counts: dict[str, NDArray[np.float64]] = {}
    frames, stride, scaled = 0, detector.contract.output.stride, True
    for mission in missions.opened(with_maps=detector.uses_gsd):
        scaled &= mission.terrain is not None

        def use(frame: Frame, mission: LabelledMission = mission) -> None:
            mask, ignored = mission.mask_of(frame), mission.ignored(frame)
            heatmap = mission.heatmap(detector, frame, missions.plan.max_range_m)
            values = heatmap_values(judged_cells(heatmap, frame, stride))
            counted = None if ignored is None else ~crowd_cells(ignored, values.shape, stride)
            added = logit_counts(values, crowd_cells(mask, values.shape, stride), counted)
            counts[mission.name] = counts.get(mission.name, 0.0) + added
            statistics.setdefault(mission.name, []).append(picture_statistics(frame.image()))

        frames += missions.over_frames(mission, use)
    return counts, frames, scaled


def _before_and_after(
    detector: Detector,
    written: Detector,
    chosen: LogitMap,
    plan: MeasurementPlan,
    mission: LabelledMission,
    frame: Frame,
) -> tuple[Heatmap, Heatmap]:
    """Of the model and of the corrected one. That one looks itself where it is shown pictures at other sizes:
    the graph corrects its own cells, and heatmaps are interpolated from these."""
    raw = mission.heatmap(detector, frame, plan.max_range_m)
    contract = detector.contract
    if contract.sizes is None and contract.input.resize not in ("stretch", "letterbox"):
        return raw, chosen.probability(raw)
    return raw, mission.heatmap(written, frame, plan.max_range_m)


def _warnings(
    before: Contract,
    completed: Contract,
    calibration: Calibration,
    measured: PassResult,
    missions: LabelledMissions,
) -> Iterator[str]:
    if calibration.after is None:
        yield (
            "crowd in fewer than two missions: only a temperature was fitted, and no mission held out "
            "shows whether it helps"
        )
    yield from missions.doubts
    yield from missions.interval_warnings(measured.quality.overall.units)
    yield from _of_chance(measured.quality.overall)
    yield from _of_people_lost(calibration.before, measured.quality.overall)
    if measured.rates:
        yield from of_few_looks(measured.rates[-1])
    if not measured.rates:
        left_out = ", and those that it stated, of other heatmaps, are left out" if before.rates else ""
        yield f"no recording comes with a map: no rates per voxel observation were measured{left_out}"
    elif measured.without_map:
        yield f"without a map, not part of the rates: {', '.join(measured.without_map)}"
    if completed.pictures is None:
        yield (
            "too few pictures, or only one mission, to say what those look like that it was tested on: no "
            "picture of a flight will be told to be unlike them"
        )


def _of_chance(after: Quality) -> Iterator[str]:
    """What ranks cells at random has the share of crowd as its area under the precision-recall curve."""
    share, pr_auc = after.crowd_cells / max(after.cells, 1), after.pr_auc.value
    if pr_auc - share < NOTABLE_LIFT * (1.0 - share):
        yield (
            f"the model does not tell crowd from other ground: PR-AUC {pr_auc:.3f}, by chance {share:.3f}. "
            "No correction mends that, and a run with it closes and clears next to nothing; check what its "
            "contract says of the picture, and what it was trained on"
        )


def _of_people_lost(before: Quality, after: Quality) -> Iterator[str]:
    """A correction that makes probabilities true may take crowd below one half."""
    called, called_before = after.true_positive_rate.value, before.true_positive_rate.value
    if called < called_before - NOTABLE_LOSS:
        yield (
            f"above 0.5 the corrected heatmaps call {called:.1%} of the crowd cells, the model's own "
            f"{called_before:.1%}: whatever goes by 0.5, as methods paper and or do, finds fewer people; "
            "evidence goes by the likelihood ratios"
        )


def of_few_looks(rates: VoxelRates) -> Iterator[str]:
    """What rates that rest on few looks at crowd do not tell, in one sentence at most."""
    if rates.crowd_observations < BORROWED:
        yield (
            f"{rates.crowd_observations} observations of crowd voxels, fewer than one picture of a crowd "
            "shows: how strongly a look speaks against crowd is hardly known, and evidence clears ground by "
            "it; add missions with crowd"
        )
