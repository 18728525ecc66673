"""Scale bar and north arrow, on one plate in the corner where they hide least."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.exports.picture.line_style import INK
from crowdfence.exports.picture.relief import Extent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.transforms import Bbox

_MARGIN_PX, _HEIGHT_PX, _ARROW_PX = 16, 58, 46
Corner = tuple[int, int]
"""(0 = west or 1 = east, 0 = south or 1 = north)."""


def scale_length_m(width_m: float) -> float:
    """Largest of 1, 2, 5 x 10^n metres that is at most a fifth of the map's width."""
    power = 10.0 ** np.floor(np.log10(width_m / 5))
    return float(max(step * power for step in (1, 2, 5) if step * power <= width_m / 5))


def emptiest_corner(extent: Extent, occupied: NDArray[np.float64]) -> Corner:
    """The corner farthest from the nearest of the points `occupied` [N, 2] (local metres)."""
    corners = ((1, 0), (0, 0), (1, 1), (0, 1))
    if len(occupied) == 0:
        return corners[0]
    low, size = np.array([extent.west, extent.south]), np.array([extent.width_m, extent.height_m])
    free_m = [np.linalg.norm(occupied - (low + size * corner), axis=1).min() for corner in corners]
    return corners[int(np.argmax(free_m))]


def draw_scale_bar(axes: Axes, extent: Extent, corner: Corner) -> Bbox:
    """Draw both and return their place on the screen."""
    from matplotlib.patches import Rectangle
    from matplotlib.transforms import Affine2D

    panel = axes.get_window_extent()
    length_m = scale_length_m(extent.width_m)
    bar_px = length_m / extent.width_m * panel.width
    plate_px = bar_px + 40 + _ARROW_PX
    left = _MARGIN_PX if corner[0] == 0 else panel.width - _MARGIN_PX - plate_px
    bottom = _MARGIN_PX if corner[1] == 0 else panel.height - _MARGIN_PX - _HEIGHT_PX
    # Pixels counted from the plate's lower left corner.
    pixels = Affine2D().translate(left, bottom).scale(1 / panel.width, 1 / panel.height) + axes.transAxes
    plate = Rectangle(
        (0, 0), plate_px, _HEIGHT_PX, transform=pixels, facecolor="white", linewidth=0, alpha=0.85, zorder=9
    )
    axes.add_patch(plate)
    style: dict[str, Any] = {"transform": pixels, "color": INK, "zorder": 10}
    _draw_bar(axes, 20, bar_px, _distance(length_m), style)
    _draw_north_arrow(axes, plate_px - _ARROW_PX / 2 - 6, style)
    return plate.get_window_extent()


def _distance(length_m: float) -> str:
    return f"{length_m:g} m" if length_m < 1000 else f"{length_m / 1000:g} km"


def _draw_bar(axes: Axes, x: float, length: float, text: str, style: dict[str, Any]) -> None:
    axes.plot([x, x + length], [16, 16], linewidth=3, solid_capstyle="butt", **style)
    for end in (x, x + length):
        axes.plot([end, end], [15, 24], linewidth=1.5, **style)
    axes.text(x + length / 2, 27, text, fontsize=10, ha="center", va="bottom", **style)


def _draw_north_arrow(axes: Axes, x: float, style: dict[str, Any]) -> None:
    from matplotlib.patches import Polygon

    arrow = np.array([(0, 22), (7, 0), (0, 5), (-7, 0)]) + np.array([x, 12])
    axes.add_patch(Polygon(arrow, linewidth=0, **style))
    axes.text(x, 36, "N", fontsize=10, fontweight="bold", ha="center", va="bottom", **style)
