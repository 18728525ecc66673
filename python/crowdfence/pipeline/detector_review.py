"""What a model states about itself beside this flight, looked at before the first frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from crowdfence._core import Terrain
from crowdfence.config import EvidenceConfig, RunConfig
from crowdfence.config.comparison import LogPoolConfig, MovingAverageConfig
from crowdfence.pipeline.detect import HeatmapSource
from crowdfence.sources.layers import CROWD, LANDING_SITE
from crowdfence.sources.recording import Recording
from crowdfence.truth.frame_labels import TARGET_HEIGHT_M

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract
    from crowdfence.detector.validity import RangeCheck


@dataclass(frozen=True, slots=True)
class DetectorReview:
    """The outcome of `review_detector`."""

    ranges: list[RangeCheck]
    """Empty when the flight sees no ground."""
    warnings: list[str]


def review_detector(
    heatmaps: HeatmapSource, recording: Recording, terrain: Terrain, *configs: RunConfig
) -> DetectorReview | None:
    """The contract of the model against the flight and the configurations, before what they leave open is
    filled in; they project views alike. None where no model makes the heatmaps. ValueError for a model that
    finds people where the layer is of another class."""
    if heatmaps.contract is None:
        return None
    for contract in (heatmaps.contract, *(member.contract for member in heatmaps.members)):
        _require_no_crowd(contract, recording.layer)
    of_flight = review_flight(heatmaps, recording, terrain, configs[0].projection.max_range_m)
    warnings = review_statement(heatmaps.contract, recording.layer, terrain, *configs)
    return DetectorReview(of_flight.ranges, list(dict.fromkeys([*warnings, *of_flight.warnings])))


def review_flight(
    heatmaps: HeatmapSource, recording: Recording, terrain: Terrain | None, max_range_m: float
) -> DetectorReview:
    """The contract of the model, which there must be, against the flight alone. Without `terrain` nobody
    knows how far away its ground is."""
    from crowdfence.detector.validity import check_ranges, sample_flight

    assert heatmaps.contract is not None
    ranges, median_m = [], None
    if terrain is not None:
        flight = sample_flight(recording.frames, terrain, max_range_m=max_range_m)
        ranges = check_ranges(heatmaps.contract, flight)
        median_m = float(np.median(flight.gsd_m)) if ranges else None
    sizes = {(frame.camera.width, frame.camera.height) for frame in recording.frames}
    outside = (warning for check in ranges for warning in check.warnings(heatmaps.contract.name))
    return DetectorReview(ranges, [*heatmaps.shrunk(sizes, median_m), *outside])


def review_statement(contract: Contract, layer: str, terrain: Terrain, *configs: RunConfig) -> list[str]:
    """What can be said before there is a flight: the contract against map and configurations."""
    from crowdfence.detector.validity import height_warning, statement_warnings

    warnings = [
        warning
        for config in configs
        for warning in statement_warnings(
            contract,
            voxel_size_m=terrain.voxel_size_m,
            b_threshold=config.method.b_threshold,
            coverage=config.projection.coverage,
            surface=config.projection.surface,
            rates_given=config.method.rates_given,
            weighed_as=_weighed_as(config, layer),
        )
    ]
    goes_by_contract = any(config.projection.target_height_m is None for config in configs)
    if layer == CROWD and goes_by_contract and (too_high := height_warning(contract)):
        warnings.append(too_high)
    return warnings


def _require_no_crowd(contract: Contract, layer: str) -> None:
    """Crowds taken for another class are worst where that is landing ground: sites would be where they stand.
    A model that was trained on crowds says what of them it marks, whatever its file is called; one that
    counts people may count few enough to find the class of some other layer."""
    finds_crowds = (contract.about or {}).get("marks") in TARGET_HEIGHT_M
    counts_people = layer == LANDING_SITE and contract.output.rule is not None
    if layer != CROWD and (finds_crowds or counts_people):
        raise ValueError(
            f"the detector {contract.name} finds {'crowds' if finds_crowds else 'people'}, not the layer "
            f"{layer!r}: name a model of that class, or take the recorded heatmaps with --detector recorded"
        )


def _weighed_as(config: RunConfig, layer: str) -> str | None:
    """Whose likelihood ratios count where a contract states none; None for methods that go by the rates."""
    if not isinstance(config.method, (EvidenceConfig, LogPoolConfig, MovingAverageConfig)):
        return None
    return "the shipped crowdnet-s" if layer == CROWD else f"layers of {layer} are by default"
