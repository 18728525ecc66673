"""Whether the drones of a recording count time alike."""

from __future__ import annotations

from itertools import pairwise

from crowdfence.errors import StampError
from crowdfence.sources.recording import Recording


def check_clocks(recording: Recording) -> None:
    """StampError where nothing was recorded for so long that one drone's clock may be hours off another's:
    what lies behind would count as newer, or older, than it is."""
    for before, after in pairwise(recording.frames):
        gap_s = (after.stamp_ns - before.stamp_ns) / 1e9
        if gap_s > recording.longest_gap_s:
            raise StampError(
                f"{after.drone} at {after.stamp_ns} ns comes {gap_s:.0f} s after {before.drone}, the last "
                f"frame before it; the bound max_jump_s is {recording.longest_gap_s:g} s. Is a clock wrong?"
            )
