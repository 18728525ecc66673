"""Stamps as RFC 3339 text with milliseconds, which every reader of these formats takes."""

from crowdfence.iso_time import iso_utc

_MILLISECOND_NS = 1_000_000


def rfc3339(stamp_ns: int, *, up: bool = False) -> str:
    """Rounded down, or `up` where a zone ends then.

    >>> rfc3339(1_760_000_000_499_514_525), rfc3339(1_760_000_000_499_514_525, up=True)
    ('2025-10-09T08:53:20.499Z', '2025-10-09T08:53:20.500Z')
    """
    whole_ns = floor_ms(stamp_ns)
    return iso_utc(whole_ns + _MILLISECOND_NS * (up and whole_ns < stamp_ns))[:-7] + "Z"


def floor_ms(stamp_ns: int) -> int:
    """The last whole millisecond up to a stamp, in nanoseconds."""
    return stamp_ns - stamp_ns % _MILLISECOND_NS
