"""The map as a GeoTIFF: band 1 probability, band 2 state and what zones close, band 3 state alone."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from os import PathLike
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import atomic_path
from crowdfence.exports.closed_cells import state_values, with_closed
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.raster_placement import RasterPlacement
from crowdfence.georeference import Georeference
from crowdfence.iso_time import iso_utc
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.zones import Zone
from crowdfence.zones.zone import closed_of

LOCAL_TAG = "LOCAL_FROM_CELLS"
"""The same placement in local metres, exact: zones are drawn there."""
_Value = TypeVar("_Value", np.float32, np.uint8)


def write_geotiff(
    path: str | PathLike[str],
    grid: SurfaceGrid,
    description: MapDescription,
    georeference: Georeference | None,
    zones: Sequence[Zone] = (),
) -> None:
    """Write the grid and everything that is closed (all of a `ZoneSet`), north up (row 0 = northernmost),
    float32, tiled, deflate.

    Band 1 is NaN, the file's nodata value, where the ground was never seen: it is never 0 for lack of data.
    Band 2 holds `VoxelState` values, and 6 where a zone reaches into a cell without crowd (of another layer:
    into any cell); band 3 the same without zones. Without a georeference the file has no CRS and its
    coordinates are local metres. Raises OSError when the file cannot be written.
    """
    import rasterio

    zones = closed_of(zones)

    placement = RasterPlacement.of(grid, georeference)
    width, height = grid.shape
    local = RasterPlacement.of(grid, None).transform
    state = _north_up(grid.state)
    with (
        atomic_path(path) as temporary,
        rasterio.open(
            temporary,
            "w",
            driver="GTiff",
            width=width,
            height=height,
            count=3,
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
        raster.write(with_closed(state, zones, local, layer=description.layer).astype(np.float32), 2)
        raster.write(state.astype(np.float32), 3)
        raster.set_band_description(1, f"probability of {description.layer} (NaN = never seen)")
        raster.set_band_description(2, "state, and what zones close")
        raster.set_band_description(3, "state, without zones")
        raster.update_tags(**_tags(description), **_placement_tags(placement, georeference))
        raster.update_tags(**{LOCAL_TAG: json.dumps(local[:6])})
        raster.update_tags(2, VALUES=state_values(layer=description.layer))
        raster.update_tags(3, VALUES=state_values(closed=False, layer=description.layer))


def _north_up(array: NDArray[_Value]) -> NDArray[_Value]:
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
        "THRESHOLD": repr(float(description.threshold)),
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
        "ANCHOR_LATITUDE_DEG": repr(float(georeference.latitude_deg)),
        "ANCHOR_LONGITUDE_DEG": repr(float(georeference.longitude_deg)),
        "ANCHOR_HEIGHT_M": repr(float(georeference.height_m)),
        "POSITION_ERROR_M": f"{math.ceil(placement.error_m * 1e4) / 1e4:.4f}",
    }
