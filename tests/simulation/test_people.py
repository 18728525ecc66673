"""Crowds, lone walkers and cyclists: where they are, how fast they are, what they keep away from."""

import hashlib
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from crowdfence.simulation.guide_line import GuideLine
from crowdfence.simulation.people.crowd_motion import CrowdMotion, slot_spacing_m, smooth_step, waves_of
from crowdfence.simulation.people.crowd_slots import core_slots, even_slots
from crowdfence.simulation.people.cyclists import build_cyclists
from crowdfence.simulation.people.people import build_people
from crowdfence.simulation.people.there_and_back import ThereAndBack
from crowdfence.simulation.scenarios.plans import CrowdPlan, CyclistPlan, WalkerPlan
from crowdfence.simulation.scenarios.scenario import ScenarioError
from support.simulated_scenes import SEED, scene_of

RACE_TIMES = np.linspace(0.0, 105.5, 24)


def everywhere(places: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.ones(len(places), np.bool_)


def nearest_m(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(cKDTree(positions).query(positions, k=2)[0][:, 1])


def crowd(plan: CrowdPlan, seed: int, line: GuideLine | None = None) -> CrowdMotion:
    rng = np.random.default_rng(seed)
    made = core_slots if plan.density == "core" else even_slots
    slots = made(plan.people, plan.length_m, plan.depth_m, slot_spacing_m(plan.spacing_m), everywhere, rng)
    assert slots is not None
    line = line or GuideLine.straight(0.0, 0.0, 0.3)
    return CrowdMotion(plan, line, 50.0, 0.0, slots, waves_of(rng), rng.uniform(0.0, 6.3, len(slots)))


# Building blocks


def test_there_and_back_by_hand() -> None:
    swing = ThereAndBack(span_m=100.0, start_m=20.0, roundness=0.97)
    assert swing.place_m(0.0) == pytest.approx(20.0)
    middle_of_way_up = swing.place_m(30.0)
    assert middle_of_way_up == pytest.approx(50.0, abs=2.0), "nearly as far as the way"
    way = np.linspace(0.0, 1000.0, 100_001)
    place = swing.place_m(way)
    assert place.min() == pytest.approx(0.0, abs=1e-3) and place.max() == pytest.approx(100.0, abs=1e-3)
    slope = np.gradient(place, way)
    np.testing.assert_allclose(slope[1:-1], swing.direction(way)[1:-1], atol=1e-4)
    assert np.abs(slope).max() <= 1.0 + 1e-6


def test_smooth_step_by_hand() -> None:
    np.testing.assert_allclose(smooth_step([-1.0, 0.0, 0.25, 0.5, 1.0, 2.0]), [0, 0, 0.103515625, 0.5, 1, 1])


def test_guide_line_around_a_quarter_circle() -> None:
    angle = np.linspace(0.0, np.pi / 2, 200)
    bend = GuideLine.through(20.0 * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=-1))
    assert bend.length_m == pytest.approx(10.0 * np.pi, rel=1e-3)
    np.testing.assert_allclose(bend.heading_rad([0.0, 5.0 * np.pi]), [0.0, np.pi / 4], atol=5e-3)
    np.testing.assert_allclose(bend.position(10.0 * np.pi, 2.0), [18.0, 20.0], atol=0.03)
    np.testing.assert_allclose(bend.position(-5.0, -1.0), [-5.0, -1.0], atol=0.03)
    # 5 m to the left, towards the centre, a step along the line is 15/20 as long; on the right it is longer.
    assert bend.narrowest(5.0, 25.0, 0.0, 5.0) == pytest.approx(0.75, abs=0.01)
    assert bend.narrowest(5.0, 25.0, -5.0, 0.0) == pytest.approx(1.0, abs=0.01)


@given(
    people=st.integers(1, 120),
    spacing=st.floats(0.5, 3.0),
    room=st.floats(1.5, 20.0),
    shape=st.floats(0.2, 5.0),
    seed=st.integers(0, 1000),
)
@settings(max_examples=40)
def test_slots_keep_their_distance(people: int, spacing: float, room: float, shape: float, seed: int) -> None:
    area = people * spacing**2 * room + (4.0 * spacing) ** 2
    length, depth = np.sqrt(area * shape), np.sqrt(area / shape)
    slots = even_slots(people, length, depth, spacing, everywhere, np.random.default_rng(seed))
    assert slots is not None and slots.shape == (people, 2)
    if people > 1:
        assert nearest_m(slots).min() >= spacing * (1 - 1e-9)
    assert np.abs(slots[:, 0]).max() <= length and np.abs(slots[:, 1]).max() <= depth


@given(people=st.integers(1, 120), spacing=st.floats(0.5, 2.0), seed=st.integers(0, 1000))
@settings(max_examples=40)
def test_core_slots_keep_their_distance_and_stay_inside(people: int, spacing: float, seed: int) -> None:
    length, depth = 20.0 * spacing, 16.0 * spacing
    slots = core_slots(people, length, depth, spacing, everywhere, np.random.default_rng(seed))
    assert slots is not None and slots.shape == (people, 2)
    if people > 1:
        assert nearest_m(slots).min() >= spacing
    assert np.abs(slots[:, 0]).max() <= 0.5 * length and np.abs(slots[:, 1]).max() <= 0.5 * depth


def test_core_slots_are_normally_distributed() -> None:
    """Cut off at 2.5 deviations, a normal distribution has a deviation of
    sqrt(1 - 5 phi(2.5) / (2 Phi(2.5) - 1)) = 0.9546 of its own."""
    slots = core_slots(4000, 100.0, 50.0, 1e-6, everywhere, np.random.default_rng(1))
    assert slots is not None
    np.testing.assert_allclose(slots.std(axis=0), [0.9546 * 20.0, 0.9546 * 10.0], rtol=0.03)


def test_core_slots_leave_free_what_is_blocked() -> None:
    slots = core_slots(60, 20.0, 10.0, 0.5, lambda places: places[:, 0] > 1.0, np.random.default_rng(2))
    assert slots is not None and slots[:, 0].min() > 1.0


def test_no_room_is_no_crowd() -> None:
    rng = np.random.default_rng(0)
    assert core_slots(50, 5.0, 5.0, 1.0, everywhere, rng) is None
    assert core_slots(20, 20.0, 20.0, 1.0, lambda places: places[:, 0] > 100.0, rng) is None
    assert even_slots(50, 5.0, 5.0, 1.0, everywhere, rng) is None
    assert even_slots(20, 20.0, 20.0, 1.0, lambda places: places[:, 0] > 100.0, rng) is None


@given(
    motion=st.sampled_from(["march", "stand", "gather"]),
    density=st.sampled_from(["even", "core"]),
    spacing=st.floats(0.5, 1.5),
    t_s=st.floats(-10.0, 5000.0),
    seed=st.integers(0, 50),
)
@settings(max_examples=60)
def test_personal_distance_is_kept_at_any_time(
    motion: str, density: str, spacing: float, t_s: float, seed: int
) -> None:
    plan = CrowdPlan(
        people=40, length_m=24, depth_m=14, spacing_m=spacing, motion=motion, scatter=3.0, density=density
    )
    assert nearest_m(crowd(plan, seed).positions(t_s)).min() >= spacing


def test_gathering_by_numbers() -> None:
    """Four times as wide before, the densest state between, four times as wide again 1.25 gather_s later."""
    plan = CrowdPlan(people=60, length_m=20, depth_m=10, motion="gather", speed_m_s=0.1, scatter=4.0)
    moving = crowd(plan, 3)

    def width(t_s: float) -> float:
        positions = moving.positions(t_s)
        return float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).mean())

    densest = width(50.0)
    assert width(0.0) == pytest.approx(4.0 * densest, rel=0.05)
    assert densest < width(15.0) < width(0.0)
    assert width(79.0) == pytest.approx(densest, rel=0.05)
    assert width(80.0 + 1.25 * 30.0) == pytest.approx(4.0 * densest, rel=0.05)


# The race


def test_race_crowds_move_slowly_and_keep_together() -> None:
    people = scene_of("race").people
    for number, moving in enumerate(people.crowds, start=1):
        mine = people.crowd_id == number
        start, later = (people.positions(t_s)[mine, :2] for t_s in (0.0, 60.0))
        middles = start.mean(axis=0), later.mean(axis=0)
        moved = float(np.linalg.norm(middles[1] - middles[0]))
        way = 60.0 * abs(moving.plan.speed_m_s)
        assert 0.6 * min(way, 0.9 * moving.plan.reach_m) < moved < 1.3 * way, "along a bent road"
        radii = [np.linalg.norm(p - m, axis=1).mean() for p, m in zip((start, later), middles, strict=True)]
        assert 0.7 < radii[1] / radii[0] < 1.4
        assert nearest_m(later).max() < 4.0, "nobody is left behind"


def test_race_people_walk_on_free_ground_and_keep_their_distance() -> None:
    scene = scene_of("race")
    for t_s in RACE_TIMES:
        state = scene.people.at(float(t_s))
        x, y, z = state.position.T
        assert nearest_m(state.position[:, :2]).min() >= 0.5
        assert not scene.landscape.blocked(x, y, 0.1).any()
        np.testing.assert_array_equal(z, scene.landscape.height_m(x, y))
        in_plan = scene.people.crowd_id > 0
        assert state.speed_m_s[in_plan].max() < 1.0 and state.speed_m_s.max() < 1.6
        assert np.isfinite(state.heading_rad).all()
        assert ((state.arms >= 0) & (state.arms <= 1)).all() and (
            (state.phase >= 0) & (state.phase < 6.3)
        ).all()


def test_stated_speed_is_that_of_the_positions() -> None:
    people = scene_of("race").people
    step = people.positions(31.0) - people.positions(30.98)
    np.testing.assert_allclose(
        people.at(30.99).speed_m_s, np.linalg.norm(step[:, :2], axis=1) / 0.02, atol=0.02
    )


def test_nearly_all_planned_people_and_no_lone_walker_are_crowd() -> None:
    people = scene_of("race").people
    for t_s in (0.0, 44.0, 100.0):
        in_crowd = people.at(t_s).in_crowd
        assert in_crowd[people.crowd_id > 0].mean() > 0.97
        assert not in_crowd[people.crowd_id == 0].any()
    alone = replace(people.definition, min_people=1)
    assert replace(people, definition=alone).at(0.0).in_crowd.all(), "the definition decides"


def test_appearance_arrays() -> None:
    people = scene_of("race").people
    count = sum(plan.people for plan in scene_of("race").scenario.crowds) + 24
    assert people.count == count == len(people.kind) == len(people.height_m)
    assert people.colours.shape == (count, 6, 3) and people.colours.dtype == people.kind.dtype == np.uint8
    assert set(people.kind.tolist()) == set(range(6))
    assert people.height_m.min() > 0.9 and people.height_m.max() < 2.1


def test_crowds_without_room_or_place_are_refused_by_name() -> None:
    scene = scene_of("race")

    def build(**changes: object) -> None:
        build_people(replace(scene.scenario, **changes), SEED, scene.landscape)  # type: ignore[arg-type]

    with pytest.raises(
        ScenarioError, match=r"crowds\[0\].place 'harbour' is not in this landscape; it has ground"
    ):
        build(crowds=(CrowdPlan(people=5, place="harbour"),))
    with pytest.raises(ScenarioError, match=r"crowds\[0\]: no room for 60 people 0.6 m apart"):
        build(crowds=(CrowdPlan(people=60, place="ground", x_m=5000.0),))
    with pytest.raises(ScenarioError, match=r"crowds\[0\].gather_s 5 makes people hurry"):
        build(crowds=(CrowdPlan(people=60, motion="gather", gather_s=5.0),))
    one = CrowdPlan(people=30, along_m=300.0, side="left", motion="stand")
    with pytest.raises(ScenarioError, match=r"crowds\[0\] and crowds\[1\] walk into each other"):
        build(crowds=(one, replace(one, along_m=303.0)))
    with pytest.raises(ScenarioError, match=r"walkers.count 20000: only \d+ walkers have room"):
        build(walkers=WalkerPlan(count=20_000), crowds=(one,))


# Cyclists


def test_cyclists_ride_on_the_road_at_possible_speeds() -> None:
    scene = scene_of("race")
    assert scene.landscape.road is not None
    lane = scene.landscape.road.half_width_m
    line = scene.cyclists.line
    assert line is not None
    road = line.position(np.arange(0.0, line.length_m, 0.25))
    for t_s in np.linspace(0.0, 900.0, 300):  # to the end of the road and back
        state = scene.cyclists.at(float(t_s))
        assert cKDTree(road).query(state.position[:, :2])[0].max() < lane
        assert state.speed_m_s.max() < 18.0
        x, y, z = state.position.T
        np.testing.assert_array_equal(z, scene.landscape.height_m(x, y))
        assert nearest_m(state.position).min() > 1.5


def test_cyclists_turn_slowly_at_the_end_of_the_road() -> None:
    cyclists = scene_of("race").cyclists
    times = np.arange(150.0, 300.0, 0.1)
    turn = times[np.argmin(np.abs(cyclists.direction(times)[:, 0]))]
    around = [cyclists.at(float(t_s)) for t_s in np.arange(turn - 6.0, turn + 6.0, 0.05)]
    speed = np.array([state.speed_m_s[0] for state in around])
    assert 0.3 < speed.min() < 3.0
    assert np.abs(np.diff(speed)).max() / 0.05 < 5.0
    turned = np.unwrap([state.heading_rad[0] for state in around])
    assert abs(turned[-1] - turned[0]) == pytest.approx(np.pi, abs=0.6)
    assert np.abs(np.diff(turned)).max() / 0.05 < 6.0, "radians per second"


def test_cyclists_ride_together_when_planned() -> None:
    cyclists = scene_of("race").cyclists
    gaps = -np.diff(cyclists.ways_m(np.array([3.0, 33.5, 70.0])), axis=-1)
    # Own unsteadiness is at most 0.6 m for each of both riders.
    np.testing.assert_allclose(gaps[0], 12.0, atol=1.3)
    np.testing.assert_allclose(gaps[2], 12.0, atol=1.3)
    np.testing.assert_allclose(gaps[1], 100.0, atol=1.3)


def test_impossible_rides_are_refused_by_name() -> None:
    scene = scene_of("race")
    for plan, message in (
        (CyclistPlan(count=1, start_m=9000.0), "cyclists.start_m 9000 must lie between 25 m and"),
        (
            CyclistPlan(count=3, together_s=((50.0, 60.0),), change_s=5.0),
            "cyclists.change_s 5 makes",
        ),
    ):
        with pytest.raises(ScenarioError, match=message):
            build_cyclists(replace(scene.scenario, cyclists=plan), SEED, scene.landscape)


# Determinism

DIGEST = """
import hashlib
import numpy as np
from crowdfence.simulation.schedule import build_schedule
def digest(scene):
    state = hashlib.sha256()
    schedule = build_schedule(scene)
    for t_s in (71.3, 12.0):
        people, riders = scene.people.at(t_s), scene.cyclists.at(t_s)
        for array in (people.position, people.heading_rad, people.phase, people.in_crowd, riders.position):
            state.update(np.ascontiguousarray(array).tobytes())
        for drone in range(scene.scenario.drones):
            state.update(scene.flight.at(drone, t_s).world_from_camera.tobytes())
            state.update(schedule.telemetry(drone, t_s, t_s + 0.2).noisy.camera_quaternion.tobytes())
    state.update(repr([list(schedule.captures(drone)) for drone in range(3)]).encode())
    return state.hexdigest()
"""


def test_another_process_makes_the_same_world() -> None:
    here: dict[str, object] = {"hashlib": hashlib}
    exec(DIGEST, here)
    program = (
        DIGEST
        + "from crowdfence.simulation.scenarios.scenario_file import load_scenario\n"
        + "from crowdfence.simulation.scene import build_scene\n"
        + f"print(digest(build_scene(load_scenario('race'), {SEED})))"
    )
    there = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=120
    )
    assert there.stdout.strip() == here["digest"](scene_of("race"))  # type: ignore[operator]


def test_times_may_be_asked_in_any_order() -> None:
    people = scene_of("race").people
    first = people.at(50.0).position
    people.at(3.0)
    np.testing.assert_array_equal(people.at(50.0).position, first)


# The other scenarios


@pytest.mark.parametrize("name", ["festival", "street", "beach"])
def test_people_of_every_scenario_stand_free_and_apart(name: str) -> None:
    scene = scene_of(name)
    for t_s in np.linspace(0.0, scene.scenario.duration_s, 12):
        state = scene.people.at(float(t_s))
        x, y, z = state.position.T
        assert not scene.landscape.blocked(x, y, 0.1).any()
        np.testing.assert_array_equal(z, scene.landscape.height_m(x, y))
        assert nearest_m(state.position[:, :2]).min() >= 0.5
        assert state.speed_m_s.max() < 2.3


def test_festival_gathers_and_disperses() -> None:
    """The crowd in front of the stage is a crowd only between gather_s and disperse_s."""
    people = scene_of("festival").people
    stage = people.crowd_id == 1
    before, between, after = (people.at(t_s).in_crowd[stage].mean() for t_s in (0.0, 60.0, 137.0))
    assert between > 0.97
    assert before < 0.5 and after < 0.5


def test_on_the_beach_density_decides_what_is_a_crowd() -> None:
    scene = scene_of("beach")
    people = scene.people
    wide = replace(people, definition=replace(people.definition, radius_m=8.0))
    shares = [
        [part.at(10.0).in_crowd[people.crowd_id == number].mean() for number in (1, 2, 3)]
        for part in (people, wide)
    ]
    assert shares[0][0] > 0.95, "0.9 m apart"
    assert max(shares[0][1:]) < 0.3, "2.2 m and 4.5 m apart"
    assert min(shares[1]) > 0.9, "to a definition with a radius of 8 m all three are crowds"


def test_a_crowd_turns_the_corner() -> None:
    people = scene_of("street").people
    turning = people.crowd_id == 1
    headings = [people.crowds[0].line.heading_rad(at) for at in (30.0, 190.0)]
    assert headings == pytest.approx([0.0, np.pi / 2], abs=0.02)
    start, end = (people.positions(t_s)[turning, :2].mean(axis=0) for t_s in (0.0, 89.0))
    assert start[0] < -20.0 and abs(start[1]) < 3.0
    assert end[1] > 5.0 and abs(end[0]) < 6.0
