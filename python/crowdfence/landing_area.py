"""Prior P(A = 1) of equation 1: the share of the terrain on which a drone could land.

The paper takes the prior as "the percentage of the area surface suitable for landing": where a drone can
land, people can stand. Suitable here means gentle enough and connected to enough other suitable ground.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.surface_grid import MAX_COLUMNS
from crowdfence.unmasked import require_unmasked

if TYPE_CHECKING:
    from crowdfence._core import Terrain

_CELLS_PER_STRIP = 1 << 17


def landing_prior(
    terrain: Terrain,
    max_slope_deg: float = 15.0,
    min_area_m2: float = 100.0,
    *,
    window_cells: int = 3,
) -> float:
    """Share of the terrain's columns that are suitable for landing, as a prior inside (0, 1).

    The surface is the highest one of each column, so roofs and tree crowns count as surface: for
    the ground alone, build the terrain from ground points. See `landing_suitable` for the criteria; the paper
    states neither limit, the defaults are ours. In bare voxels, as of an OctoMap, a single step on level
    ground reads as a slope of up to 13.4 degrees: for limits below that, widen the window.

    Raises ValueError when the share is exactly 0 or 1 (such a prior would decide every voxel before the
    first look), for an empty terrain, and for one that spans too many columns to grid.
    """
    height_m = column_surface_m(terrain)
    suitable = landing_suitable(
        height_m, terrain.voxel_size_m, max_slope_deg, min_area_m2, window_cells=window_cells
    )
    columns = int(np.count_nonzero(np.isfinite(height_m)))
    landable = int(np.count_nonzero(suitable))
    if landable in (0, columns):
        raise ValueError(
            f"{landable} of {columns} columns are suitable for landing (slope up to {max_slope_deg:g} deg, "
            f"at least {min_area_m2:g} m2 connected), and a prior must lie inside (0, 1)"
        )
    return landable / columns


def landing_suitable(
    height_m: ArrayLike,
    cell_size_m: float,
    max_slope_deg: float = 15.0,
    min_area_m2: float = 100.0,
    *,
    window_cells: int = 3,
) -> NDArray[np.bool_]:
    """Where a drone could land: height map [X, Y] in metres (NaN is a hole) -> bool [X, Y].

    A cell is suitable when its slope (`slope_deg`) is known and at most `max_slope_deg`, and when it belongs
    to a connected area of such cells (sharing an edge, not only a corner) of at least `min_area_m2`, measured
    on the map. Holes are never suitable.
    """
    from scipy import ndimage

    if not 0.0 <= max_slope_deg < 90.0:
        raise ValueError(f"max_slope_deg must lie in [0, 90), got {max_slope_deg}")
    if not (np.isfinite(min_area_m2) and min_area_m2 >= 0.0):
        raise ValueError(f"min_area_m2 must be a finite area of at least 0, got {min_area_m2}")
    # float32 slopes are exact to about 1e-6 deg; a plane at exactly the limit must pass.
    gentle = slope_deg(height_m, cell_size_m, window_cells=window_cells) <= max_slope_deg + 1e-4
    area_of_cell, area_count = ndimage.label(gentle)
    cells = sum(
        (np.bincount(area_of_cell[rows].ravel(), minlength=area_count + 1) for rows in _strips(gentle.shape)),
        start=np.zeros(area_count + 1, np.int64),
    )
    large = cells * cell_size_m**2 >= min_area_m2
    large[0] = False  # label 0 is everything that is not gentle
    return np.asarray(large[area_of_cell])


def slope_deg(height_m: ArrayLike, cell_size_m: float, *, window_cells: int = 3) -> NDArray[np.float32]:
    """Slope [X, Y] in degrees of the plane that fits the heights around each cell best (least squares).

    The window is `window_cells` x `window_cells` (odd, at least 3), square on the map. Holes and the outside
    of the map take no part in the fit. NaN where the cell is a hole, where less than a quarter of the window
    is known, or where the known cells lie in one line.
    """
    require_unmasked(height_m, "heights (NaN marks a hole)")
    heights = np.asarray(height_m)
    if heights.ndim != 2 or heights.size == 0 or heights.dtype.kind not in "fiu":
        raise ValueError(f"height_m must be numbers [X, Y], got {heights.dtype} {list(heights.shape)}")
    if not (np.isfinite(cell_size_m) and cell_size_m > 0.0):
        raise ValueError(f"cell_size_m must be positive and finite, got {cell_size_m}")
    if window_cells < 3 or window_cells % 2 == 0:
        raise ValueError(f"window_cells must be odd and at least 3, got {window_cells}")
    if np.isinf(heights).any():
        raise ValueError("height_m must not be infinite; mark holes with NaN")
    reach = window_cells // 2
    slopes = np.empty(heights.shape, np.float32)
    for rows in _strips(heights.shape):
        first = max(rows.start - reach, 0)
        strip = heights[first : rows.stop + reach].astype(np.float64)
        slopes[rows] = _plane_slope_deg(strip, cell_size_m, reach)[rows.start - first :][
            : rows.stop - rows.start
        ]
    return slopes


def column_surface_m(terrain: Terrain) -> NDArray[np.float32]:
    """Height [X, Y] of the highest surface over the middle of each column, metres above the terrain's lowest
    face.

    Cell (0, 0) is the column of the smallest grid indices in use; NaN is a column without a voxel. ValueError
    for a terrain without voxels or with more than `MAX_COLUMNS` columns.
    """
    if terrain.voxel_count == 0:
        raise ValueError("the terrain has no voxels")
    low, high = terrain.bounds[:, :2] / terrain.voxel_size_m
    east, north = (int(side) for side in np.rint(high - low))
    if east * north > MAX_COLUMNS:
        raise ValueError(
            f"the terrain spans {east} x {north} columns, more than {MAX_COLUMNS}; "
            "cut it to the area of the flight or use larger voxels"
        )
    return terrain.surface_map()


def _strips(shape: tuple[int, ...]) -> Iterator[slice]:
    """Row ranges of some hundred thousand cells, whose intermediate arrays stay in the processor's cache."""
    rows = max(1, _CELLS_PER_STRIP // shape[1])
    for start in range(0, shape[0], rows):
        yield slice(start, min(start + rows, shape[0]))


def _plane_slope_deg(height_m: NDArray[np.float64], cell_size_m: float, reach: int) -> NDArray[np.float64]:
    """Weighted least squares in every window at once: weight 1 where the height is known, 0 elsewhere."""
    from scipy.ndimage import correlate1d

    offset = np.arange(-reach, reach + 1, dtype=np.float64)
    known = np.isfinite(height_m)
    if not known.any():
        return np.full(height_m.shape, np.nan)
    # Heights from the strip's mean: sums of products then keep their digits far above sea level.
    z = np.where(known, height_m - height_m[known].mean(), 0.0)

    def along(axis: int, values: NDArray[np.float64], power: int) -> NDArray[np.float64]:
        return np.asarray(correlate1d(values, offset**power, axis=axis, mode="constant"))

    n, x, y, x2, y2, x_y = _weight_moments(known, along)
    z_along_x = along(0, z, 0)
    z_sum, x_z, y_z = along(1, z_along_x, 0), along(1, along(0, z, 1), 0), along(1, z_along_x, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        xx = x2 - x * x / n
        yy = y2 - y * y / n
        xy = x_y - x * y / n
        xz = x_z - x * z_sum / n
        yz = y_z - y * z_sum / n
        determinant = xx * yy - xy * xy
        rise_x = (xz * yy - yz * xy) / determinant
        rise_y = (yz * xx - xz * xy) / determinant
    slope = np.degrees(np.arctan(np.hypot(rise_x, rise_y) / cell_size_m))
    # Offsets are whole numbers: points that do not lie in one line have a determinant of 1/n^2 or more.
    fitted = known & (4.0 * n >= offset.size**2) & (determinant > 1e-6)
    return np.where(fitted, slope, np.nan)


def _weight_moments(
    known: NDArray[np.bool_], along: Callable[[int, NDArray[np.float64], int], NDArray[np.float64]]
) -> list[NDArray[np.float64]]:
    """Sums over the window of 1, x, y, x2, y2 and x y where the height is known. Without holes the weights
    are a column times a row, and so are their sums: whole numbers either way."""
    whole = bool(known.all())
    rows = known[:, :1] if whole else known
    of_rows = [along(0, rows.astype(np.float64), power) for power in range(3)]
    powers = ((0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (1, 1))
    if whole:
        of_columns = [along(1, known[:1].astype(np.float64), power) for power in range(3)]
        return [of_rows[x] * of_columns[y] for x, y in powers]
    return [along(1, of_rows[x], y) for x, y in powers]
