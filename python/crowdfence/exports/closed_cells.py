"""Which cells of a raster zones close. The state of the ground does not say it: zones also close what is held
until somebody looks, safety distances, and what somebody else drew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.layers import CROWD
from crowdfence.voxel_state import VoxelState
from crowdfence.zones import Zone

if TYPE_CHECKING:
    from affine import Affine

CLOSED = 6
"""In rasters of states, beside the values of `VoxelState`: no crowd as far as anybody knows, and closed."""
_EDGE_CELLS = 1e-6
"""An outline along the edges of cells closes none beyond them, whatever is lost in rounding."""


def state_values(*, closed: bool = True, layer: str = CROWD) -> str:
    """What the numbers in rasters mean; on the map of another class than crowd CROWD is where that is."""
    found = {} if layer == CROWD else {VoxelState.CROWD: layer, VoxelState.EMPTY: f"no {layer}"}
    names = {state.value: found.get(state, state.name) for state in VoxelState} | (
        {CLOSED: "CLOSED by a zone"} if closed else {}
    )
    return ", ".join(f"{value} = {name}" for value, name in names.items())


def closed_cells(
    zones: Sequence[Zone], shape: tuple[int, int], local_from_cells: Affine
) -> NDArray[np.bool_]:
    """[rows, columns] of `shape`: every cell that a zone reaches into. `local_from_cells` takes (column, row)
    to local metres."""
    import shapely
    from rasterio.features import rasterize

    if not zones:
        return np.zeros(shape, dtype=np.bool_)
    inside_m = _EDGE_CELLS * abs(local_from_cells.a)
    shapes = [shapely.buffer(zone.polygon, -inside_m, join_style="mitre") for zone in zones]
    shapes = [outline for outline in shapes if not outline.is_empty]
    if not shapes:
        return np.zeros(shape, dtype=np.bool_)
    touched = rasterize(shapes, shape, transform=local_from_cells, all_touched=True, dtype="uint8")
    return np.asarray(touched > 0)


def with_closed(
    state: NDArray[np.uint8], zones: Sequence[Zone], local_from_cells: Affine, *, layer: str = CROWD
) -> NDArray[np.uint8]:
    """States [rows, columns] with `CLOSED` where a zone reaches into a cell without crowd; on the map of
    another class, whose finds close nothing, into any cell."""
    height, width = state.shape
    closed = closed_cells(zones, (height, width), local_from_cells)
    if layer == CROWD:
        closed &= state != VoxelState.CROWD
    return np.where(closed, np.uint8(CLOSED), state)


def reach_beyond(zones: Sequence[Zone], shape: tuple[int, int], local_from_cells: Affine) -> list[str]:
    """Ids of the zones that do not lie within the raster, all of them or in part."""
    import shapely

    (west, north), (east, south) = local_from_cells @ (0, 0), local_from_cells @ (shape[1], shape[0])
    edge_m = _EDGE_CELLS * abs(local_from_cells.a)
    raster = shapely.box(west, south, east, north).buffer(edge_m, join_style="mitre")
    return [zone.id for zone in zones if not raster.covers(zone.polygon)]
