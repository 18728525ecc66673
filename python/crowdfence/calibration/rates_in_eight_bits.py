"""What a model in eight bits is worth: measured anew, or said to be of the model in floating point.

Its contract is that of a model with another arithmetic, so what was measured of that one is not true of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from crowdfence.calibration.calibrate import of_few_looks, plan_for
from crowdfence.calibration.model_file import with_measured_rates
from crowdfence.detector.contract.contract import Contract
from crowdfence.evaluation.labelled_missions import (
    LabelledMission,
    LabelledMissions,
    MeasurementPlan,
    open_labelled,
)
from crowdfence.evaluation.labelled_pass import Heatmap, measure
from crowdfence.sources.recording import Frame

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector

ARITHMETIC = "arithmetic"
"""Key of a contract's `about`, and of what was measured: in which."""
EIGHT_BITS, FLOATING_POINT = "int8", "float32"
_SETTINGS = ("b_threshold", "coverage", "surface", "max_range_m")
"""Of a measurement plan, as rates state them."""


def in_eight_bits(contract: Contract) -> Contract:
    """The contract of a model in floating point for the same model in eight bits, nothing of which has been
    measured."""
    about, rates = dict(contract.about or {}), contract.rates
    if isinstance(about.get("photographs"), dict):
        about["photographs"] = {**about["photographs"], ARITHMETIC: FLOATING_POINT}
    return replace(
        contract,
        about={**about, ARITHMETIC: EIGHT_BITS},
        rates=None if rates is None else {**rates, ARITHMETIC: FLOATING_POINT},
    )


def stated_settings(contract: Contract) -> dict[str, Any]:
    """Of a measurement plan, what the rates of a contract were measured with."""
    stated = contract.rates or {}
    return {name: stated[name] for name in _SETTINGS if name in stated}


class OwnRates(NamedTuple):
    """Measured of a model in eight bits."""

    contract: Contract
    """Its own with these rates."""
    warnings: tuple[str, ...]
    """What is doubtful about the recordings and their maps, and what the intervals and the rates do not
    tell."""
    refused: tuple[str, ...]
    """Frames that were not used, and why."""


def with_own_rates(
    detector: Detector, data: Sequence[Path], plan: MeasurementPlan, on_frame: Callable[[], None]
) -> OwnRates:
    """The contract of a model in eight bits with rates of its own, measured as its contract says that those
    in floating point were.

    ValueError that says why it keeps those: no labels, no map, or fewer missions than they rest on.
    """
    contract, stated = detector.contract, detector.contract.rates or {}
    plan = plan_for(contract, replace(plan, **stated_settings(contract)))
    if all(open_labelled(path).terrain is None for path in data):
        raise ValueError("no recording comes with a map")
    missions = LabelledMissions(list(data), plan, on_frame)

    def heatmaps(mission: LabelledMission, frame: Frame) -> tuple[Heatmap]:
        return (mission.heatmap(detector, frame, plan.max_range_m),)

    measured = measure(missions, heatmaps, contract.output.stride)
    (rates,) = measured.rates
    if rates.missions < stated.get("missions", 0):
        raise ValueError(f"they rest on {stated['missions']} missions, --data has {rates.missions}")
    own = with_measured_rates(contract, rates, measured.settings)
    own = replace(own, rates={**(own.rates or {}), ARITHMETIC: EIGHT_BITS})
    intervals = missions.interval_warnings(measured.quality.overall.units)
    return OwnRates(own, (*missions.doubts, *intervals, *of_few_looks(rates)), tuple(missions.refused))
