"""How one crowd moves: a function of time that never brings two of its people closer than planned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.simulation.guide_line import GuideLine
from crowdfence.simulation.people.there_and_back import ThereAndBack
from crowdfence.simulation.scenarios.plans import CrowdPlan

SWAY_M = 0.12
SHIFT_M = 0.03
"""Amplitudes of the sway that neighbours share and of each person's own."""

_ROUNDNESS = 0.97
_BEFORE_START = 0.06
_MAX_STRAIN = 0.12


@dataclass(frozen=True, slots=True)
class CrowdMotion:
    """Positions of the people of one crowd at any time.

    Each person has a slot (along, across) in a frame that moves along `line`. A crowd that gathers is a
    stretched copy of its densest state: the stretch is never below 1 and grows from the middle outwards, so
    no two people are ever closer than in the densest state, whatever the way.
    """

    plan: CrowdPlan
    line: GuideLine
    along_m: float
    left_m: float
    """Middle of the crowd at the start: arc length, and distance to the left of the line."""
    slots: NDArray[np.float64]
    """[P, 2] metres along and across, from the middle."""
    waves: NDArray[np.float64]
    """Shared sway, rows (wave number along, across [rad/m], angular speed [rad/s], phase [rad])."""
    phase_rad: NDArray[np.float64]
    """[P] of each person's own small movement."""

    def drift_m(self, t_s: float) -> float:
        """How far the middle has moved along the line: there and back, never faster than planned."""
        plan = self.plan
        if plan.motion == "stand" or plan.speed_m_s == 0.0:
            return 0.0
        behind_m = _BEFORE_START * plan.reach_m
        swing = ThereAndBack(plan.reach_m, behind_m, _ROUNDNESS)
        way_m = float(swing.place_m(abs(plan.speed_m_s) * t_s)) - behind_m
        return float(np.sign(plan.speed_m_s)) * way_m

    def drift_range_m(self) -> tuple[float, float]:
        """Least and greatest `drift_m` at any time."""
        if self.plan.motion == "stand" or self.plan.speed_m_s == 0.0:
            return 0.0, 0.0
        behind, ahead = _BEFORE_START * self.plan.reach_m, (1.0 - _BEFORE_START) * self.plan.reach_m
        return (-behind, ahead) if self.plan.speed_m_s > 0.0 else (-ahead, behind)

    def stretch(self, t_s: float, radius: NDArray[np.float64]) -> NDArray[np.float64]:
        """How much wider than at its densest the crowd is, for people at relative `radius` (0 to about 1)."""
        plan = self.plan
        if plan.motion != "gather":
            return np.ones_like(radius)
        late, moving_s = 0.25 * plan.gather_s * np.clip(radius, 0.0, 1.0), 0.75 * plan.gather_s
        arrived = smooth_step((t_s - late) / moving_s)
        left = smooth_step((t_s - plan.disperse_s - 0.25 * plan.gather_s + late) / moving_s)
        return np.asarray(1.0 + (plan.scatter - 1.0) * (1.0 - arrived + left))

    def frame_places(self, t_s: float, slots: NDArray[np.float64]) -> NDArray[np.float64]:
        """Slots [P, 2] as stretched at time `t_s`, without sway."""
        half = 0.5 * np.array([self.plan.length_m, self.plan.depth_m])
        # One radius for every direction: the stretch must grow along every ray, whatever the crowd's shape.
        radius = np.linalg.norm(slots, axis=-1) / np.linalg.norm(half)
        return np.asarray(slots * self.stretch(t_s, radius)[:, None])

    def positions(self, t_s: float) -> NDArray[np.float64]:
        """Positions [P, 2] east, north."""
        place = self.frame_places(t_s, self.slots)
        phase = self.slots @ self.waves[:, :2].T + self.waves[:, 2] * t_s + self.waves[:, 3]
        sway = SWAY_M * np.stack([np.sin(phase[:, :2]).mean(axis=1), np.sin(phase[:, 2:]).mean(axis=1)], -1)
        own = SHIFT_M * np.stack(
            [np.sin(0.9 * t_s + self.phase_rad), np.sin(0.7 * t_s + 2.0 * self.phase_rad)], -1
        )
        u, v = (place + sway + own).T
        return self.line.position(self.along_m + self.drift_m(t_s) + u, self.left_m + v)

    def walked_m(self, t_s: float) -> NDArray[np.float64]:
        """Way [P] since the start as the legs need it: along the line and towards the middle."""
        moved = self.frame_places(t_s, self.slots) - self.frame_places(0.0, self.slots)
        return np.asarray(abs(self.drift_m(t_s)) + np.linalg.norm(moved, axis=-1))


def waves_of(rng: np.random.Generator) -> NDArray[np.float64]:
    """Four waves of the shared sway, 9 to 16 m and 10 to 20 s long."""
    number, direction = 2 * np.pi / rng.uniform(9.0, 16.0, 4), rng.uniform(0.0, 2 * np.pi, 4)
    speed = 2 * np.pi / rng.uniform(10.0, 20.0, 4)
    return np.stack(
        [number * np.cos(direction), number * np.sin(direction), speed, rng.uniform(0.0, 2 * np.pi, 4)], -1
    )


def slot_spacing_m(spacing_m: float) -> float:
    """Distance of slots that leaves `spacing_m` between people however they sway."""
    return (spacing_m + 2.0 * np.sqrt(2.0) * SHIFT_M) / (1.0 - _MAX_STRAIN)


def smooth_step(x: ArrayLike) -> NDArray[np.float64]:
    """0 below 0, 1 above 1, twice continuously differentiable in between."""
    clipped = np.clip(np.asarray(x, np.float64), 0.0, 1.0)
    return np.asarray(clipped**3 * (10.0 - 15.0 * clipped + 6.0 * clipped**2))
