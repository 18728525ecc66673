"""Shaded ground, coloured by what is known of it, as pixels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence.exports.colours import state_colours
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.voxel_state import VoxelState


@dataclass(frozen=True, slots=True, eq=False)
class ShadedGround:
    """Pixels of the ground, row 0 = north."""

    image: NDArray[np.uint8]
    """[H, W, 3]"""
    height_m: NDArray[np.float64]
    """[H, W] local height of the smoothed surface, NaN where there is no terrain."""


OFF_MAP = np.array([244, 244, 242], dtype=np.uint8)
"""Colour of places without terrain."""

_LIGHT_FROM = np.array([-1.0, 1.0, 1.4])  # north-west, the convention of printed maps
_VERTICAL_EXAGGERATION = 1.2
_SMOOTHING_CELLS, _SMOOTHING_STEPS = 2.0, 40
_WASH, _RELIEF, _SKYLIGHT = 0.72, 0.9, 0.5
_HATCH_PERIOD_PX = 9
_HATCHED = (VoxelState.NEVER_SEEN, VoxelState.OCCLUDED, VoxelState.STALE, VoxelState.NOT_CLEARED)


@dataclass(frozen=True, slots=True)
class Extent:
    """Rectangle of the local plane, metres."""

    west: float
    south: float
    east: float
    north: float

    @property
    def width_m(self) -> float:
        return self.east - self.west

    @property
    def height_m(self) -> float:
        return self.north - self.south


def shaded_ground(grid: SurfaceGrid, threshold: float, extent: Extent, width_px: int) -> ShadedGround:
    """Picture of the ground inside `extent`, `width_px` wide, with square pixels.

    Ground that was not seen is grey and hatched. Where a pixel covers several columns it shows the most
    urgent of them, so that a crowd of one column is never lost between pixels.
    """
    metres_per_px = extent.width_m / width_px
    height_px = max(2, round(extent.height_m / metres_per_px))
    column = _cells(extent.west, metres_per_px, width_px, grid.east_edges_m[0], grid.cell_size_m)
    row = _cells(extent.south, metres_per_px, height_px, grid.north_edges_m[0], grid.cell_size_m)[::-1]
    x, y = _clipped(column, grid.shape[0])[:, None], _clipped(row, grid.shape[1])[None, :]
    inside = _inside(column, grid.shape[0])[:, None] & _inside(row, grid.shape[1])[None, :]
    inside &= grid.has_surface[x, y]
    state, probability = _most_urgent(grid, max(1, round(metres_per_px / grid.cell_size_m)))
    colours = state_colours(probability[x, y], state[x, y], threshold).astype(np.float64)
    height_m = _heights(grid, column, row, metres_per_px)
    lit = _lit(colours, _light(height_m, metres_per_px), state[x, y])
    lit[~inside] = OFF_MAP
    height_m[~inside] = np.nan
    image = lit.transpose(1, 0, 2).round().clip(0, 255).astype(np.uint8)
    return ShadedGround(np.ascontiguousarray(image), height_m.T)


def _cells(
    first_edge_m: float, metres_per_px: float, count: int, grid_edge_m: float, cell_size_m: float
) -> NDArray[np.float64]:
    """Grid coordinate of the pixel centres: 0 = outer edge of the first cell, 0.5 = its centre."""
    centres_m = first_edge_m + (np.arange(count) + 0.5) * metres_per_px
    return np.asarray((centres_m - grid_edge_m) / cell_size_m, dtype=np.float64)


def _inside(cells: NDArray[np.float64], count: int) -> NDArray[np.bool_]:
    return (cells >= 0) & (cells < count)


def _clipped(cells: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    return np.floor(cells).astype(np.int64).clip(0, count - 1)


def _most_urgent(grid: SurfaceGrid, cells_per_px: int) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """State and probability in which every crowd column has spread over at least one pixel."""
    if cells_per_px == 1:
        return grid.state, grid.probability
    from scipy import ndimage

    crowd = np.where(grid.state == VoxelState.CROWD, grid.probability, -1.0)
    spread = ndimage.maximum_filter(crowd, size=cells_per_px)
    has_crowd = spread >= 0.0
    return (
        np.where(has_crowd, VoxelState.CROWD, grid.state).astype(np.uint8),
        np.where(has_crowd, spread, grid.probability),
    )


def _heights(
    grid: SurfaceGrid, column: NDArray[np.float64], row: NDArray[np.float64], metres_per_px: float
) -> NDArray[np.float64]:
    """Local height [X, Y] of the smoothed surface at the pixels."""
    from scipy import ndimage

    # Only the neighbourhood of the pixels is worked on, whatever the size of the map.
    (x0, x1), (y0, y1) = _window(column, grid.shape[0]), _window(row, grid.shape[1])
    stride = max(1, int(metres_per_px / grid.cell_size_m))
    window = (slice(x0, x1, stride), slice(y0, y1, stride))
    tops = np.where(grid.has_surface[window], grid.height_m(grid.top_index[window] + 1.0), np.nan)
    surface = _smoothest_surface(_filled(tops), grid.cell_size_m)
    at = np.meshgrid((column - 0.5 - x0) / stride, (row - 0.5 - y0) / stride, indexing="ij")
    return np.asarray(ndimage.map_coordinates(surface, at, order=1, mode="nearest"))


def _light(height_m: NDArray[np.float64], metres_per_px: float) -> NDArray[np.float64]:
    """Hillshade [X, Y]: 1 = level ground, brighter facing the light, darker away from it."""
    east, north = np.gradient(height_m * _VERTICAL_EXAGGERATION, metres_per_px, -metres_per_px)
    normal = np.stack([-east, -north, np.ones_like(east)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    level = _LIGHT_FROM[2] / np.linalg.norm(_LIGHT_FROM)
    return np.asarray((normal @ (_LIGHT_FROM / np.linalg.norm(_LIGHT_FROM))).clip(0.0) / level)


def _smoothest_surface(tops: NDArray[np.float64], voxel_size_m: float) -> NDArray[np.float64]:
    """Surface that passes through every column's highest voxel and is otherwise as smooth as it can be.

    Voxels turn a slope into terraces, and shading would show the terraces instead of the slope.
    """
    from scipy import ndimage

    surface = tops - voxel_size_m / 2
    for _ in range(_SMOOTHING_STEPS):
        surface = ndimage.gaussian_filter(surface, _SMOOTHING_CELLS, mode="nearest")
        surface = surface.clip(tops - voxel_size_m, tops)
    return np.asarray(ndimage.gaussian_filter(surface, 1.0, mode="nearest"))


def _window(cells: NDArray[np.float64], count: int) -> tuple[int, int]:
    reach = 8
    low = int(np.clip(np.floor(cells.min()) - reach, 0, count - 1))
    return low, int(np.clip(np.ceil(cells.max()) + reach, low + 1, count))


def _filled(heights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Holes take the height of their nearest neighbour, so that they cast no false cliffs."""
    from scipy import ndimage

    holes = np.isnan(heights)
    if holes.all():
        return np.zeros_like(heights)
    if not holes.any():
        return heights
    nearest = ndimage.distance_transform_edt(holes, return_distances=False, return_indices=True)
    return np.asarray(heights[tuple(nearest)])


def _lit(
    colours: NDArray[np.float64], light: NDArray[np.float64], state: NDArray[np.uint8]
) -> NDArray[np.float64]:
    """Colours [X, Y, 3] with relief and, where nothing was seen, a hatch."""
    # Crowd keeps its legend colour almost unshaded; everything else is a paler wash over the relief.
    crowd = state == VoxelState.CROWD
    wash = np.where(crowd, 1.0, _WASH)[..., None]
    depth = np.where(crowd, 0.15, _RELIEF)[..., None]
    washed = colours * wash + 255.0 * (1.0 - wash)
    # Skylight keeps steep shade from going black.
    brightness = (_SKYLIGHT + (1.0 - _SKYLIGHT) * light).clip(0.0, 1.15)
    shaded = washed * (1.0 + depth * (brightness[..., None] - 1.0))
    return shaded * _hatch(state)[..., None]


def _hatch(state: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Brightness factor [X, Y]: diagonal lines over unseen ground, crossed if occluded, opposite if stale,
    and dots where it was not cleared, as light as empty ground on a print without colours."""
    x, y = np.indices(state.shape)
    rising = (x + y) % _HATCH_PERIOD_PX < 2
    falling = (x - y) % _HATCH_PERIOD_PX < 2
    dots = ((x + y) % _HATCH_PERIOD_PX < 3) & ((x - y) % _HATCH_PERIOD_PX < 3)
    lines = np.select(
        [state == hatched for hatched in _HATCHED],
        [rising, rising | falling, falling, dots],
        default=False,
    )
    return np.where(lines, 0.86, 1.0)
