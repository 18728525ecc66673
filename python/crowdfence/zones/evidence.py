"""Who saw a zone: the last look of every drone, what it showed, from how far, and how many there were."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
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


def with_looks(evidence: Evidence, looks: Iterable[DroneEvidence]) -> dict[str, DroneEvidence]:
    """Evidence by drone after the looks of an instant at the same zone (`looks_at`), which may come late."""
    after = dict(evidence)
    for look in looks:
        before = evidence.get(look.drone)
        after[look.drone] = look if before is None else replace(_newest(before, look), looks=before.looks + 1)
    return after


def joined(parts: Iterable[Evidence]) -> dict[str, DroneEvidence]:
    """Of zones that became one: each drone's newest look; looks at several of them count once."""
    together: dict[str, DroneEvidence] = {}
    for part in parts:
        for drone, one in part.items():
            other = together.get(drone)
            if other is not None:
                one = replace(_newest(one, other), looks=max(one.looks, other.looks))
            together[drone] = one
    return together


def _newest(*looks: DroneEvidence) -> DroneEvidence:
    return max(looks, key=lambda look: (look.last_look_ns, look.value))


def looks_at(
    zones: Sequence[NDArray[np.int64]], observations: Iterable[Observation], shows_crowd: float
) -> list[list[DroneEvidence]]:
    """What the observations of an instant show of each zone, given as the voxels of crowd in it: one look per
    drone that saw any of them. All zones are asked for together: an instant may have hundreds. From below
    its top the side of a place is seen: a look only where its value is above `shows_crowd`."""
    looks: list[list[DroneEvidence]] = [[] for _ in zones]
    sizes = np.array([len(voxel_ids) for voxel_ids in zones], dtype=np.int64)
    voxel_ids = np.concatenate([np.empty(0, dtype=np.int64), *zones])
    of_zone = np.repeat(np.arange(len(zones)), sizes)
    for observation in observations:
        seen = observation.voxel_ids
        if not len(seen):
            continue
        at = np.searchsorted(seen, voxel_ids).clip(max=len(seen) - 1)
        is_seen = seen[at] == voxel_ids
        at, zone = at[is_seen], of_zone[is_seen]
        mean, tilt_deg = observation.mean[at], observation.tilt_deg[at]
        tells = (tilt_deg > 0.0) | (mean > shows_crowd)
        at, zone, mean = at[tells], zone[tells], mean[tells]
        numbers, first, count = np.unique(zone, return_index=True, return_counts=True)
        if not len(numbers):
            continue
        value = np.maximum.reduceat(mean, first).tolist()
        range_m = np.minimum.reduceat(observation.range_m[at], first).tolist()
        share = (count / sizes[numbers]).tolist()
        for number, look in zip(numbers.tolist(), zip(value, share, range_m, strict=True), strict=True):
            looks[number].append(DroneEvidence(observation.drone, observation.stamp_ns, *look, 1))
    return looks
