"""Regular or not: rates and gaps of stamps, and how frames of several drones fall together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from crowdfence.sources.recording import Instant

LONG_GAP_PERIODS = 1.5
"""A gap counts as long beyond this many median periods: one frame is missing, not just late."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Rate and gaps of one sequence of stamps. Figures that need more stamps than there are, are None."""

    count: int
    rate_hz: float | None
    """Mean rate over the whole span."""
    median_period_ms: float | None
    longest_gap_ms: float | None
    long_gaps: int
    """Gaps above 1.5 median periods."""

    @staticmethod
    def of(stamps_ns: ArrayLike) -> Timing:
        """stamps_ns [N] int64, increasing."""
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        if stamps.size < 2:
            return Timing(int(stamps.size), None, None, None, 0)
        gaps_ns = np.diff(stamps)
        median_ns = float(np.median(gaps_ns))
        return Timing(
            count=int(stamps.size),
            rate_hz=(stamps.size - 1) / (int(stamps[-1] - stamps[0]) / 1e9),
            median_period_ms=median_ns / 1e6,
            longest_gap_ms=int(gaps_ns.max()) / 1e6,
            long_gaps=int(np.count_nonzero(gaps_ns > LONG_GAP_PERIODS * median_ns)),
        )


@dataclass(frozen=True, slots=True)
class PairOffset:
    """How much later the second drone's frames are than the first one's, within instants."""

    drones: tuple[str, str]
    instants: int
    """Instants that hold a frame of both."""
    median_ms: float | None
    """Shutters that fire at different times and clocks that differ look alike here."""


@dataclass(frozen=True, slots=True)
class InstantSummary:
    """Frames grouped by time."""

    tolerance_ms: float
    count: int
    with_drones: dict[int, int]
    """Number of drones -> how many instants hold frames of that many; every number up to the fleet's size."""
    offsets: tuple[PairOffset, ...]
    """Every pair of drones."""

    @staticmethod
    def of(instants: Sequence[Instant], drones: Sequence[str], tolerance_ms: float) -> InstantSummary:
        sizes = Counter(len(instant.frames) for instant in instants)
        return InstantSummary(
            tolerance_ms=tolerance_ms,
            count=len(instants),
            with_drones={size: sizes[size] for size in range(1, len(drones) + 1)},
            offsets=tuple(_pair_offset(instants, pair) for pair in combinations(drones, 2)),
        )


def _pair_offset(instants: Sequence[Instant], pair: tuple[str, str]) -> PairOffset:
    offsets_ns = []
    for instant in instants:
        stamps = {frame.drone: frame.stamp_ns for frame in instant.frames}
        if pair[0] in stamps and pair[1] in stamps:
            offsets_ns.append(stamps[pair[1]] - stamps[pair[0]])
    median_ms = float(np.median(offsets_ns)) / 1e6 if offsets_ns else None
    return PairOffset(pair, len(offsets_ns), median_ms)
