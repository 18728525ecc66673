"""Where a drone could land in a simulated landscape: truth of the layer `landing-site`.

A place is fit for landing where the ground is level, and where within a margin there is no building, no
thing that stands on it (crowns included), no water, no road and nobody, and where a drone has room.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.landing_area import slope_deg
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.landscape.obstacles import Obstacles
from crowdfence.simulation.rendering.mesh_catalogue import MeshFamily, prop_families
from crowdfence.sources.layers import LayerGround

CELL_M = 0.5
WIDE_CELL_M = 1.0
"""Of landscapes wider than `WIDE_M`, of which there would be too many cells."""
WIDE_M = 800.0
MAX_SLOPE_DEG = 10.0
"""Of the plane through 5 x 5 cells."""
CLEAR_M = 3.0
"""To buildings, things, water and roads."""
PEOPLE_M = 5.0
"""To anybody."""
PAD_M = 1.5
"""Radius of the disc of such ground that a drone needs."""

_SLOPE_CELLS = 5
_DEPTH_M = 0.02
"""Shallower water is damp ground."""
_SIZE_STEP_M = 0.5


def landing_ground(landscape: Landscape) -> LayerGround:
    """The ground of a landscape that is fit for landing as long as nobody is near."""
    west, south, east, north = landscape.extent_m
    cell_m = WIDE_CELL_M if max(east - west, north - south) > WIDE_M else CELL_M
    shape = (int((east - west) / cell_m), int((north - south) / cell_m))
    x, y = _middles(west, shape[0], cell_m), _middles(south, shape[1], cell_m)
    at = np.meshgrid(x, y, indexing="ij")
    level = slope_deg(landscape.height_m(*at), cell_m, window_cells=_SLOPE_CELLS) <= MAX_SLOPE_DEG
    taken = landscape.on_road(*at)
    if landscape.surface.water_depth_m is not None:
        taken |= landscape.surface.lattice.interpolate(landscape.surface.water_depth_m, *at) > _DEPTH_M
    corner = np.array([west, south])
    fits = level & ~_within(taken, CLEAR_M / cell_m)
    _take_out_buildings(fits, landscape, x, y)
    for radius_m, places in _things(landscape):
        near = _within(_drawn(shape, (places - corner) / cell_m), (radius_m + CLEAR_M) / cell_m)
        fits &= ~near
    fits = _with_room(fits, PAD_M / cell_m)
    return LayerGround(fits, cell_m, west, south, PEOPLE_M)


def _middles(edge_m: float, cells: int, cell_m: float) -> NDArray[np.float64]:
    return np.asarray(edge_m + (np.arange(cells) + 0.5) * cell_m, np.float64)


def landing_manifest() -> dict[str, float]:
    """Ready for JSON."""
    return {
        "max_slope_deg": MAX_SLOPE_DEG,
        "clear_m": CLEAR_M,
        "people_m": PEOPLE_M,
        "pad_m": PAD_M,
    }


def _within(taken: NDArray[np.bool_], cells: float) -> NDArray[np.bool_]:
    """Cells whose middle lies within so many cells of the middle of one that is taken."""
    from scipy.ndimage import distance_transform_edt

    if not taken.any():
        return taken
    return np.asarray(distance_transform_edt(~taken) <= cells)


def _with_room(fits: NDArray[np.bool_], cells: float) -> NDArray[np.bool_]:
    """What a disc of this radius covers that lies on fitting ground."""
    return _within(~_within(~fits, cells), cells)


def _drawn(shape: tuple[int, int], places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The cells that hold one of the places [N, 2], in cells."""
    cells = np.floor(places).astype(np.int64)
    cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
    drawn = np.zeros(shape, np.bool_)
    drawn[tuple(cells.T)] = True
    return drawn


def _things(landscape: Landscape) -> list[tuple[float, NDArray[np.float64]]]:
    """Everything that stands on the ground as discs: a radius, rounded up, and the middles [N, 2] of it."""
    families = prop_families()
    radii: list[NDArray[np.float64]] = []
    middles: list[NDArray[np.float64]] = []
    for props in landscape.props:
        radii.append(_reach_m(families[props.kind]) * props.scale)
        middles.append(props.position[:, :2])
    for circles in landscape.obstacles.circles:
        radii.append(circles[:, 2])
        middles.append(circles[:, :2])
    if not radii:
        return []
    size = np.ceil(np.concatenate(radii) / _SIZE_STEP_M).astype(np.int64)
    where = np.concatenate(middles)
    return [(float(step) * _SIZE_STEP_M, where[size == step]) for step in np.unique(size)]


def _reach_m(family: MeshFamily) -> float:
    """How far a thing reaches from its foot, seen from above, at scale 1."""
    shapes = [shape for levels in family.variants for shape in levels]
    return float(max(np.hypot(*shape.position[:, :2].T).max() for shape in shapes))


def _take_out_buildings(
    fits: NDArray[np.bool_], landscape: Landscape, x: NDArray[np.float64], y: NDArray[np.float64]
) -> None:
    """Everything near the outline of a building, roofs included, and near an oblong obstacle; x [X] and y [Y]
    are the middles of the cells."""
    import shapely

    for mesh in landscape.solids:
        outline = shapely.MultiPoint(mesh.vertices[:, :2]).convex_hull.buffer(CLEAR_M)
        window, at = _window(outline.bounds, x, y)
        fits[window] &= ~shapely.contains_xy(outline, *at)
    for rectangles in landscape.obstacles.rectangles:
        for row in rectangles:
            reach_m = float(np.hypot(row[3], row[4])) + CLEAR_M
            bounds = (row[0] - reach_m, row[1] - reach_m, row[0] + reach_m, row[1] + reach_m)
            window, (px, py) = _window(bounds, x, y)
            near = Obstacles(rectangles=[row[None]]).blocked(px.ravel(), py.ravel(), CLEAR_M)
            fits[window] &= ~near.reshape(px.shape)


def _window(
    bounds: tuple[float, float, float, float], x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[tuple[slice, slice], list[NDArray[np.float64]]]:
    """Cells inside the bounds (west, south, east, north), and where their middles lie."""
    west, south, east, north = bounds
    inside = slice(*np.searchsorted(x, (west, east))), slice(*np.searchsorted(y, (south, north)))
    return inside, list(np.meshgrid(x[inside[0]], y[inside[1]], indexing="ij"))
