"""Who saw a zone: the last look of every drone, what it showed, from how far, and how many there were."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Observation


@dataclass(frozen=True, slots=True)
class DroneEvidence:
    """What one drone showed of the crowd in a zone since the zone was created."""

    drone: str
    last_look_ns: int
    value: float
    """Largest mean heatmap value over the zone's voxels of crowd at the last look, in [0, 1]."""
    seen_share: float
    """Share of those voxels that the last look saw."""
    range_m: float
    """Distance to the nearest of them at the last look."""
    looks: int
    """Instants at which the drone saw any of them."""


Evidence = Mapping[str, DroneEvidence]


def with_looks(
    evidence: Evidence, voxel_ids: NDArray[np.int64], observations: Iterable[Observation]
) -> dict[str, DroneEvidence]:
    """Evidence by drone after the observations of an instant; `voxel_ids` [N] are the zone's voxels of crowd,
    sorted."""
    after = dict(evidence)
    for observation in observations:
        look = _look(voxel_ids, observation)
        if look is not None:
            before = evidence.get(observation.drone)
            after[observation.drone] = look if before is None else replace(look, looks=before.looks + 1)
    return after


def joined(parts: Iterable[Evidence]) -> dict[str, DroneEvidence]:
    """Of zones that became one: each drone's newest look; looks at several of them count once."""
    together: dict[str, DroneEvidence] = {}
    for part in parts:
        for drone, one in part.items():
            other = together.get(drone)
            if other is not None:
                newest = max(one, other, key=lambda look: (look.last_look_ns, look.value))
                one = replace(newest, looks=max(one.looks, other.looks))
            together[drone] = one
    return together


def _look(voxel_ids: NDArray[np.int64], observation: Observation) -> DroneEvidence | None:
    seen = observation.voxel_ids
    if not len(seen) or not len(voxel_ids):
        return None
    at = np.searchsorted(seen, voxel_ids).clip(max=len(seen) - 1)
    at = at[seen[at] == voxel_ids]
    if not len(at):
        return None
    return DroneEvidence(
        observation.drone,
        observation.stamp_ns,
        value=float(observation.mean[at].max()),
        seen_share=len(at) / len(voxel_ids),
        range_m=float(observation.range_m[at].min()),
        looks=1,
    )
