"""What the views of a mission show, projected once: every method is then fed the same observations."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import crowdfence as cf
from crowdfence.config import ProjectionConfig
from crowdfence.detector.contract.contract import Contract
from crowdfence.evaluation.safety import EVERY_S, CrowdsInView, CrowdWatch
from crowdfence.pipeline.detect import HeatmapSource, heatmap_source
from crowdfence.truth.over_time import CrowdsOfTheWorld


class Moment(NamedTuple):
    """One instant."""

    stamp_ns: int
    observations: list[cf.Observation]
    crowd_ids: NDArray[np.int64]
    """Voxels that crowds stand on, seen or not."""
    in_view: CrowdsInView | None
    """Who stands where, once in `EVERY_S`."""


class Mission(NamedTuple):
    name: str
    terrain: cf.Terrain
    contract: Contract
    drones: int
    moments: list[Moment]


def seen(path: Path) -> Mission:
    """By the shipped detector. Kept beside the mission, so that a second reading takes seconds, until core or
    mission are made anew."""
    recording = cf.open_recording(path)
    terrain = cf.open_terrain(recording)
    detector = cf.Detector()
    kept = path.with_suffix(".seen")
    made_ns = max(Path(one).stat().st_mtime_ns for one in (cf._core.__file__, path))
    if kept.exists() and kept.stat().st_mtime_ns > made_ns:
        moments = pickle.loads(kept.read_bytes())
    else:
        heatmaps = heatmap_source(detector, terrain, ProjectionConfig().max_range_m)
        moments = list(moments_of(recording, terrain, heatmaps, detector.contract))
        kept.write_bytes(pickle.dumps(moments))
    return Mission(path.stem, terrain, detector.contract, len(recording.drones), moments)


def part_of(terrain: cf.Terrain, one: cf.Observation, some: NDArray[np.bool_]) -> cf.Observation:
    """Of a look, what it says of `some` [S] of its voxels."""
    return cf.Observation(
        terrain,
        one.drone,
        one.stamp_ns,
        voxel_ids=one.voxel_ids[some],
        mean=one.mean[some],
        pixel_count=one.pixel_count[some],
        range_m=one.range_m[some],
        tilt_deg=one.tilt_deg[some],
        occluded_ids=[],
        focal_px=one.focal_px,
    )


def moments_of(
    recording: cf.Recording, terrain: cf.Terrain, heatmaps: HeatmapSource, contract: Contract
) -> Iterator[Moment]:
    """What the views show, by whatever makes the heatmaps; `contract` says in which range a detector is
    judged."""
    config = cf.RunConfig(cf.OrConfig()).with_detector(contract)
    crowd_map = config.crowd_map(terrain, len(recording.drones))
    crowds = CrowdsOfTheWorld(recording, terrain)
    watch = CrowdWatch(recording, terrain, contract.validity)
    watched_ns = -np.inf
    instants = recording.instants(config.grouping.tolerance_ms)
    for instant, found in heatmaps.detected(instants, len(recording.drones)):
        update = crowd_map.integrate(found.views, instant.stamp_ns)
        watch.saw(update.observations)
        in_view = None
        if instant.stamp_ns - watched_ns >= EVERY_S * 1e9:
            watched_ns, in_view = instant.stamp_ns, watch.at(instant)
        crowd_ids = np.flatnonzero(crowds.at(instant))
        yield Moment(instant.stamp_ns, list(update.observations), crowd_ids, in_view)
