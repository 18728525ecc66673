"""GeoTIFF's keys, by which height models and lidar points name their reference system and unit of heights.

GDAL makes a reference system of them, but gives heights the unit of the vertical system that they name even
where the key of the unit says another; laspy reads the horizontal system alone. Layout: TIFF 6.0 and BigTIFF,
OGC 19-008r4 (GeoTIFF 1.1) and ASPRS LAS 1.4 R15, which takes the keys over.
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

if TYPE_CHECKING:
    from pyproj import CRS

DIRECTORY, DOUBLES, TEXT = 34735, 34736, 34737
"""Tags of a TIFF, and numbers of the records of a LAS file."""

_VERTICAL_UNIT = 4099
_UNITS = {9001: "metre", 9002: "foot", 9003: "US survey foot"}
_ELLIPSOID = "not specified (based on"
"""How EPSG calls the datum of heights above an ellipsoid; GeoTIFF 1.0 has a vertical system for each."""


def compound_systems() -> AbstractContextManager[Any]:
    """In here GDAL opens GeoTIFFs with the vertical part of their reference system, which it leaves out
    otherwise where a file is of version 1.0, as most are."""
    import rasterio

    return rasterio.Env(GTIFF_REPORT_COMPD_CS=True)


def crs_of(dataset: Any) -> CRS | None:
    """The reference system of an open GeoTIFF; None where it has none with a place on Earth.

    Without a vertical part where that is an ellipsoid of satellite positioning, or names nothing and only
    carries the unit, which the band's label has too. pyproj's CRSError where it is damaged.
    """
    from pyproj import CRS

    if not dataset.crs:
        return None
    crs = CRS.from_wkt(dataset.crs.to_wkt(version="WKT2_2019"))
    if crs.is_engineering:  # "local" or "unnamed"
        return None
    return crs.sub_crs_list[0] if crs.is_compound and _says_nothing(crs.sub_crs_list[1]) else crs


def _says_nothing(vertical: CRS) -> bool:
    datum = "unknown" if vertical.datum is None else vertical.datum.name.lower()
    if datum.startswith(_ELLIPSOID):
        return "wgs 84" in datum or "grs 1980" in datum
    return datum == "unknown" and vertical.name.lower() in ("", "unknown", "unnamed")


def tiff_vertical_unit(path: Path) -> str | None:
    """The unit that a key of a GeoTIFF gives its heights, None where it has no such key."""
    with path.open("rb") as file:
        order, data = _tiff_tag(file, DIRECTORY)
    return vertical_unit(struct.unpack(f"{order}{len(data) // 2}H", data[: len(data) // 2 * 2]))


def vertical_unit(directory: Sequence[int]) -> str | None:
    """The unit of heights in a directory of keys: a header of four numbers, then four for each key."""
    for at in range(4, len(directory) - 3, 4):
        key, location, _, value = directory[at : at + 4]
        if key == _VERTICAL_UNIT and location == 0:
            return _UNITS.get(value, f"EPSG unit {value}")
    return None


def _tiff_tag(file: BinaryIO, wanted: int) -> tuple[str, bytes]:
    """Byte order of a TIFF and the numbers of two bytes in a tag of its first directory, none where it is
    not there. ValueError where the file ends before."""
    order = ">" if _bytes(file, 0, 2) == b"MM" else "<"
    is_big = struct.unpack(f"{order}H", _bytes(file, 2, 2))[0] == 43
    address, count = ("Q", "Q") if is_big else ("I", "H")
    entry = f"{order}HH{address}{address}"

    def unpack(layout: str, at: int) -> Any:
        return struct.unpack(layout, _bytes(file, at, struct.calcsize(layout)))

    (first,) = unpack(order + address, 8 if is_big else 4)
    (entries,) = unpack(order + count, first)
    first += struct.calcsize(order + count)
    for number in range(entries):
        at = first + number * struct.calcsize(entry)
        tag, _, values, place = unpack(entry, at)
        if tag == wanted:
            inside = 2 * values <= struct.calcsize(order + address)
            where = at + struct.calcsize(entry) - struct.calcsize(order + address) if inside else place
            return order, _bytes(file, where, 2 * values)
    return order, b""


def _bytes(file: BinaryIO, at: int, count: int) -> bytes:
    file.seek(at)
    data = file.read(count)
    if len(data) < count:
        raise ValueError("truncated or damaged: it ends inside its tags")
    return data


def las_directory(records: Iterable[Any]) -> tuple[int, ...]:
    """The directory of keys in the records of a LAS file, empty where it has none."""
    data = _record(records, DIRECTORY)
    numbers = struct.unpack(f"<{len(data) // 2}H", data[: len(data) // 2 * 2])
    # Unused places at the end are zero, and GDAL would take them for keys.
    keys = [numbers[at : at + 4] for at in range(4, len(numbers) - 3, 4) if numbers[at]]
    return (*numbers[:3], len(keys), *(number for key in keys for number in key)) if keys else ()


def las_crs(records: Sequence[Any]) -> CRS | None:
    """The reference system that the keys of a LAS file give, with its vertical part; None as for `crs_of`."""
    from rasterio.errors import NotGeoreferencedWarning
    from rasterio.io import MemoryFile

    directory = las_directory(records)
    if not directory:
        return None
    keys = struct.pack(f"<{len(directory)}H", *directory)
    tiff = _one_pixel(
        {DIRECTORY: (3, keys), DOUBLES: (12, _record(records, DOUBLES)), TEXT: (2, _record(records, TEXT))}
    )
    with compound_systems(), MemoryFile(tiff) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)  # one pixel need not lie anywhere
        with file.open(driver="GTiff") as dataset:
            return crs_of(dataset)


def _record(records: Iterable[Any], number: int) -> bytes:
    for record in records:
        if record.record_id == number and record.user_id.startswith("LASF_Projection"):
            return bytes(record.record_data_bytes())
    return b""


def _one_pixel(tags: dict[int, tuple[int, bytes]]) -> bytes:
    """A TIFF of one pixel with further tags: type and bytes of each."""
    bytes_of = {2: 1, 3: 2, 12: 8}
    plain = {256: 1, 257: 1, 258: 8, 259: 1, 262: 1, 273: 8, 277: 1, 278: 1, 279: 1}  # the pixel is at byte 8
    further = {tag: (kind, data) for tag, (kind, data) in tags.items() if data}
    at = 10 + 2 + 12 * (len(plain) + len(further)) + 4
    entries, body = b"", b""
    for tag, value in plain.items():
        entries += struct.pack("<HHIHH", tag, 3, 1, value, 0)
    for tag, (kind, data) in further.items():
        place = at + len(body) if len(data) > 4 else int.from_bytes(data.ljust(4, b"\0"), "little")
        entries += struct.pack("<HHII", tag, kind, len(data) // bytes_of[kind], place)
        body += data + b"\0" * (len(data) % 2) if len(data) > 4 else b""
    count = struct.pack("<H", len(plain) + len(further))
    return b"II\x2a\0" + struct.pack("<I", 10) + b"\0\0" + count + entries + bytes(4) + body
