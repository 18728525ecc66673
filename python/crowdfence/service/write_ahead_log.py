"""What SQLite leaves out of its write-ahead log, which it does without a word.

A log ends for SQLite at the first frame whose checksum does not fit. After a loss of power that is a write
that nobody was told of; after a flipped bit it is every commit from there on, acknowledged or not. Frames of
the log as it is now carry one salt, what is left in the file of logs before it others
(https://www.sqlite.org/fileformat2.html#walformat).
"""

from __future__ import annotations

import struct
from pathlib import Path

_HEADER = struct.Struct(">8xI4x8s8x")
"""Size of a page, salts."""
_SUMMED = struct.Struct("6I")
"""Of the header; the sum of it follows."""
_FRAME = struct.Struct(">4xI8s8x")
"""Size of the database where a commit ends, else 0, and salts; the page follows."""
_PAGE_BYTES = struct.Struct(">16xH")
"""At the beginning of the database itself; 1 stands for 65536."""


def commits_in(database: Path) -> tuple[int, ...]:
    """Frames of the log of a database up to the end of each commit, by salts alone, whatever checksums say.
    None where there is no log. OSError."""
    log = database.with_name(f"{database.name}-wal")
    if not log.exists() or log.stat().st_size < _HEADER.size:
        return ()
    with log.open("rb") as file:
        header = file.read(_HEADER.size)
        is_sound = _is_sound(header)
        page_bytes, salts = _HEADER.unpack(header)
        if not is_sound:
            page_bytes = _page_bytes(database)
        frame_bytes = _FRAME.size + page_bytes
        frames = []
        for start in range(_HEADER.size, log.stat().st_size - frame_bytes + 1, frame_bytes):
            file.seek(start)
            frames.append(_FRAME.unpack(file.read(_FRAME.size)))
    if frames and not is_sound:
        _, salts = frames[0]
    return tuple(number for number, (pages, of_frame) in enumerate(frames, 1) if pages and of_frame == salts)


def _is_sound(header: bytes) -> bool:
    """Whether a log's header is as it was written: two running sums of its words, in the order of bytes that
    its first number names."""
    words = struct.unpack((">" if header[3] & 1 else "<") + _SUMMED.format, header[: _SUMMED.size])
    first = second = 0
    for even, odd in zip(words[::2], words[1::2], strict=True):
        first = (first + even + second) & 0xFFFFFFFF
        second = (second + odd + first) & 0xFFFFFFFF
    return (first, second) == struct.unpack(">2I", header[_SUMMED.size :])


def _page_bytes(database: Path) -> int:
    """Larger than any log where the database does not say."""
    with database.open("rb") as file:
        beginning = file.read(_PAGE_BYTES.size)
    (size,) = _PAGE_BYTES.unpack(beginning) if len(beginning) == _PAGE_BYTES.size else (0,)
    return int({0: 2**40, 1: 65536}.get(size, size))
