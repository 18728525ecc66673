"""Drones on survey lines: each flies to and fro over its strip of a square, one above the other, and keeps
its camera on the inside of the square."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from crowdfence.simulation.flight.top_surface import TopSurface, rounded_above
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.random_streams import Stream, stream
from crowdfence.simulation.scenarios.plan_checks import ScenarioError
from crowdfence.simulation.scenarios.plans import FlightPlan
from crowdfence.simulation.scenarios.scenario import Scenario

_SPACING_M = 1.0
_CLEARANCE_M = 8.0
_TURN_M = 12.0
_HEIGHT_ROUNDING_M = 14.0
_LOOK_ROUNDING_M = 14.0
_SWEEP_RAD, _NOD_RAD = 0.3, 0.35
_FOCUS_OF_AREA = 0.22
"""How far from the middle of the square the point lies that a drone looks at, over the square's side."""


@dataclass(frozen=True, slots=True)
class Loop:
    """A closed way."""

    curve: CubicSpline
    """(x, y, least height, azimuth of the focus without its whole turns) by arc length."""
    length_m: float
    turns: int
    """Whole turns of the azimuth of the focus on one round."""
    focus: NDArray[np.float64]
    """[x, y] of the point that the camera looks at, more or less."""


@dataclass(frozen=True, slots=True)
class SurveyFlight:
    """Drone i flies `loops[i]` round and round in its own band of heights."""

    plan: FlightPlan
    loops: tuple[Loop, ...]
    start_m: NDArray[np.float64]
    rhythm: NDArray[np.float64]
    """[drones, 3, 2] angular speed and phase of height, nod and sweep."""

    @staticmethod
    def over(scenario: Scenario, seed: int, landscape: Landscape) -> SurveyFlight:
        """The survey of `scenario`; ScenarioError when its square leaves the landscape."""
        plan, drones = scenario.flight, scenario.drones
        _require_inside(plan, landscape)
        rng = stream(seed, Stream.FLIGHT)
        top = TopSurface.of(landscape, plan.altitude_m[0], _CLEARANCE_M)
        angle = rng.uniform(0.0, 2 * np.pi, drones)
        reach_m = _FOCUS_OF_AREA * plan.area_m
        focus = np.array([plan.x_m, plan.y_m]) + reach_m * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        loops = tuple(_loop(_corners(plan, drone, drones), focus[drone], top) for drone in range(drones))
        period_s = rng.uniform([50.0, 23.0, 13.0], [80.0, 41.0, 27.0], (drones, 3))
        phase = rng.uniform(0.0, 2 * np.pi, (drones, 3))
        start = np.array([rng.uniform(0.0, loop.length_m) for loop in loops])
        return SurveyFlight(plan, loops, start, np.stack([2 * np.pi / period_s, phase], axis=-1))

    def position(self, drone: int, t_s: float) -> NDArray[np.float64]:
        """Body [3]."""
        x, y, lowest, _ = self._on_loop(drone, t_s)
        return np.array([x, y, lowest + self._above_m(drone, t_s) - self.plan.altitude_m[0]])

    def heading_rad(self, drone: int, t_s: float) -> float:
        """Along the line; turns begin a little before those of the way and are slower."""
        ahead = self._on_loop(drone, t_s + 2.2)[:2] - self._on_loop(drone, t_s - 1.4)[:2]
        return float(np.arctan2(ahead[1], ahead[0]))

    def look(self, drone: int, t_s: float, camera: NDArray[np.float64]) -> tuple[float, float]:
        """Towards the focus, sweeping and nodding, between the planned tilts."""
        loop = self.loops[drone]
        round_of = self._arc_m(drone, t_s) / loop.length_m
        azimuth = float(self._on_loop(drone, t_s)[3]) + 2 * np.pi * loop.turns * round_of
        away_m = float(np.hypot(*(loop.focus - camera[:2])))
        low, high = np.radians(self.plan.tilt_deg)
        tilt = np.arctan2(self._above_m(drone, t_s), away_m) + _NOD_RAD * self._wave(drone, 1, t_s)
        return azimuth + _SWEEP_RAD * self._wave(drone, 2, t_s), float(np.clip(tilt, low, high))

    def _above_m(self, drone: int, t_s: float) -> float:
        """Altitude in the drone's own band, before the ground below adds to it."""
        low, high = self.plan.altitude_m
        return low + (high - low) * (drone + 0.5 + 0.45 * self._wave(drone, 0, t_s)) / len(self.loops)

    def _arc_m(self, drone: int, t_s: float) -> float:
        return float(np.mod(self.start_m[drone] + self.plan.speed_m_s * t_s, self.loops[drone].length_m))

    def _on_loop(self, drone: int, t_s: float) -> NDArray[np.float64]:
        return np.asarray(self.loops[drone].curve(self._arc_m(drone, t_s)))

    def _wave(self, drone: int, kind: int, t_s: float) -> float:
        speed, phase = self.rhythm[drone, kind]
        return float(np.sin(speed * t_s + phase))


def _require_inside(plan: FlightPlan, landscape: Landscape) -> None:
    west, south, east, north = landscape.extent_m
    half = 0.5 * plan.area_m
    if plan.x_m - half < west or plan.x_m + half > east or plan.y_m - half < south or plan.y_m + half > north:
        raise ScenarioError(
            f"flight.area_m {plan.area_m:g} around ({plan.x_m:g}, {plan.y_m:g}) leaves the landscape, which "
            f"reaches from ({west:.0f}, {south:.0f}) to ({east:.0f}, {north:.0f})"
        )


def _corners(plan: FlightPlan, drone: int, drones: int) -> NDArray[np.float64]:
    """Corners [K, 2] of a closed way up and down over the strip of one drone.

    Strips of even drones lie side by side from west to east and are flown north and south, those of odd
    drones from south to north and are flown east and west, so that ways cross.
    """
    half, across = 0.5 * plan.area_m, drone % 2
    share = (drones + 1 - across) // 2
    width = plan.area_m / share
    lines = max(2, 2 * round(0.5 * width / plan.line_spacing_m))
    place = -half + width * (drone // 2 + (np.arange(lines) + 0.5) / lines)
    along = np.where(np.arange(lines) % 2 == 0, -half, half)
    corners = np.stack([np.repeat(place, 2), np.stack([along, -along], axis=-1).ravel()], axis=-1)
    return np.array([plan.x_m, plan.y_m]) + (corners[:, ::-1] if across else corners)


def _loop(corners: NDArray[np.float64], focus: NDArray[np.float64], top: TopSurface) -> Loop:
    """The way through `corners` and back to the first, rounded, with the least height along it."""
    closed = np.concatenate([corners, corners[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=-1))])
    arc = np.linspace(0.0, along[-1], max(8, round(along[-1] / _SPACING_M)), endpoint=False)
    way = np.stack([np.interp(arc, along, closed[:, axis]) for axis in (0, 1)], axis=-1)
    way = gaussian_filter1d(way, _TURN_M / (arc[1] - arc[0]), axis=0, mode="wrap")
    step = np.linalg.norm(np.diff(np.concatenate([way, way[:1]]), axis=0), axis=-1)
    arc = np.concatenate([[0.0], np.cumsum(step)])
    height = rounded_above(top.at(way), _HEIGHT_ROUNDING_M / _SPACING_M, closed=True)
    turns, azimuth = _azimuth(way, focus, arc[:-1] / arc[-1])
    points = np.column_stack([way, height, azimuth])
    curve = CubicSpline(arc, np.concatenate([points, points[:1]]), bc_type="periodic")
    return Loop(curve, float(arc[-1]), turns, focus)


def _azimuth(
    way: NDArray[np.float64], focus: NDArray[np.float64], round_of: NDArray[np.float64]
) -> tuple[int, NDArray[np.float64]]:
    """Direction of `focus` along a closed way: its whole turns, and the smoothed rest [N].

    Smoothing the angle itself turns the camera steadily where the way passes over the focus.
    """
    to = focus - way
    angle = np.unwrap(np.arctan2(to[:, 1], to[:, 0]))
    closing = np.angle(np.exp(1j * (angle[0] - angle[-1])))
    turns = round((angle[-1] + closing - angle[0]) / (2 * np.pi))
    return turns, gaussian_filter1d(angle - 2 * np.pi * turns * round_of, _LOOK_ROUNDING_M, mode="wrap")
