"""PMTiles archives (specification version 3), small ones: pictures or areas of one layer per tile."""

import io
import json
import math
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from PIL import Image

_PNG, _MVT = 2, 1
_PLAIN = 1
_TILE_PIXELS = 256
_EXTENT = 4096

Box = tuple[float, float, float, float]
"""West, south, east, north in degrees."""
Colour = Callable[[np.ndarray, np.ndarray], np.ndarray]


def write_pictures(path: Path, box: Box, zoom: int, colour: Colour) -> Path:
    """`colour` gives uint8 [..., 3] at latitudes and longitudes in degrees."""

    def tile(x: int, y: int) -> bytes:
        across, down = np.meshgrid(
            *(start + (np.arange(_TILE_PIXELS) + 0.5) / _TILE_PIXELS for start in (x, y))
        )
        longitude = across / 2**zoom * 360 - 180
        latitude = np.degrees(np.arctan(np.sinh(np.pi * (1 - 2 * down / 2**zoom))))
        written = io.BytesIO()
        Image.fromarray(colour(latitude, longitude)).save(written, "PNG")
        return written.getvalue()

    return _write(path, box, zoom, _PNG, {"attribution": '<a href="#">Somebody</a>'}, tile)


def write_areas(path: Path, box: Box, zoom: int, layer: str, area: Box) -> Path:
    """One rectangle of `layer` on all tiles that it touches, and on all others one far away from it."""

    def tile(x: int, y: int) -> bytes:
        west, north = (
            round((v - start) * _EXTENT) for v, start in zip(_at(area[0], area[3], zoom), (x, y), strict=True)
        )
        east, south = (
            round((v - start) * _EXTENT) for v, start in zip(_at(area[2], area[1], zoom), (x, y), strict=True)
        )
        corners = [
            (max(min(c, 2 * _EXTENT), -_EXTENT), max(min(r, 2 * _EXTENT), -_EXTENT))
            for c, r in ((west, north), (east, north), (east, south), (west, south))
        ]
        return _vector_tile(layer, corners)

    return _write(path, box, zoom, _MVT, {"vector_layers": [{"id": layer, "fields": {}}]}, tile)


def _at(longitude: float, latitude: float, zoom: int) -> tuple[float, float]:
    """In tiles from the north-west corner of the world."""
    y = math.asinh(math.tan(math.radians(latitude)))
    return (longitude / 360 + 0.5) * 2**zoom, (0.5 - y / (2 * math.pi)) * 2**zoom


def _write(
    path: Path, box: Box, zoom: int, kind: int, metadata: object, tile: Callable[[int, int], bytes]
) -> Path:
    left, top = (int(v) for v in _at(box[0], box[3], zoom))
    right, bottom = (int(v) for v in _at(box[2], box[1], zoom))
    places = [(x, y) for x in range(left, right + 1) for y in range(top, bottom + 1)]
    tiles = sorted((_number(zoom, x, y), tile(x, y)) for x, y in places)
    directory = _directory([(number, len(body)) for number, body in tiles])
    told, bodies = json.dumps(metadata).encode(), b"".join(body for _, body in tiles)
    start = 127
    header = b"PMTiles\x03" + struct.pack(
        "<11Q",
        *(start, len(directory)),
        *(start + len(directory), len(told)),
        *(0, 0),
        *(start + len(directory) + len(told), len(bodies)),
        *(len(tiles), len(tiles), len(tiles)),
    )
    header += struct.pack("<6B", 1, _PLAIN, _PLAIN, kind, zoom, zoom)
    header += struct.pack("<4i", *(round(v * 1e7) for v in box))
    header += struct.pack("<B2i", zoom, round((box[0] + box[2]) * 5e6), round((box[1] + box[3]) * 5e6))
    path.write_bytes(header + directory + told + bodies)
    return path


def _directory(entries: list[tuple[int, int]]) -> bytes:
    """Number and length of tiles that lie one behind the other."""
    numbers = [number for number, _ in entries]
    steps = [number - before for number, before in zip(numbers, [0, *numbers[:-1]], strict=True)]
    values = [len(entries), *steps, *[1] * len(entries), *(length for _, length in entries)]
    values += [1] + [0] * (len(entries) - 1)  # an offset plus one, and "right behind the one before"
    return b"".join(_varint(value) for value in values)


def _number(zoom: int, x: int, y: int) -> int:
    """Along the Hilbert curve, behind all tiles of coarser zooms."""
    number, side = (4**zoom - 1) // 3, 1 << zoom
    step = side >> 1
    while step:
        right, down = int(x & step > 0), int(y & step > 0)
        number += step * step * ((3 * right) ^ down)
        if not down:
            if right:
                x, y = side - 1 - x, side - 1 - y
            x, y = y, x
        step >>= 1
    return number


def _vector_tile(layer: str, corners: list[tuple[int, int]]) -> bytes:
    """Mapbox Vector Tile 2.1: one polygon, clockwise on the screen."""
    geometry = [9, *_zigzag(corners[0])]
    geometry += [(len(corners) - 1) << 3 | 2]
    for (x, y), (u, v) in zip(corners[1:], corners[:-1], strict=True):
        geometry += _zigzag((x - u, y - v))
    geometry += [15]
    packed = b"".join(_varint(value) for value in geometry)
    feature = _varint(3 << 3) + _varint(3) + _field(4, packed)
    body = _varint(15 << 3) + _varint(2) + _field(1, layer.encode()) + _field(2, feature)
    return _field(3, body + _varint(5 << 3) + _varint(_EXTENT))


def _field(number: int, body: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(body)) + body


def _zigzag(values: tuple[int, int]) -> Iterator[int]:
    return ((value << 1) ^ (value >> 31) for value in values)


def _varint(value: int) -> bytes:
    body = b""
    while value > 127:
        body += bytes([value & 127 | 128])
        value >>= 7
    return body + bytes([value])
