"""The frame loop: recording -> views of each instant -> crowd map, with one row of figures an instant."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap, Terrain, Update, View
from crowdfence.config import RunConfig
from crowdfence.exports.frames_csv import FrameRow
from crowdfence.sources.recording import Instant, Recording, RefusedFrame
from crowdfence.zones import count_regions


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One integrated instant."""

    instant: Instant
    views: list[View]
    update: Update
    crowd_ids: NDArray[np.int64]
    """Voxels at or above the threshold after the instant, sorted."""
    row: FrameRow


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A recording fused to the end."""

    recording: Recording
    terrain: Terrain
    config: RunConfig
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
    on_step: Callable[[Step], None] | None = None,
) -> Run:
    """Fuse a whole recording. `on_step` is told of every instant, for progress or scores.

    ValueError when the configuration is out of bounds, the cameras are nowhere near the terrain, or no view
    saw any of it. Frames that cannot be used are in `recording.refused`.
    """
    check_overlap(recording, terrain, config.max_range_m)
    crowd_map = config.crowd_map(terrain, len(recording.drones))
    threshold = crowd_map.default_threshold() if config.threshold is None else config.threshold
    rows: list[FrameRow] = []
    last_views: dict[str, View] = {}
    for step in steps(recording, crowd_map, threshold, config):
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
    return Run(recording, terrain, config, crowd_map, threshold, rows, last_views)


def steps(recording: Recording, crowd_map: CrowdMap, threshold: float, config: RunConfig) -> Iterator[Step]:
    """Integrate instant after instant. The figures of a row cost what was seen, not the map."""
    min_columns = math.ceil(config.min_area_m2 / crowd_map.terrain.voxel_size_m**2)
    for instant in recording.instants(config.tolerance_ms):
        views = instant.views()
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
