"""The map and the zones as nav_msgs/OccupancyGrid: 0 free, 100 occupied, -1 not known.

Free is only what is known to be empty. Ground that was never seen, is hidden, was looked at without being
cleared, or was seen too long ago is not known. Probabilities are rounded up.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.mission.layout import MAP_FRAME
from crowdfence.sources.mission.ros2_messages import header, time
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.voxel_state import VoxelState
from crowdfence.zones import Zone

UNKNOWN, FREE, OCCUPIED = -1, 0, 100


def belief_cells(grid: SurfaceGrid) -> NDArray[np.int8]:
    """[X, Y] probability of crowd in hundredths where ground is empty or crowd."""
    told = (grid.state == VoxelState.EMPTY) | (grid.state == VoxelState.CROWD)
    hundredths = np.ceil(np.where(told, grid.probability, 0.0) * OCCUPIED)
    return np.where(told, hundredths, UNKNOWN).astype(np.int8)


def closed_cells(zones: Sequence[Zone], grid: SurfaceGrid, *, with_state: bool = False) -> NDArray[np.int8]:
    """[X, Y] occupied where a zone touches the cell, else not known; `with_state`: free where the grid, then
    of the same moment, knows it to be empty, and occupied where it holds crowd."""
    from affine import Affine
    from rasterio.features import rasterize

    west, south, _, _ = grid.bounds_m
    cells = np.full(grid.shape, UNKNOWN, dtype=np.int8)
    if with_state:
        cells[grid.state == VoxelState.EMPTY] = FREE
        cells[grid.state == VoxelState.CROWD] = OCCUPIED
    shapes = [zone.polygon for zone in zones if not zone.polygon.is_empty]
    if shapes:
        size_m = grid.cell_size_m
        rows_from_south = Affine(size_m, 0.0, west, 0.0, size_m, south)
        touched = rasterize(shapes, grid.shape[::-1], transform=rows_from_south, all_touched=True)
        cells[touched.T > 0] = OCCUPIED
    return cells


def occupancy_grid(cells: NDArray[np.int8], grid: SurfaceGrid, stamp_ns: int) -> dict[str, Any]:
    """The message of cells [X, Y], row by row from the south-west corner, at the lowest ground's height."""
    west, south, _, _ = grid.bounds_m
    lowest = grid.bottom_index[grid.has_surface]
    height_m = float(grid.height_m(int(lowest.min()))) if lowest.size else 0.0
    return {
        "header": header(stamp_ns, MAP_FRAME),
        "info": {
            "map_load_time": time(stamp_ns),
            "resolution": grid.cell_size_m,
            "width": cells.shape[0],
            "height": cells.shape[1],
            "origin": {
                "position": {"x": west, "y": south, "z": height_m},
                "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            },
        },
        "data": cells.T.ravel().tolist(),
    }
