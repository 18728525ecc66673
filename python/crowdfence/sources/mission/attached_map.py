"""The map inside a mission file: an MCAP attachment, so that one file is the whole recording.

Map readers take files, so an attached map is copied into a folder that lives as long as the process.
"""

from __future__ import annotations

import re
import struct
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
MAX_MAP_BYTES = 2**30
"""Larger maps stay outside."""

_RECORD_HEADER = struct.Struct("<BQ")


def attach_map(mcap: Writer, path: Path) -> None:
    """Put a map file into a mission file. ValueError for one above `MAX_MAP_BYTES`, OSError when it cannot be
    read."""
    size = path.stat().st_size
    if size > MAX_MAP_BYTES:
        raise ValueError(
            f"the map {path} has {size / 1e9:.1f} GB, too much to put into a recording (limit "
            f"{MAX_MAP_BYTES / 1e9:.1f} GB); give it with --terrain"
        )
    mcap.add_attachment(
        create_time=0, log_time=0, name=path.name, media_type=MEDIA_TYPE, data=path.read_bytes()
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
    found = _attachment(path)
    if found is None:
        return None
    folder = mkdtemp(dir=_folder().name)
    # The name comes from a file: nothing of it may lead elsewhere.
    copy = Path(folder) / re.sub(r"[^\w.-]", "_", Path(found.name).name)
    copy.write_bytes(found.data)
    return copy


@lru_cache(maxsize=1)
def _folder() -> TemporaryDirectory[str]:
    return TemporaryDirectory(prefix="crowdfence-map-")


def _attachment(path: Path) -> Attachment | None:
    """The first map among the records outside of chunks; it stands before them in files of ours."""
    with path.open("rb") as file:
        file.seek(len(MAGIC))
        while len(header := file.read(_RECORD_HEADER.size)) == _RECORD_HEADER.size:
            opcode, length = _RECORD_HEADER.unpack(header)
            if opcode in (0, Opcode.DATA_END, Opcode.FOOTER):
                return None
            if opcode != Opcode.ATTACHMENT:
                file.seek(length, 1)
                continue
            if length > MAX_MAP_BYTES + 2**16 or len(data := file.read(length)) < length:
                raise ValueError("the map inside the file is cut off")
            found = _parsed(data)
            if found.media_type == MEDIA_TYPE:
                return found
    return None


def _parsed(data: bytes) -> Attachment:
    if struct.unpack("<I", data[-4:].rjust(4, b"\0"))[0] != zlib.crc32(data[:-4]):
        raise ValueError("the map inside the file is damaged: its checksum does not match")
    try:
        return Attachment.read(ReadDataStream(BytesIO(data)))
    except (struct.error, OverflowError, UnicodeDecodeError, ValueError, McapError) as error:
        raise ValueError(f"the map inside the file is damaged: {one_line(error)}") from error
