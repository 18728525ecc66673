"""Stamps in JSON: int64 nanoseconds do not fit a JavaScript number, so they are text, with milliseconds
beside them for drawing."""

from __future__ import annotations

from typing import Any

_MS_NS = 1_000_000
LARGEST_NS = (1 << 63) - 1


def moment_json(name: str, stamp_ns: int | None) -> dict[str, Any]:
    """`name`_ns as text and `name`_ms as a number; both None for no stamp."""
    known = stamp_ns is not None and stamp_ns >= 0
    return {
        f"{name}_ns": str(stamp_ns) if known else None,
        f"{name}_ms": _ms(stamp_ns) if known else None,
    }


def _ms(stamp_ns: int | None) -> float:
    assert stamp_ns is not None
    return stamp_ns / _MS_NS


def stamp_of(text: str | None) -> int | None:
    """A stamp that was asked for; None for the newest. ValueError for text that is none."""
    if text is None or text == "":
        return None
    if not (text.isascii() and text.isdigit() and len(text) <= 19 and int(text) <= LARGEST_NS):
        raise ValueError(f"{text[:40]!r} is no stamp: nanoseconds since 1970 as digits")
    return int(text)
