"""The map as a GeoTIFF: band 1 probability, band 2 state."""

from __future__ import annotations

import json
import math
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import atomic_path
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.raster_placement import RasterPlacement
from crowdfence.georeference import Georeference
from crowdfence.iso_time import iso_utc
from crowdfence.sources.layers import CROWD
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.voxel_state import VoxelState


def write_geotiff(
    path: str | PathLike[str],
    grid: SurfaceGrid,
    description: MapDescription,
    georeference: Georeference | None,
) -> None:
    """Write the grid, north up (row 0 = northernmost), float32, tiled, deflate.

    Band 1 is NaN, the file's nodata value, where the ground was never seen: it is never 0 for lack of data.
    Band 2 holds `VoxelState` values. Without a georeference the file has no CRS and its coordinates are local
    metres. Raises OSError when the file cannot be written.
    """
    import rasterio

    placement = RasterPlacement.of(grid, georeference)
    width, height = grid.shape
    with (
        atomic_path(path) as temporary,
        rasterio.open(
            temporary,
            "w",
            driver="GTiff",
            width=width,
            height=height,
            count=2,
            dtype="float32",
            nodata=float("nan"),
            crs=placement.crs_wkt,
            transform=placement.transform,
            tiled=True,
            blockxsize=256,
            blockysize=256,
            compress="deflate",
            predictor=3,
            BIGTIFF="IF_SAFER",
        ) as raster,
    ):
        raster.write(_north_up(_float32_never_below(grid.probability)), 1)
        raster.write(_north_up(grid.state.astype(np.float32)), 2)
        raster.set_band_description(1, f"probability of {description.layer} (NaN = never seen)")
        raster.set_band_description(2, "state")
        raster.update_tags(**_tags(description), **_placement_tags(placement, georeference))
        raster.update_tags(2, VALUES=_states(description.layer))


def _states(layer: str) -> str:
    """What the numbers of band 2 mean; on the map of another class than crowd, CROWD is where that is."""
    if layer == CROWD:
        return ", ".join(f"{state.value} = {state.name}" for state in VoxelState)
    names = {VoxelState.CROWD: layer, VoxelState.EMPTY: f"no {layer}"}
    return ", ".join(f"{state.value} = {names.get(state, state.name)}" for state in VoxelState)


def _north_up(array: NDArray[np.float32]) -> NDArray[np.float32]:
    """[X, Y] from south-west -> rows from the north, columns from the west."""
    return array.T[::-1]


def _float32_never_below(probability: NDArray[np.float64]) -> NDArray[np.float32]:
    """float32 that is never below its float64: a cell at the threshold must not fall under it by rounding."""
    rounded = probability.astype(np.float32)
    return np.where(rounded < probability, np.nextafter(rounded, np.float32(2.0)), rounded)


def _tags(description: MapDescription) -> dict[str, str]:
    first_ns = description.first_stamp_ns
    return {
        "METHOD": description.method,
        "PARAMETERS": json.dumps(dict(description.parameters)),
        "THRESHOLD": repr(description.threshold),
        "STAMP_UTC": iso_utc(description.stamp_ns),
        "STAMP_NS": str(description.stamp_ns),
        "FIRST_INSTANT_UTC": "" if first_ns is None else iso_utc(first_ns),
        "DRONES": " ".join(description.drones),
        "LAYER": description.layer,
        "MISSION": description.mission,
    }


def _placement_tags(placement: RasterPlacement, georeference: Georeference | None) -> dict[str, str]:
    if georeference is None:
        return {"FRAME": "local east-north-up metres, not georeferenced"}
    return {
        "FRAME": "azimuthal equidistant around the anchor of the local frame",
        "ANCHOR_LATITUDE_DEG": repr(georeference.latitude_deg),
        "ANCHOR_LONGITUDE_DEG": repr(georeference.longitude_deg),
        "ANCHOR_HEIGHT_M": repr(georeference.height_m),
        "POSITION_ERROR_M": f"{math.ceil(placement.error_m * 1e4) / 1e4:.4f}",
    }
