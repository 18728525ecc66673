"""Counts and offsets in a LAS or LAZ file against the size of the file.

Readers trust these numbers: a wrong one can make them loop for hours, or end the process because it asks
for more memory than there is. Layout: ASPRS LAS 1.4 R15, public header block and variable length records;
LASzip's record 22204, its table of chunks and the head of a chunk of layers.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, BinaryIO

from crowdfence.maps.map_error import MapError

# Bits of the point format that mark compression, and LASzip's compressors that write a table of chunks.
_COMPRESSED = 0xC0
_CHUNKED = (2, 3)
_LAYERED = 3
# Layers of LASzip's kinds of fields in such chunks: point, RGB, RGB with infrared, wave packet. Extra bytes
# (14) have one each.
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_EXTRA_BYTES = 14


def check_las_header(path: Path) -> None:
    """MapError unless all records and points that the header announces can be in the file."""
    with path.open("rb") as file:
        _HeaderCheck(path, file, path.stat().st_size).run()


class _HeaderCheck:
    def __init__(self, path: Path, file: BinaryIO, size: int) -> None:
        self._path = path
        self._file = file
        self._size = size

    def run(self) -> None:
        signature = self._bytes(0, 4)
        if signature != b"LASF":
            raise MapError(self._path, f"starts with {signature!r}, a lidar file starts with b'LASF'")
        (minor,) = self._unpack("<B", 25)
        header_bytes, points_at, vlrs, format_id, point_bytes, points = self._unpack("<HIIBHI", 94)
        if minor >= 4:
            evlrs_at, evlrs, points = self._unpack("<QIQ", 235)
            self._walk(evlrs_at, evlrs, self._size, head="<H16sHQ", head_bytes=60)
        self._require("offset of the points", points_at, self._size)
        laszip_at, laszip_bytes = self._walk(header_bytes, vlrs, points_at, head="<H16sHH", head_bytes=54)
        if not format_id & _COMPRESSED:
            self._require("number of points", points, (self._size - points_at) // max(1, point_bytes))
        elif laszip_at is not None and (compressor := self._unpack("<H", laszip_at)[0]) in _CHUNKED:
            self._check_chunk_table(points_at, points)
            if compressor == _LAYERED:
                self._check_layers(laszip_at, laszip_bytes, points_at)

    def _walk(self, at: int, count: int, end: int, *, head: str, head_bytes: int) -> tuple[int | None, int]:
        """Follows variable length records up to `end`; where the data of LASzip's record starts, if any, and
        its length."""
        found: tuple[int | None, int] = None, 0
        for _ in range(count):
            self._require("start of a record", at, end - head_bytes)
            _, user, kind, length = self._unpack(head, at)
            self._require("length of a record", length, end - at - head_bytes)
            if kind == 22204 and user.startswith(b"laszip encoded"):
                found = at + head_bytes, length
            at += head_bytes + length
        return found

    def _check_chunk_table(self, points_at: int, points: int) -> None:
        (table_at,) = self._unpack("<q", points_at)
        if table_at == -1:  # written to a stream: the offset follows at the end
            (table_at,) = self._unpack("<q", self._size - 8)
        self._require("offset of the table of chunks", table_at, self._size - 8)
        _, chunks = self._unpack("<II", max(0, table_at))
        self._require("number of chunks", chunks, min(points, self._size))

    def _check_layers(self, laszip_at: int, laszip_bytes: int, points_at: int) -> None:
        """A chunk begins with its first point, their number, and the length of every layer."""
        import lazrs

        (count,) = self._unpack("<H", laszip_at + 32)
        fields = [self._unpack("<HHH", laszip_at + 34 + 6 * number) for number in range(count)]
        layers = sum(size if kind == _EXTRA_BYTES else _LAYERS.get(kind, 0) for kind, size, _ in fields)
        head_bytes = sum(size for _, size, _ in fields) + 4
        vlr = lazrs.LazVlr(self._bytes(laszip_at, laszip_bytes))
        self._file.seek(points_at)
        at = points_at + 8
        for _, chunk_bytes in lazrs.read_chunk_table(self._file, vlr):
            if chunk_bytes:
                most = chunk_bytes - head_bytes - 4 * layers
                lengths = self._unpack(f"<{layers}I", at + head_bytes)
                self._require("length of the layers of a chunk", sum(lengths), most)
            at += chunk_bytes

    def _unpack(self, layout: str, at: int) -> tuple[Any, ...]:
        return struct.unpack(layout, self._bytes(at, struct.calcsize(layout)))

    def _bytes(self, at: int, count: int) -> bytes:
        self._file.seek(at)
        data = self._file.read(count)
        if len(data) < count:
            raise MapError(
                self._path, f"ends at byte {self._size}, inside its header or a record: truncated or damaged"
            )
        return data

    def _require(self, what: str, value: int, most: int) -> None:
        if not 0 <= value <= most:
            raise MapError(
                self._path,
                f"its header gives {value} as {what}, at most {most} is possible: truncated or damaged",
            )
