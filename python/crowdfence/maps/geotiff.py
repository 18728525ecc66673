"""Height models as GeoTIFF -> Terrain."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdfence._core import COARSER, Terrain
from crowdfence.errors import one_line
from crowdfence.georeference import Georeference
from crowdfence.maps.geo_keys import compound_systems, crs_of
from crowdfence.maps.height_raster import HeightRaster
from crowdfence.maps.holes import MAX_HOLE_M2, bridge_holes
from crowdfence.maps.map_error import MapError
from crowdfence.maps.map_reading import MapReading
from crowdfence.maps.raster_projection import RasterProjection
from crowdfence.maps.source_frame import HeightRules, HeightUnit, chosen_crs
from crowdfence.maps.tangent_grid import NODE_SPACING_M, LocalGrid, resample
from crowdfence.maps.voxel_size import VoxelSize, chosen_voxel_size

if TYPE_CHECKING:
    from pyproj import CRS

# 16 km2 at 0.5 m are 64 million columns; the core needs about 30 bytes a voxel while it builds the tree.
MAX_COLUMNS = 100_000_000
# A country at 10 m or a county at 1 m.
MAX_PIXELS = 1_000_000_000
# GDAL holds the pieces that it touches as a whole.
MAX_BLOCK_PIXELS = 100_000_000
# Side of the pixel window that is held at a time.
_WINDOW_SIDE = 4096


def open_geotiff(
    path: Path,
    *,
    voxel_size_m: float | None = None,
    georeference: Georeference | None = None,
    band: int | None = None,
    nodata: float | None = None,
    crs: str | int | CRS | None = None,
    height_unit: HeightUnit = "auto",
    height_offset_m: float | None = None,
    assume_local: bool = False,
    max_hole_m2: float = MAX_HOLE_M2,
) -> MapReading:
    """Height model -> closed voxel surface in the local frame, sampled at the middle of every voxel column;
    where voxels are larger than pixels, what stands out of a column counts (`_core.raised`).

    Any reference system and any affine transform (rotated, south-up) will do; the surface is carried into
    the true tangent plane of the anchor, curvature of the earth included. Without `georeference` the anchor
    is the middle of the raster at the lowest height, rounded down to whole metres. Without `voxel_size_m`
    voxels are as large as pixels, rounded to two digits, and at least 0.25 m; pixels of more than a metre are
    interpolated to voxels of 0.5 m, or as fine as ten million columns allow (`maps.voxel_size`).

    - `band`: which one holds heights (1 = first); must be given when there are several.
    - `nodata`: a value that marks missing data besides the one that the file declares. Missing pixels are
      holes, never height zero.
    - `max_hole_m2`: holes up to this size with heights all around are bridged (see `maps.holes`), 0 for none;
      across larger ones and at the edge of the data nothing is interpolated. Columns whose height rests on
      such a bridge are `unmeasured`.
    - `crs`: takes precedence over the one in the file, for instance where that names no datum: it is refused,
      or taken as WGS84 where it names the ellipsoid of GNSS. `assume_local=True`: for files without one;
      pixels then lie in local metres as their transform says.
    - `height_unit`: "m", "ft", "us-ft", or "auto" (see `maps.source_frame.HeightRules`).
    - `height_offset_m`: added to all heights. Heights count from the WGS84 ellipsoid, unless the reference
      system has a vertical part whose geoid grid PROJ has installed. Most height models count from a geoid
      without saying so: pass its height above the ellipsoid at the place (45 to 55 m in the Alps).

    MapError for a file without reference system, transform, unit of heights or any height, implausible
    heights, sizes that do not fit into memory, a raster more than 200 km from the anchor, and damaged files.
    """
    if not (math.isfinite(max_hole_m2) and max_hole_m2 >= 0):
        raise MapError(path, f"max_hole_m2 is {max_hole_m2}, must be finite and >= 0")
    rules = HeightRules(height_unit, height_offset_m)
    with _dataset(path) as dataset:
        raster = HeightRaster(path, dataset, _height_band(path, dataset, band), nodata)
        in_file = _crs(path, dataset) if crs is None else None
        known_crs = chosen_crs(in_file, crs, assume_local=assume_local)
        projection = RasterProjection.of(raster, known_crs, georeference, rules)
        bridges, holes = bridge_holes(raster, projection.pixel_area_m2(), max_hole_m2)
        bridged = replace(projection, raster=replace(raster, bridges=bridges))
        voxels = _voxel_size(bridged, voxel_size_m)
        terrain = _terrain(path, bridged, voxels.size_m)
        marks = raster.mark_doubts(*projection.height_range, projection.frame.metres_per_height)
        doubts = (*projection.frame.doubts, *marks)
    terrain.georeference = projection.frame.georeference
    return MapReading(terrain, holes, voxels.why, doubts)


def stated_crs(path: Path) -> CRS | None:
    """The reference system in the file's header."""
    with _dataset(path) as dataset:
        return _crs(path, dataset)


@contextmanager
def _dataset(path: Path) -> Iterator[Any]:
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)  # an error of our own where it matters
        try:
            # Only this driver: other formats (VRT) can name further files and addresses.
            with compound_systems():
                dataset = rasterio.open(path, driver="GTiff")
        except RasterioError as error:
            raise MapError(path, f"not a readable GeoTIFF ({one_line(error)})") from error
    with dataset:
        _check_size(path, dataset)
        try:
            yield dataset
        except Exception as error:
            # GDAL complains about damage late, at any access, and with types that have no public name.
            if not type(error).__module__.startswith("rasterio."):
                raise
            raise MapError(path, f"truncated or damaged ({one_line(error)})") from error


def _check_size(path: Path, dataset: Any) -> None:
    pixels = dataset.width * dataset.height
    if pixels > MAX_PIXELS:
        raise MapError(
            path,
            f"has {dataset.width} x {dataset.height} pixels, the bound is {MAX_PIXELS}; cut it to the area "
            "of the flight (rio clip, see docs/maps.md)",
        )
    block = max(rows * columns for rows, columns in dataset.block_shapes)
    if block > MAX_BLOCK_PIXELS:
        raise MapError(
            path,
            f"stores {block} pixels in one piece, the bound is {MAX_BLOCK_PIXELS}; rewrite it in tiles "
            "(rio convert --co TILED=YES, see docs/maps.md)",
        )


def _height_band(path: Path, dataset: Any, band: int | None) -> int:
    from rasterio.enums import ColorInterp

    if band is None:
        meanings = zip(dataset.indexes, dataset.colorinterp, strict=True)
        candidates = [number for number, meaning in meanings if meaning is not ColorInterp.alpha]
        if len(candidates) != 1:
            raise MapError(path, f"has {dataset.count} bands; say which one holds heights, such as band=1")
        band = int(candidates[0])
        if dataset.colorinterp[band - 1] is ColorInterp.palette:
            raise MapError(
                path,
                f"band {band} holds numbers of colours, as a picture of a map does; pass band={band} if they "
                "are heights all the same",
            )
    if not 1 <= band <= dataset.count:
        raise MapError(path, f"band is {band}, the file has bands 1 to {dataset.count}")
    if np.dtype(dataset.dtypes[band - 1]).kind not in "iuf":
        raise MapError(path, f"band {band} is of type {dataset.dtypes[band - 1]}; heights are real numbers")
    scale, offset = dataset.scales[band - 1], dataset.offsets[band - 1]
    if not (math.isfinite(scale) and math.isfinite(offset) and scale != 0.0):
        raise MapError(
            path,
            f"band {band} says that heights are its values times {scale:g} plus {offset:g}: write it with "
            "the scale and offset that are meant (gdal_edit.py -scale, -offset)",
        )
    return band


def _crs(path: Path, dataset: Any) -> CRS | None:
    from pyproj.exceptions import CRSError

    try:
        return crs_of(dataset)
    except CRSError as error:
        raise MapError(path, "its coordinate reference system is damaged; pass crs") from error


def _voxel_size(projection: RasterProjection, given_m: float | None) -> VoxelSize:
    low, high = projection.local_bounds()
    pixel_m = float(f"{projection.pixel_size_m():.1e}")
    return chosen_voxel_size(
        given_m, pixel_m, f"the file's pixels of {pixel_m:g} m", float((high - low)[:2].prod())
    )


def _terrain(path: Path, projection: RasterProjection, size_m: float) -> Terrain:
    pixel_size_m = projection.pixel_size_m()
    bounds = projection.local_bounds()
    # Multiples of the voxel size, so that terrains in the same frame share their voxel grid.
    low, high = np.floor(bounds[0] / size_m), np.ceil(bounds[1] / size_m)
    columns = np.maximum(high[:2] - low[:2], 1)
    if columns.prod() > MAX_COLUMNS:
        fitting_m = math.sqrt((bounds[1, :2] - bounds[0, :2]).prod() / MAX_COLUMNS)
        raise MapError(
            path,
            f"{columns[0]:.0f} x {columns[1]:.0f} columns of {size_m:g} m are more than {MAX_COLUMNS}; pass "
            f"a voxel_size_m above {fitting_m:.3g}, or cut the file to the area of the flight (rio clip, see "
            "docs/maps.md)",
        )
    origin = low * size_m
    grid = LocalGrid(origin[0], origin[1], size_m, (int(columns[0]), int(columns[1])))
    heights = resample(
        grid,
        projection.source_from_local,
        projection.sample,
        up_range_m=(float(bounds[0, 2]), float(bounds[1, 2])),
        base_up_m=float(origin[2]),
        block_cells=int(np.clip(_WINDOW_SIDE * pixel_size_m / size_m, 1, 512)),
        node_spacing_m=0.0 if projection.bends else NODE_SPACING_M,
        highest=partial(projection.highest, side_m=size_m) if size_m > COARSER * pixel_size_m else None,
    )
    if np.isnan(heights).all():
        raise MapError(
            path,
            f"no column of {size_m:g} m has its middle on a pixel with height; pass a smaller voxel_size_m",
        )
    terrain = Terrain.from_height_map(heights, size_m, size_m, origin=origin.tolist())
    bridges = projection.raster.bridges
    if bridges is None or not len(bridges.row):
        return terrain
    return terrain.with_unmeasured(np.argwhere(grid.cells_near(*projection.reach_of(bridges, size_m))))
