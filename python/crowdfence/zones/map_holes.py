"""Ground that a map lacks inside of itself: nobody can see it, so nobody knows that it is empty."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.zones.regions import Runs, connected


def hole_columns(columns: NDArray[np.int64]) -> NDArray[np.int64]:
    """(i, j) [H, 2] of the columns that are missing among `columns` [C, 2] and from which no way over edges
    leads out between them. Both are distinct and sorted by i, then j. Costs the runs, not the bounds."""
    runs = Runs.of(columns)
    follows = np.flatnonzero(runs.i[1:] == runs.i[:-1])
    gaps = Runs(runs.i[follows], runs.north[follows], runs.south[follows + 1])
    if not len(gaps):
        return np.empty((0, 2), dtype=np.int64)
    part = connected(gaps)
    is_open = np.zeros(part.max() + 1, dtype=np.bool_)
    is_open[part[_leads_out(gaps, runs, -1) | _leads_out(gaps, runs, 1)]] = True
    holes = gaps[~is_open[part]]
    within = np.arange(holes.length.sum()) - np.repeat(np.cumsum(holes.length) - holes.length, holes.length)
    return np.column_stack([np.repeat(holes.i, holes.length), np.repeat(holes.south, holes.length) + within])


def _leads_out(gaps: Runs, runs: Runs, step: int) -> NDArray[np.bool_]:
    """Whether each gap touches ground south or north of all runs of the next i, or the one before."""
    i, first = np.unique(runs.i, return_index=True)
    last = np.append(first[1:], len(runs)) - 1
    beside = np.searchsorted(i, gaps.i + step).clip(max=len(i) - 1)
    within = (gaps.south >= runs.south[first[beside]]) & (gaps.north <= runs.north[last[beside]])
    return np.asarray((i[beside] != gaps.i + step) | ~within)
