"""How much of the ground several drones see at the same time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain, project
from crowdfence.sources.recording import Frame, Instant

ItemT = TypeVar("ItemT")

Footprint = NDArray[np.int64]
"""Sorted ids of the voxels that a view sees."""

# Footprints depend on camera and pose alone, so that damaged or missing heatmaps do not hide an overlap.
_NO_HEATMAP = np.zeros((1, 1), dtype=np.uint8)


@dataclass(frozen=True, slots=True)
class PairOverlap:
    """Ground that two drones see at the same instant, as a share of the smaller of both footprints."""

    drones: tuple[str, str]
    instants: int
    """Sampled instants in which both see terrain; the others have no share."""
    mean_share: float | None


@dataclass(frozen=True, slots=True)
class ViewOverlap:
    """Footprints compared over evenly spread instants that hold at least two drones."""

    max_range_m: float
    instants: int
    """Sampled instants."""
    overlapping_instants: int
    """Those in which at least one voxel is seen by two drones."""
    overlapping_share: float | None
    """Share of the sampled instants, None when no instant holds two drones."""
    pairs: tuple[PairOverlap, ...]
    """Every pair of drones."""


def measure_overlap(
    instants: Sequence[Instant],
    drones: Sequence[str],
    terrain: Terrain,
    *,
    max_range_m: float,
    samples: int,
    tell: Callable[[str], None] = lambda stage: None,
) -> ViewOverlap:
    """Project the views of up to `samples` instants; every visible voxel counts (coverage "full")."""
    chosen = evenly_spread([instant for instant in instants if len(instant.frames) > 1], samples)
    shares: dict[tuple[str, str], list[float]] = {pair: [] for pair in combinations(drones, 2)}
    overlapping = 0
    for number, instant in enumerate(chosen, start=1):
        tell(f"projecting views of instant {number}/{len(chosen)}")
        footprints = {frame.drone: footprint(frame, terrain, max_range_m) for frame in instant.frames}
        found = [
            (pair, share_of_smaller(footprints[pair[0]], footprints[pair[1]]))
            for pair in shares
            if pair[0] in footprints and pair[1] in footprints
        ]
        overlapping += any(share for _, share in found)
        for pair, share in found:
            if share is not None:
                shares[pair].append(share)
    return ViewOverlap(
        max_range_m=max_range_m,
        instants=len(chosen),
        overlapping_instants=overlapping,
        overlapping_share=overlapping / len(chosen) if chosen else None,
        pairs=tuple(
            PairOverlap(pair, len(values), float(np.mean(values)) if values else None)
            for pair, values in shares.items()
        ),
    )


def footprint(frame: Frame, terrain: Terrain, max_range_m: float) -> Footprint:
    """Ids of the voxels that the frame's camera sees."""
    return project(frame.view(_NO_HEATMAP), terrain, max_range_m=max_range_m, coverage="full").voxel_ids


def share_of_smaller(first: Footprint, second: Footprint) -> float | None:
    """Common voxels over those of the smaller footprint; None when one of them is empty."""
    smaller = min(len(first), len(second))
    if smaller == 0:
        return None
    return len(np.intersect1d(first, second, assume_unique=True)) / smaller


def evenly_spread(items: Sequence[ItemT], samples: int) -> list[ItemT]:
    """At most `samples` of them, first and last included."""
    places = np.linspace(0, len(items) - 1, min(samples, len(items)))
    return [items[round(place)] for place in places]
