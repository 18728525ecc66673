"""Names on the map, placed so that none covers another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.exports.drawn_name import drawn
from crowdfence.exports.picture.drone_track import DroneTrack
from crowdfence.exports.picture.line_style import MOST_LABELS, ZONE_LINE, drone_line
from crowdfence.zones import ZoneSet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.transforms import Bbox

_GAPS_PX = (3, 24, 48)
_AROUND = np.array([(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, 1), (1, -1), (-1, -1)])


def write_labels(axes: Axes, zones: ZoneSet, tracks: Sequence[DroneTrack], taken: Sequence[Bbox]) -> None:
    """Names of the drones and of the largest zones; `taken` are places on the screen to keep clear."""
    placed = [
        *taken,
        *(_marker_box(axes, position) for track in tracks for position in track.positions[[0, -1]]),
    ]
    for number, track in enumerate(tracks):
        beside = _marker_box(axes, track.positions[-1])
        placed.append(_place_label(axes, drawn(track.drone), beside, placed, drone_line(number)))
    for zone in zones[:MOST_LABELS]:
        beside = _screen_box(axes, zone.polygon.bounds)
        placed.append(_place_label(axes, drawn(zone.id), beside, placed, ZONE_LINE))


def _marker_box(axes: Axes, position: NDArray[np.float64]) -> Bbox:
    x, y = axes.transData.transform(position[:2])
    return _bbox(x - 7, y - 7, x + 7, y + 7)


def _screen_box(axes: Axes, bounds: tuple[float, float, float, float]) -> Bbox:
    west, south, east, north = bounds
    return _bbox(*axes.transData.transform([(west, south), (east, north)]).ravel())


def _bbox(left: float, bottom: float, right: float, top: float) -> Bbox:
    from matplotlib.transforms import Bbox

    return Bbox.from_extents(left, bottom, right, top)


def _place_label(
    axes: Axes,
    text: str,
    beside: Bbox,
    taken: Sequence[Bbox],
    colour: str,
) -> Bbox:
    """Write `text` beside the box `beside`, inside the panel and clear of `taken`, or else on top of it."""
    plate = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}
    style: dict[str, Any] = {"fontsize": 10, "fontweight": "bold", "color": colour, "bbox": plate}
    label = axes.text(0, 0, text, ha="center", va="center", zorder=11, **style)
    panel, size = axes.get_window_extent(), np.array(label.get_window_extent().padded(3).size)
    corners = np.array(beside.get_points())
    middle, half = corners.mean(axis=0), np.ptp(corners, axis=0) / 2
    beyond = np.concatenate([_AROUND * (half + gap + size / 2) for gap in _GAPS_PX])
    boxes = [_bbox(*(centre - size / 2), *(centre + size / 2)) for centre in middle + beyond]
    free = (box for box in boxes if _within(box, panel) and not any(box.overlaps(other) for other in taken))
    chosen = next(free, _bbox(*(middle - size / 2), *(middle + size / 2)))
    x, y = axes.transData.inverted().transform(np.array(chosen.get_points()).mean(axis=0))
    label.set_position((float(x), float(y)))
    return chosen


def _within(box: Bbox, panel: Bbox) -> bool:
    across = panel.x0 <= box.x0 and box.x1 <= panel.x1
    return bool(across and panel.y0 <= box.y0 and box.y1 <= panel.y1)
