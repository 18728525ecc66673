"""One pass over the records of an MCAP file, whole or damaged, one chunk in memory at a time.

The library's readers need the index at the end of the file, which a recording that was cut off does not
have, and trust the lengths they find. This one walks the records from the front, checks every length against
what is left before it reads or allocates, and tells where each message lies so that its bytes can be fetched
later. Format: https://mcap.dev/spec.
"""

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema

from crowdfence.errors import one_line
from crowdfence.sources.mission.layout import MAGIC

MAX_CHUNK_BYTES = 2**28
"""No chunk or record may be larger than this, packed or unpacked; writers use 1 to 4 MiB."""

_RECORD_HEADER = struct.Struct("<BQ")
_MESSAGE_HEADER = struct.Struct("<HIQQ")
_CACHED_CHUNKS = 4


@dataclass(frozen=True, slots=True)
class MessageLocation:
    """Where the payload of a message lies: in the chunk whose record begins at `chunk_offset`, or, without a
    chunk, in the file itself."""

    chunk_offset: int | None
    offset: int
    length: int


@dataclass(frozen=True, slots=True)
class StoredMessage:
    """A message met by the scan."""

    topic: str
    schema_name: str
    log_time_ns: int
    location: MessageLocation
    data: bytes | memoryview
    """The payload; only valid until the scan goes on."""


@dataclass(slots=True)
class McapFile:
    """An MCAP file on disk. ValueError when it does not begin like one."""

    path: Path
    damage: list[str] = field(default_factory=list)
    """After a scan: what could not be read, one sentence each."""
    messages: int = 0
    """After a scan: how many there are."""
    _chunk: Callable[[int], bytes] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise ValueError(
                    f"{self.path} is not an MCAP file: it does not begin with the MCAP magic bytes"
                )
        self._chunk = lru_cache(maxsize=_CACHED_CHUNKS)(self._load_chunk)

    def scan(self) -> Iterator[Metadata | StoredMessage]:
        """Metadata records and messages in the order of the file. Damage is skipped and noted in `damage`."""
        self.damage.clear()
        self.messages = 0
        scan = _Scan(self.path.stat().st_size, self.damage)
        with self.path.open("rb") as file:
            file.seek(len(MAGIC))
            for found in scan.records(file):
                self.messages += isinstance(found, StoredMessage)
                yield found

    def payload(self, location: MessageLocation) -> bytes:
        """The bytes of a message found by `scan`. ValueError or OSError when they are no longer there."""
        if location.chunk_offset is not None:
            data = self._chunk(location.chunk_offset)
            return data[location.offset : location.offset + location.length]
        with self.path.open("rb") as file:
            file.seek(location.offset)
            data = file.read(location.length)
        if len(data) != location.length:
            raise ValueError(f"{self.path} ends inside a message at byte {location.offset}")
        return data

    def _load_chunk(self, offset: int) -> bytes:
        with self.path.open("rb") as file:
            file.seek(offset)
            header = file.read(_RECORD_HEADER.size)
            if len(header) < _RECORD_HEADER.size:
                raise ValueError(
                    f"{self.path} no longer reaches byte {offset}: it was cut after it was opened"
                )
            _, length = _RECORD_HEADER.unpack(header)
            return _unpack_chunk(file.read(min(length, MAX_CHUNK_BYTES)))


class _Scan:
    """State of one pass: the schemas and channels met so far."""

    def __init__(self, file_size: int, damage: list[str]) -> None:
        self._file_size = file_size
        self._damage = damage
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._last_log_time_ns: int | None = None

    def records(self, file: BinaryIO) -> Iterator[Metadata | StoredMessage]:
        while True:
            start = file.tell()
            header = file.read(_RECORD_HEADER.size)
            if len(header) < _RECORD_HEADER.size:
                self._cut_off(start)
                return
            opcode, length = _RECORD_HEADER.unpack(header)
            left = self._file_size - file.tell()
            if opcode == 0 or length > left:
                self._note(
                    f"the record at byte {start} (type {opcode}) claims {length} bytes, {left} are left: "
                    f"{self._file_size - start} bytes lost{self._read_until()}"
                )
                return
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                self._check_end(file)
                return
            if opcode == Opcode.CHUNK:
                yield from self._chunk(file, start, length)
            elif opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
                yield from self._record(opcode, file, start, length)
            file.seek(start + _RECORD_HEADER.size + length)

    def _chunk(self, file: BinaryIO, start: int, length: int) -> Iterator[Metadata | StoredMessage]:
        try:
            if length > MAX_CHUNK_BYTES:
                raise ValueError(f"it has {length} bytes (limit {MAX_CHUNK_BYTES})")
            data = _unpack_chunk(file.read(length))
        except ValueError as error:
            self._note(f"the chunk at byte {start} cannot be read ({error}): its messages are lost")
            return
        offset = 0
        while offset + _RECORD_HEADER.size <= len(data):
            opcode, size = _RECORD_HEADER.unpack_from(data, offset)
            offset += _RECORD_HEADER.size
            if size > len(data) - offset:
                self._note(
                    f"a record in the chunk at byte {start} is longer than the chunk: the rest of it is lost"
                )
                return
            yield from self._parse(opcode, memoryview(data)[offset : offset + size], start, offset)
            offset += size

    def _record(
        self, opcode: int, file: BinaryIO, start: int, length: int
    ) -> Iterator[Metadata | StoredMessage]:
        if length > MAX_CHUNK_BYTES:
            self._note(
                f"the record at byte {start} has {length} bytes (limit {MAX_CHUNK_BYTES}): it is left out"
            )
            return
        yield from self._parse(opcode, memoryview(file.read(length)), None, file.tell() - length)

    def _parse(
        self, opcode: int, payload: memoryview, chunk_offset: int | None, offset: int
    ) -> Iterator[Metadata | StoredMessage]:
        try:
            if opcode == Opcode.MESSAGE:
                yield self._message(payload, chunk_offset, offset)
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(ReadDataStream(BytesIO(payload)))
                self._schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(payload)))
                self._channels[channel.id] = channel
            elif opcode == Opcode.METADATA:
                yield Metadata.read(ReadDataStream(BytesIO(payload)))
        except (struct.error, OverflowError, UnicodeDecodeError, ValueError, McapError) as error:
            where = (
                f"byte {offset}"
                if chunk_offset is None
                else f"byte {offset} of the chunk at byte {chunk_offset}"
            )
            self._note(f"the record at {where} (type {opcode}) is damaged: {one_line(error)}")

    def _message(self, payload: memoryview, chunk_offset: int | None, offset: int) -> StoredMessage:
        channel_id, _, log_time_ns, _ = _MESSAGE_HEADER.unpack_from(payload)
        if channel_id not in self._channels:
            raise ValueError(f"message of channel {channel_id}, which was not announced")
        channel = self._channels[channel_id]
        schema = self._schemas.get(channel.schema_id)
        self._last_log_time_ns = log_time_ns
        data = payload[_MESSAGE_HEADER.size :]
        location = MessageLocation(chunk_offset, offset + _MESSAGE_HEADER.size, len(data))
        return StoredMessage(channel.topic, schema.name if schema else "", log_time_ns, location, data)

    def _check_end(self, file: BinaryIO) -> None:
        file.seek(-min(len(MAGIC), self._file_size), 2)
        if file.read() != MAGIC:
            self._note("the index at the end of the file is missing; all messages before it were read")

    def _cut_off(self, start: int) -> None:
        self._note(f"the file ends at byte {start} without its closing records{self._read_until()}")

    def _read_until(self) -> str:
        if self._last_log_time_ns is None:
            return "; no message was read"
        return f"; messages were read up to stamp {self._last_log_time_ns}"

    def _note(self, sentence: str) -> None:
        self._damage.append(sentence)


def _unpack_chunk(payload: bytes) -> bytes:
    """The records inside a chunk. ValueError when lengths, compression or checksum are wrong."""
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(payload)))
    except (struct.error, OverflowError, UnicodeDecodeError, McapError) as error:
        raise ValueError(f"its header is damaged: {error}") from error
    if chunk.uncompressed_size > MAX_CHUNK_BYTES:
        raise ValueError(f"it unpacks to {chunk.uncompressed_size} bytes (limit {MAX_CHUNK_BYTES})")
    data = _decompress(chunk)
    if len(data) != chunk.uncompressed_size:
        raise ValueError(f"it unpacks to {len(data)} bytes, its header says {chunk.uncompressed_size}")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("its checksum does not match")
    return data


def _decompress(chunk: Chunk) -> bytes:
    if chunk.compression == "":
        return chunk.data
    if chunk.compression == "zstd":
        return _decompress_zstd(chunk)
    if chunk.compression == "lz4":
        import lz4.frame  # type: ignore[import-untyped]

        try:
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, chunk.uncompressed_size))
        except RuntimeError as error:
            raise ValueError(f"lz4: {error}") from error
    raise ValueError(f"unknown compression {chunk.compression!r} (zstd, lz4 or none)")


def _decompress_zstd(chunk: Chunk) -> bytes:
    import zstandard

    try:
        # The frame's own size would be allocated as it stands.
        declared = zstandard.frame_content_size(chunk.data)
        if declared not in (-1, chunk.uncompressed_size):
            raise ValueError(f"zstd frame of {declared} bytes, the chunk says {chunk.uncompressed_size}")
        return zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=chunk.uncompressed_size)
    except zstandard.ZstdError as error:
        raise ValueError(f"zstd: {error}") from error
