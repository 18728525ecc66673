"""A way round zones as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import atomic_path
from crowdfence.exports.colours import STATE_COLOURS
from crowdfence.exports.drawn_name import drawn
from crowdfence.exports.state_raster import StateRaster
from crowdfence.voxel_state import VoxelState
from crowdfence.zones import Zone

_COLOURS = {"crowd": "#b40826", "unseen": "#9a9a9a", "static": "#1e5ab4"}
_NAMES = {"crowd": "crowd", "unseen": "not known to be empty", "static": "closed by others"}
_GROUND_NAMES = {
    VoxelState.EMPTY: "seen empty",
    VoxelState.STALE: "seen empty too long ago",
    VoxelState.NOT_CLEARED: "looked at, not cleared",
    VoxelState.OCCLUDED: "hidden",
    VoxelState.NEVER_SEEN: "never seen",
}
"""Crowd is in its zones."""
_GROUND_STRENGTH = 0.6
"""How strong its colours are, of 1."""
_INCHES = 8.0
_MARGIN = 0.15
"""Of the way's extent, around it."""
_FLATTEST = 0.5
"""Height of a picture over its width, and the other way round, at the least."""


def write_route_picture(
    path: str | PathLike[str],
    route: Any,
    zones: Sequence[Zone],
    clearance_m: float,
    states: StateRaster | None = None,
) -> None:
    """The way, the zones near it and what is kept clear around them, north up, in local metres, on what is
    known of the ground. `route` has `waypoints` [N, 2] and lengths. OSError when the file cannot be
    written."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    way = route.waypoints
    low, high = _extent(way)
    figure = Figure(figsize=tuple(_INCHES * (high - low) / (high - low).max()), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    ground = [] if states is None else _draw_ground(axes, states, low, high)
    for kind in ("unseen", "static", "crowd"):
        members = [zone for zone in zones if zone.kind == kind]
        _draw_zones(axes, members, kind, clearance_m)
    axes.plot(*way[[0, -1]].T, color="#666666", linestyle=":", linewidth=1.2, label="as the crow flies")
    axes.plot(*way.T, color="#0b7a3b", linewidth=2.2, label=f"way, {route.length_m:.0f} m")
    axes.plot(*way[1:-1].T, "o", color="#0b7a3b", markersize=4)
    for name, place in (("start", way[0]), ("goal", way[-1])):
        axes.plot(*place, "o", color="#0b7a3b", markersize=8, markeredgecolor="white", zorder=4)
        axes.annotate(name, place, xytext=(-10, -16), textcoords="offset points")
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    axes.grid(color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    ways, _ = axes.get_legend_handles_labels()
    axes.legend(handles=[*ways, *ground], loc="upper left", framealpha=0.95)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")


def _extent(way: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """South-west and north-east corner of what is drawn [2] of a way [N, 2], m."""
    low, high = way.min(axis=0), way.max(axis=0)
    largest = max(float((high - low).max()), 10.0)
    reach = np.maximum((high - low) / 2, _FLATTEST * largest / 2) + _MARGIN * largest
    middle = (low + high) / 2
    return middle - reach, middle + reach


def _draw_ground(
    axes: Any, states: StateRaster, low: NDArray[np.float64], high: NDArray[np.float64]
) -> list[Any]:
    """The states between two corners, pale, for zones and way lie on them; what the legend says of them."""
    from matplotlib.patches import Patch

    table = np.array([STATE_COLOURS[state] for state in VoxelState], dtype=np.float64) / 255
    pale = 1.0 - _GROUND_STRENGTH * (1.0 - table)
    affine, (rows, columns) = states.local_from_cells, states.state.shape
    (west, north), (east, south) = affine @ (0, 0), affine @ (columns, rows)
    # Beyond the raster nobody looked.
    axes.set_facecolor(pale[VoxelState.NEVER_SEEN])
    axes.imshow(pale[states.state], extent=(west, east, south, north), interpolation="nearest", zorder=0)
    first, last = ~affine @ (low[0], high[1]), ~affine @ (high[0], low[1])
    (left, top), (right, bottom) = np.floor(first).astype(int), np.ceil(last).astype(int)
    shown = {*np.unique(states.state[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)]).tolist()}
    if left < 0 or top < 0 or right > columns or bottom > rows:
        shown.add(int(VoxelState.NEVER_SEEN))
    return [
        Patch(facecolor=pale[state], edgecolor="#999999", linewidth=0.5, label=_GROUND_NAMES[state])
        for state in VoxelState
        if state in shown and state in _GROUND_NAMES
    ]


def _draw_zones(axes: Any, zones: Sequence[Zone], kind: str, clearance_m: float) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.5, foreground="white", alpha=0.85)]
    label: str | None = _NAMES[kind]
    for zone in zones:
        if clearance_m > 0.0:
            near = _path(zone.polygon.buffer(clearance_m))
            axes.add_patch(PathPatch(near, facecolor=_COLOURS[kind], alpha=0.12, linewidth=0))
        inside = _path(zone.polygon)
        axes.add_patch(PathPatch(inside, facecolor=_COLOURS[kind], alpha=0.55, linewidth=1, label=label))
        label = None
        if kind == "crowd":
            place = zone.polygon.representative_point()
            axes.annotate(
                drawn(zone.id),
                (place.x, place.y),
                ha="center",
                va="center",
                color="#3a0010",
                weight="bold",
                path_effects=halo,
                clip_on=True,
            )


def _path(outline: Any) -> Any:
    """Rings as one path, so that holes are holes."""
    from matplotlib.path import Path as Outline

    rings = [
        Outline(np.asarray(ring.coords), closed=True)
        for part in getattr(outline, "geoms", [outline])
        for ring in (part.exterior, *part.interiors)
    ]
    return Outline.make_compound_path(*rings)
