"""Crop and layout of the picture: map on the left, legend on the right, title above."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import atomic_path
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.picture.drone_track import DroneTrack
from crowdfence.exports.picture.legend import draw_legend, draw_origin, draw_title
from crowdfence.exports.picture.map_panel import draw_map
from crowdfence.exports.picture.relief import Extent, shaded_ground
from crowdfence.georeference import Georeference
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.voxel_state import VoxelState
from crowdfence.zones import Zone, ZoneSet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 100
_TITLE_PX, _AXIS_PX, _LEFT_PX, _LEGEND_PX, _GAP_PX = 92, 62, 78, 330, 26
_LOWEST_ASPECT, _HIGHEST_ASPECT = 0.68, 1.05
_MARGIN = 0.06
_OUTLIERS = 4.0
"""Percent of the seen cells on every side that do not widen the picture: sparse voxels on far ridges."""


def write_picture(
    path: str | PathLike[str],
    grid: SurfaceGrid,
    zones: ZoneSet,
    description: MapDescription,
    *,
    tracks: Sequence[DroneTrack] = (),
    georeference: Georeference | None = None,
    width_px: int = 1600,
) -> None:
    """Write a PNG `width_px` wide, cropped to what was seen, flown, found and closed around crowds.

    Build the grid with a margin (`SurfaceGrid.from_crowd_map(..., margin_m=60)`), or the ground around what
    was seen stays blank. Raises ValueError for a width below 900 pixels, OSError when the file cannot be
    written.
    """
    if width_px < 900:
        raise ValueError(f"width_px must be at least 900 to hold map and legend, got {width_px}")
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    # The caller's own matplotlib settings must not change the picture.
    with matplotlib.rc_context(), atomic_path(path) as temporary:
        matplotlib.rcdefaults()
        figure = _compose(grid, zones, description, tracks, georeference, width_px)
        FigureCanvasAgg(figure).print_figure(
            temporary, format="png", dpi=_DPI, metadata=_metadata(description)
        )


def _metadata(description: MapDescription) -> dict[str, str]:
    return {"Software": "crowdfence", "Description": f"crowd map at {description.stamp_ns} ns"}


def _compose(
    grid: SurfaceGrid,
    zones: ZoneSet,
    description: MapDescription,
    tracks: Sequence[DroneTrack],
    georeference: Georeference | None,
    width_px: int,
) -> Figure:
    from matplotlib.figure import Figure

    map_width_px = width_px - _LEFT_PX - _LEGEND_PX - 2 * _GAP_PX
    extent = interesting_extent(grid, tracks, zones)
    ground = shaded_ground(grid, description.threshold, extent, map_width_px)
    map_height_px = ground.image.shape[0]
    height_px = map_height_px + _TITLE_PX + _AXIS_PX
    figure = Figure(figsize=(width_px / _DPI, height_px / _DPI), dpi=_DPI, facecolor="white")

    def axes_px(left: int, bottom: int, width: int, height: int) -> tuple[float, float, float, float]:
        return (left / width_px, bottom / height_px, width / width_px, height / height_px)

    map_axes = figure.add_axes(axes_px(_LEFT_PX, _AXIS_PX, map_width_px, map_height_px))
    contour_step = draw_map(map_axes, ground, extent, zones, tracks)
    legend_left = width_px - _GAP_PX - _LEGEND_PX
    legend_axes = figure.add_axes(axes_px(legend_left, _AXIS_PX, _LEGEND_PX, map_height_px))
    draw_legend(legend_axes, grid, zones, description, tracks, contour_step, extent)
    draw_origin(legend_axes, georeference)
    title_axes = figure.add_axes(
        axes_px(_LEFT_PX, _AXIS_PX + map_height_px, width_px - _LEFT_PX - _GAP_PX, _TITLE_PX)
    )
    draw_title(title_axes, description)
    return figure


def interesting_extent(grid: SurfaceGrid, tracks: Sequence[DroneTrack], zones: Sequence[Zone] = ()) -> Extent:
    """Rectangle around most of the seen ground, every crowd cell, the tracks and the zones given: those of
    crowd close ground that holds no crowd cell, what is forgotten and safety distances."""
    corners = [_seen_corners(grid), *_crowd_corners(grid)]
    corners += [track.positions[:, :2] for track in tracks]
    corners += [np.reshape(zone.polygon.bounds, (2, 2)) for zone in zones]
    points = np.concatenate(corners)
    low, high = points.min(axis=0), points.max(axis=0)
    margin = max(_MARGIN * float((high - low).max()), 2 * grid.cell_size_m)
    return _with_aspect(low - margin, high + margin)


def _seen_corners(grid: SurfaceGrid) -> NDArray[np.float64]:
    cells = np.argwhere(grid.seen)
    if len(cells) == 0:
        west, south, east, north = grid.bounds_m
        return np.array([(west, south), (east, north)])
    low, high = np.percentile(cells, [_OUTLIERS, 100 - _OUTLIERS], axis=0).astype(np.int64)
    return _cell_corners(grid, low, high)


def _crowd_corners(grid: SurfaceGrid) -> list[NDArray[np.float64]]:
    cells = np.argwhere(grid.state == VoxelState.CROWD)
    return [_cell_corners(grid, cells.min(axis=0), cells.max(axis=0))] if len(cells) else []


def _cell_corners(grid: SurfaceGrid, low: NDArray[np.int64], high: NDArray[np.int64]) -> NDArray[np.float64]:
    east, north = grid.east_edges_m, grid.north_edges_m
    return np.array([(east[low[0]], north[low[1]]), (east[high[0] + 1], north[high[1] + 1])])


def _with_aspect(low: NDArray[np.float64], high: NDArray[np.float64]) -> Extent:
    """Grow the shorter side, so that the picture is neither a ribbon nor a tower."""
    width, height = high - low
    middle = (low + high) / 2
    height = max(height, width * _LOWEST_ASPECT)
    width = max(width, height / _HIGHEST_ASPECT)
    half = np.array([width, height]) / 2
    return Extent(*(float(value) for value in (*(middle - half), *(middle + half))))
