"""The states of the ground as a raster in local metres, those of a run's `crowd_map.tif` read again."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import one_line
from crowdfence.exports.geotiff import LOCAL_TAG
from crowdfence.exports.raster_placement import RasterPlacement
from crowdfence.maps.map_error import MapError
from crowdfence.surface_grid import SurfaceGrid

if TYPE_CHECKING:
    from affine import Affine

_STATE_BAND = 3
"""Without zones."""


@dataclass(frozen=True, slots=True, eq=False)
class StateRaster:
    """What is known of the ground, seen from above."""

    state: NDArray[np.uint8]
    """[rows, columns] `VoxelState`, row 0 northernmost. Ends near what was seen: beyond it nobody looked."""
    local_from_cells: Affine
    """From (column, row) to local metres."""

    @staticmethod
    def of(grid: SurfaceGrid) -> StateRaster:
        return StateRaster(grid.state.T[::-1], RasterPlacement.of(grid, None).transform)


def read_states(crowd_map: str | Path) -> StateRaster | None:
    """None for a file that does not say where its cells lie in the local frame, as older ones do not.
    MapError for one that cannot be read."""
    import rasterio
    from affine import Affine
    from rasterio.errors import RasterioError

    try:
        with rasterio.open(crowd_map) as raster:
            told = raster.tags().get(LOCAL_TAG)
            if told is None or raster.count < _STATE_BAND:
                return None
            return StateRaster(raster.read(_STATE_BAND).astype(np.uint8), Affine(*json.loads(told)))
    except (RasterioError, TypeError, ValueError) as error:
        why = one_line(error.__cause__ or error)
        raise MapError(crowd_map, f"truncated or damaged ({why}); run again to have it anew") from error
