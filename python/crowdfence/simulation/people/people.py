"""All people of a scene: who they are, and where they are at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.people.appearance import appearance
from crowdfence.simulation.people.bodies import Bodies, random_bodies, usual_bodies
from crowdfence.simulation.people.crowd_motion import CrowdMotion
from crowdfence.simulation.people.crowd_placement import place_crowd
from crowdfence.simulation.people.lone_walkers import LoneWalkers, place_walkers
from crowdfence.simulation.random_colours import random_clothes
from crowdfence.simulation.random_streams import Stream, stream
from crowdfence.simulation.scenarios.plan_checks import ScenarioError
from crowdfence.simulation.scenarios.plans import CrowdDefinition
from crowdfence.simulation.scenarios.scenario import Scenario
from crowdfence.truth.crowd_ground import crowds_of

STRIDE_M = 1.35
_SPEED_STEP_S = 0.05
_WALKING_M_S = 0.18
_WATCHING = 0.4
_CROWDS_APART_M, _MEETING_SAMPLES = 0.6, 40
_WAY_SAMPLES, _WAY_HORIZON_S = 60, 600.0


@dataclass(frozen=True, slots=True)
class PeopleState:
    """All people at one instant (arrays of length P, person p has instance id p + 1)."""

    position: NDArray[np.float64]
    """[P, 3] feet, on the ground."""
    heading_rad: NDArray[np.float64]
    """Where the body faces, counter-clockwise from east."""
    speed_m_s: NDArray[np.float64]
    phase: NDArray[np.float64]
    """Gait, radians: one turn per double step."""
    arms: NDArray[np.float64]
    """0 arms down .. 1 arms up."""
    in_crowd: NDArray[np.bool_]
    """Whether the person belongs to a crowd by the scenario's definition: class CROWD, otherwise GROUND."""


@dataclass(frozen=True, slots=True)
class People:
    """The people of a scene; the crowds' people come first, then the lone walkers."""

    crowds: tuple[CrowdMotion, ...]
    walkers: LoneWalkers
    landscape: Landscape
    definition: CrowdDefinition
    crowd_id: NDArray[np.int64]
    """[P] planned crowd 1, 2, ..., or 0 for a lone walker."""
    kind: NDArray[np.uint8]
    """[P] body and clothing, 0..5."""
    colours: NDArray[np.uint8]
    """[P, 6, 3] skin, hair, top, bottom, shoes, extra."""
    height_m: NDArray[np.float64]
    phase_rad: NDArray[np.float64]
    watching: NDArray[np.bool_]
    """[P] looks at the line that the crowd moves along instead of where it goes."""
    cheering: NDArray[np.float64]
    """[P] how far the arms go up."""
    bodies: Bodies

    @property
    def count(self) -> int:
        return len(self.crowd_id)

    def at(self, t_s: float) -> PeopleState:
        """Everybody at `t_s` seconds after the start of the mission."""
        ground = self.ground_positions(t_s)
        position = self._on_ground(ground)
        before, after = (self.ground_positions(t_s + step) for step in (-_SPEED_STEP_S, _SPEED_STEP_S))
        velocity = (after - before) / (2.0 * _SPEED_STEP_S)
        speed = np.linalg.norm(velocity, axis=-1)
        walked = np.concatenate([*(crowd.walked_m(t_s) for crowd in self.crowds), self.walkers.walked_m(t_s)])
        raised = np.clip(np.sin(1.3 * t_s + 3.0 * self.phase_rad) + 0.3, 0.0, 1.0)
        return PeopleState(
            position,
            self._heading(t_s, velocity, speed),
            speed,
            np.mod(self.phase_rad + 2.0 * np.pi * walked / STRIDE_M, 2.0 * np.pi),
            self.cheering * raised,
            self.in_crowd(position),
        )

    def positions(self, t_s: float) -> NDArray[np.float64]:
        """Feet [P, 3] of everybody at time `t_s`, local ENU metres."""
        return self._on_ground(self.ground_positions(t_s))

    def ground_positions(self, t_s: float) -> NDArray[np.float64]:
        """The same without height [P, 2]."""
        return np.concatenate([*(crowd.positions(t_s) for crowd in self.crowds), self.walkers.positions(t_s)])

    def in_crowd(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which of the people at `position` [P, 3] is in a crowd by the scenario's definition."""
        return crowds_of(position, self.definition.radius_m, self.definition.min_people) >= 0

    def _on_ground(self, ground: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack([ground, self.landscape.height_m(ground[:, 0], ground[:, 1])])

    def _heading(
        self, t_s: float, velocity: NDArray[np.float64], speed: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Towards the line of the crowd for those who stand or watch, ahead for those who walk."""
        look = np.concatenate(
            [*(_towards_line(crowd, t_s) for crowd in self.crowds), np.zeros((self.walkers.count, 2))]
        )
        ahead = velocity / np.maximum(speed, 1e-6)[:, None]
        walking = np.where(self.watching, 0.0, np.clip(speed / _WALKING_M_S, 0.0, 1.0) ** 2)
        walking[self.crowd_id == 0] = 1.0
        facing = (1.0 - walking)[:, None] * look + walking[:, None] * ahead
        own = 0.45 * np.sin(0.23 * t_s + 5.0 * self.phase_rad) * (self.crowd_id > 0)
        return np.asarray(np.arctan2(facing[:, 1], facing[:, 0]) + own)


def build_people(scenario: Scenario, seed: int, landscape: Landscape) -> People:
    """The people of `scenario`; ScenarioError when the landscape has no room for them."""
    crowds = tuple(
        place_crowd(plan, number, seed, landscape) for number, plan in enumerate(scenario.crowds, start=1)
    )
    _require_apart(crowds, scenario.duration_s)
    walkers = place_walkers(scenario.walkers, seed, landscape, _ways(crowds))
    sizes = [len(crowd.slots) for crowd in crowds]
    crowd_id = np.repeat(np.arange(len(crowds) + 1), [walkers.count, *sizes])
    crowd_id = np.concatenate([crowd_id[crowd_id > 0], crowd_id[crowd_id == 0]])
    rng = stream(seed, Stream.APPEARANCE)
    varied = scenario.looks == "random"
    looks = appearance(len(crowd_id), rng, random_clothes(seed) if varied else None)
    bodies = (random_bodies if varied else usual_bodies)(len(crowd_id), seed)
    draws = rng.random((3, len(crowd_id)))
    in_plan = crowd_id > 0
    return People(
        crowds,
        walkers,
        landscape,
        scenario.crowd_definition,
        crowd_id,
        looks.kind,
        looks.colours,
        looks.height_m,
        2.0 * np.pi * draws[0],
        in_plan & (draws[1] < _WATCHING),
        np.where(in_plan & (draws[2] < bodies.cheering_share), np.minimum(0.4 + 2.5 * draws[2], 1.0), 0.0),
        bodies,
    )


def _require_apart(crowds: tuple[CrowdMotion, ...], duration_s: float) -> None:
    """No crowd walks into another during the mission (its first hour)."""
    number = np.repeat(np.arange(len(crowds)), [len(crowd.slots) for crowd in crowds])
    for t_s in np.linspace(0.0, min(duration_s, 3600.0), _MEETING_SAMPLES):
        ground = np.concatenate([np.zeros((0, 2)), *(crowd.positions(t_s) for crowd in crowds)])
        pairs = cKDTree(ground).query_pairs(_CROWDS_APART_M, output_type="ndarray")
        met = pairs[number[pairs[:, 0]] != number[pairs[:, 1]]]
        if len(met):
            one, other = number[met[0]]
            raise ScenarioError(
                f"crowds[{one}] and crowds[{other}] walk into each other {t_s:.0f} s after the start; place "
                "them further apart or let them move less (speed_m_s, reach_m)"
            )


def _ways(crowds: tuple[CrowdMotion, ...]) -> NDArray[np.float64]:
    """Points [N, 2] that show where the crowds pass in ten minutes."""
    times = np.linspace(0.0, _WAY_HORIZON_S, _WAY_SAMPLES)
    return np.concatenate([np.zeros((0, 2)), *(crowd.positions(t_s) for crowd in crowds for t_s in times)])


def _towards_line(crowd: CrowdMotion, t_s: float) -> NDArray[np.float64]:
    """Unit vectors [P, 2] from each person of a crowd towards its line (or along it, in its middle)."""
    along = crowd.along_m + crowd.drift_m(t_s) + crowd.slots[:, 0]
    heading = crowd.line.heading_rad(along)
    if crowd.left_m == 0.0:
        return np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    side = -np.sign(crowd.left_m)
    return np.stack([-side * np.sin(heading), side * np.cos(heading)], axis=-1)
