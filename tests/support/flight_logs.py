"""Flight logs of their parts: PX4's ULog by its specification, telemetry of one autopilot by pymavlink."""

import struct
from collections.abc import Iterable, Mapping
from typing import Any

from pymavlink.dialects.v20 import common as mavlink


def ulog(zero_us: int, topics: Mapping[str, str], records: Iterable[bytes]) -> bytes:
    """A ULog (docs.px4.io/main/en/dev_log/ulog_file_format) that begins at `zero_us`, with the fields of its
    topics behind their stamps; a record is the number of its topic (H), its stamp (Q) and the fields."""
    described = [(b"F", f"{name}:uint64_t timestamp;{fields}".encode()) for name, fields in topics.items()]
    named = [(b"A", struct.pack("<BH", 0, number) + name.encode()) for number, name in enumerate(topics)]
    parts = [*described, *named, *((b"D", record) for record in records)]
    head = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", zero_us)
    return head + b"".join(struct.pack("<HB", len(body), kind[0]) + body for kind, body in parts)


def tlog(told: Iterable[tuple[int, Iterable[Any]]]) -> bytes:
    """Messages by when they arrived, microseconds."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    return b"".join(
        struct.pack(">Q", arrived_us) + message.pack(sender)
        for arrived_us, messages in told
        for message in messages
    )
