"""The map inside a mission file: an MCAP attachment, so that one file is the whole recording.

Files beside a GeoTIFF may say which of its pixels hold heights, in which unit, or where it lies: they go with
it. Map readers take files, so an attached map is copied into a folder that lives as long as the process.
"""

from __future__ import annotations

import re
import struct
import warnings
import zlib
from functools import cache, lru_cache
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import TYPE_CHECKING

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment

from crowdfence.errors import one_line
from crowdfence.sources.mission.layout import MAGIC

if TYPE_CHECKING:
    from mcap.writer import Writer

MEDIA_TYPE = "application/x-crowdfence-map"
MEDIA_TYPE_BESIDE = "application/x-crowdfence-map-beside"
"""What lay beside the map and belongs to it; stands before it."""
MAX_MAP_BYTES = 2**30
"""Larger maps stay outside."""

_MASK, _NOTES = ".msk", ".xml"
_BESIDE = (_MASK, _NOTES, ".tfw", ".tifw", ".tiffw", ".wld", ".tab")
"""How files end that say something of the map beside them; overviews and metadata of a satellite do not."""
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_ANOTHER_FILE = b"OVERVIEW_FILE"

_RECORD_HEADER = struct.Struct("<BQ")


def attach_map(mcap: Writer, path: Path) -> None:
    """Put a map file into a mission file, and what lies beside it and belongs to it. ValueError for more than
    `MAX_MAP_BYTES` and where something beside it names further files, OSError when it cannot be read."""
    beside = _beside(path)
    size = sum(one.stat().st_size for one in (path, *beside))
    if size > MAX_MAP_BYTES:
        raise ValueError(
            f"the map {path} has {size / 1e9:.1f} GB, too much to put into a recording (limit "
            f"{MAX_MAP_BYTES / 1e9:.1f} GB): leave it out (--without-map), and name it where the recording "
            "is used (--terrain)"
        )
    for one in beside:
        _require_no_others(one.name, one.read_bytes())
        _attach(mcap, one, MEDIA_TYPE_BESIDE)
    _attach(mcap, path, MEDIA_TYPE)


def _attach(mcap: Writer, path: Path, media_type: str) -> None:
    data = path.read_bytes()
    mcap.add_attachment(create_time=0, log_time=0, name=path.name, media_type=media_type, data=data)


def _beside(path: Path) -> list[Path]:
    """Files beside a GeoTIFF that GDAL reads with it: a mask, a world file, a scale or a reference system
    that was set without touching the file itself."""
    if path.suffix.lower() not in (".tif", ".tiff"):
        return []
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        try:
            with rasterio.open(path, driver="GTiff") as dataset:
                named = [Path(name) for name in dataset.files]
        except RasterioError:
            return []  # whoever opens the map says what is wrong with it
    return [one for one in named if one.parent == path.parent and one.suffix.lower() in _BESIDE]


def _require_no_others(name: str, data: bytes) -> None:
    """ValueError for a file beside a map that sends GDAL on to files elsewhere, as one that came with a
    recording must not."""
    suffix = Path(name).suffix.lower()
    masks = suffix == _MASK and not data.startswith(_TIFF)
    if masks or (suffix == _NOTES and _ANOTHER_FILE in data.upper()):
        raise ValueError(
            f"{name}, beside the map, names further files, which a recording cannot hold: write the map as "
            "one file (rio convert)"
        )


def attached_map(path: Path) -> Path | None:
    """The map in the mission file `path`, as a file of its own; None where there is none. ValueError when it
    is damaged, OSError when it cannot be copied."""
    return _copied(path.resolve(), path.stat().st_size, path.stat().st_mtime_ns)


def is_copy(path: Path) -> bool:
    """Whether a map was copied out of a recording, and so has no place of its own."""
    return _folder.cache_info().currsize > 0 and Path(_folder().name) in path.parents


@cache
def _copied(path: Path, size: int, changed_ns: int) -> Path | None:
    found = _attachments(path)
    if not found:
        return None
    folder = Path(mkdtemp(dir=_folder().name))
    for one in found:
        # The name comes from a file: nothing of it may lead elsewhere.
        copy = folder / re.sub(r"[^\w.-]", "_", Path(one.name).name)
        copy.write_bytes(one.data)
    return copy


@lru_cache(maxsize=1)
def _folder() -> TemporaryDirectory[str]:
    return TemporaryDirectory(prefix="crowdfence-map-")


def _attachments(path: Path) -> list[Attachment]:
    """The first map among the records outside of chunks, behind what lay beside it; they stand before them in
    files of ours. Empty where there is none."""
    beside: list[Attachment] = []
    with path.open("rb") as file:
        file.seek(len(MAGIC))
        while len(header := file.read(_RECORD_HEADER.size)) == _RECORD_HEADER.size:
            opcode, length = _RECORD_HEADER.unpack(header)
            if opcode in (0, Opcode.DATA_END, Opcode.FOOTER):
                return []
            if opcode != Opcode.ATTACHMENT:
                file.seek(length, 1)
                continue
            if length > MAX_MAP_BYTES + 2**16 or len(data := file.read(length)) < length:
                raise ValueError("the map inside the file is cut off")
            found = _parsed(data)
            if found.media_type == MEDIA_TYPE:
                return [*beside, found]
            if found.media_type == MEDIA_TYPE_BESIDE and Path(found.name).suffix.lower() in _BESIDE:
                _require_no_others(found.name, found.data)
                beside.append(found)
    return []


def _parsed(data: bytes) -> Attachment:
    if struct.unpack("<I", data[-4:].rjust(4, b"\0"))[0] != zlib.crc32(data[:-4]):
        raise ValueError("the map inside the file is damaged: its checksum does not match")
    try:
        return Attachment.read(ReadDataStream(BytesIO(data)))
    except (struct.error, OverflowError, UnicodeDecodeError, ValueError, McapError) as error:
        raise ValueError(f"the map inside the file is damaged: {one_line(error)}") from error
