"""Layout of a contact sheet: instants as rows, drones as columns, the map on the right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import atomic_path
from crowdfence.exports.contact_sheet.frame_tile import CLASS_COLOURS, labelled, photograph
from crowdfence.exports.contact_sheet.ground_panel import draw_ground_panel, footprints, panel_extent
from crowdfence.exports.drawn_name import drawn
from crowdfence.exports.picture.line_style import INK, drone_line
from crowdfence.iso_time import iso_utc
from crowdfence.sources.recording import Frame, Instant, Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from crowdfence._core import Terrain

_T = TypeVar("_T")

MOST_INSTANTS, MOST_DRONES = 3, 3
_DPI = 100
_TILE_PX, _GAP_PX, _EDGE_PX = 360, 8, 24
_TITLE_PX, _HEAD_PX, _SIDE_PX, _AXIS_PX, _FOOT_PX = 76, 30, 60, 62, 44
_SMALLEST_MAP_PX = 700


@dataclass(frozen=True, slots=True, eq=False)
class _Tile:
    """One frame of the sheet and its rows of pixels, photograph first."""

    frame: Frame
    pictures: list[NDArray[np.uint8]]
    what: str


def write_contact_sheet(
    path: str | PathLike[str],
    recording: Recording,
    terrain: Terrain | None,
    *,
    tolerance_ms: float = 100.0,
) -> None:
    """Write a PNG with up to three instants of up to three drones: pictures, their labels, and a map.

    Instants are spread evenly over the recording, among those that hold the most drones. Without `terrain`
    the map shows the flights alone. ValueError when no frame has a picture, labels or a heatmap; OSError
    when the file cannot be written.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    flying = [drone for drone in recording.drones if recording.frames_of(drone)]
    drones = _spread(flying, MOST_DRONES)
    rows = [_tiles(instant, drones) for instant in _chosen(recording, drones, tolerance_ms)]
    if not any(rows):
        raise ValueError(f"{recording.name} holds no picture, label or heatmap that could be shown")
    # The caller's own matplotlib settings must not change the picture.
    with matplotlib.rc_context(), atomic_path(path) as temporary:
        matplotlib.rcdefaults()
        figure = _compose(recording, terrain, drones, [row for row in rows if row])
        FigureCanvasAgg(figure).print_figure(temporary, format="png", dpi=_DPI)


def _chosen(recording: Recording, drones: Sequence[str], tolerance_ms: float) -> list[Instant]:
    instants = list(recording.instants(tolerance_ms, drones=drones))
    most = max((len(instant.frames) for instant in instants), default=0)
    return _spread([instant for instant in instants if len(instant.frames) == most], MOST_INSTANTS)


def _spread(items: Sequence[_T], count: int) -> list[_T]:
    """At most `count` of them: the middle ones of as many equal parts."""
    if len(items) <= count:
        return list(items)
    return [items[int((number + 0.5) * len(items) / count)] for number in range(count)]


def _tiles(instant: Instant, drones: Sequence[str]) -> list[_Tile]:
    tiles = []
    for frame in sorted(instant.frames, key=lambda frame: drones.index(frame.drone)):
        photo, labels = photograph(frame), labelled(frame)
        pictures = [picture for picture in (photo, labels[0] if labels else None) if picture is not None]
        if pictures:
            tiles.append(_Tile(frame, pictures, labels[1] if labels else ""))
    return tiles


def legend_title(when_s: float, *, with_people: bool) -> str:
    """Nobody on the map means nothing where the recording does not say where people are."""
    people = " and people" if with_people else ""
    return f"flights, and footprints (150 m){people} at {when_s:.1f} s"


def _compose(
    recording: Recording, terrain: Terrain | None, drones: Sequence[str], rows: list[list[_Tile]]
) -> Figure:
    from matplotlib.figure import Figure

    camera = rows[0][0].frame.camera
    tile_height = round(_TILE_PX * camera.height / camera.width)
    strips = [max(len(tile.pictures) for tile in row) for row in rows]
    block_height = sum(strips) * (tile_height + _GAP_PX) + (len(rows) - 1) * _GAP_PX
    tiles_width = len(drones) * (_TILE_PX + _GAP_PX)
    map_height = block_height - _AXIS_PX + _HEAD_PX
    map_width = max(_SMALLEST_MAP_PX, round(0.72 * map_height))
    width = _SIDE_PX + tiles_width + 2 * _AXIS_PX + map_width + _EDGE_PX
    height = _TITLE_PX + _HEAD_PX + block_height + _FOOT_PX
    figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI, facecolor="white")

    def axes_at(left: float, top: float, wide: float, high: float) -> Axes:
        return figure.add_axes((left / width, 1 - (top + high) / height, wide / width, high / height))

    _write_title(figure, recording, width, height)
    for column, drone in enumerate(drones):
        x = _SIDE_PX + column * (_TILE_PX + _GAP_PX) + _TILE_PX / 2
        y = 1 - (_TITLE_PX + _HEAD_PX / 2) / height
        colour = drone_line(recording.drones.index(drone))
        figure.text(
            x / width, y, drawn(drone), ha="center", va="center", fontsize=13, color=colour, fontweight="bold"
        )
    top = float(_TITLE_PX + _HEAD_PX)
    first_ns = recording.frames[0].stamp_ns
    for row, strip in zip(rows, strips, strict=True):
        seconds = (row[0].frame.stamp_ns - first_ns) / 1e9
        middle = 1 - (top + strip * (tile_height + _GAP_PX) / 2) / height
        figure.text(
            _SIDE_PX / 2 / width, middle, f"{seconds:.1f} s", rotation=90, ha="center", va="center", color=INK
        )
        for tile in row:
            left = _SIDE_PX + drones.index(tile.frame.drone) * (_TILE_PX + _GAP_PX)
            for number, picture in enumerate(tile.pictures):
                axes = axes_at(left, top + number * (tile_height + _GAP_PX), _TILE_PX, tile_height)
                axes.imshow(picture, aspect="auto", interpolation="lanczos")
                axes.set(xticks=[], yticks=[])
        top += strip * (tile_height + _GAP_PX) + _GAP_PX
    middle_row = rows[len(rows) // 2]
    frames = [tile.frame for tile in middle_row]
    _write_legend(figure, rows[0][0].what, _SIDE_PX / width, 0.45 * _FOOT_PX / height)
    outlines = footprints(frames, terrain)
    extent = panel_extent(recording, outlines, map_height / map_width)
    if extent is not None:
        axes = axes_at(_SIDE_PX + tiles_width + _AXIS_PX + 8, _TITLE_PX + 4, map_width, map_height)
        people = recording.people_truth(_world_stamp_ns(frames[0]))
        draw_ground_panel(axes, recording, terrain, extent, frames, outlines, people, map_width)
        when = (frames[0].stamp_ns - first_ns) / 1e9
        title = legend_title(when, with_people=people is not None)
        axes.legend(loc="upper right", fontsize=10, framealpha=0.9, markerscale=2, title=title)
    return figure


def _world_stamp_ns(frame: Frame) -> int:
    return frame.stamp_ns if frame.truth.exposure_ns is None else frame.exposure_ns()


def _write_title(figure: Figure, recording: Recording, width: int, height: int) -> None:
    simulation = recording.manifest.get("simulation", {})
    scenario = simulation.get("scenario", {}) if isinstance(simulation, dict) else {}
    title, details = recording.name, []
    if scenario:
        title = f"{recording.name}: {scenario.get('description') or scenario.get('name')}"
        details += [
            f"simulated, scenario {scenario.get('name')}, seed {simulation.get('seed')}",
            f"{scenario.get('season')}, {scenario.get('time_of_day_h')} h",
            f"{simulation.get('people')} people",
        ]
    first_ns, last_ns = recording.span_ns or (0, 0)
    details.append(f"drones: {len(recording.drones)}, frames: {len(recording.frames)}")
    details.append(f"{iso_utc(first_ns)} + {(last_ns - first_ns) / 1e9:.1f} s")
    figure.text(_SIDE_PX / width, 1 - 30 / height, drawn(title), fontsize=17, color=INK, va="center")
    figure.text(
        _SIDE_PX / width, 1 - 60 / height, "   ·   ".join(details), fontsize=11, color=INK, va="center"
    )


def _write_legend(figure: Figure, what: str, x: float, y: float) -> None:
    figure.text(x, y, what, fontsize=10.5, color=INK, va="center")
    if not what.startswith("true classes"):
        return
    width_px = figure.get_figwidth() * _DPI
    x += 290 / width_px
    for name, colour in CLASS_COLOURS.items():
        figure.text(x, y, "\u25a0", fontsize=15, color=np.array(colour) / 255, va="center")
        figure.text(x + 20 / width_px, y, name, fontsize=10.5, color=INK, va="center")
        x += 96 / width_px
