"""Where the drones fly and where their cameras look."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.flight.follow import FollowFlight
from crowdfence.simulation.flight.gimbal import CAMERA_IN_BODY_M, body_attitude, camera_attitude, rigid
from crowdfence.simulation.flight.survey import SurveyFlight
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.people.cyclists import Cyclists
from crowdfence.simulation.scenarios.scenario import Scenario

_STEP_S = 0.25


@dataclass(frozen=True, slots=True)
class DroneState:
    """One drone at one instant; world = local ENU metres, seconds."""

    world_from_body: NDArray[np.float64]
    """[4, 4]; body axes forward, left, up."""
    world_from_camera: NDArray[np.float64]
    """[4, 4]; camera axes right, down, forward (OpenCV)."""
    velocity: NDArray[np.float64]
    """[3] of the body."""


class Pattern(Protocol):
    """What a flight pattern knows: the way of each drone, and where it looks."""

    def position(self, drone: int, t_s: float) -> NDArray[np.float64]:
        """Body [3]."""
        ...

    def heading_rad(self, drone: int, t_s: float) -> float:
        """Where the nose points, counter-clockwise from east."""
        ...

    def look(self, drone: int, t_s: float, camera: NDArray[np.float64]) -> tuple[float, float]:
        """Azimuth (counter-clockwise from east) and tilt below the horizon for a camera at `camera` [3]."""
        ...


@dataclass(frozen=True, slots=True)
class Flight:
    """All drones of a mission."""

    drones: int
    pattern: Pattern

    def at(self, drone: int, t_s: float) -> DroneState:
        """Drone number `drone` (0, 1, ...) at `t_s` seconds after the start of the mission."""
        if not 0 <= drone < self.drones:
            raise ValueError(f"drone must be between 0 and {self.drones - 1}, got {drone}")
        before, now, after = (self.pattern.position(drone, t_s + step) for step in (-_STEP_S, 0.0, _STEP_S))
        velocity = (after - before) / (2.0 * _STEP_S)
        acceleration = (after - 2.0 * now + before) / _STEP_S**2
        attitude = body_attitude(self.pattern.heading_rad(drone, t_s), velocity, acceleration)
        camera = now + attitude @ CAMERA_IN_BODY_M
        azimuth, tilt = self.pattern.look(drone, t_s, camera)
        return DroneState(rigid(attitude, now), rigid(camera_attitude(azimuth, tilt), camera), velocity)


def build_flight(scenario: Scenario, seed: int, landscape: Landscape, cyclists: Cyclists) -> Flight:
    """The flight of `scenario`; ScenarioError when it does not fit into the landscape."""
    if scenario.flight.pattern == "follow":
        return Flight(scenario.drones, FollowFlight.over(scenario, seed, landscape, cyclists))
    return Flight(scenario.drones, SurveyFlight.over(scenario, seed, landscape))
