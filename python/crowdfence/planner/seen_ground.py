"""What is known of the ground below a way. A way is clear where it meets no zone; that nobody stands below it
is known only of ground that was seen empty.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.exports.state_raster import StateRaster
from crowdfence.surface_grid import LEAST_TO_MOST_URGENT
from crowdfence.voxel_state import VoxelState
from crowdfence.zones import Zone
from crowdfence.zones.engine import UNSEEN_ID

if TYPE_CHECKING:
    from affine import Affine
    from shapely import MultiPolygon, Polygon

_URGENCY = np.argsort(LEAST_TO_MOST_URGENT).astype(np.uint8)
_EDGE_CELLS = 1e-6
"""A way so near to the edge of a cell lies over both cells."""


def metres_by_state(waypoints: ArrayLike, ground: StateRaster) -> dict[VoxelState, float]:
    """How many metres of the way over `waypoints` [N, 2] (local metres) lie over ground in each state, exact;
    beyond the raster nobody looked. On the edge of two cells counts the one of which less is known."""
    places = np.asarray(waypoints, dtype=np.float64)
    rows, columns = ground.state.shape
    cells = _placed(~ground.local_from_cells, places)
    metres = np.zeros(len(VoxelState))
    for begin, end, length_m in zip(
        cells[:-1], cells[1:], np.linalg.norm(np.diff(places, axis=0), axis=1).tolist(), strict=True
    ):
        cuts = _cuts(begin, end, (columns, rows))
        middles = begin + ((cuts[1:] + cuts[:-1]) / 2)[:, None] * (end - begin)
        state = _least_known(ground.state, middles)
        metres += np.bincount(state, np.diff(cuts) * length_m, len(VoxelState))
    return {state: float(metres[state]) for state in VoxelState}


def not_known_empty(ground: StateRaster, within: Polygon | MultiPolygon) -> Zone:
    """All ground `within` the rim of the map that was not seen empty, as a zone: what `close_unseen` closes
    in a run, of its last map alone."""
    import shapely
    from rasterio.features import shapes

    empty = ground.state == VoxelState.EMPTY
    seen_empty = [
        shapely.geometry.shape(outline)
        for outline, _ in shapes(empty.astype(np.uint8), empty, transform=ground.local_from_cells)
    ]
    closed = shapely.difference(within, shapely.union_all(seen_empty))
    return Zone.of_no_look(UNSEEN_ID, closed, "unseen", "never_cleared")


def _placed(affine: Affine, places: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y = places.T
    return np.column_stack([affine.a * x + affine.b * y + affine.c, affine.d * x + affine.e * y + affine.f])


def _cuts(begin: NDArray[np.float64], end: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.float64]:
    """Where a leg crosses lines of the raster, as shares of it, sorted, with 0 and 1."""
    shares = [np.array([0.0, 1.0])]
    for axis in (0, 1):
        low, high = sorted((begin[axis], end[axis]))
        lines = np.arange(max(np.ceil(low), 0.0), min(np.floor(high), size[axis]) + 1.0)
        if low < high:
            shares.append(((lines - begin[axis]) / (end[axis] - begin[axis])).clip(0.0, 1.0))
    return np.sort(np.concatenate(shares))


def _least_known(state: NDArray[np.uint8], places: NDArray[np.float64]) -> NDArray[np.uint8]:
    """[P] of places (column, row) [P, 2]."""
    rows, columns = state.shape
    worst = np.zeros(len(places), dtype=np.uint8)
    for aside in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        column, row = np.floor(places + np.multiply(aside, _EDGE_CELLS)).astype(np.int64).T
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        here = np.full(len(places), VoxelState.NEVER_SEEN, dtype=np.uint8)
        here[inside] = state[row[inside], column[inside]]
        worst = np.maximum(worst, _URGENCY[here])
    return np.array(LEAST_TO_MOST_URGENT, dtype=np.uint8)[worst]
