"""Crowd maps that change from instant to instant as a test draws them, and the zones that follow them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from crowdfence import CrowdMap, Observation, Terrain
from crowdfence.config import ZoneConfig
from crowdfence.zones import ZoneEngine, ZoneSet
from support.small_crowd_maps import SURE, look

SECOND_NS = 1_000_000_000


class DrawnZones:
    """A plain of 1 m columns, one voxel each, whose probabilities a test sets at every instant."""

    def __init__(self, shape: tuple[int, int], config: ZoneConfig | None = None, **options: object) -> None:
        indices = np.stack([*np.nonzero(np.ones(shape)), np.zeros(shape[0] * shape[1], int)], axis=1)
        self.terrain = Terrain.from_indices(indices, 1.0)
        self.crowd_map = CrowdMap(self.terrain, SURE)
        self._shape = shape
        self._ids = self.terrain.voxel_ids(indices)
        if config is None:
            given = {"threshold": 0.5, "min_area_m2": 0.0, **options}
            config = ZoneConfig(**given)  # type: ignore[arg-type]
        self.engine = ZoneEngine(self.crowd_map, config.rules(0.5))
        self.stamp_ns = -SECOND_NS

    def step(self, probability: NDArray[np.float64], evidence_of: str | None = None) -> ZoneSet:
        """A second later one drone sees everything anew: P [X, Y], NaN = not looked at. The zones are told of
        a look at everything where a drone is named, of 0.9 from 40 m."""
        self.stamp_ns += SECOND_NS
        wanted = np.asarray(probability, dtype=float).ravel()
        seen = np.flatnonzero(~np.isnan(wanted))
        look(self.crowd_map, "uav1", self.stamp_ns, self._ids[seen], (1.0 + wanted[seen]) / 2.0)
        looks = [] if evidence_of is None else [self._look(evidence_of)]
        return self.engine.step(self.stamp_ns, looks)

    def _look(self, drone: str) -> Observation:
        count = self.terrain.voxel_count
        return Observation(
            self.terrain,
            drone,
            self.stamp_ns,
            voxel_ids=np.arange(count),
            mean=np.full(count, 0.9),
            pixel_count=np.ones(count, int),
            range_m=np.full(count, 40.0),
            tilt_deg=np.full(count, 60.0),
            occluded_ids=[],
        )

    def probability(self) -> NDArray[np.float64]:
        """P [X, Y] as the map holds it."""
        return self.crowd_map.probability(self.stamp_ns, self._ids).reshape(self._shape)

    def drawn(self, picture: str) -> ZoneSet:
        """The same from a picture: # crowd, + above a threshold of 0.3, north up."""
        return self.step(drawing(picture))


def drawing(picture: str) -> NDArray[np.float64]:
    rows = [line.strip() for line in picture.strip().splitlines()]
    values = {"#": 1.0, "+": 0.4, ".": 0.0}
    return np.array([[values[cell] for cell in row] for row in rows[::-1]]).T


def told(zones: ZoneSet) -> list[tuple[str, ...]]:
    """Events in short: (kind, id) or (kind, id, other)."""
    return [
        tuple(part for part in (event.kind, event.id, event.other) if part is not None)
        for event in zones.events
    ]


def ids(zones: Sequence[object]) -> list[str]:
    return [zone.id for zone in zones]  # type: ignore[attr-defined]
