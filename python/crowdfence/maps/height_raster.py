"""One band of a GeoTIFF as heights: missing data, scale, plausibility, and bilinear sampling anywhere."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import one_line
from crowdfence.maps.map_error import MapError

# Land lies between -430 m (the shore of the Dead Sea) and 8850 m. Values outside these bounds are undeclared
# marks of missing data, of which -999 and 9999 are the nearest.
LOWEST_PLAUSIBLE_M = -500.0
HIGHEST_PLAUSIBLE_M = 9000.0

# Water has shores: where its level meets land, some land is less than this above it.
_LOWEST_LAND_M = 20.0

_HIGH_MARKS = (999.0, 9999.0, 99999.0, 32767.0, 65535.0)
"""Marks of missing data above all land, as stored; scales and feet bring them among heights."""

_STRIP_PIXELS = 1 << 24


@dataclass(frozen=True, slots=True, eq=False)
class Bridges:
    """Heights for pixels without one, by rising row and column."""

    row: NDArray[np.int64]
    column: NDArray[np.int64]
    height: NDArray[np.float64]

    def into(self, heights: NDArray[np.float64], rows: slice, columns: slice) -> None:
        """Fill those that lie in a window of the raster."""
        inside = slice(*np.searchsorted(self.row, [rows.start, rows.stop]))
        row, column = self.row[inside], self.column[inside]
        wanted = (column >= columns.start) & (column < columns.stop)
        heights[row[wanted] - rows.start, column[wanted] - columns.start] = self.height[inside][wanted]


@dataclass(frozen=True, slots=True)
class HeightRaster:
    """Open raster band. In continuous pixel coordinates the pixel (row, column) covers [column, column + 1) x
    [row, row + 1); its height belongs to its centre."""

    path: Path
    dataset: Any
    band: int
    nodata: float | None
    bridges: Bridges | None = None
    """Heights for small holes."""

    @property
    def width(self) -> int:
        return int(self.dataset.width)

    @property
    def height(self) -> int:
        return int(self.dataset.height)

    def read(self, rows: slice, columns: slice) -> NDArray[np.float64]:
        """Heights as written in the file (scale and offset applied), NaN where data is missing."""
        raw = self._stored(self.band, rows, columns)
        missing = np.ma.getmaskarray(raw).copy()
        values = np.ma.getdata(raw).astype(np.float64)
        # GDAL's mask is one of the file's mask, its value and its alpha, and of most types no alpha.
        for mark in (self.dataset.nodatavals[self.band - 1], self.nodata):
            if mark is not None:
                missing |= values == mark
        for alpha in self._alpha_bands():
            missing |= np.ma.getdata(self._stored(alpha, rows, columns)) == 0
        missing |= ~np.isfinite(values)
        values *= self.dataset.scales[self.band - 1]
        values += self.dataset.offsets[self.band - 1]
        values[missing] = np.nan
        if self.bridges is not None:
            self.bridges.into(values, rows, columns)
        return values

    def _alpha_bands(self) -> list[int]:
        from rasterio.enums import ColorInterp

        meanings = zip(self.dataset.indexes, self.dataset.colorinterp, strict=True)
        return [band for band, meaning in meanings if meaning is ColorInterp.alpha and band != self.band]

    def _stored(self, band: int, rows: slice, columns: slice) -> np.ma.MaskedArray[Any, Any]:
        """Values of a band as they are in the file, with GDAL's mask."""
        from rasterio.errors import RasterioError

        window = ((rows.start, rows.stop), (columns.start, columns.stop))
        try:
            return self.dataset.read(band, window=window, masked=True)
        except RasterioError as error:
            raise MapError(
                self.path,
                f"rows {rows.start} to {rows.stop - 1} cannot be read "
                f"({one_line(error.__cause__ or error)}): the file is truncated or damaged",
            ) from error

    def range(self, unit_m: float) -> tuple[float, float]:
        """Lowest and highest height as written in the file.

        MapError when no pixel has a height, or when one lies outside the plausible -500 to 9000 m: that is
        how missing data looks that the file does not declare.
        """
        lowest, highest = math.inf, -math.inf
        for first_row, strip in self.strips():
            if np.isnan(strip).all():
                continue
            lowest, highest = min(lowest, float(np.nanmin(strip))), max(highest, float(np.nanmax(strip)))
            for value in (lowest, highest):
                if not LOWEST_PLAUSIBLE_M <= value * unit_m <= HIGHEST_PLAUSIBLE_M:
                    row, column = (int(index) for index in np.argwhere(strip == value)[0])
                    raise MapError(
                        self.path,
                        f"height {value!r} at row {first_row + row}, column {column} lies outside "
                        f"[{LOWEST_PLAUSIBLE_M:g}, {HIGHEST_PLAUSIBLE_M:g}] m. If it marks missing data, "
                        f"pass nodata={self._as_stored(value)!r}; otherwise check band and height_unit",
                    )
        if lowest > highest:
            raise MapError(self.path, "no pixel has a height: all are marked as missing")
        return lowest, highest

    def mark_doubts(self, lowest: float, highest: float, unit_m: float) -> tuple[str, ...]:
        """One sentence each where the `lowest` height of the file lies far below all others, or the `highest`
        far above them and is a number that marks things: so look marks of missing data that the file does
        not declare, 0 most often."""
        stored = self._as_stored(highest)
        dtype = np.dtype(self.dataset.dtypes[self.band - 1])
        is_mark = stored in _HIGH_MARKS or (dtype.kind in "iu" and stored == np.iinfo(dtype).max)
        low = (self._mark_doubt(lowest, unit_m, 1.0, "and more", "pits"),)
        high = (self._mark_doubt(highest, unit_m, -1.0, "and less", "towers"),) if is_mark else ()
        return tuple(doubt for doubt in (*low, *high) if doubt is not None)

    def _mark_doubt(self, mark: float, unit_m: float, others: float, beyond: str, what: str) -> str | None:
        """`others` lie above (1.0) or below (-1.0)."""
        count, gap = 0, math.inf
        for _, strip in self.strips():
            count += int(np.count_nonzero(strip == mark))
            gaps = (strip - mark) * others
            gap = min(gap, float(np.min(gaps, initial=math.inf, where=gaps > 0.0)))
            if gap * unit_m < _LOWEST_LAND_M:
                return None
        if gap == math.inf:
            return None
        share, next_to_it = count / (self.width * self.height), mark + others * gap
        return (
            f"{count:,} pixels ({share:.1%}) have the height {mark:.5g} and all others {next_to_it:.5g} "
            f"{beyond}: where that marks missing data there are {what} now, in which crowds are put in wrong "
            f"places; pass nodata={self._as_stored(mark):.17g}"
        )

    def _as_stored(self, height: float) -> float:
        """The value of a pixel before its scale and offset."""
        value = (height - self.dataset.offsets[self.band - 1]) / self.dataset.scales[self.band - 1]
        return round(value) if np.dtype(self.dataset.dtypes[self.band - 1]).kind in "iu" else value

    def strips(self, first: int = 0, stop: int | None = None) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """Whole rows from `first` to before `stop`, some at a time: the number of their first and heights."""
        stop = self.height if stop is None else stop
        rows = max(1, _STRIP_PIXELS // self.width)
        for row in range(first, stop, rows):
            yield row, self.read(slice(row, min(row + rows, stop)), slice(0, self.width))

    def sample(self, column: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
        """Heights at continuous pixel coordinates, NaN outside of all pixels that have one.

        Bilinear between pixel centres. Missing neighbours take no part, so that inside a pixel with a height
        there is always one, between the heights around it, and a pixel without height stays a hole of exactly
        its size.
        """
        inside = (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height)
        result = np.full(column.shape, np.nan)
        if not inside.any():
            return result
        window, top, left = self._padded_window(column[inside], row[inside])
        result[inside] = _bilinear(window, column[inside] - left, row[inside] - top)
        return result

    def highest(
        self, column: NDArray[np.float64], row: NDArray[np.float64], box: tuple[float, float]
    ) -> NDArray[np.float64]:
        """The greatest height of the pixels whose middles lie in boxes of `box` (columns, rows) around
        continuous pixel coordinates; NaN where none has one."""
        from scipy import ndimage

        first = [np.ceil(at - side / 2 - 0.5) for at, side in zip((row, column), box[::-1], strict=True)]
        count = [math.ceil(side) for side in box[::-1]]
        low = [int(start.min()) for start in first]
        stop = [int(start.max()) + many for start, many in zip(first, count, strict=True)]
        inside = [
            slice(min(max(a, 0), size), max(min(b, size), 0))
            for a, b, size in zip(low, stop, (self.height, self.width), strict=True)
        ]
        if any(along.stop <= along.start for along in inside):
            return np.full(column.shape, np.nan)
        window = np.full((stop[0] - low[0], stop[1] - low[1]), -np.inf)
        heights = self.read(inside[0], inside[1])
        at = tuple(slice(along.start - a, along.stop - a) for along, a in zip(inside, low, strict=True))
        window[at] = np.where(np.isnan(heights), -np.inf, heights)
        for axis, many in enumerate(count):  # [i] becomes the greatest of [i, i + many)
            window = ndimage.maximum_filter1d(window, many, axis, origin=-(many // 2))
        found = window[(first[0] - low[0]).astype(np.intp), (first[1] - low[1]).astype(np.intp)]
        return np.where(np.isfinite(found), found, np.nan)

    def _padded_window(
        self, column: NDArray[np.float64], row: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], int, int]:
        """Pixels around all positions, NaN beyond the raster, and the window's top row and left column."""
        top, bottom = math.floor(row.min()) - 1, math.floor(row.max()) + 2
        left, right = math.floor(column.min()) - 1, math.floor(column.max()) + 2
        rows = slice(max(top, 0), min(bottom, self.height))
        columns = slice(max(left, 0), min(right, self.width))
        window = np.full((bottom - top, right - left), np.nan)
        window[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = self.read(
            rows, columns
        )
        return window, top, left


def _bilinear(
    window: NDArray[np.float64], column: NDArray[np.float64], row: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weighted mean of the heights of the four nearest pixels; NaN where the own pixel has none."""
    from scipy import ndimage

    at = [row - 0.5, column - 0.5]  # counted from the middle of the first pixel
    missing = np.isnan(window)
    if not missing.any():
        return ndimage.map_coordinates(window, at, order=1)
    weights = ndimage.map_coordinates((~missing).astype(np.float64), at, order=1)
    total = ndimage.map_coordinates(np.where(missing, 0.0, window), at, order=1)
    own = missing[row.astype(np.intp), column.astype(np.intp)]
    with np.errstate(invalid="ignore"):
        return np.where(own, np.nan, total / weights)
