"""A map of the surroundings, a file of the operator's own: what the page lays around and on the terrain."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence.georeference import Georeference

_PMTILES = b"PMTiles\x03"
_TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
_KNOTS = 33
"""Places a side that go through PROJ; between them lines are straight."""


@dataclass(frozen=True, slots=True)
class BaseMap:
    """`tiles` are a PMTiles archive, which the page reads piece by piece; a `picture` is a GeoTIFF."""

    path: Path
    kind: Literal["tiles", "picture"]

    @classmethod
    def open(cls, path: Path) -> BaseMap:
        """ValueError for a file of another kind; OSError where there is none."""
        with path.open("rb") as file:
            magic = file.read(8)
        if magic == _PMTILES:
            return cls(path, "tiles")
        if magic[:4] in _TIFF:
            _check_picture(path)
            return cls(path, "picture")
        raise ValueError(f"{path} is neither a PMTiles archive (version 3) nor a GeoTIFF")

    def over(
        self, anchor: Georeference, bounds: tuple[float, float, float, float], shape: tuple[int, int]
    ) -> bytes:
        """PNG of `shape` (rows, columns) of a picture, over west, south, east, north in local metres;
        transparent where the file has nothing."""
        from PIL import Image

        column, row = _pixels_under(self.path, anchor, bounds, shape)
        colours = _sampled(self.path, column, row)
        written = io.BytesIO()
        Image.fromarray(colours, "RGBA").save(written, "PNG", compress_level=1)
        return written.getvalue()


def _check_picture(path: Path) -> None:
    import rasterio
    from rasterio.errors import RasterioError

    try:
        with rasterio.open(path) as raster:
            crs, kinds = raster.crs, set(raster.dtypes)
    except RasterioError as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    if crs is None:
        raise ValueError(f"{path} does not say where on Earth it lies")
    if kinds != {"uint8"}:
        raise ValueError(f"{path} holds {', '.join(sorted(kinds))}; a picture of the ground has bytes")


def _pixels_under(
    path: Path,
    anchor: Georeference,
    bounds: tuple[float, float, float, float],
    shape: tuple[int, int],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Column and row [R, C] in the file of the middle of every pixel asked for."""
    import rasterio

    west, south, east, north = bounds
    x, y = np.meshgrid(np.linspace(west, east, _KNOTS), np.linspace(north, south, _KNOTS))
    places = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    with rasterio.open(path) as raster:
        projected = anchor.projected_from_local(raster.crs.to_wkt(), places)
        columns, rows = ~raster.transform * (projected[:, 0], projected[:, 1])
    return _between_knots(columns, shape), _between_knots(rows, shape)


def _between_knots(values: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.float64]:
    knots = values.reshape(_KNOTS, _KNOTS)
    down, across = (((np.arange(n) + 0.5) / n * (_KNOTS - 1)) for n in shape)
    at = np.arange(_KNOTS)
    lines = np.stack([np.interp(across, at, line) for line in knots])
    upper = np.minimum(down.astype(np.int64), _KNOTS - 2)
    share = (down - upper)[:, None]
    return np.asarray(lines[upper] * (1.0 - share) + lines[upper + 1] * share)


def _sampled(path: Path, column: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Colours [R, C, 4] at pixels of the file; only that part of it is read, as fine as it is asked for."""
    import rasterio
    from rasterio.windows import Window

    colours = np.zeros((*column.shape, 4), dtype=np.uint8)
    with rasterio.open(path) as raster:
        left, right = (int(np.clip(v, 0, raster.width)) for v in (np.floor(column.min()), column.max() + 1))
        top, bottom = (int(np.clip(v, 0, raster.height)) for v in (np.floor(row.min()), row.max() + 1))
        if right <= left or bottom <= top:
            return colours
        window = Window(left, top, right - left, bottom - top)  # type: ignore[no-untyped-call]
        coarser = max(1, min(window.width // column.shape[1], window.height // column.shape[0]))
        shape = (max(1, window.height // coarser), max(1, window.width // coarser))
        bands = [1, 2, 3] if raster.count >= 3 else [1, 1, 1]
        pixels = raster.read(bands, window=window, out_shape=(3, *shape))
        mask = raster.dataset_mask(window=window, out_shape=shape)
    i = np.floor((row - top) * shape[0] / window.height).astype(np.int64)
    j = np.floor((column - left) * shape[1] / window.width).astype(np.int64)
    inside = (i >= 0) & (i < shape[0]) & (j >= 0) & (j < shape[1])
    colours[inside, :3] = pixels[:, i[inside], j[inside]].T
    colours[inside, 3] = mask[i[inside], j[inside]]
    return colours
