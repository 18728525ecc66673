"""A simulation that did not come to its end: what it wrote is whole, the mission is not."""

from __future__ import annotations

from typing import Any


def interrupted_line(statistics: Any) -> str | None:
    """One sentence, by the statistics that a simulated recording holds of itself; None of a whole one, and
    where they do not say."""
    if not isinstance(statistics, dict) or statistics.get("complete") is not False:
        return None
    there, planned = statistics.get("frames"), statistics.get("planned_frames")
    known = type(there) is int and type(planned) is int
    told = f": {there} of {planned} frames are there" if known else ""
    return f"the simulation was interrupted{told}, and nothing of what came after"
