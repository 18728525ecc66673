"""Each drone follows one cyclist, and in parts of the flight all look at the same place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from crowdfence.simulation.flight.top_surface import TopSurface, rounded_above
from crowdfence.simulation.guide_line import GuideLine
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.people.crowd_motion import smooth_step
from crowdfence.simulation.people.cyclists import Cyclists
from crowdfence.simulation.random_streams import Stream, stream
from crowdfence.simulation.scenarios.plans import FlightPlan
from crowdfence.simulation.scenarios.scenario import Scenario

SIDE_M = 9.0
"""Greatest distance of a drone from the smoothed middle of the road, on its own side of it."""

_CLEARANCE_M = 4.0
_WAY_ROUNDING_M = 14.0
_HEIGHT_ROUNDING_M = 12.0
_NEXT_IN_LINE_M = 14.0
_TURN_S = 3.0
_EYES_ABOVE_ROAD_M = 1.0


@dataclass(frozen=True, slots=True)
class FollowFlight:
    """Drone i behind cyclist i (modulo their number) on a rounded copy of the road."""

    plan: FlightPlan
    cyclists: Cyclists
    way: GuideLine
    lowest_m: CubicSpline
    """Height below which no drone flies, by arc length of the way."""
    per_road_m: float
    """Metres along the way per metre along the road: rounding shortens it."""
    rhythm: NDArray[np.float64]
    """[drones, 4, 2] angular speed and phase of height, distance, side and look-ahead."""

    @staticmethod
    def over(scenario: Scenario, seed: int, landscape: Landscape, cyclists: Cyclists) -> FollowFlight:
        """The flight of `scenario` along the road of `landscape`."""
        road = cyclists.line
        assert road is not None  # `Scenario` refuses to follow nobody
        arc = np.linspace(0.0, road.length_m, round(road.length_m) + 1)
        way = GuideLine.through(road.position(arc), _WAY_ROUNDING_M)
        rng = stream(seed, Stream.FLIGHT)
        period_s = rng.uniform([26.0, 19.0, 31.0, 11.0], [44.0, 33.0, 52.0, 19.0], (scenario.drones, 4))
        phase = rng.uniform(0.0, 2 * np.pi, (scenario.drones, 4))
        return FollowFlight(
            scenario.flight,
            cyclists,
            way,
            _lowest(way, TopSurface.of(landscape, scenario.flight.altitude_m[0], _CLEARANCE_M)),
            way.length_m / road.length_m,
            np.stack([2 * np.pi / period_s, phase], axis=-1),
        )

    def position(self, drone: int, t_s: float) -> NDArray[np.float64]:
        """Body [3]."""
        rider = drone % self.cyclists.count
        back, side = self._distance_m(drone, t_s), self._side_m(drone, t_s)
        direction = float(self.cyclists.direction(t_s)[rider])
        along = self._way_m(float(self.cyclists.along_m(t_s)[rider]) - direction * back)
        low, high = self.plan.altitude_m
        height = float(self.lowest_m(np.clip(along, 0.0, self.way.length_m)))
        ground = self.way.position(along, side)
        return np.array([*ground, height + (high - low) * (0.5 + 0.5 * self._wave(drone, 0, t_s))])

    def heading_rad(self, drone: int, t_s: float) -> float:
        """Along the way, towards the rider."""
        rider = drone % self.cyclists.count
        to = self.cyclists.ground_positions(t_s)[rider] - self.position(drone, t_s)[:2]
        return float(np.arctan2(to[1], to[0]))

    def look(self, drone: int, t_s: float, camera: NDArray[np.float64]) -> tuple[float, float]:
        """At the road ahead of the rider, or, while the view is shared, ahead of the middle rider."""
        rider = drone % self.cyclists.count
        ahead = 6.0 + 10.0 * (0.5 + 0.5 * self._wave(drone, 3, t_s))
        own = self._target(float(self.cyclists.along_m(t_s)[rider]), rider, ahead, t_s)
        middle = self.cyclists.count // 2
        shared = self._target(float(self.cyclists.along_m(t_s).mean()), middle, 16.0, t_s)
        share = self.shared(t_s)
        to = (1.0 - share) * own + share * shared - camera
        tilt = float(np.arctan2(-to[2], np.hypot(to[0], to[1])))
        low, high = np.radians(self.plan.tilt_deg)
        return float(np.arctan2(to[1], to[0])), float(np.clip(tilt, low, high))

    def shared(self, t_s: float) -> float:
        """1 while all drones look at the same place, 0 while each looks at its own rider."""
        share = 0.0
        for start, end in self.plan.shared_view_s:
            turn = smooth_step((t_s - start) / _TURN_S) * (1.0 - smooth_step((t_s - end) / _TURN_S))
            share = max(share, float(turn))
        return share

    def _target(self, along_m: float, rider: int, ahead_m: float, t_s: float) -> NDArray[np.float64]:
        direction = float(self.cyclists.direction(t_s)[rider])
        road = self.cyclists.line
        assert road is not None
        x, y = road.position(along_m + direction * ahead_m)
        height = self.cyclists.landscape.height_m(np.array([x]), np.array([y]))[0]
        return np.array([x, y, height + _EYES_ABOVE_ROAD_M])

    def _distance_m(self, drone: int, t_s: float) -> float:
        low, high = self.plan.distance_m
        further = _NEXT_IN_LINE_M * (drone // self.cyclists.count)
        return further + low + (high - low) * (0.5 + 0.5 * self._wave(drone, 1, t_s))

    def _side_m(self, drone: int, t_s: float) -> float:
        """Drones take turns on the left and on the right of the road."""
        sign = 1.0 if drone % 2 else -1.0
        return sign * SIDE_M * (0.7 + 0.3 * self._wave(drone, 2, t_s))

    def _way_m(self, road_m: float) -> float:
        return road_m * self.per_road_m

    def _wave(self, drone: int, kind: int, t_s: float) -> float:
        speed, phase = self.rhythm[drone, kind]
        return float(np.sin(speed * t_s + phase))


def _lowest(way: GuideLine, top: TopSurface) -> CubicSpline:
    """Smooth height by arc length, above everything within reach of the way."""
    arc = np.arange(0.0, way.length_m + 1.0)
    sides = np.linspace(-SIDE_M, SIDE_M, 7)
    highest = np.stack([top.at(way.position(arc, side)) for side in sides]).max(axis=0)
    return CubicSpline(arc, rounded_above(highest, _HEIGHT_ROUNDING_M, closed=False))
