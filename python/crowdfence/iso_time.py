"""Stamps as text."""

from datetime import datetime, timezone


def iso_utc(stamp_ns: int) -> str:
    """ISO 8601 / RFC 3339 text of nanoseconds since the Unix epoch, UTC, all nine decimals kept.

    >>> iso_utc(1_760_000_000_499_514_525)
    '2025-10-09T08:53:20.499514525Z'
    """
    seconds, nanoseconds = divmod(int(stamp_ns), 1_000_000_000)
    whole = datetime.fromtimestamp(seconds, tz=timezone.utc).replace(tzinfo=None)
    return f"{whole.isoformat()}.{nanoseconds:09d}Z"
