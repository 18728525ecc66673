"""The map of a contact sheet: relief, flights, footprints of one instant, people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.exports.drawn_name import drawn
from crowdfence.exports.picture.footprint import ground_footprint
from crowdfence.exports.picture.line_style import INK, drone_line
from crowdfence.exports.picture.relief import OFF_MAP, Extent
from crowdfence.sources.recorded_truth import RecordedPeople
from crowdfence.sources.recording import Frame, Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from crowdfence._core import Terrain

FOOTPRINT_RANGE_M = 150.0
_NO_HEATMAP = np.zeros((1, 1), dtype=np.uint8)
_MARGIN = 0.06
_LIGHT_FROM = np.array([-1.0, 1.0, 1.4])  # north-west, the convention of printed maps
_SMOOTHING_VOXELS = 3.0
_LOW, _HIGH = np.array([196.0, 208.0, 178.0]), np.array([236.0, 228.0, 208.0])
_CROWD, _ALONE = "#c81e3a", "#4b5563"


def footprints(frames: Sequence[Frame], terrain: Terrain | None) -> list[NDArray[np.float64]]:
    """Outlines [M, 2] of the ground that the frames show."""
    if terrain is None:
        return [np.empty((0, 2)) for _ in frames]
    return [
        ground_footprint(replace(frame, mask=None).view(_NO_HEATMAP), terrain, FOOTPRINT_RANGE_M)
        for frame in frames
    ]


def panel_extent(
    recording: Recording, outlines: Sequence[NDArray[np.float64]], aspect: float
) -> Extent | None:
    """Rectangle of `aspect` (height / width) around flights and footprints; None when there are none."""
    tracks = [track.positions[:, :2] for track in recording.tracks().values()]
    points = np.concatenate([np.empty((0, 2)), *tracks, *outlines])
    if len(points) == 0:
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = np.maximum(high - low, 10.0) * (1 + 2 * _MARGIN)
    width, height = max(width, height / aspect), max(height, width * aspect)
    x, y = (low + high) / 2
    return Extent(*(float(v) for v in (x - width / 2, y - height / 2, x + width / 2, y + height / 2)))


def draw_ground_panel(
    axes: Axes,
    recording: Recording,
    terrain: Terrain | None,
    extent: Extent,
    frames: Sequence[Frame],
    outlines: Sequence[NDArray[np.float64]],
    people: RecordedPeople | None,
    width_px: int,
) -> None:
    """Fill the panel; `outlines` belong to `frames`."""
    sides = (extent.west, extent.east, extent.south, extent.north)
    if terrain is not None:
        axes.imshow(_relief(terrain, extent, width_px), extent=sides, interpolation="bilinear", zorder=0)
    axes.set(xlim=sides[:2], ylim=sides[2:], aspect="auto")
    for number, drone in enumerate(recording.drones):
        _draw_flight(axes, recording, drone, drone_line(number))
    for frame, outline in zip(frames, outlines, strict=True):
        _draw_footprint(axes, outline, drone_line(recording.drones.index(frame.drone)))
        at = frame.world_from_camera[:2, 3]
        colour = drone_line(recording.drones.index(frame.drone))
        axes.plot(*at, marker="o", markersize=6, color=colour, markeredgecolor="white", zorder=6)
    if people is not None:
        _draw_people(axes, people)
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.tick_params(labelsize=9, colors=INK)
    axes.set_xlabel("east [m]", fontsize=10, color=INK)
    axes.set_ylabel("north [m]", fontsize=10, color=INK)


def _draw_flight(axes: Axes, recording: Recording, drone: str, colour: str) -> None:
    track = recording.tracks().get(drone)
    if track is not None and len(track):
        axes.plot(*track.positions[:, :2].T, color=colour, linewidth=1.4, zorder=4, label=drawn(drone))


def _draw_footprint(axes: Axes, outline: NDArray[np.float64], colour: str) -> None:
    if len(outline) >= 3:
        x, y = np.vstack([outline, outline[:1]]).T
        axes.fill(x, y, color=colour, alpha=0.12, linewidth=0, zorder=2)
        axes.plot(x, y, color=colour, linewidth=1.0, linestyle=(0, (4, 2)), zorder=3)


def _draw_people(axes: Axes, people: RecordedPeople) -> None:
    for chosen, colour, size, name in (
        (people.crowd == 0, _ALONE, 12.0, "person in no crowd"),
        (people.crowd > 0, _CROWD, 9.0, "person in a crowd"),
    ):
        if chosen.any():
            x, y = people.position[chosen, :2].T
            axes.scatter(x, y, s=size, c=colour, edgecolors="white", linewidths=0.3, zorder=5, label=name)


def _relief(terrain: Terrain, extent: Extent, width_px: int) -> NDArray[np.uint8]:
    """Shaded relief of the highest voxels [H, W, 3], row 0 = north."""
    from scipy.ndimage import gaussian_filter

    step_m = extent.width_m / width_px
    x = extent.west + (np.arange(width_px) + 0.5) * step_m
    y = extent.north - (np.arange(max(2, round(extent.height_m / step_m))) + 0.5) * step_m
    columns, rows = np.meshgrid(x, y)
    above = float(terrain.bounds[1, 2]) + 1.0
    origins = np.column_stack([columns.ravel(), rows.ravel(), np.full(columns.size, above)])
    depth = above - float(terrain.bounds[0, 2]) + 1.0
    _, distance = terrain.raycast(origins, np.tile([0.0, 0.0, -1.0], (columns.size, 1)), depth)
    height = (above - distance).reshape(columns.shape)
    on_map = np.isfinite(height)
    if not on_map.any():
        return np.broadcast_to(OFF_MAP, (*columns.shape, 3))
    # Voxels are steps: without smoothing every step would be a cliff.
    smooth_px = max(1.0, _SMOOTHING_VOXELS * terrain.voxel_size_m / step_m)
    filled = gaussian_filter(np.where(on_map, height, height[on_map].mean()), smooth_px)
    south, east = np.gradient(filled, step_m)
    normal = np.stack([-east, south, np.ones_like(filled)], axis=-1)
    light = normal @ _LIGHT_FROM / np.linalg.norm(normal, axis=-1) / np.linalg.norm(_LIGHT_FROM)
    low, high = np.percentile(filled[on_map], [2, 98])
    share = np.clip((filled - low) / max(high - low, 1.0), 0.0, 1.0)[..., None]
    level = _LIGHT_FROM[2] / np.linalg.norm(_LIGHT_FROM)
    lit = (_LOW + share * (_HIGH - _LOW)) * np.clip(1.0 + 0.9 * (light - level), 0.45, 1.15)[..., None]
    lit[~on_map] = OFF_MAP
    return lit.round().clip(0, 255).astype(np.uint8)
