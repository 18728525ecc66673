"""Title and legend of the picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdfence.exports.colours import STATE_COLOURS, probability_colours
from crowdfence.exports.drawn_name import drawn
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.picture.drone_track import DroneTrack
from crowdfence.exports.picture.line_style import INK, MOST_LABELS, OTHERS_STYLE, ZONE_LINE, drone_line
from crowdfence.exports.picture.relief import Extent
from crowdfence.georeference import Georeference
from crowdfence.iso_time import iso_utc
from crowdfence.legible import first_of
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.voxel_state import VoxelState
from crowdfence.zones import Zone, ZoneSet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FAINT = "#6b7280"
_MOST_DRONES = 8
_MOST_AROUND = 1
"""Zones that hold all of the picture, by name."""
_STATE_TEXTS = {
    VoxelState.CROWD: "crowd",
    VoxelState.EMPTY: "seen, empty",
    VoxelState.NOT_CLEARED: "looked at, not cleared",
    VoxelState.STALE: "seen empty, long ago",
    VoxelState.OCCLUDED: "hidden from view",
    VoxelState.NEVER_SEEN: "never seen",
}
_HATCHES = {
    VoxelState.NOT_CLEARED: "....",
    VoxelState.STALE: "\\\\\\\\\\",
    VoxelState.OCCLUDED: "xxxx",
    VoxelState.NEVER_SEEN: "/////",
}


def draw_title(axes: Axes, description: MapDescription) -> None:
    """Name of the mission, then when, by whom and how."""
    axes.set(xlim=(0, 1), ylim=(0, 1))
    axes.axis("off")
    title = f"Crowd map · {drawn(description.mission)}" if description.mission else "Crowd map"
    axes.text(0, 0.60, title, fontsize=19, fontweight="bold", color=INK, va="center")
    axes.text(0, 0.25, "   ·   ".join(_facts(description)), fontsize=11.5, color=_FAINT, va="center")


def _facts(description: MapDescription) -> list[str]:
    facts = [_time_span(description)]
    if description.drones:
        facts.append(f"{len(description.drones)} drone{'s' if len(description.drones) > 1 else ''}")
    return [*facts, f"method “{description.method}”", f"crowd where P ≥ {description.threshold:.3g}"]


def _time_span(description: MapDescription) -> str:
    end = iso_utc(description.stamp_ns)
    date, end_time = end[:10], end[11:21]
    first_ns = description.first_stamp_ns
    if first_ns is None:
        return f"{date} {end_time} UTC"
    first = iso_utc(first_ns)
    first_text = first[11:21] if first[:10] == date else f"{first[:10]} {first[11:21]}"
    duration_s = (description.stamp_ns - first_ns) / 1e9
    return f"{date}  {first_text} \N{EN DASH} {end_time} UTC ({duration_s:.1f} s)"


class _Column:
    """Writes downwards in pixels, so that no two entries can ever overlap."""

    def __init__(self, axes: Axes) -> None:
        box = axes.get_window_extent()
        self.axes, self.width, self.y = axes, box.width, box.height
        axes.set(xlim=(0, box.width), ylim=(0, box.height))
        axes.axis("off")

    def heading(self, text: str) -> None:
        self.y -= 14
        self.axes.text(0, self.y, text, fontsize=11.5, fontweight="bold", color=INK, va="top")
        self.y -= 30

    def row(self, text: str, right: str = "", *, indent: float = 0, **style: Any) -> None:
        style = {"fontsize": 10.5, "color": INK, "va": "center", **style}
        self.axes.text(indent, self.y - 10, text, **style)
        self.axes.text(self.width, self.y - 10, right, ha="right", **style)
        self.y -= 24

    @property
    def rows_left(self) -> int:
        return int(self.y // 24)


def draw_legend(
    axes: Axes,
    grid: SurfaceGrid,
    zones: ZoneSet,
    description: MapDescription,
    tracks: Sequence[DroneTrack],
    contour_step_m: float | None,
    extent: Extent | None = None,
) -> None:
    """What the colours and lines mean, and the figures behind them; `extent` is what the picture shows."""
    column = _Column(axes)
    column.y += 14
    _probability(column, description.threshold)
    _states(column, grid)
    if contour_step_m is not None:
        _line(column, f"contour lines every {contour_step_m:g} m", color=INK, linewidth=0.8, alpha=0.5)
    if tracks:
        _drones(column, tracks)
    if zones.static:
        others = "1 zone of others" if len(zones.static) == 1 else f"{len(zones.static)} zones of others"
        _line(column, others, color=ZONE_LINE, linewidth=1.2, linestyle=OTHERS_STYLE)
        _around(column, zones.static, extent)
    _zones(column, zones, description)


def _probability(column: _Column, threshold: float) -> None:
    column.heading("Probability of crowd")
    ramp = probability_colours(np.linspace(0.0, 1.0, 512), threshold)[None]
    top, bottom = column.y, column.y - 16
    column.axes.imshow(
        ramp, extent=(0, column.width, bottom, top), aspect="auto", interpolation="none", zorder=1
    )
    # A threshold close to an end of the ramp takes the place of that end's label.
    ends = [end for end in (0.0, 1.0) if abs(end - threshold) > 0.12]
    for value in (*ends, threshold):
        x = value * column.width
        column.axes.plot([x, x], [bottom - 5, top], color=INK, linewidth=1.0, zorder=2, clip_on=False)
        align = {0.0: "left", 1.0: "right"}.get(value, "center")
        column.axes.text(x, bottom - 8, f"{value:.3g}", fontsize=9.5, color=INK, ha=align, va="top")
    column.y = bottom - 26


def _states(column: _Column, grid: SurfaceGrid) -> None:
    from matplotlib.patches import Rectangle

    column.heading("Ground")
    for state, text in _STATE_TEXTS.items():
        area_m2 = grid.area_m2(state)
        if area_m2 == 0.0 and state in (VoxelState.STALE, VoxelState.OCCLUDED, VoxelState.NOT_CLEARED):
            continue
        colour = np.array(STATE_COLOURS[state]) / 255
        swatch = Rectangle((0, column.y - 18), 30, 16, facecolor=colour, edgecolor="none")
        column.axes.add_patch(swatch)
        if state in _HATCHES:
            swatch.set(hatch=_HATCHES[state], edgecolor=colour * 0.72)
        # How much of the map was never seen depends on where the map was cut, so no figure is given for it.
        column.row(text, "" if state == VoxelState.NEVER_SEEN else _area(area_m2), indent=42)


def _area(area_m2: float) -> str:
    return f"{area_m2:,.0f} m²".replace(",", " ")


def _drones(column: _Column, tracks: Sequence[DroneTrack]) -> None:
    column.heading("Drones")
    for number, track in enumerate(tracks[:_MOST_DRONES]):
        y, colour = column.y - 10, drone_line(number)
        column.axes.plot([4, 26], [y, y], color=colour, linewidth=2.2)
        column.axes.plot([4], [y], "o", markersize=6.5, markerfacecolor="white", markeredgecolor=colour)
        column.axes.plot([26], [y], marker=(3, 0, -90), markersize=10, color=colour, markeredgecolor="white")
        column.row(drawn(track.drone), f"{_path_length_m(track):,.0f} m flown", indent=42)
    if len(tracks) > _MOST_DRONES:
        column.row(f"and {len(tracks) - _MOST_DRONES} more", indent=42, color=_FAINT)
    _line(column, "ground in its last picture", color=_FAINT, linewidth=1.3, linestyle=(0, (5, 3)))


def _line(column: _Column, text: str, **style: Any) -> None:
    column.axes.plot([0, 30], [column.y - 10] * 2, **style)
    column.row(text, indent=42)


def _around(column: _Column, others: Sequence[Zone], extent: Extent | None) -> None:
    """A zone that holds the whole picture, as one of an airport does, has no line in it."""
    import shapely

    if extent is None:
        return
    shown = shapely.box(extent.west, extent.south, extent.east, extent.north)
    names = [drawn(zone.id) for zone in others if zone.polygon.covers(shown)]
    if names:
        column.row(f"all of this is closed by {first_of(names, _MOST_AROUND)}")


def _path_length_m(track: DroneTrack) -> float:
    return float(np.linalg.norm(np.diff(track.positions, axis=0), axis=1).sum())


def _zones(column: _Column, zones: ZoneSet, description: MapDescription) -> None:
    column.heading(f"Zones ({len(zones)})")
    if len(zones) == 0:
        column.row("none of crowd" if zones.unseen else "none; that does not mean free", color=_FAINT)
        _not_drawn(column, zones)
        return
    shown = zones[: max(1, min(MOST_LABELS, column.rows_left - (6 if zones.unseen else 5)))]
    _zone_row(column, ("", "crowd", "max. P", "last seen"), color=_FAINT, fontsize=9.5)
    for zone in shown:
        age = _age(description.stamp_ns - zone.last_seen_ns)
        _zone_row(column, (zone.id, _area(zone.area_m2), f"{zone.probability_max:.2f}", age), color=INK)
    if len(zones) > len(shown):
        rest_m2 = sum(zone.area_m2 for zone in zones[len(shown) :])
        column.row(f"and {len(zones) - len(shown)} smaller ones, {_area(rest_m2)}", color=_FAINT)
    _not_drawn(column, zones)


def _not_drawn(column: _Column, zones: ZoneSet) -> None:
    """Ground that is closed because nobody cleared it has no outline in the picture: it would hide the rest.
    Crowd that is too small for a zone is closed with it."""
    if zones.unseen:
        column.row("closed: not known empty", _area(sum(zone.polygon.area for zone in zones.unseen)))
    if zones.dropped_count:
        dropped = f"{zones.dropped_count} below {_area(zones.min_area_m2)}, {_area(zones.dropped_area_m2)}"
        column.row(f"{'with' if zones.unseen else 'not drawn:'} {dropped}", color=_FAINT)


def _zone_row(column: _Column, cells: tuple[str, str, str, str], **style: Any) -> None:
    style = {"fontsize": 10.5, "va": "center", **style}
    column.axes.text(0, column.y - 10, cells[0], fontweight="bold", **style)
    for text, right in zip(cells[1:], (0.45, 0.68, 1.0), strict=True):
        column.axes.text(right * column.width, column.y - 10, text, ha="right", **style)
    column.y -= 24


def _age(age_ns: int) -> str:
    seconds = age_ns / 1e9
    if seconds < 120:
        return f"{seconds:.1f} s ago"
    return f"{seconds / 60:.0f} min ago" if seconds < 7200 else f"{seconds / 3600:.0f} h ago"


def draw_origin(axes: Axes, georeference: Georeference | None) -> None:
    """Where the local frame lies, at the foot of the legend."""
    if georeference is None:
        text = "local metres, not georeferenced"
    else:
        north = "N" if georeference.latitude_deg >= 0 else "S"
        east = "E" if georeference.longitude_deg >= 0 else "W"
        text = (
            f"(0, 0) = {abs(georeference.latitude_deg):.6f}° {north}, "
            f"{abs(georeference.longitude_deg):.6f}° {east} (WGS 84)"
        )
    axes.text(0, 0, text, fontsize=9.5, color=_FAINT, va="bottom")
