"""The one frame loop: the views of an instant in, what happened out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap, CrowdMass, Observation, Update, View
from crowdfence.config import ZoneConfig
from crowdfence.sources.recording import RefusedFrame
from crowdfence.zones import ZoneSet, find_zones


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What one instant brought."""

    stamp_ns: int
    drones: tuple[str, ...]
    """Whose views were taken in, in their order."""
    refused: tuple[RefusedFrame, ...]
    """Frames of the instant that could not be used, and why."""
    update: Update
    seen_ids: NDArray[np.int64]
    """Voxels seen at this instant or any earlier one [S], sorted."""
    probability: NDArray[np.float64]
    """Their probability of crowd after the instant [S]."""
    threshold: float
    """Probability from which they are crowd."""
    zones: ZoneSet
    """The no-fly zones as of this instant."""

    @property
    def crowd_ids(self) -> NDArray[np.int64]:
        """Voxels at or above the threshold after the instant, sorted."""
        return self.seen_ids[self.probability >= self.threshold]

    @property
    def crowd_mass(self) -> CrowdMass:
        """Where the crowd in the pictures of the instant went."""
        return sum((observation.crowd_mass for observation in self.update.observations), CrowdMass())


class FrameLoop:
    """Keeps a crowd map and its zones up to date. `run`, `evaluate` and a live service differ in where views
    come from and in what becomes of the steps, and in nothing else.

    A step costs what was seen so far, never the map.
    """

    def __init__(self, crowd_map: CrowdMap, zones: ZoneConfig) -> None:
        self.crowd_map = crowd_map
        self._zones = zones
        self.threshold = crowd_map.default_threshold() if zones.threshold is None else zones.threshold
        """Probability from which ground is crowd."""
        self.crowd_mass: dict[str, CrowdMass] = {}
        """Where the crowd in the pictures of each drone went, over all steps."""

    def step(self, views: Sequence[View], stamp_ns: int, refused: Sequence[RefusedFrame] = ()) -> Step:
        """Take in the views of one instant, each drone at most once. `refused` are frames that did not become
        views. StampError or ViewError where the instant cannot be integrated; nothing has changed then."""
        return self._happened(self.crowd_map.integrate(views, stamp_ns), refused)

    def step_observed(
        self, observations: Sequence[Observation], stamp_ns: int, refused: Sequence[RefusedFrame] = ()
    ) -> Step:
        """The same for views that were projected before, by another loop on this terrain or elsewhere."""
        return self._happened(self.crowd_map.integrate_observations(observations, stamp_ns), refused)

    def _happened(self, update: Update, refused: Sequence[RefusedFrame]) -> Step:
        for observation in update.observations:
            so_far = self.crowd_mass.get(observation.drone, CrowdMass())
            self.crowd_mass[observation.drone] = so_far + observation.crowd_mass
        seen_ids = self.crowd_map.seen_ids()
        return Step(
            stamp_ns=update.stamp_ns,
            drones=tuple(observation.drone for observation in update.observations),
            refused=tuple(refused),
            update=update,
            seen_ids=seen_ids,
            probability=self.crowd_map.probability(update.stamp_ns, seen_ids),
            threshold=self.threshold,
            zones=find_zones(
                self.crowd_map,
                update.stamp_ns,
                threshold=self.threshold,
                min_area_m2=self._zones.min_area_m2,
            ),
        )
