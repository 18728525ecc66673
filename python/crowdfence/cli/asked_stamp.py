"""The instant of --at, with a warning where the run knows nothing of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from crowdfence.cli import console
from crowdfence.iso_time import iso_utc

if TYPE_CHECKING:
    from crowdfence.zones.history import ZoneHistory


def asked_stamp(at: str, history: ZoneHistory) -> int:
    """What is told of a stamp after the last instant is what was known at that instant: zones stay
    closed, and nothing that came since is known. ValueError before the first."""
    from crowdfence.result_folder import stamp_of

    stamp_ns, last_ns = stamp_of(at, history), history.stamps_ns[-1]
    if stamp_ns < history.stamps_ns[0] and at.isdigit():
        raise ValueError(
            f"--at {at} is so many nanoseconds since 1970, before the first instant, "
            f"{iso_utc(history.stamps_ns[0])}; seconds after that are +SECONDS, such as --at +5"
        )
    if stamp_ns > last_ns:
        console.warn(
            f"--at {at} is {(stamp_ns - last_ns) / 1e9:,.1f} s after the last instant, {iso_utc(last_ns)}: "
            "told is what was known then"
        )
    return stamp_ns
