"""The map of a layer and its landing sites as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import atomic_path
from crowdfence.exports.drawn_name import drawn
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.picture import DroneTrack, interesting_extent
from crowdfence.exports.picture.line_style import INK, MOST_LABELS, drone_line
from crowdfence.iso_time import iso_utc
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.zones import Zone
from crowdfence.zones.sites import LandingSite

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = "PuOr"
"""Purple and orange are told apart by every kind of eyes, and neither is the red of zones."""
_UNSEEN = (0.62, 0.62, 0.64)
_SITE_LINE, _ZONE_LINE = "#0b3d91", "#b3001b"
_WASH = 0.62


def write_site_picture(
    path: str | PathLike[str],
    grid: SurfaceGrid,
    sites: Sequence[LandingSite],
    closed: Sequence[Zone],
    description: MapDescription,
    *,
    tracks: Sequence[DroneTrack] = (),
) -> None:
    """Write a PNG: probability of the layer on shaded ground, sites with the largest disc in each, closed
    zones, tracks. OSError when the file cannot be written."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    # The caller's own matplotlib settings must not change the picture.
    with matplotlib.rc_context(), atomic_path(path) as temporary:
        matplotlib.rcdefaults()
        extent = interesting_extent(grid, tracks)
        height = 11.0 * min(max(extent.height_m / extent.width_m, 0.5), 1.2)
        figure = Figure(figsize=(13.4, height + 1.1), layout="constrained", facecolor="white")
        axes = figure.add_subplot()
        sides = (grid.east_edges_m[0], grid.east_edges_m[-1], grid.north_edges_m[0], grid.north_edges_m[-1])
        axes.imshow(_ground(grid), extent=sides, origin="lower", interpolation="none")
        _draw_zones(axes, closed)
        _draw_sites(axes, sites)
        for number, track in enumerate(tracks):
            x, y = track.positions[:, :2].T
            axes.plot(x, y, color=drone_line(number), linewidth=1.2, label=drawn(track.drone))
            axes.plot(x[-1:], y[-1:], color=drone_line(number), marker="o", markersize=5)
        axes.set(
            xlim=(extent.west, extent.east),
            ylim=(extent.south, extent.north),
            aspect="equal",
            xlabel="east [m]",
            ylabel="north [m]",
        )
        _key(axes, bool(closed), len(sites))
        figure.colorbar(
            matplotlib.cm.ScalarMappable(matplotlib.colors.Normalize(0.0, 1.0), _COLOURS),
            ax=axes,
            shrink=0.6,
            label=f"probability of {description.layer}",
        )
        axes.set_title(_title(sites, description), loc="left", color=INK, fontsize=13)
        FigureCanvasAgg(figure).print_figure(temporary, format="png", dpi=100)


def _title(sites: Sequence[LandingSite], description: MapDescription) -> str:
    area_m2 = sum(site.area_m2 for site in sites)
    return (
        f"{description.layer} · {drawn(description.mission)} · {iso_utc(description.stamp_ns)[:19]}Z\n"
        f"{len(sites)} sites, {area_m2:,.0f} m², P ≥ {description.threshold:.3g}, "
        f"method “{description.method}”"
    )


def _ground(grid: SurfaceGrid) -> NDArray[np.float64]:
    """Colours [Y, X, 3]: the probability as a wash over the relief; grey where nobody has looked."""
    import matplotlib
    from matplotlib.colors import LightSource

    height_m = np.where(grid.has_surface, grid.height_m(grid.top_index + 1.0), np.nan)
    level = np.where(np.isfinite(height_m), height_m, np.nanmin(height_m))
    shade = LightSource(315, 45).hillshade(level.T, dx=grid.cell_size_m, dy=grid.cell_size_m)
    relief = np.repeat((0.35 + 0.65 * shade)[..., None], 3, axis=-1)
    probability = grid.probability.T
    seen = np.isfinite(probability)
    colours = matplotlib.colormaps[_COLOURS](np.where(seen, probability, 0.5))[..., :3]
    washed = np.where(seen[..., None], _WASH * colours + (1.0 - _WASH) * relief, _UNSEEN * relief)
    washed[~grid.has_surface.T] = 0.957
    return np.asarray(washed)


def _draw_sites(axes: Axes, sites: Sequence[LandingSite]) -> None:
    from matplotlib.patches import Circle

    for site in sites:
        _outline(axes, site.polygon, facecolor="none", edgecolor=_SITE_LINE, linewidth=1.3)
    plate = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}
    style: dict[str, Any] = {"fontsize": 9, "fontweight": "bold", "color": _SITE_LINE, "bbox": plate}
    for site in sites[:MOST_LABELS]:
        x, y, _ = site.centre
        axes.add_patch(Circle((x, y), site.radius_m, fill=False, color=_SITE_LINE, linestyle=":"))
        axes.text(x, y, site.id, ha="center", va="center", clip_on=True, **style)


def _draw_zones(axes: Axes, closed: Sequence[Zone]) -> None:
    for zone in closed:
        _outline(axes, zone.polygon, facecolor="none", edgecolor=_ZONE_LINE, linewidth=1.5, hatch="//")


def _outline(axes: Axes, polygon: Any, **style: Any) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    for part in getattr(polygon, "geoms", [polygon]):
        rings = [Path(np.asarray(ring.coords), closed=True) for ring in (part.exterior, *part.interiors)]
        axes.add_patch(PathPatch(Path.make_compound_path(*rings), **style))


def _key(axes: Axes, closed: bool, sites: int) -> None:
    from matplotlib.patches import Patch

    entries: list[Any] = [Patch(facecolor=_UNSEEN, label="never seen: not known to be fit")]
    if sites:
        named = f" (the {MOST_LABELS} roomiest are named)" if sites > MOST_LABELS else ""
        label = f"site, with its largest free disc{named}"
        entries.append(Patch(facecolor="none", edgecolor=_SITE_LINE, label=label))
    if closed:
        entries.append(Patch(facecolor="none", edgecolor=_ZONE_LINE, hatch="//", label="no-fly zone"))
    tracks, _ = axes.get_legend_handles_labels()
    axes.legend(handles=[*entries, *tracks], loc="lower right", fontsize=9, framealpha=0.9)
