"""A recording with truth, replayed under several configurations and scored against that truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap, Terrain
from crowdfence.config import RunConfig
from crowdfence.evaluation.crowd_regions import crowd_regions
from crowdfence.evaluation.detector_rates import Confusion, confusion
from crowdfence.evaluation.iou import MeanIou
from crowdfence.evaluation.projected_truth import ProjectedTruth, TruthMap, project_truth
from crowdfence.evaluation.threshold_sweep import SweepResult, ThresholdSweep
from crowdfence.heatmap_source import RECORDED, HeatmapSource
from crowdfence.pipeline import check_overlap
from crowdfence.sources.recording import Frame, Instant, Recording

CLOSING_PX = 6.0
"""Radius in pixels with which silhouettes are merged where a recording holds no ready regions."""

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


def crowd_mask(frame: Frame) -> NDArray[np.bool_]:
    """True crowd pixels [H, W]: recorded regions, or silhouettes merged and filled. FrameError without."""
    if frame.pixels.regions is not None:
        return frame.regions() > 0
    return crowd_regions(frame.silhouettes(), closing_px=CLOSING_PX)


def has_truth(frame: Frame) -> bool:
    return frame.pixels.regions is not None or frame.pixels.silhouettes is not None


def measured_rates(
    recording: Recording,
    heatmaps: HeatmapSource = RECORDED,
    *,
    on_instant: Callable[[Instant], None] | None = None,
) -> Confusion:
    """Heatmap cells of all frames with truth, counted at threshold 0.5. ValueError when there are none."""
    _require_truth(recording, [frame for frame in recording.frames if has_truth(frame)])
    counts = Confusion(0, 0, 0, 0)
    with heatmaps.viewing(len(recording.drones)) as views_of:
        for instant in recording.instants():
            frames = {frame.drone: frame for frame in instant.frames if has_truth(frame)}
            labelled = [view for view in views_of(instant) if view.drone in frames]
            if labelled:
                masks = (crowd_mask(frames[view.drone]) for view in labelled)
                counts += confusion((view.heatmap for view in labelled), masks)
            if on_instant is not None:
                on_instant(instant)
    if counts.positives + counts.negatives == 0:
        raise ValueError(f"no frame of {recording.name} has truth and a usable heatmap")
    return counts


def score(
    recording: Recording,
    terrain: Terrain,
    configs: Sequence[RunConfig],
    heatmaps: HeatmapSource = RECORDED,
    *,
    on_instant: Callable[[Instant], None] | None = None,
) -> list[Score]:
    """Replay the recording once, feeding every configuration the same views, and score each.

    Truth is projected from the labelled frames of the instant, the last label seen is kept (the paper's). The
    configurations must agree on how views are projected and grouped; what they leave open is filled in from
    the detector's contract. ValueError when they do not, or when the recording holds no truth.
    """
    configs = [config.with_detector(heatmaps.contract) for config in configs]
    first = configs[0]
    if any(_projection(config) != _projection(first) for config in configs):
        raise ValueError("configurations that are scored together must project and group views alike")
    _require_truth(recording, [frame for frame in recording.frames if has_truth(frame)])
    check_overlap(recording, terrain, first.max_range_m)
    maps = [config.crowd_map(terrain, len(recording.drones)) for config in configs]
    chosen = [
        crowd_map.default_threshold() if config.threshold is None else config.threshold
        for crowd_map, config in zip(maps, configs, strict=True)
    ]
    sweeps = [ThresholdSweep([*THRESHOLDS, threshold]) for threshold in chosen]
    truth = TruthMap(terrain.voxel_count)
    with heatmaps.viewing(len(recording.drones)) as views_of:
        for instant in recording.instants(first.tolerance_ms):
            views = views_of(instant)
            update = maps[0].integrate(views, instant.stamp_ns)
            for crowd_map in maps[1:]:
                drones = [view.drone for view in views]
                crowd_map.integrate_observations(drones, update.observations, instant.stamp_ns)
            truth.update(_projected(instant, terrain, first))
            seen_ids = maps[0].seen_ids()
            crowd = truth.crowd[seen_ids]
            for crowd_map, sweep in zip(maps, sweeps, strict=True):
                sweep.update(crowd_map.probability(instant.stamp_ns, seen_ids), crowd)
            if on_instant is not None:
                on_instant(instant)
    return [_score(*parts) for parts in zip(configs, maps, chosen, sweeps, strict=True)]


def _score(config: RunConfig, crowd_map: CrowdMap, threshold: float, sweep: ThresholdSweep) -> Score:
    result = sweep.result()
    return Score(config, crowd_map, threshold, result.at(threshold), result)


def _projection(config: RunConfig) -> tuple[float, float, str, float]:
    return (config.max_range_m, config.used("target_height_m"), config.coverage, config.tolerance_ms)


def _projected(instant: Instant, terrain: Terrain, config: RunConfig) -> list[ProjectedTruth]:
    return [
        project_truth(
            crowd_mask(frame),
            frame.camera,
            frame.world_from_camera,
            terrain,
            max_range_m=config.max_range_m,
            target_height_m=config.used("target_height_m"),
            coverage=config.coverage,
        )
        for frame in instant.frames
        if has_truth(frame)
    ]


def _require_truth(recording: Recording, frames: Sequence[Frame]) -> None:
    if not frames:
        raise ValueError(
            f"{recording.name} holds no truth: no frame has crowd regions or a segmentation with crowd"
        )
