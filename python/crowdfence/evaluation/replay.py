"""A recording with truth, replayed under several configurations and scored against that truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from crowdfence._core import CrowdMass, Terrain
from crowdfence.config import RunConfig
from crowdfence.evaluation.cells.rates import Confusion, confusion
from crowdfence.evaluation.iou import MeanIou
from crowdfence.evaluation.threshold_sweep import SweepResult, ThresholdSweep
from crowdfence.pipeline.detect import RECORDED, HeatmapSource
from crowdfence.pipeline.frame_loop import FrameLoop
from crowdfence.pipeline.terrain import check_overlap
from crowdfence.sources.recording import Instant, InstantViews, Recording, RefusedFrame
from crowdfence.truth.crowd_masks import crowd_mask, has_crowd_mask, require_crowd_masks
from crowdfence.truth.over_time import CrowdsOfTheWorld, ProjectedLabels, TruthOverTime

TruthKind = Literal["projected", "world"]
OnInstant = Callable[[Instant, InstantViews], None]

THRESHOLDS = np.arange(0.01, 1.0, 0.01)


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """How well one configuration found the crowd."""

    config: RunConfig
    threshold: float
    iou: MeanIou
    """Equation 4 at `threshold`."""
    sweep: SweepResult


class Scores(NamedTuple):
    """What a replay found: `rows, refused, crowd_mass = score(...)`."""

    rows: list[Score]
    """One per configuration, in their order."""
    refused: tuple[RefusedFrame, ...]
    """Frames that took no part."""
    crowd_mass: dict[str, CrowdMass]
    """Where the crowd in the pictures of each drone went, under the first configuration."""


class CellCounter:
    """Heatmap cells of labelled frames, counted at threshold 0.5."""

    def __init__(self) -> None:
        self.counts = Confusion(0, 0, 0, 0)

    def add(self, instant: Instant, found: InstantViews) -> None:
        """The views of an instant; those of frames without a label do not count."""
        labelled = {frame.drone: frame for frame in instant.frames if has_crowd_mask(frame)}
        judged = [view for view in found.views if view.drone in labelled]
        if judged:
            masks = (crowd_mask(labelled[view.drone]) for view in judged)
            self.counts += confusion((view.heatmap for view in judged), masks)

    def counted(self) -> Confusion:
        """The counts; ValueError when there was no labelled frame with a usable heatmap."""
        if self.counts.positives + self.counts.negatives == 0:
            raise ValueError("no frame has both a crowd label and a usable heatmap")
        return self.counts


def measured_rates(
    recording: Recording, heatmaps: HeatmapSource = RECORDED, *, on_instant: OnInstant | None = None
) -> Confusion:
    """Heatmap cells of all labelled frames, counted at threshold 0.5. ValueError when there are none."""
    require_crowd_masks(recording)
    cells = CellCounter()
    with heatmaps.detecting(len(recording.drones)) as detect:
        for instant in recording.instants():
            found = detect(instant)
            cells.add(instant, found)
            if on_instant is not None:
                on_instant(instant, found)
    return cells.counted()


def score(
    recording: Recording,
    terrain: Terrain,
    configs: Sequence[RunConfig],
    heatmaps: HeatmapSource = RECORDED,
    *,
    truth: TruthKind = "projected",
    on_instant: OnInstant | None = None,
) -> Scores:
    """Replay the recording once, feeding every configuration the same views, and score each.

    `truth` is "projected", the paper's (`ProjectedLabels`), or "world" (`CrowdsOfTheWorld`). The
    configurations must agree on how views are projected and grouped; what they leave open is filled in from
    the detector's contract. ValueError when they do not, or when the recording does not hold that truth.
    """
    configs = [config.with_detector(heatmaps.contract) for config in configs]
    first = configs[0]
    if any((config.projection, config.grouping) != (first.projection, first.grouping) for config in configs):
        raise ValueError("configurations that are scored together must project and group views alike")
    crowds = _truth(truth, recording, terrain, first)
    check_overlap(recording, terrain, first.projection.max_range_m)
    drones = len(recording.drones)
    loops = [FrameLoop(config.crowd_map(terrain, drones), config.zones) for config in configs]
    sweeps = [ThresholdSweep([*THRESHOLDS, loop.threshold]) for loop in loops]
    refused = list(recording.refused)
    with heatmaps.detecting(drones) as detect:
        for instant in recording.instants(first.grouping.tolerance_ms):
            found = detect(instant)
            # Views are projected once; the other maps take the observations.
            update = loops[0].integrate(found.views, instant.stamp_ns)
            for loop in loops[1:]:
                loop.integrate_observed(update.observations, instant.stamp_ns)
            crowd = crowds.at(instant)
            for loop, sweep in zip(loops, sweeps, strict=True):
                seen_ids, probability = loop.crowd_map.seen_probability(instant.stamp_ns)
                sweep.update(probability, crowd[seen_ids])
            refused += found.refused
            if on_instant is not None:
                on_instant(instant, found)
    rows = [_score(*parts) for parts in zip(configs, loops, sweeps, strict=True)]
    return Scores(rows, tuple(refused), loops[0].crowd_mass)


def _truth(kind: TruthKind, recording: Recording, terrain: Terrain, config: RunConfig) -> TruthOverTime:
    if kind == "world":
        return CrowdsOfTheWorld(recording, terrain)
    projection = config.projection.with_detector(None)
    assert projection.target_height_m is not None
    return ProjectedLabels(
        recording,
        terrain,
        max_range_m=projection.max_range_m,
        target_height_m=projection.target_height_m,
        coverage=projection.coverage,
        surface=projection.surface,
    )


def _score(config: RunConfig, loop: FrameLoop, sweep: ThresholdSweep) -> Score:
    result = sweep.result()
    return Score(config, loop.threshold, result.at(loop.threshold), result)
