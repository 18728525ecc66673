"""The map panel of the picture: ground, zones, tracks, footprints, scale bar, north arrow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.exports.picture.drone_track import DroneTrack
from crowdfence.exports.picture.labels import write_labels
from crowdfence.exports.picture.line_style import INK, OTHERS_STYLE, ZONE_LINE, drone_line
from crowdfence.exports.picture.relief import Extent, ShadedGround
from crowdfence.exports.picture.scale_bar import draw_scale_bar, emptiest_corner
from crowdfence.zones import Zone, ZoneSet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patheffects import AbstractPathEffect


def draw_map(
    axes: Axes, ground: ShadedGround, extent: Extent, zones: ZoneSet, tracks: Sequence[DroneTrack]
) -> float | None:
    """Fill the panel; `ground` covers `extent` with one image pixel per screen pixel.

    Returns the height step between the contour lines, None when there are none.
    """
    sides = (extent.west, extent.east, extent.south, extent.north)
    axes.imshow(ground.image, extent=sides, interpolation="none", zorder=0)
    axes.set(xlim=sides[:2], ylim=sides[2:], aspect="auto")
    contour_step_m = _draw_contours(axes, ground, extent)
    _draw_graticule(axes)
    for number, track in enumerate(tracks):
        _draw_footprint(axes, track, drone_line(number))
    for zone in zones:
        _draw_outline(axes, zone, "-")
    for zone in zones.static:
        _draw_outline(axes, zone, OTHERS_STYLE)
    for number, track in enumerate(tracks):
        _draw_track(axes, track, drone_line(number))
    scale = draw_scale_bar(axes, extent, emptiest_corner(extent, _what_matters(zones, tracks)))
    write_labels(axes, zones, tracks, taken=[scale])
    return contour_step_m


def _halo(width: float) -> list[AbstractPathEffect]:
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=width, foreground="white", alpha=0.85)]


def _draw_graticule(axes: Axes) -> None:
    from matplotlib.ticker import MaxNLocator

    for axis, name in ((axes.xaxis, "east [m]"), (axes.yaxis, "north [m]")):
        axis.set_major_locator(MaxNLocator(7, steps=[1, 2, 5, 10]))
        axis.set_label_text(name, fontsize=10.5, color=INK)
    axes.grid(color="white", linewidth=0.6, alpha=0.35)
    axes.tick_params(labelsize=9.5, colors=INK, length=4)
    axes.ticklabel_format(useOffset=False, style="plain")
    for spine in axes.spines.values():
        spine.set(color=INK, linewidth=0.9)


def choose_contour_step_m(relief_m: float) -> float:
    """Smallest of 1, 2, 5 x 10^n metres that gives at most twelve contour lines; at least 1 m."""
    power = 10.0 ** np.floor(np.log10(max(relief_m / 12, 1.0)))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= relief_m / 12))


def _draw_contours(axes: Axes, ground: ShadedGround, extent: Extent) -> float | None:
    height_m = ground.height_m
    if np.isnan(height_m).all():
        return None
    low, high = np.nanmin(height_m), np.nanmax(height_m)
    step = choose_contour_step_m(high - low)
    levels = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    if levels.size == 0:
        return None
    rows, columns = height_m.shape
    x = extent.west + (np.arange(columns) + 0.5) * extent.width_m / columns
    y = extent.north - (np.arange(rows) + 0.5) * extent.height_m / rows
    axes.contour(x, y, height_m, levels=levels, colors=INK, linewidths=0.6, alpha=0.28, zorder=1)
    return step


def _draw_footprint(axes: Axes, track: DroneTrack, colour: str) -> None:
    if len(track.footprint) < 3:
        return
    x, y = np.vstack([track.footprint, track.footprint[:1]]).T
    axes.fill(x, y, color=colour, alpha=0.05, linewidth=0, zorder=2)
    axes.plot(x, y, color=colour, linewidth=1.3, linestyle=(0, (5, 3)), zorder=3, path_effects=_halo(2.6))


def _draw_outline(axes: Axes, zone: Zone, style: str) -> None:
    for ring in _rings(zone):
        axes.plot(*ring.T, style, color=ZONE_LINE, linewidth=1.2, zorder=4, path_effects=_halo(2.8))


def _what_matters(zones: ZoneSet, tracks: Sequence[DroneTrack]) -> NDArray[np.float64]:
    """Points [N, 2] that nothing should be drawn over."""
    rings = [ring for zone in zones for ring in _rings(zone)]
    return np.concatenate([np.empty((0, 2)), *rings, *(track.positions[:, :2] for track in tracks)])


def _rings(zone: Zone) -> list[NDArray[np.float64]]:
    polygons = getattr(zone.polygon, "geoms", [zone.polygon])
    return [
        np.asarray(ring.coords) for polygon in polygons for ring in (polygon.exterior, *polygon.interiors)
    ]


def _draw_track(axes: Axes, track: DroneTrack, colour: str) -> None:
    x, y = track.positions[:, 0], track.positions[:, 1]
    axes.plot(x, y, color=colour, linewidth=2.2, zorder=5, solid_capstyle="round", path_effects=_halo(4.2))
    axes.plot(x[:1], y[:1], "o", markersize=8, markerfacecolor="white", markeredgecolor=colour, zorder=6)
    axes.plot(
        x[-1:],
        y[-1:],
        marker=(3, 0, _heading_deg(track.positions)),
        markersize=13,
        color=colour,
        markeredgecolor="white",
        zorder=7,
    )


def _heading_deg(positions: NDArray[np.float64]) -> float:
    """Direction of the last movement, counter-clockwise from north; north for a drone that hovered."""
    offsets = positions[-1, :2] - positions[:, :2]
    moved = np.flatnonzero(np.linalg.norm(offsets, axis=1) > 1.0)
    if moved.size == 0:
        return 0.0
    east, north = offsets[moved[-1]]
    return float(np.degrees(np.arctan2(-east, north)))
