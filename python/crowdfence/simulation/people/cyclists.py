"""Cyclists on the road."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.simulation.guide_line import GuideLine
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.people.crowd_motion import smooth_step
from crowdfence.simulation.people.crowd_placement import road_line
from crowdfence.simulation.people.there_and_back import ThereAndBack
from crowdfence.simulation.random_streams import Stream, stream
from crowdfence.simulation.scenarios.plan_checks import ScenarioError
from crowdfence.simulation.scenarios.plans import CyclistPlan
from crowdfence.simulation.scenarios.scenario import Scenario

MAX_SPEED_M_S = 18.0
METRES_PER_PEDAL_TURN = 4.6

_ROUNDNESS = 0.9993
_ROAD_END_M = 25.0
_STEP_S = 0.1
_HALF_WHEELBASE_M = 0.5


@dataclass(frozen=True, slots=True)
class CyclistState:
    """All cyclists at one instant (arrays of length C)."""

    position: NDArray[np.float64]
    """[C, 3] on the road, below the middle of the bicycle."""
    heading_rad: NDArray[np.float64]
    """Counter-clockwise from east."""
    pitch_rad: NDArray[np.float64]
    """Positive uphill."""
    pedal_phase: NDArray[np.float64]
    """Radians, one turn per turn of the pedals."""
    speed_m_s: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Cyclists:
    """Who rides where: a way along the road per cyclist, there and back."""

    plan: CyclistPlan
    landscape: Landscape
    line: GuideLine | None
    """Middle of the road; None without cyclists."""
    swing: ThereAndBack
    lane_m: float
    """Distance from the middle of the road; cyclists keep to the right."""
    phase: NDArray[np.float64]

    @property
    def count(self) -> int:
        return self.plan.count

    def spread(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """1 where the riders are `gap_m` apart, 0 where they ride together."""
        t = np.asarray(t_s, np.float64)
        spread = np.ones_like(t)
        for start, end in self.plan.together_s:
            # Whoever is together at the start of the mission has not come from anywhere.
            come = smooth_step((t - start) / self.plan.change_s + 1.0) if start > 0.0 else np.ones_like(t)
            spread *= 1.0 - come * (1.0 - smooth_step((t - end) / self.plan.change_s))
        return np.asarray(spread)

    def ways_m(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """Way [..., C] ridden by each cyclist; the first one is in front."""
        t = np.asarray(t_s, np.float64)[..., None]
        rank = 0.5 * (self.count - 1) - np.arange(self.count)
        gap = self.plan.close_gap_m + (self.plan.gap_m - self.plan.close_gap_m) * self.spread(t)
        own = 0.6 * np.sin(0.31 * t + self.phase)
        return np.asarray(self.plan.speed_m_s * t + rank * gap + own)

    def along_m(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """Arc length [..., C] along the road."""
        return _ROAD_END_M + self.swing.place_m(self.ways_m(t_s))

    def direction(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """1 for those [..., C] who ride up the road's arc length, -1 for those on the way back."""
        return self.swing.direction(self.ways_m(t_s))

    def ground_positions(self, t_s: float) -> NDArray[np.float64]:
        """[C, 2] east, north."""
        if self.line is None:
            return np.zeros((0, 2))
        wobble = 0.15 * np.sin(0.8 * t_s + 2.0 * self.phase)
        return self.line.position(self.along_m(t_s), -(self.lane_m + wobble) * self.direction(t_s))

    def at(self, t_s: float) -> CyclistState:
        """All cyclists at `t_s` seconds after the start of the mission."""
        ground = self.ground_positions(t_s)
        velocity = (self.ground_positions(t_s + _STEP_S) - self.ground_positions(t_s - _STEP_S)) / (
            2 * _STEP_S
        )
        speed = np.linalg.norm(velocity, axis=-1)
        heading = np.arctan2(velocity[:, 1], velocity[:, 0])
        ahead = _HALF_WHEELBASE_M * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        height, front, rear = (
            self.landscape.height_m(at[:, 0], at[:, 1]) for at in (ground, ground + ahead, ground - ahead)
        )
        return CyclistState(
            np.column_stack([ground, height]),
            heading,
            np.arctan2(front - rear, 2 * _HALF_WHEELBASE_M),
            np.mod(2 * np.pi * self.ways_m(t_s) / METRES_PER_PEDAL_TURN + self.phase, 2 * np.pi),
            speed,
        )


def build_cyclists(scenario: Scenario, seed: int, landscape: Landscape) -> Cyclists:
    """The cyclists of `scenario`; ScenarioError for a road that is too short and riders that are too fast."""
    plan = scenario.cyclists
    phase = stream(seed, Stream.CYCLISTS).uniform(0.0, 2 * np.pi, plan.count)
    if plan.count == 0:
        return Cyclists(plan, landscape, None, ThereAndBack(1.0, 0.5, _ROUNDNESS), 0.0, phase)
    line = road_line(landscape)
    assert landscape.road is not None
    span_m = line.length_m - 2 * _ROAD_END_M
    if plan.start_m - _ROAD_END_M > 0.9 * span_m or plan.start_m < _ROAD_END_M:
        raise ScenarioError(
            f"cyclists.start_m {plan.start_m:g} must lie between {_ROAD_END_M:g} m and "
            f"{_ROAD_END_M + 0.9 * span_m:.0f} m of a road {line.length_m:.0f} m long"
        )
    _require_riding(plan)
    swing = ThereAndBack(span_m, plan.start_m - _ROAD_END_M, _ROUNDNESS)
    return Cyclists(plan, landscape, line, swing, 0.5 * landscape.road.half_width_m, phase)


def _require_riding(plan: CyclistPlan) -> None:
    """Nobody races or rolls backwards to keep the planned distances."""
    change = 0.5 * (plan.count - 1) * (plan.gap_m - plan.close_gap_m) * 1.875 / plan.change_s
    if not plan.together_s or (change < plan.speed_m_s and plan.speed_m_s + change <= MAX_SPEED_M_S):
        return
    raise ScenarioError(
        f"cyclists.change_s {plan.change_s:g} makes riders ride at {plan.speed_m_s - change:.1f} to "
        f"{plan.speed_m_s + change:.1f} m/s; more than 0 and at most {MAX_SPEED_M_S:g} m/s are possible: "
        "give them more time, or a smaller gap_m"
    )
