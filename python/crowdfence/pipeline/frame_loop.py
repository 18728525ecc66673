"""The one frame loop: the views of an instant in, what happened out."""

from __future__ import annotations

import json
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap, CrowdMass, Observation, Update, View
from crowdfence.config import ZoneConfig
from crowdfence.sources.recording import RefusedFrame
from crowdfence.zones import Zone, ZoneEngine, ZoneSet
from crowdfence.zones.given_ground import on_ground
from crowdfence.zones.no_zones import NoZones


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What one instant brought."""

    stamp_ns: int
    """The newest instant, which is the step's own unless that came late."""
    drones: tuple[str, ...]
    """Whose views were taken in, in their order."""
    refused: tuple[RefusedFrame, ...]
    """Frames of the instant that could not be used, and why."""
    update: Update
    seen_count: int
    """How many voxels were seen at this instant or any earlier one."""
    crowd_ids: NDArray[np.int64]
    """Those of them at or above the threshold after the instant, sorted."""
    shown_ids: NDArray[np.int64]
    """Voxels that one look clearly showed as crowd by itself, now or within 2 s before, sorted; none where
    nothing is closed, nor of a method that cannot tell."""
    threshold: float
    """Probability from which they are crowd."""
    zones: ZoneSet
    """The no-fly zones as of this instant."""

    @property
    def crowd_mass(self) -> CrowdMass:
        """Where the crowd in the pictures of the instant went."""
        return sum((observation.crowd_mass for observation in self.update.observations), CrowdMass())


class FrameLoop:
    """Keeps a crowd map and its zones up to date. `run`, `evaluate` and a live service differ in where views
    come from and in what becomes of the steps, and in nothing else.

    A step costs what was seen at it and what is closed, never the map. Threads may share a loop, and wait
    for each other.
    """

    def __init__(
        self,
        crowd_map: CrowdMap,
        zones: ZoneConfig,
        static_zones: Sequence[Zone] = (),
        *,
        closes: bool = True,
    ) -> None:
        """`static_zones` are zones that somebody else drew: they are part of every step's zones; of a
        `ZoneSet` all that it closes. `closes`: what is found is closed, as crowd is. ValueError as
        `ZoneEngine` has it."""
        self.crowd_map = crowd_map
        rules = zones.rules(crowd_map.default_threshold(), crowd_map.coverage)
        self.threshold = rules.threshold
        """Probability from which ground is crowd."""
        self._engine = (ZoneEngine if closes else NoZones)(
            crowd_map, rules, on_ground(static_zones, crowd_map.terrain)
        )
        self.crowd_mass: dict[str, CrowdMass] = {}
        """Where the crowd in the pictures of each drone went, over all steps."""
        # The zones of a step are those of the map behind it, and not of what another thread puts into it.
        self._whole = threading.RLock()

    def step(self, views: Sequence[View], stamp_ns: int, refused: Sequence[RefusedFrame] = ()) -> Step:
        """Take in the views of one instant, each drone at most once; where the method takes instants in any
        order, also of one before the newest. `refused` are frames that did not become views. StampError or
        ViewError where the instant cannot be integrated; nothing has changed then."""
        with self._whole:
            return self._happened(self.integrate(views, stamp_ns), refused)

    def step_observed(
        self, observations: Sequence[Observation], stamp_ns: int, refused: Sequence[RefusedFrame] = ()
    ) -> Step:
        """The same for views that were projected before, by another loop on this terrain or elsewhere."""
        with self._whole:
            return self._happened(self.integrate_observed(observations, stamp_ns), refused)

    def look_again(self, stamp_ns: int) -> ZoneSet:
        """The zones at a stamp after the last step, when nothing came: what nobody looked at for long is not
        known any more. StampError for a stamp before the last step."""
        with self._whole:
            return self._engine.step(stamp_ns)

    def integrate(self, views: Sequence[View], stamp_ns: int) -> Update:
        """The first half of `step`, for those who want the map without zones."""
        with self._whole:
            return self._counted(self.crowd_map.integrate(views, stamp_ns))

    def integrate_observed(self, observations: Sequence[Observation], stamp_ns: int) -> Update:
        """The first half of `step_observed`."""
        with self._whole:
            return self._counted(self.crowd_map.integrate_observations(observations, stamp_ns))

    def to_bytes(self) -> bytes:
        """What the next step depends on beside the crowd map, to go on from."""
        with self._whole:
            masses = {drone: mass.by_fate() for drone, mass in self.crowd_mass.items()}
            lost = json.dumps(masses).encode()
            return len(lost).to_bytes(8, "little") + lost + self._engine.to_bytes()

    def restore(self, data: bytes) -> None:
        """What `to_bytes` gave, for a loop around the crowd map of that moment. Where `ZoneConfig` is another
        one than before, its buffer and the like hold at once. ValueError for anything else."""
        end = 8 + int.from_bytes(data[:8], "little")
        try:
            masses = {drone: CrowdMass(**mass) for drone, mass in json.loads(data[8:end]).items()}
        except (AttributeError, TypeError, ValueError) as error:
            raise ValueError(f"that is no state of a frame loop: {error}") from error
        with self._whole:
            self._engine.restore(data[end:])
            self.crowd_mass = masses

    def _counted(self, update: Update) -> Update:
        for observation in update.observations:
            so_far = self.crowd_mass.get(observation.drone, CrowdMass())
            self.crowd_mass[observation.drone] = so_far + observation.crowd_mass
        return update

    def _happened(self, update: Update, refused: Sequence[RefusedFrame]) -> Step:
        # A late instant changes what is held now, and its zones are those of now.
        _, newest_ns = self.crowd_map.span_ns or (0, update.stamp_ns)
        zones = self._engine.step(newest_ns, update.observations)
        return Step(
            stamp_ns=newest_ns,
            drones=tuple(observation.drone for observation in update.observations),
            refused=tuple(refused),
            update=update,
            seen_count=self.crowd_map.seen_count,
            crowd_ids=self._engine.crowd_voxel_ids,
            shown_ids=self._engine.shown_ids,
            threshold=self.threshold,
            zones=zones,
        )
