"""What a detector is worth behind cameras finer than those that it was calibrated with.

Its likelihood ratios go by distance and tilt. A finer camera finds more of a crowd as far away, and more that
is none, while poses are as far off and trees hide as much: neither distance nor metres per pixel alone tells
one from the other. So finer cameras are measured by themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import sqrt
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, NamedTuple

from crowdfence.calibration.calibrate import of_few_looks, plan_for
from crowdfence.calibration.rates_in_eight_bits import stated_settings
from crowdfence.config.evidence import calibration_focal_px
from crowdfence.detector.contract.contract import Contract
from crowdfence.evaluation.labelled_missions import LabelledMission, LabelledMissions, MeasurementPlan
from crowdfence.evaluation.labelled_pass import Heatmap, measure_rates
from crowdfence.evaluation.voxels.rates import VoxelRates
from crowdfence.sources.recording import Frame

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector

LEAST_TIMES = 1.2
"""As fine as those of the calibration; a coarser camera is one of them."""
MOST_SPREAD = 1.2
"""Finest over coarsest camera of one table."""


class FinerRates(NamedTuple):
    """Measured of a detector behind finer cameras."""

    contract: Contract
    """Its own with these rates."""
    focal_px: float
    """Of those cameras, the median."""
    rates: VoxelRates
    warnings: tuple[str, ...]
    """What is doubtful about the recordings and their maps, and what the intervals and the rates do not
    tell."""
    refused: tuple[str, ...]
    """Frames that were not used, and why."""


def with_rates_of_finer(
    detector: Detector,
    data: Sequence[Path],
    plan: MeasurementPlan,
    on_frame: Callable[[], None] = lambda: None,
) -> FinerRates:
    """Run a calibrated detector over labelled missions of finer cameras, measured as its contract says that
    its rates were; `every` and the options of the map are those of `plan`.

    ValueError for a detector without such rates, for data without maps or crowd, and for cameras that are not
    1.2 times as fine as those of its calibration, or differ too much for one table.
    """
    contract, stated = detector.contract, detector.contract.rates or {}
    if "likelihood_ratio" not in stated:
        raise ValueError(
            f"{contract.name} states no likelihood ratios of the cameras that it was calibrated with: "
            "`crowdfence calibrate` measures them"
        )
    plan = plan_for(contract, replace(plan, **stated_settings(contract)))
    missions = LabelledMissions(list(data), plan, on_frame)
    focal_px: list[float] = []

    def heatmap_of(mission: LabelledMission, frame: Frame) -> Heatmap:
        focal_px.append(sqrt(frame.camera.fx * frame.camera.fy))
        _check_focal_lengths(focal_px, LEAST_TIMES * calibration_focal_px(contract))
        return mission.heatmap(detector, frame, plan.max_range_m)

    rates, settings = measure_rates(missions, heatmap_of)
    finer = {"focal_px": round(median(focal_px), 1), "validity": rates.validity, **rates.to_json(settings)}
    completed = Contract.from_json({**contract.to_json(), "rates": {**stated, "finer": finer}})
    intervals = missions.interval_warnings(rates.missions)
    warnings = (*missions.doubts, *intervals, *of_few_looks(rates))
    return FinerRates(completed, finer["focal_px"], rates, warnings, tuple(missions.refused))


def _check_focal_lengths(focal_px: Sequence[float], least_px: float) -> None:
    finest, coarsest = max(focal_px), min(focal_px)
    if coarsest < least_px or finest > MOST_SPREAD * coarsest:
        raise ValueError(
            f"the cameras of these missions have focal lengths from {coarsest:.4g} to {finest:.4g} px; one "
            f"table is for cameras from {least_px:.4g} px on, the finest at most {MOST_SPREAD:g} times as "
            "fine as the coarsest"
        )
