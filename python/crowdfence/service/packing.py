"""Several byte strings as one."""

from __future__ import annotations

import struct

_LENGTH = struct.Struct("<Q")


def packed(*parts: bytes) -> bytes:
    """Each after its length."""
    return b"".join(piece for part in parts for piece in (_LENGTH.pack(len(part)), part))


def unpacked(data: bytes) -> list[bytes]:
    """What `packed` was given. ValueError where the lengths do not add up."""
    parts, place = [], 0
    while place < len(data):
        if place + _LENGTH.size > len(data):
            raise ValueError(f"a length is cut off at byte {place} of {len(data)}")
        (length,) = _LENGTH.unpack_from(data, place)
        place += _LENGTH.size
        if length > len(data) - place:
            raise ValueError(f"a part of {length} bytes at byte {place} of {len(data)} is cut off")
        parts.append(data[place : place + length])
        place += length
    return parts
