"""A recording with truth, replayed under several configurations and scored against that truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from crowdfence._core import CrowdMap, Terrain, View
from crowdfence.config import RunConfig
from crowdfence.evaluation.cells.rates import Confusion, confusion
from crowdfence.evaluation.iou import MeanIou
from crowdfence.evaluation.threshold_sweep import SweepResult, ThresholdSweep
from crowdfence.heatmap_source import RECORDED, HeatmapSource
from crowdfence.pipeline import check_overlap
from crowdfence.sources.recording import Instant, Recording
from crowdfence.truth.crowd_masks import crowd_mask, has_crowd_mask, require_crowd_masks
from crowdfence.truth.over_time import CrowdsOfTheWorld, ProjectedLabels, TruthOverTime

TruthKind = Literal["projected", "world"]
OnViews = Callable[[Instant, Sequence[View]], None]

THRESHOLDS = np.arange(0.01, 1.0, 0.01)


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """How well one configuration found the crowd."""

    config: RunConfig
    crowd_map: CrowdMap
    threshold: float
    iou: MeanIou
    """Equation 4 at `threshold`."""
    sweep: SweepResult


class CellCounter:
    """Heatmap cells of labelled frames, counted at threshold 0.5."""

    def __init__(self) -> None:
        self.counts = Confusion(0, 0, 0, 0)

    def add(self, instant: Instant, views: Sequence[View]) -> None:
        """The views of an instant; those of frames without a label do not count."""
        labelled = {frame.drone: frame for frame in instant.frames if has_crowd_mask(frame)}
        judged = [view for view in views if view.drone in labelled]
        if judged:
            masks = (crowd_mask(labelled[view.drone]) for view in judged)
            self.counts += confusion((view.heatmap for view in judged), masks)

    def counted(self) -> Confusion:
        """The counts; ValueError when there was no labelled frame with a usable heatmap."""
        if self.counts.positives + self.counts.negatives == 0:
            raise ValueError("no frame has both a crowd label and a usable heatmap")
        return self.counts


def measured_rates(
    recording: Recording,
    heatmaps: HeatmapSource = RECORDED,
    *,
    on_instant: OnViews | None = None,
) -> Confusion:
    """Heatmap cells of all labelled frames, counted at threshold 0.5. ValueError when there are none."""
    require_crowd_masks(recording)
    cells = CellCounter()
    with heatmaps.viewing(len(recording.drones)) as views_of:
        for instant in recording.instants():
            views = views_of(instant)
            cells.add(instant, views)
            if on_instant is not None:
                on_instant(instant, views)
    return cells.counted()


def score(
    recording: Recording,
    terrain: Terrain,
    configs: Sequence[RunConfig],
    heatmaps: HeatmapSource = RECORDED,
    *,
    truth: TruthKind = "projected",
    on_instant: OnViews | None = None,
) -> list[Score]:
    """Replay the recording once, feeding every configuration the same views, and score each.

    `truth` is "projected", the paper's (`ProjectedLabels`), or "world" (`CrowdsOfTheWorld`). The
    configurations must agree on how views are projected and grouped; what they leave open is filled in from
    the detector's contract. ValueError when they do not, or when the recording does not hold that truth.
    """
    configs = [config.with_detector(heatmaps.contract) for config in configs]
    first = configs[0]
    if any(_projection(config) != _projection(first) for config in configs):
        raise ValueError("configurations that are scored together must project and group views alike")
    crowds: TruthOverTime = (
        CrowdsOfTheWorld(recording, terrain)
        if truth == "world"
        else ProjectedLabels(
            recording,
            terrain,
            max_range_m=first.max_range_m,
            target_height_m=first.used("target_height_m"),
            coverage=first.coverage,
        )
    )
    check_overlap(recording, terrain, first.max_range_m)
    maps = [config.crowd_map(terrain, len(recording.drones)) for config in configs]
    chosen = [
        crowd_map.default_threshold() if config.threshold is None else config.threshold
        for crowd_map, config in zip(maps, configs, strict=True)
    ]
    sweeps = [ThresholdSweep([*THRESHOLDS, threshold]) for threshold in chosen]
    with heatmaps.viewing(len(recording.drones)) as views_of:
        for instant in recording.instants(first.tolerance_ms):
            views = views_of(instant)
            update = maps[0].integrate(views, instant.stamp_ns)
            for crowd_map in maps[1:]:
                drones = [view.drone for view in views]
                crowd_map.integrate_observations(drones, update.observations, instant.stamp_ns)
            seen_ids = maps[0].seen_ids()
            crowd = crowds.at(instant)[seen_ids]
            for crowd_map, sweep in zip(maps, sweeps, strict=True):
                sweep.update(crowd_map.probability(instant.stamp_ns, seen_ids), crowd)
            if on_instant is not None:
                on_instant(instant, views)
    return [_score(*parts) for parts in zip(configs, maps, chosen, sweeps, strict=True)]


def _score(config: RunConfig, crowd_map: CrowdMap, threshold: float, sweep: ThresholdSweep) -> Score:
    result = sweep.result()
    return Score(config, crowd_map, threshold, result.at(threshold), result)


def _projection(config: RunConfig) -> tuple[float, float, str, float]:
    return (config.max_range_m, config.used("target_height_m"), config.coverage, config.tolerance_ms)
