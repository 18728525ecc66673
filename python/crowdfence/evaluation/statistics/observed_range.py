"""The range of a quantity in which most of what was observed lies, in bounded memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class ObservedRange:
    """Counts values between fixed edges; what lies outside counts with the nearest bin."""

    def __init__(self, edges: NDArray[np.float64]) -> None:
        self._edges = edges
        self._count = np.zeros(len(edges) - 1, np.int64)

    def add(self, values: NDArray[np.float64]) -> None:
        bin_of = np.searchsorted(self._edges[1:-1], values, side="right")
        self._count += np.bincount(bin_of, minlength=len(self._count))

    def middle(self, share: float = 0.98) -> tuple[float, float] | None:
        """Edges between which at least `share` of the values lie, as many left out below as above; None
        before the first value."""
        total = int(self._count.sum())
        if total == 0:
            return None
        tail = (1.0 - share) / 2.0 * total
        up_to = np.cumsum(self._count)
        first = int(np.searchsorted(up_to, tail, side="right"))
        last = int(np.searchsorted(up_to, total - tail, side="left"))
        return float(self._edges[first]), float(self._edges[last + 1])
