"""A bag on disk, of whatever kind: its topics, its messages in order, and any one of them again.

MCAP files are scanned by our own reader, which takes what is intact of a damaged one; SQLite and ROS 1 bags
are read through rosbags (extra `ros`), which also decodes the messages of all of them.
"""

from __future__ import annotations

import re
import shlex
import struct
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from crowdfence.errors import one_line
from crowdfence.sources.mission.layout import MAGIC
from crowdfence.sources.mission.mcap_records import McapFile, MessageLocation, StoredMessage

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys.store import Typestore

METADATA_NAME = "metadata.yaml"
SUFFIXES = (".bag", ".db3", ".mcap")
_ROS1_MAGIC = b"#ROSBAG V"
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_LARGEST_MESSAGE_BYTES = 1 << 28
"""A raw picture of 8192 x 8192 pixels in colour."""
_TIME = struct.Struct("<II")
_ALSO = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "tf/msg/tfMessage": "geometry_msgs/TransformStamped[] transforms",
    "geographic_msgs/msg/GeoPoint": "float64 latitude\nfloat64 longitude\nfloat64 altitude",
    "geographic_msgs/msg/GeoPointStamped": "std_msgs/Header header\ngeographic_msgs/GeoPoint position",
}
"""Types that rosbags does not bring for both generations of ROS."""


@dataclass(frozen=True, slots=True)
class BagMessage:
    """One message as it lies in the bag."""

    topic: str
    log_ns: int
    data: bytes
    place: Any
    """What `Bag.read` finds it by again."""


@dataclass(slots=True)
class BagTopic:
    """A topic and how many messages it has."""

    type: str
    """Such as sensor_msgs/msg/Image, for ROS 1 too."""
    count: int = 0


class Bag(Protocol):
    """What the reader needs of a bag. Everything raises ValueError for a bag that is damaged there."""

    path: Path
    ros1: bool
    damage: list[str]
    """After `messages`: what could not be read, one sentence each."""

    def topics(self) -> dict[str, BagTopic]: ...
    def messages(self, topics: Sequence[str]) -> Iterator[BagMessage]: ...
    def read(self, place: Any) -> bytes: ...


def is_bag(path: Path) -> bool:
    """Whether the path looks like a bag: a folder of rosbag2, a .bag or a .db3."""
    if path.is_dir():
        return (path / METADATA_NAME).is_file() or bool(_parts(path, ".mcap") or _parts(path, ".db3"))
    if path.suffix.lower() == ".db3":
        return True
    with path.open("rb") as file:
        return file.read(len(_ROS1_MAGIC)) == _ROS1_MAGIC


def open_bag(path: Path) -> Bag:
    """ValueError when the path is no bag, or one of a kind or state that cannot be read."""
    files = [path] if path.is_file() else _parts(path, ".mcap")
    if files and all(_begins_like_mcap(file) for file in files):
        return McapBag(path, files)
    if not path.is_dir() or (path / METADATA_NAME).is_file():
        return RosBag(path)
    stores = _parts(path, ".db3")
    if len(stores) == 1:
        return RosBag(stores[0])
    raise ValueError(f"{path} has no {METADATA_NAME}: `ros2 bag reindex` makes a new one")


class McapBag:
    """MCAP files of one recording, one after the other."""

    def __init__(self, path: Path, files: Sequence[Path]) -> None:
        self.path = path
        self.damage: list[str] = []
        self._files = [McapFile(file) for file in files]
        self._topics: dict[str, BagTopic] = {}
        schemas: dict[str, str] = {}
        for _, message in self._scan():
            topic = self._topics.setdefault(message.topic, BagTopic(_ros2_name(message.schema_name)))
            topic.count += 1
            schemas.setdefault(message.topic, message.schema_name)
        self.ros1 = bool(schemas) and not any("/msg/" in name for name in schemas.values())

    def topics(self) -> dict[str, BagTopic]:
        return self._topics

    def messages(self, topics: Sequence[str]) -> Iterator[BagMessage]:
        wanted = set(topics)
        for number, message in self._scan():
            if message.topic in wanted:
                place = number, message.location
                yield BagMessage(message.topic, message.log_time_ns, _unpacked(bytes(message.data)), place)

    def read(self, place: tuple[int, MessageLocation]) -> bytes:
        number, location = place
        return _unpacked(self._files[number].payload(location))

    def _scan(self) -> Iterator[tuple[int, StoredMessage]]:
        self.damage = []
        for number, file in enumerate(self._files):
            for record in file.scan():
                if isinstance(record, StoredMessage):
                    yield number, record
            self.damage += file.damage


@dataclass(slots=True)
class RosBag:
    """A ROS 1 bag, or a rosbag2 in SQLite or packed MCAP files, through rosbags."""

    path: Path
    damage: list[str] = field(default_factory=list)
    ros1: bool = False
    _topics: dict[str, BagTopic] = field(default_factory=dict)
    _own: threading.local = field(default_factory=threading.local, repr=False)

    def __post_init__(self) -> None:
        self.ros1 = self.path.suffix.lower() == ".bag"
        stores = [self.path] if self.path.is_file() else _parts(self.path, ".db3")
        for store in stores:
            _require_all_in(store)
        if self.path.is_dir():
            _require_described(self.path, stores)
        with self._refusing():
            for connection in self._reader().connections:
                topic = self._topics.setdefault(connection.topic, BagTopic(connection.msgtype))
                topic.count += connection.msgcount

    def topics(self) -> dict[str, BagTopic]:
        return self._topics

    def messages(self, topics: Sequence[str]) -> Iterator[BagMessage]:
        wanted = set(topics)
        self.damage = []
        seen: dict[tuple[str, int], int] = {}
        try:
            reader = self._reader()
            chosen = [one for one in reader.connections if one.topic in wanted]
            for connection, log_ns, data in reader.messages(connections=chosen):
                key = connection.topic, log_ns
                number = seen[key] = seen.get(key, -1) + 1
                yield BagMessage(connection.topic, log_ns, bytes(data), (*key, number))
        except GeneratorExit:
            raise
        except Exception as error:  # whatever a library meets in a damaged file
            self.damage.append(f"it cannot be read any further: {one_line(error)}")

    def read(self, place: tuple[str, int, int]) -> bytes:
        topic, log_ns, number = place
        with self._refusing():
            reader = self._reader()
            chosen = [one for one in reader.connections if one.topic == topic]
            found = reader.messages(connections=chosen, start=log_ns, stop=log_ns + 1)
            for index, (_, _, data) in enumerate(found):
                if index == number:
                    return bytes(data)
        raise ValueError(f"{self.path}: a message on {topic} is no longer there")

    def _reader(self) -> AnyReader:
        # SQLite connections belong to the thread that opened them.
        if not hasattr(self._own, "reader"):
            from rosbags.highlevel import AnyReader

            reader = AnyReader([self.path], default_typestore=_typestore(self.ros1))
            reader.open()
            self._own.reader = reader
        reader = self._own.reader
        return reader

    @contextmanager
    def _refusing(self) -> Iterator[None]:
        """A library meets damage with whatever exception comes first; ours is one line."""
        try:
            yield
        except (OSError, ModuleNotFoundError):
            raise
        except Exception as error:
            raise ValueError(f"{self.path} cannot be read as a bag: {one_line(error)}") from error


@dataclass(frozen=True, slots=True)
class Header:
    """std_msgs/Header."""

    stamp_ns: int
    frame: str


def header_of(data: bytes, *, ros1: bool) -> Header:
    """The header that a message begins with, without decoding the rest. ValueError when it is cut short."""
    # CDR: 4 bytes of encapsulation before it; ROS 1: a sequence number.
    if len(data) < 16:
        raise ValueError(f"the message has {len(data)} bytes, too few for a header")
    if not ros1 and data[1] not in (1, 7):
        raise ValueError(f"the message is not CDR in little-endian order: it begins with {data[:4].hex()}")
    seconds, nanoseconds = _TIME.unpack_from(data, 4)
    if not ros1 and seconds >= 2**31:
        raise ValueError(f"the stamp has {seconds - 2**32} s, before 1970")
    length = int.from_bytes(data[12:16], "little")
    frame = data[16 : 16 + min(length, 256)].rstrip(b"\0").decode(errors="replace")
    return Header(seconds * 1_000_000_000 + nanoseconds, frame.lstrip("/"))


def decode(data: bytes, type_name: str, *, ros1: bool) -> Any:
    """A message by rosbags. ValueError when the bytes are none of this type."""
    store = _typestore(ros1)
    try:
        return (store.deserialize_ros1 if ros1 else store.deserialize_cdr)(data, type_name)
    except Exception as error:  # whatever a library meets in damaged bytes
        raise ValueError(f"no {type_name}: {one_line(error)}") from error


@lru_cache(maxsize=2)
def _typestore(ros1: bool) -> Typestore:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for name, text in _ALSO.items():
        if name not in store.types:
            store.register(get_types_from_msg(text, name))
    return store


def _unpacked(data: bytes) -> bytes:
    """A message that `ros2 bag record --compression-mode message` packed by itself, or as it is: neither CDR
    nor the sequence number of a ROS 1 header begins like zstd, but by one chance in 4 billion. What cannot be
    unpacked stays what it is, and is refused as no message."""
    if not data.startswith(_ZSTD_MAGIC):
        return data
    import zstandard

    try:
        if not 0 < zstandard.frame_content_size(data) <= _LARGEST_MESSAGE_BYTES:
            return data
        return zstandard.ZstdDecompressor().decompress(data)
    except zstandard.ZstdError:
        return data


def _parts(folder: Path, suffix: str) -> list[Path]:
    """Files of one rosbag2, in order. Without its description only files that are named after the folder are:
    others are recordings of their own."""
    files = [file for file in folder.iterdir() if file.suffix == suffix and file.is_file()]
    if not (folder / METADATA_NAME).is_file():
        name = folder.resolve().name
        files = [file for file in files if re.fullmatch(re.escape(name) + r"_\d+", file.stem)]
    return sorted(files, key=lambda file: (len(file.stem), file.stem))


def _require_all_in(store: Path) -> None:
    """ValueError for a file of SQLite beside which its recorder, cut off, left what it wrote last, or how to
    take back what it had half written: rosbags reads the file alone."""
    for journal in ("-wal", "-journal"):
        left = store.with_name(f"{store.name}{journal}")
        if left.is_file() and left.stat().st_size > 0:
            take_in = "PRAGMA journal_mode=DELETE; SELECT count(*) FROM messages"
            raise ValueError(
                f"{store}: {left.name} lies beside it, as a recorder leaves it that was cut off, and without "
                "it messages would be missing or half written; SQLite takes it in, and says how many "
                f"there are then: sqlite3 {shlex.quote(str(store))} {shlex.quote(take_in)}"
            )


def _require_described(folder: Path, stores: Sequence[Path]) -> None:
    """ValueError for parts in the folder that its description does not name: rosbags reads only those that it
    does."""
    described = (folder / METADATA_NAME).read_text(encoding="utf-8", errors="replace")
    if unknown := [store.name for store in stores if store.name not in described]:
        raise ValueError(
            f"{folder}: {unknown[0]} is not in its {METADATA_NAME}, as where the recorder was cut off, and "
            "would be left out: `ros2 bag reindex` describes all parts; or name a file, to read it alone"
        )


def _begins_like_mcap(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def _ros2_name(schema: str) -> str:
    package, _, name = schema.rpartition("/")
    return schema if not package or package.endswith("/msg") else f"{package}/msg/{name}"
