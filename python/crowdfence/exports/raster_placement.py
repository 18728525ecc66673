"""Where the cells of the local frame lie in a map projection.

The local frame is a plane that touches the Earth at the anchor; a raster needs a map projection. The
placement uses an azimuthal equidistant projection around the anchor (any GIS knows it) and stretches the
cells to the size that they have there: ground h metres above the ellipsoid is wider than its projection by
h / R, 19 cm in a kilometre at 1200 m. What is left over is measured over the map at its lowest and highest
ground. It is about distance^3 / 6 R^2 (0.5 mm at 5 km) plus distance * relief / 2 R (4 mm at 1 km and 50 m).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.georeference import Georeference
from crowdfence.surface_grid import SurfaceGrid

if TYPE_CHECKING:
    from affine import Affine

_SAMPLES_PER_AXIS = 5


@dataclass(frozen=True, slots=True)
class RasterPlacement:
    """Transform from (column, row), row 0 = northernmost, to the coordinates of a CRS."""

    transform: Affine
    crs_wkt: str | None
    """None when there is no georeference: the coordinates are local metres then."""
    error_m: float
    """Largest distance between a cell and its true place."""

    @staticmethod
    def of(grid: SurfaceGrid, georeference: Georeference | None) -> RasterPlacement:
        """Placement of a grid's cells; exact without a georeference."""
        if georeference is None:
            return RasterPlacement(_north_up_transform(grid.bounds_m, grid.shape), None, 0.0)
        return _in_projection(grid, georeference)


def azimuthal_equidistant_wkt(anchor: Georeference) -> str:
    """CRS around the anchor, WKT 1 because every reader of GeoTIFF understands it."""
    return (
        f'PROJCS["crowdfence local frame at {anchor.latitude_deg:.6f}, {anchor.longitude_deg:.6f}",'
        'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],'
        'AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433],'
        'AUTHORITY["EPSG","4326"]],PROJECTION["Azimuthal_Equidistant"],'
        f'PARAMETER["latitude_of_center",{float(anchor.latitude_deg)!r}],'
        f'PARAMETER["longitude_of_center",{float(anchor.longitude_deg)!r}],'
        'PARAMETER["false_easting",0],PARAMETER["false_northing",0],'
        'UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
    )


def _in_projection(grid: SurfaceGrid, anchor: Georeference) -> RasterPlacement:
    wkt = azimuthal_equidistant_wkt(anchor)
    samples = _samples(grid)
    tops = grid.top_index[grid.has_surface]
    lowest_m, highest_m = grid.height_m([int(tops.min()) + 1, int(tops.max()) + 1])
    middle = _on_map(samples, (lowest_m + highest_m) / 2, anchor, wkt)
    east = np.polynomial.Polynomial.fit(samples[:, 0], middle[:, 0], 1)
    north = np.polynomial.Polynomial.fit(samples[:, 1], middle[:, 1], 1)
    placed = np.column_stack([east(samples[:, 0]), north(samples[:, 1])]).astype(np.float64)
    errors_m = [
        np.linalg.norm(placed - _on_map(samples, level_m, anchor, wkt), axis=1).max()
        for level_m in (lowest_m, highest_m)
    ]
    west, south, east_end, north_end = grid.bounds_m
    bounds = (float(east(west)), float(north(south)), float(east(east_end)), float(north(north_end)))
    return RasterPlacement(_north_up_transform(bounds, grid.shape), wkt, float(max(errors_m)))


def _north_up_transform(bounds: tuple[float, float, float, float], shape: tuple[int, int]) -> Affine:
    from affine import Affine

    west, south, east, north = bounds
    return Affine((east - west) / shape[0], 0.0, west, 0.0, (south - north) / shape[1], north)


def _samples(grid: SurfaceGrid) -> NDArray[np.float64]:
    """Local points (x, y) [N, 2] spread over the grid, its corners among them."""
    west, south, east, north = grid.bounds_m
    x, y = np.linspace(west, east, _SAMPLES_PER_AXIS), np.linspace(south, north, _SAMPLES_PER_AXIS)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _on_map(
    points: NDArray[np.float64], level_m: float, anchor: Georeference, wkt: str
) -> NDArray[np.float64]:
    """Exact map coordinates [N, 2] of local points (x, y) [N, 2] at one height."""
    local = np.column_stack([points, np.full(len(points), level_m)])
    return anchor.projected_from_local(wkt, local)[:, :2]
