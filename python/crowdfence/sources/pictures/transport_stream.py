"""Where an MPEG transport stream, as drones send pictures down, lost packets on its way (ISO/IEC 13818-1).

Each packet of a stream counts on from the one before, so that losses show. FFmpeg's demuxer sees them too
and does not pass that on, and its decoders know no better: that of HEVC goes on with whatever bytes come next
and hands out smeared pictures as whole ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_SYNC = 0x47
_PACKET = 188
_STRIDES = (_PACKET, 192, 204)
"""Bytes from packet to packet: cameras put a time before each (M2TS), broadcasters a checksum behind it."""
_HEAD = 6
"""Bytes of a packet up to the flags of its adaptation field."""
_AT_ONCE = 1 << 16
"""Packets."""


def losses(path: Path, pid: int) -> NDArray[np.int64]:
    """Byte positions, ascending, of the packets of a stream behind which some of it are missing, and of those
    that say that they were damaged. A loss of exactly 16 packets, or of 32, is not noticed, and none of a
    stream that does not count, as some devices send it."""
    data = np.memmap(path, np.uint8, "r") if path.stat().st_size else np.empty(0, np.uint8)
    runs = [_of_stream(data, places, pid) for places in _runs(data)]
    at = np.concatenate([np.empty(0, np.int64), *runs])
    if not len(at):
        return at
    heads = data[at[:, None] + np.arange(_HEAD)]
    damaged = heads[:, 1] & 0x80 != 0
    counts = heads[:, 3] & 0x0F
    # Only packets that carry something count on.
    carries, adapts = heads[:, 3] & 0x10 != 0, heads[:, 3] & 0x20 != 0
    starts_anew = adapts & (heads[:, 4] > 0) & (heads[:, 5] & 0x80 != 0)
    goes_on = counts[1:] == (counts[:-1] + carries[1:]) & 0x0F
    is_missing = ~(goes_on | starts_anew[1:])
    for k in np.flatnonzero(is_missing & (counts[1:] == counts[:-1])).tolist():
        # A packet may be sent twice.
        one, other = (data[place : place + _PACKET] for place in at[k : k + 2])
        is_missing[k] = not np.array_equal(one, other)
    if 2 * np.count_nonzero(is_missing) > len(at):
        is_missing[:] = False
    return at[damaged | np.append(is_missing, False)]


def _of_stream(data: NDArray[np.uint8], at: NDArray[np.int64], pid: int) -> NDArray[np.int64]:
    """Of the packets that begin at these bytes those of one stream."""
    pids = (data[at + 1].astype(np.int64) & 0x1F) << 8 | data[at + 2]
    return at[pids == pid]


def _runs(data: NDArray[np.uint8]) -> Iterator[NDArray[np.int64]]:
    """Where packets begin [N], run after run: bytes that are lost or strange shift those that follow."""
    begin = 0
    while (found := _next_run(data, begin)) is not None:
        begin, stride = found
        count = min((len(data) - begin - _PACKET) // stride + 1, _AT_ONCE)
        at = begin + stride * np.arange(count, dtype=np.int64)
        broken = np.flatnonzero(data[at] != _SYNC)
        at = at[: broken[0]] if len(broken) else at
        yield at
        begin += stride * len(at)


def _next_run(data: NDArray[np.uint8], begin: int) -> tuple[int, int] | None:
    """The first byte from there on that begins a packet, another one behind it or the end, and the stride
    between them."""
    while begin + _PACKET <= len(data):
        for stride in _STRIDES:
            is_last = begin + stride + _HEAD > len(data)
            if data[begin] == _SYNC and (is_last or data[begin + stride] == _SYNC):
                return begin, stride
        ahead = np.flatnonzero(data[begin + 1 : begin + _AT_ONCE] == _SYNC)
        begin += int(ahead[0]) + 1 if len(ahead) else _AT_ONCE
    return None
