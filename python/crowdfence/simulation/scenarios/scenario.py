"""One scenario: everything that a simulated mission is made from, apart from the seed."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from crowdfence._core import Camera
from crowdfence.georeference import Georeference
from crowdfence.simulation.scenarios.plan_checks import (
    LONGEST_S,
    ScenarioError,
    require_one_of,
    require_positive,
    require_within,
)
from crowdfence.simulation.scenarios.plans import (
    CameraPlan,
    CrowdDefinition,
    CrowdPlan,
    CyclistPlan,
    FlightPlan,
    LandscapePlan,
    TroublePlan,
    WalkerPlan,
)

__all__ = [
    "LOOKS",
    "SEASONS",
    "CameraPlan",
    "CrowdDefinition",
    "CrowdPlan",
    "CyclistPlan",
    "FlightPlan",
    "LandscapePlan",
    "Scenario",
    "ScenarioError",
    "TroublePlan",
    "WalkerPlan",
]

SEASONS = ("summer", "autumn", "winter", "dry")
LOOKS = ("natural", "random")
MAX_DRONES = 64
MAX_INSTANCES = 65_535
ALPINE_VALLEY = Georeference(46.5, 8.0, 1200.0)
EPOCH_NS = 1_767_225_600_000_000_000
"""Start of a mission unless the scenario says otherwise: 2026-01-01 00:00 UTC."""

_MARGIN_S = 120
"""Telemetry begins before the mission and ends after it, and clocks may be wrong by tens of seconds."""
EARLIEST_NS = _MARGIN_S * 10**9
LATEST_NS = (2**31 - 1 - _MARGIN_S) * 10**9
"""Stamps of recordings are seconds in 31 bits, from 1970 to 2038: a mission has to lie between."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """A mission to simulate; the world is a function of it, the seed and the time since its start.

    `frames` per drone at `fps`; `epoch_ns` is the stamp of the mission's start; `georeference` anchors the
    local ENU metres. ScenarioError (a ValueError) names the parameter that cannot be simulated.
    """

    name: str
    description: str
    landscape: LandscapePlan
    crowds: tuple[CrowdPlan, ...] = ()
    walkers: WalkerPlan = field(default_factory=WalkerPlan)
    cyclists: CyclistPlan = field(default_factory=CyclistPlan)
    flight: FlightPlan = field(default_factory=FlightPlan)
    camera: CameraPlan = field(default_factory=CameraPlan)
    drones: int = 3
    frames: int = 1056
    fps: float = 10.0
    season: str = "summer"
    looks: str = "natural"
    """ "natural", or "random": plants, ground and clothes in any colours, people of any build and pose, to
    train detectors on."""
    time_of_day_h: float = 15.0
    voxel_size_m: float = 0.5
    crowd_definition: CrowdDefinition = field(default_factory=CrowdDefinition)
    trouble: TroublePlan = field(default_factory=TroublePlan)
    georeference: Georeference = ALPINE_VALLEY
    epoch_ns: int = EPOCH_NS

    def __post_init__(self) -> None:
        require_within("drones", self.drones, 1, MAX_DRONES)
        require_within("frames", self.frames, 1, 10_000_000)
        require_positive("fps", self.fps, 240.0)
        if self.duration_s > LONGEST_S:
            raise ScenarioError(
                f"frames {self.frames} at fps {self.fps:g} take {self.duration_s:g} s; at most "
                f"{LONGEST_S:g} s"
            )
        require_one_of("season", self.season, SEASONS)
        require_one_of("looks", self.looks, LOOKS)
        require_within("time_of_day_h", self.time_of_day_h, 0.0, 24.0)
        require_within("voxel_size_m", self.voxel_size_m, 0.1, 20.0)
        require_within("epoch_ns", self.epoch_ns, EARLIEST_NS, LATEST_NS)
        if self.epoch_ns + self.duration_s * 1e9 > LATEST_NS:
            raise ScenarioError(
                f"epoch_ns {self.epoch_ns} and the {self.duration_s:g} s that frames at fps take end after "
                f"{LATEST_NS}, in January 2038, where stamps of recordings end"
            )
        if self.flight.pattern == "follow" and self.cyclists.count < 1:
            raise ScenarioError('flight.pattern "follow" needs cyclists.count of at least 1, got 0')
        if self.cyclists.count and not self.landscape.road:
            raise ScenarioError(f"cyclists.count {self.cyclists.count} needs landscape.road = true")
        people = sum(crowd.people for crowd in self.crowds) + self.walkers.count + self.cyclists.count
        if people > MAX_INSTANCES:
            raise ScenarioError(
                f"crowds, walkers and cyclists are {people} together; instance ids allow {MAX_INSTANCES}"
            )
        for kind, pairs in (("joins_s", self.trouble.joins_s), ("leaves_s", self.trouble.leaves_s)):
            for drone, _ in pairs:
                if drone < 0:
                    raise ScenarioError(f"trouble.{kind} names drone {drone}; drones count from 0")

    @property
    def duration_s(self) -> float:
        """Time from the first to the last capture."""
        return (self.frames - 1) / self.fps

    @property
    def drone_names(self) -> tuple[str, ...]:
        """ "uav1", "uav2", ... in the order of the drone numbers 0, 1, ..."""
        return tuple(f"uav{number + 1}" for number in range(self.drones))

    def intrinsics(self) -> Camera:
        """The camera of every drone: square pixels, centre in the middle, the trouble's lens distortion."""
        plan = self.camera
        focal_px = plan.width / 2.0 / math.tan(math.radians(plan.hfov_deg) / 2.0)
        distortion = list(self.trouble.lens_distortion) or None
        return Camera.pinhole(
            plan.width, plan.height, focal_px, focal_px, plan.width / 2.0, plan.height / 2.0, distortion
        )
