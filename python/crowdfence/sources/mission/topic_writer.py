"""Writes ROS 2 messages by topic to an MCAP file that is whole or absent."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, NamedTuple, TypeVar

from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import Writer

from crowdfence.atomic_file import file_at, lock_for_writing
from crowdfence.sources.mission import ros2_messages

CHUNK_BYTES = 2**20
"""A chunk is written when it holds this much; a kill loses the one at hand."""

_ENDLESS = "{sec: 9223372036, nsec: 854775807}"
LATCHED_QOS = (
    "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n"
    f"  deadline: {_ENDLESS}\n  lifespan: {_ENDLESS}\n"
    f"  liveliness: 1\n  liveliness_lease_duration: {_ENDLESS}\n"
    "  avoid_ros_namespace_conventions: false\n"
)
"""How rosbag2 marks a topic whose last message those get too who come later (transient local)."""

WriterT = TypeVar("WriterT", bound="TopicWriter")


class TopicMessage(NamedTuple):
    """One message, encoded."""

    stamp_ns: int
    topic: str
    message_type: str
    data: bytes
    latched: bool = False
    """Sent once, for everybody who comes later."""


class TopicWriter:
    """An MCAP file that grows as `<path>.part` and takes its name when it is closed, so that no half-written
    file ever carries it; a context manager. After an error inside the `with` block nothing is left behind. A
    link stays a link: what it leads to is written.

    FileExistsError while another process, or another writer of this one, writes the same file.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path = Path(path)
        self._part_path = part_path(self.path)
        self._file = _locked_and_empty(self.path)
        self._mcap = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._mcap.start(profile=Profile.ROS2, library="crowdfence")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        self._mcap.add_metadata(name, dict(values))

    def add_message(self, message: TopicMessage) -> None:
        """A message of its own stamp."""
        self._write(
            message.topic, message.message_type, message.data, message.stamp_ns, latched=message.latched
        )

    def close(self) -> None:
        """Finish the file and give it its name. Closing twice is harmless."""
        if self._file.closed:
            return
        self._mcap.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        os.replace(
            self._part_path, file_at(self.path)
        )  # while it is locked: nobody else has begun to write it
        self._file.close()

    def abandon(self) -> None:
        """Stop writing and leave the partial file, which can be read as far as it goes."""
        with contextlib.suppress(OSError):
            self._file.close()

    def discard(self) -> None:
        """Stop writing and remove the partial file."""
        if not self._file.closed:
            self._part_path.unlink(missing_ok=True)  # while it is locked: it is ours
        self.abandon()  # closing flushes, which fails again on a full disk

    def __enter__(self: WriterT) -> WriterT:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self.discard()
            return
        try:
            self.close()
        except BaseException:
            self.discard()
            raise

    def _write(
        self,
        name: str,
        message_type: str,
        message: bytes,
        log_time_ns: int,
        stamp_ns: int | None = None,
        *,
        latched: bool = False,
    ) -> None:
        published_ns = log_time_ns if stamp_ns is None else stamp_ns
        channel = self._channel(name, message_type, latched)
        self._mcap.add_message(channel, log_time=log_time_ns, data=message, publish_time=published_ns)

    def _channel(self, name: str, message_type: str, latched: bool) -> int:
        if message_type not in self._schemas:
            definition = ros2_messages.DEFINITIONS[message_type].encode()
            self._schemas[message_type] = self._mcap.register_schema(
                message_type, SchemaEncoding.ROS2, definition
            )
        if name not in self._channels:
            metadata = {"offered_qos_profiles": LATCHED_QOS} if latched else {}
            self._channels[name] = self._mcap.register_channel(
                name, MessageEncoding.CDR, self._schemas[message_type], metadata
            )
        return self._channels[name]


def part_path(path: Path) -> Path:
    """Where a file grows until it is closed: beside it, or beside what a link leads to."""
    target = file_at(path)
    return target.with_name(target.name + ".part")


def refuse_while_written(path: Path) -> None:
    """FileExistsError while somebody else writes a file, who would lose it to whoever writes it too."""
    with contextlib.suppress(FileNotFoundError), part_path(path).open("rb") as file:
        lock_for_writing(file.fileno(), path)


def _locked_and_empty(path: Path) -> BinaryIO:
    """Where a file grows, for one writer alone; the lock ends with its process. FileExistsError."""
    part = part_path(path)
    while True:
        handle = os.open(part, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            lock_for_writing(handle, path)
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), part.stat()):
                    os.truncate(handle, 0)
                    return os.fdopen(handle, "wb")
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # somebody finished it meanwhile, so that it has another name
