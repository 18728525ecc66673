"""From the plan of a crowd and a landscape to people with room to stand."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.guide_line import GuideLine
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.people.crowd_motion import CrowdMotion, slot_spacing_m, waves_of
from crowdfence.simulation.people.crowd_slots import core_slots, even_slots
from crowdfence.simulation.random_streams import Stream, stream
from crowdfence.simulation.scenarios.plan_checks import ScenarioError
from crowdfence.simulation.scenarios.plans import CrowdPlan

CLEARANCE_M = 0.65
"""From the middle of a body to any obstacle: half a body, its sway, and what two checked moves leave out."""
CORNER_ROUNDING_M = 5.0
MAX_WALKING_M_S = 2.2
_LEAST_STRETCH = 0.35
_SMOOTH_STEP_PEAK = 1.875
_SHIFTS_M = (0.0, 4.0, -4.0, 8.0, -8.0, 14.0, -14.0, 20.0, -20.0, 30.0, -30.0)


def place_crowd(plan: CrowdPlan, number: int, seed: int, landscape: Landscape) -> CrowdMotion:
    """The crowd `number` (1, 2, ...) of a scenario, where nothing blocks the way of any of its people.

    It moves up to 30 m along its line where there is no room at the planned place. Raises ScenarioError when
    the landscape has no such place or line, or its people would have to run to gather in time.
    """
    _require_walking(plan, number)
    line, origin_m = guide_line_of(plan, number, landscape)
    left_m = _left_of_line(plan, landscape)
    rng = stream(seed, Stream.CROWD, number)
    for shift_m in _SHIFTS_M:
        crowd = _placed(plan, line, origin_m + plan.along_m + shift_m, left_m, landscape, rng)
        if crowd is not None:
            return crowd
    raise ScenarioError(
        f"crowds[{number - 1}]: no room for {plan.people} people {plan.spacing_m:g} m apart within "
        f"{max(_SHIFTS_M):g} m of along_m {plan.along_m:g} on {plan.place!r}; "
        "use fewer people, more length_m or depth_m, or another place"
    )


def guide_line_of(plan: CrowdPlan, number: int, landscape: Landscape) -> tuple[GuideLine, float]:
    """The line of a crowd and the arc length at which its `along_m` is 0."""
    if plan.place == "ground":
        heading = np.pi / 2.0 - np.radians(plan.heading_deg)
        line = GuideLine.straight(plan.x_m, plan.y_m, heading)
        return line, 0.5 * line.length_m
    if plan.place == "way":
        return GuideLine.through(np.array(plan.way_m), CORNER_ROUNDING_M), 0.0
    if plan.place == "road" and landscape.road is not None:
        return road_line(landscape), 0.0
    if plan.place not in landscape.places:
        known = ", ".join(["ground", "way", *(["road"] if landscape.road else []), *landscape.places])
        raise ScenarioError(
            f"crowds[{number - 1}].place {plan.place!r} is not in this landscape; it has {known}"
        )
    points = np.atleast_2d(landscape.places[plan.place])[:, :2]
    if len(points) == 1:
        heading = np.pi / 2.0 - np.radians(plan.heading_deg)
        line = GuideLine.straight(points[0, 0] + plan.x_m, points[0, 1] + plan.y_m, heading)
        return line, 0.5 * line.length_m
    return GuideLine.through(points, CORNER_ROUNDING_M), 0.0


def road_line(landscape: Landscape) -> GuideLine:
    """The middle of the landscape's road."""
    road = landscape.road
    if road is None:
        raise ScenarioError("this landscape has no road: set landscape.road = true")
    arc = np.linspace(0.0, road.length_m, max(4, round(road.length_m) + 1))
    return GuideLine.through(road.position(arc, np.zeros_like(arc))[:, :2], rounding_m=1.5)


def _require_walking(plan: CrowdPlan, number: int) -> None:
    if plan.motion != "gather":
        return
    way_m = 0.5 * float(np.hypot(plan.length_m, plan.depth_m)) * (plan.scatter - 1.0)
    speed = way_m * _SMOOTH_STEP_PEAK / (0.75 * plan.gather_s) + abs(plan.speed_m_s)
    if speed > MAX_WALKING_M_S:
        raise ScenarioError(
            f"crowds[{number - 1}].gather_s {plan.gather_s:g} makes people hurry at {speed:.2f} m/s, "
            f"more than {MAX_WALKING_M_S:g} m/s: give them more time or less scatter"
        )


def _left_of_line(plan: CrowdPlan, landscape: Landscape) -> float:
    if plan.side == "middle":
        return 0.0
    edge_m = landscape.road.half_width_m if plan.place == "road" and landscape.road else 0.0
    distance = edge_m + plan.offset_m + 0.5 * plan.depth_m
    return distance if plan.side == "left" else -distance


def _placed(
    plan: CrowdPlan,
    line: GuideLine,
    along_m: float,
    left_m: float,
    landscape: Landscape,
    rng: np.random.Generator,
) -> CrowdMotion | None:
    probe = CrowdMotion(plan, line, along_m, left_m, np.zeros((0, 2)), waves_of(rng), np.zeros(0))
    moves = list(_moves(probe))
    shifts = [shift for shift, _ in moves]
    widest = plan.scatter if plan.motion == "gather" else 1.0
    reach_m = 0.5 * plan.depth_m * widest
    half_m = 0.5 * plan.length_m * widest
    stretch = line.narrowest(
        along_m + min(shifts) - half_m, along_m + max(shifts) + half_m, left_m - reach_m, left_m + reach_m
    )
    if stretch < _LEAST_STRETCH:
        return None

    def is_free(flat: NDArray[np.float64]) -> NDArray[np.bool_]:
        slots = flat / [stretch, 1.0]
        free = np.abs(slots[:, 1]) <= 0.5 * plan.depth_m
        for shift, t_s in moves:
            u, v = probe.frame_places(t_s, slots).T
            point = line.position(along_m + shift + u, left_m + v)
            free &= ~landscape.blocked(point[:, 0], point[:, 1], CLEARANCE_M)
        return free

    # On the inside of bends the strip shrinks along the line, so the slots are laid out on the shrunk strip.
    slots = core_slots if plan.density == "core" else even_slots
    flat = slots(plan.people, plan.length_m, plan.depth_m, slot_spacing_m(plan.spacing_m), is_free, rng)
    if flat is None:
        return None
    return CrowdMotion(
        plan,
        line,
        along_m,
        left_m,
        flat / [stretch, 1.0],
        probe.waves,
        rng.uniform(0.0, 2 * np.pi, len(flat)),
    )


def _moves(crowd: CrowdMotion) -> Iterator[tuple[float, float]]:
    """(way along the line, time) of states that people need room for, about a metre apart."""
    plan = crowd.plan
    if plan.motion == "gather":
        leaving_s = np.linspace(plan.disperse_s, plan.disperse_s + plan.gather_s, 24)
        for t_s in [*np.linspace(0.0, plan.gather_s, 24), *leaving_s]:
            yield crowd.drift_m(float(t_s)), float(t_s)
    gathered_s = 0.5 * (plan.gather_s + plan.disperse_s)
    lowest, highest = crowd.drift_range_m()
    for shift in np.linspace(lowest, highest, 1 + int(np.ceil(highest - lowest))):
        yield float(shift), gathered_s
