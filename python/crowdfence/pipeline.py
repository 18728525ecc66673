"""The frame loop: recording -> heatmaps -> views of each instant -> crowd map, with a row of figures each."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap, Terrain, Update, View
from crowdfence.config import RunConfig
from crowdfence.exports.frames_csv import FrameRow
from crowdfence.heatmap_source import HeatmapFunction, HeatmapSource, heatmap_source
from crowdfence.sources.recording import Instant, Recording, RefusedFrame
from crowdfence.zones import count_regions

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector
    from crowdfence.detector.validity import RangeCheck


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One integrated instant."""

    instant: Instant
    views: list[View]
    update: Update
    crowd_ids: NDArray[np.int64]
    """Voxels at or above the threshold after the instant, sorted."""
    row: FrameRow


@dataclass(frozen=True, slots=True)
class DetectorReview:
    """What a model states about itself beside this flight."""

    ranges: list[RangeCheck]
    """Empty when the flight sees no ground."""
    warnings: list[str]


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A recording fused to the end."""

    recording: Recording
    terrain: Terrain
    config: RunConfig
    """Complete: what was left to the detector is filled in."""
    heatmaps: HeatmapSource
    review: DetectorReview | None
    """None where no model made the heatmaps."""
    crowd_map: CrowdMap
    threshold: float
    rows: list[FrameRow]
    last_views: dict[str, View]
    """Newest view of each drone."""

    @property
    def stamp_ns(self) -> int:
        """The last instant."""
        return int(self.crowd_map.stamps_ns[-1])


def open_terrain(recording: Recording, path: Path | None, **options: Any) -> Terrain:
    """The map to project onto: `path`, or else the one that came with the recording.

    Georeferenced maps are brought into the recording's local frame; `options` are those of
    `maps.open_terrain`. ValueError when there is no map or an option does not belong to its kind.
    """
    chosen = path or recording.terrain
    if chosen is None:
        raise ValueError(f"{recording.name} comes without a map; give one with --terrain")
    try:
        return Terrain.open(chosen, georeference=recording.georeference, **options)
    except TypeError as error:
        raise ValueError(f"{chosen}: {error}") from error


def run(
    recording: Recording,
    terrain: Terrain,
    config: RunConfig,
    *,
    detector: Detector | HeatmapFunction | None = None,
    on_step: Callable[[Step], None] | None = None,
) -> Run:
    """Fuse a whole recording. `on_step` is told of every instant, for progress or scores.

    `detector` makes the heatmaps: a `Detector` from the pictures, or any function frame -> heatmap [h, w];
    None takes the recorded ones. What `config` leaves open is filled in from a model's contract.

    ValueError when the configuration is out of bounds, the cameras are nowhere near the terrain, or no view
    saw any of it. Frames that cannot be used are in `recording.refused`.
    """
    check_overlap(recording, terrain, config.max_range_m)
    heatmaps = heatmap_source(detector, terrain, config.max_range_m)
    review = review_detector(heatmaps, recording, terrain, config)
    config = config.with_detector(heatmaps.contract)
    crowd_map = config.crowd_map(terrain, len(recording.drones))
    threshold = crowd_map.default_threshold() if config.threshold is None else config.threshold
    rows: list[FrameRow] = []
    last_views: dict[str, View] = {}
    for step in steps(recording, crowd_map, threshold, config, heatmaps):
        rows.append(step.row)
        last_views.update({view.drone: view for view in step.views})
        if on_step is not None:
            on_step(step)
    if not rows:
        raise ValueError(f"no frame of {recording.name} can be used{_first_reason(recording.refused)}")
    if rows[-1].voxels_seen_so_far == 0:
        raise ValueError(
            f"no view saw the terrain within max_range_m = {config.max_range_m:g} m: "
            "do map and poses share one frame?"
        )
    return Run(recording, terrain, config, heatmaps, review, crowd_map, threshold, rows, last_views)


def steps(
    recording: Recording,
    crowd_map: CrowdMap,
    threshold: float,
    config: RunConfig,
    heatmaps: HeatmapSource,
) -> Iterator[Step]:
    """Integrate instant after instant. The figures of a row cost what was seen, not the map."""
    min_columns = math.ceil(config.min_area_m2 / crowd_map.terrain.voxel_size_m**2)
    with heatmaps.viewing(len(recording.drones)) as views_of:
        for instant in recording.instants(config.tolerance_ms):
            views = views_of(instant)
            update = crowd_map.integrate(views, instant.stamp_ns)
            seen_ids = crowd_map.seen_ids()
            crowd_ids = seen_ids[crowd_map.probability(instant.stamp_ns, seen_ids) >= threshold]
            columns = np.unique(crowd_map.terrain.voxel_indices(crowd_ids)[:, :2], axis=0)
            row = FrameRow(
                stamp_ns=instant.stamp_ns,
                drones=tuple(view.drone for view in views),
                frames_refused=len(instant.frames) - len(views),
                voxels_seen=len(update.voxel_ids),
                voxels_seen_so_far=len(seen_ids),
                crowd_voxels=len(crowd_ids),
                crowd_area_m2=len(columns) * crowd_map.terrain.voxel_size_m**2,
                zones=count_regions(columns, min_columns=min_columns),
            )
            yield Step(instant, views, update, crowd_ids, row)


def review_detector(
    heatmaps: HeatmapSource, recording: Recording, terrain: Terrain, config: RunConfig
) -> DetectorReview | None:
    """The contract of the model against the flight and `config`, before what it leaves open is filled in.
    None where no model makes the heatmaps."""
    if heatmaps.contract is None:
        return None
    from crowdfence.detector.validity import check_ranges, sample_flight, statement_warnings

    flight = sample_flight(recording.frames, terrain, max_range_m=config.max_range_m)
    ranges = check_ranges(heatmaps.contract, flight)
    given = config.true_positive_rate is not None and config.false_positive_rate is not None
    warnings = statement_warnings(
        heatmaps.contract,
        voxel_size_m=terrain.voxel_size_m,
        b_threshold=config.b_threshold,
        coverage=config.coverage,
        rates_given=given or config.method == "or",
    )
    for check in ranges:
        warnings += check.warnings(heatmaps.contract.name)
    return DetectorReview(ranges, warnings)


def check_overlap(recording: Recording, terrain: Terrain, max_range_m: float) -> None:
    """ValueError when no camera of the recording comes within range of the terrain's bounding box."""
    if not recording.frames:
        return
    cameras = np.array([frame.world_from_camera[:3, 3] for frame in recording.frames])
    low, high = terrain.bounds
    distance_m = np.linalg.norm(cameras - np.clip(cameras, low, high), axis=1)
    if distance_m.min() > max_range_m:
        raise ValueError(
            f"terrain and poses do not overlap: the nearest camera is {distance_m.min():.0f} m away from the "
            f"terrain, max_range_m is {max_range_m:g}. The terrain spans {_box(low, high)}, the cameras "
            f"{_box(cameras.min(axis=0), cameras.max(axis=0))} (local metres)"
        )


def _box(low: NDArray[np.float64], high: NDArray[np.float64]) -> str:
    spans = (f"{axis} {a:.0f} to {b:.0f}" for axis, a, b in zip("xyz", low, high, strict=True))
    return ", ".join(spans)


def _first_reason(refused: list[RefusedFrame]) -> str:
    return f"; the first of {len(refused)} refusals: {refused[0]}" if refused else ""
