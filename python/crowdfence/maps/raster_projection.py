"""Pixels of a georeferenced raster <-> local metres."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.georeference import Georeference
from crowdfence.maps.geo_keys import tiff_vertical_unit
from crowdfence.maps.height_raster import Bridges, HeightRaster
from crowdfence.maps.map_error import MapError
from crowdfence.maps.source_frame import HeightRules, SourceFrame, source_frame

if TYPE_CHECKING:
    from pyproj import CRS

# Closer to a pole, degrees of a geographic system bend too much to be interpolated.
NEAR_POLE_DEG = 85.0


@dataclass(frozen=True, slots=True)
class RasterProjection:
    """`height_range`: lowest and highest height as written in the file. `source_from_pixel`: affine transform
    from continuous pixel coordinates (column, row) to x, y of `frame`. `turn`: how far x goes once around the
    Earth, where the raster may cross the line that it begins at anew."""

    raster: HeightRaster
    frame: SourceFrame
    height_range: tuple[float, float]
    source_from_pixel: Any
    turn: float | None = None

    @staticmethod
    def of(
        raster: HeightRaster, crs: CRS | None, georeference: Georeference | None, rules: HeightRules
    ) -> RasterProjection:
        """MapError where pixels have no place or no area or heights no unit, and for a raster without
        plausible heights."""
        transform = raster.dataset.transform
        if transform.is_identity:  # what GDAL gives where there is none; rows would run to the north
            raise MapError(
                raster.path,
                "has no geotransform: nothing says where its pixels lie and how large they are; give it one "
                "(rio edit-info --transform, or a world file .tfw beside it)",
            )
        if transform.is_degenerate or not all(math.isfinite(value) for value in transform):
            raise MapError(raster.path, f"its transform {tuple(transform)[:6]} gives pixels no area")
        label = tiff_vertical_unit(raster.path) or raster.dataset.units[raster.band - 1]
        if unsaid := rules.unsaid_unit(crs, label):
            raise MapError(
                raster.path,
                f"its coordinates are in {unsaid}, and nothing says what its heights are in; pass "
                "height_unit='m', 'ft' or 'us-ft'",
            )
        metres_per_height = rules.metres_per_height(crs, label)
        height_range = raster.range(metres_per_height)
        centre = _applied(transform, raster.width / 2, raster.height / 2)
        frame = source_frame(
            crs, georeference, rules, metres_per_height, centre=centre, lowest=height_range[0]
        )
        projection = RasterProjection(raster, frame, height_range, transform)
        return replace(projection, turn=projection._turn())

    @property
    def bends(self) -> bool:
        """Whether source coordinates change too unevenly to be interpolated over 100 m."""
        crs, anchor = self.frame.crs, self.frame.georeference
        return bool(crs and crs.is_geographic and anchor and abs(anchor.latitude_deg) > NEAR_POLE_DEG)

    def source_from_local(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Local metres [N, 3] -> (x, y, height) [N, 3]; longitudes continue across the date line, and so does
        what a cylindrical projection makes of them."""
        source = self.frame.source_from_local(points)
        if self.turn is not None:
            middle = _applied(self.source_from_pixel, self.raster.width / 2, self.raster.height / 2)
            west = middle[0] - self.turn / 2
            source[:, 0] = west + (source[:, 0] - west) % self.turn
        return source

    def _turn(self) -> float | None:
        """`turn`, by what comes back of the outline from local metres where it is projected. ValueError where
        that is neither the same place nor one a turn away: the map would end there, in silence."""
        crs = self.frame.crs
        if crs is None:
            return None
        if crs.is_geographic:
            return 2 * math.pi / float(crs.axis_info[0].unit_conversion_factor)
        column, row = self._outline()
        x, _ = _applied(self.source_from_pixel, column, row)
        back = self.frame.source_from_local(self._local_from_pixel(column, row, self.height_range[0]))
        leap = back[:, 0] - x
        turn = float(np.abs(leap).max())
        # A leap is longer than any raster; by what coarse transformations differ there and back is not.
        for around, pixels in ((None, max(self.raster.width, self.raster.height)), (turn, 1.0)):
            x_back = back[:, 0] if around is None else back[:, 0] - np.round(leap / around) * around
            column_back, row_back = _applied(~self.source_from_pixel, x_back, back[:, 1])
            if max(np.abs(column_back - column).max(), np.abs(row_back - row).max()) < pixels:
                return around
        raise ValueError(
            f"it reaches beyond the edge of its reference system {crs.name!r}, as across the 180th meridian, "
            "and would be cut off there: bring it into one that holds all of it (rio warp --dst-crs EPSG:...)"
        )

    def sample(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height of the surface at source coordinates, NaN for holes."""
        return self.raster.sample(*_applied(~self.source_from_pixel, x, y))

    def highest(self, x: NDArray[np.float64], y: NDArray[np.float64], side_m: float) -> NDArray[np.float64]:
        """Greatest height in local squares of `side_m` around source coordinates, NaN where there is none."""
        wide, high = self._box(side_m)
        return self.raster.highest(*_applied(~self.source_from_pixel, x, y), (float(wide), float(high)))

    def reach_of(
        self, pixels: Bridges, cell_size_m: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Middles [N, 2] of pixels, local metres, and how near (east, north) to one the middle of a cell is
        that the pixel lies in or takes part in the height of."""
        column, row = (np.asarray(index + 0.5, np.float64) for index in (pixels.column, pixels.row))
        middles = self._local_from_pixel(column, row, pixels.height)[:, :2]
        sides_m = np.abs(self._middle_pixel()[:, :2])
        to_next_m = sides_m.sum(axis=0)
        box = self._box(cell_size_m)
        to_highest_m = (np.ceil(box) - box / 2) @ sides_m  # of a number of pixels that is rounded up
        return middles, np.maximum.reduce([to_next_m, (to_next_m + cell_size_m) / 2, to_highest_m])

    def pixel_size_m(self) -> float:
        """Shorter side of the middle pixel."""
        return float(np.linalg.norm(self._middle_pixel(), axis=1).min())

    def pixel_area_m2(self) -> float:
        """Area of the middle pixel."""
        return float(np.linalg.norm(np.cross(*self._middle_pixel())))

    def _box(self, side_m: float) -> NDArray[np.float64]:
        """Columns and rows [2] of the pixels that a local square of `side_m` spans."""
        pixels_per_m = np.abs(np.linalg.inv(self._middle_pixel()[:, :2].T))  # [column, row] by [east, north]
        return np.asarray(pixels_per_m.sum(axis=1) * side_m)

    def _middle_pixel(self) -> NDArray[np.float64]:
        """Sides of the middle pixel [2, 3], local metres."""
        column, row = self.raster.width / 2, self.raster.height / 2
        corners = self._local_from_pixel(
            np.array([column, column + 1, column]), np.array([row, row, row + 1]), self.height_range[0]
        )
        return np.asarray(corners[1:] - corners[0])

    def local_bounds(self) -> NDArray[np.float64]:
        """[2, 3]: box around outline and middle of the raster at its lowest and its highest height."""
        column, row = self._outline()
        points = np.concatenate([self._local_from_pixel(column, row, height) for height in self.height_range])
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def _outline(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Columns and rows around the raster, and its middle."""
        share = np.linspace(0, 1, 65)
        zero, one = np.zeros_like(share), np.ones_like(share)
        column = np.concatenate([share, one, share, zero, [0.5]]) * self.raster.width
        row = np.concatenate([zero, share, one, share, [0.5]]) * self.raster.height
        return column, row

    def _local_from_pixel(
        self, column: NDArray[np.float64], row: NDArray[np.float64], height: NDArray[np.float64] | float
    ) -> NDArray[np.float64]:
        x, y = _applied(self.source_from_pixel, column, row)
        return self.frame.local_from_source(x, y, np.full(x.shape, height))


def _applied(affine: Any, column: Any, row: Any) -> tuple[Any, Any]:
    """The affine transform of numbers or arrays (its own operator for this changes between versions)."""
    return affine.a * column + affine.b * row + affine.c, affine.d * column + affine.e * row + affine.f
