"""Stamps as RFC 3339 text with milliseconds, which every reader of these formats takes."""

from crowdfence.iso_time import iso_utc

_MILLISECOND_NS = 1_000_000


def rfc3339(stamp_ns: int, *, up: bool = False) -> str:
    """Rounded down, or `up` where a zone ends then.

    >>> rfc3339(1_760_000_000_499_514_525), rfc3339(1_760_000_000_499_514_525, up=True)
    ('2025-10-09T08:53:20.499Z', '2025-10-09T08:53:20.500Z')
    """
    count = stamp_ns // _MILLISECOND_NS + (up and stamp_ns % _MILLISECOND_NS > 0)
    return iso_utc(count * _MILLISECOND_NS)[:-7] + "Z"
