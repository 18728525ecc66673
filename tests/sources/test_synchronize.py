"""Grouping frames into instants and judging stamps: hand-made sequences and properties."""

from dataclasses import dataclass
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowdfence.sources.stamps import LAST_STAMP_NS, stamp_faults
from crowdfence.sources.synchronize import Grouped, InstantGrouper, group_instants


@dataclass(frozen=True)
class Shot:
    drone: str
    stamp_ns: int


def shots(*pairs):
    return [Shot(drone, stamp) for drone, stamp in pairs]


def grouped(frames, tolerance):
    return [[(shot.drone, shot.stamp_ns) for shot in group] for group in group_instants(frames, tolerance)]


def test_three_shutters_make_one_instant():
    frames = shots(("a", 0), ("b", 37), ("c", 71), ("a", 100), ("b", 138), ("c", 170))
    assert grouped(frames, 100) == [[("a", 0), ("b", 37), ("c", 71)], [("a", 100), ("b", 138), ("c", 170)]]


def test_a_lost_frame_does_not_shift_the_others():
    frames = shots(("a", 0), ("c", 71), ("a", 100), ("b", 137), ("c", 171))
    assert grouped(frames, 100) == [[("a", 0), ("c", 71)], [("a", 100), ("b", 137), ("c", 171)]]


def test_tolerance_is_inclusive_and_counts_from_the_first():
    assert grouped(shots(("a", 0), ("b", 60), ("c", 100)), 100) == [[("a", 0), ("b", 60), ("c", 100)]]
    assert grouped(shots(("a", 0), ("b", 60), ("c", 101)), 100) == [[("a", 0), ("b", 60)], [("c", 101)]]


def test_equal_stamps_stay_together_after_a_lost_frame():
    # A simulator in lockstep: without the rule, ("a", 100) would join the first group and 100 come twice.
    frames = shots(("b", 0), ("a", 100), ("b", 100))
    assert grouped(frames, 100) == [[("b", 0)], [("a", 100), ("b", 100)]]


def test_no_frames_no_instants():
    assert grouped([], 100) == []


# --- frames as they arrive


def test_an_instant_is_known_once_no_frame_can_join_it_any_more():
    grouper = InstantGrouper(tolerance_ns=100, max_delay_ns=50)
    a, b, c = shots(("a", 0), ("b", 60), ("a", 170))
    assert grouper.push(a) == Grouped([], [])
    assert grouper.push(b) == Grouped([], [])
    # At 170 everything stamped before 120 is there, so nothing can come within 100 of the first frame.
    assert grouper.push(c) == Grouped([[a, b]], [])
    assert grouper.flush() == Grouped([[c]], [])


def test_the_clock_completes_an_instant_without_a_frame():
    grouper = InstantGrouper(tolerance_ns=100, max_delay_ns=50)
    (a,) = shots(("a", 0))
    grouper.push(a)
    assert grouper.advance(150) == Grouped([], [])
    assert grouper.advance(151) == Grouped([[a]], [])


def test_a_frame_whose_time_is_over_is_late_and_in_no_group():
    grouper = InstantGrouper(tolerance_ns=100, max_delay_ns=50)
    a, late, just_in_time = shots(("a", 1000), ("b", 949), ("b", 950))
    grouper.push(a)
    assert grouper.push(late) == Grouped([], [late])
    assert grouper.push(just_in_time) == Grouped([], [])
    assert grouper.flush() == Grouped([[just_in_time, a]], [])


def test_bounds_of_the_grouper_are_named():
    with pytest.raises(ValueError, match="max_delay_ns is -1; it must not be negative"):
        InstantGrouper(0, -1)


fleets = st.dictionaries(
    st.sampled_from("abcde"), st.lists(st.integers(0, 400), min_size=1, max_size=30, unique=True), min_size=1
)


@given(fleets, st.integers(0, 120))
def test_every_frame_lands_in_exactly_one_instant(fleet, tolerance):
    frames = [Shot(drone, stamp) for drone, stamps in fleet.items() for stamp in stamps]
    groups = list(group_instants(frames, tolerance))
    assert sorted((s.drone, s.stamp_ns) for group in groups for s in group) == sorted(
        (s.drone, s.stamp_ns) for s in frames
    )
    for group in groups:
        stamps = [shot.stamp_ns for shot in group]
        assert max(stamps) - min(stamps) <= tolerance
        assert len({shot.drone for shot in group}) == len(group)
    newest = [max(shot.stamp_ns for shot in group) for group in groups]
    assert all(earlier < later for earlier, later in pairwise(newest))


def refused(stamps, max_jump_s=3600.0):
    return {index: fault for index, fault in enumerate(stamp_faults(stamps, max_jump_s)) if fault is not None}


def test_increasing_stamps_are_all_believed():
    assert refused([1, 2, 5, 100]) == {}
    assert refused([]) == {}


def test_a_repeated_stamp_keeps_the_first():
    faults = refused([10, 20, 20, 30])
    assert list(faults) == [2] and "stamp 20 repeats" in faults[2]


def test_one_step_back_costs_one_frame():
    second = 10**9
    faults = refused([1 * second, 2 * second, 3 * second, 2 * second + second // 2, 4 * second, 5 * second])
    assert len(faults) == 1
    (index, fault) = next(iter(faults.items()))
    # Leaving out either of the two that disagree is right; each has its own wording.
    assert (index == 3 and "goes back 0.500 s" in fault) or (index == 2 and "runs ahead" in fault)


def test_one_stamp_far_ahead_does_not_cost_the_frames_after_it():
    second = 10**9
    faults = refused([1 * second, 1000 * second, 2 * second, 3 * second])
    assert list(faults) == [1] and "runs ahead of the frames recorded after it" in faults[1]


@pytest.mark.parametrize("far_first", [False, True])
def test_a_jump_by_hours_costs_the_smaller_part(far_first):
    hour = 3600 * 10**9
    near, far = [hour, hour + 1, hour + 2], [4 * hour + 2]
    stamps = far + near if far_first else near + far
    faults = refused(stamps)
    assert list(faults) == [0 if far_first else 3]
    assert "jumps 3.00 h away from the 3 frames" in next(iter(faults.values()))
    assert "max_jump_s = 3600 s" in next(iter(faults.values()))


HOUR = 3600 * 10**9


@pytest.mark.parametrize("first", [2, 5])
@pytest.mark.parametrize("back", [2, 5])
@pytest.mark.parametrize("away_h", [2, 24])
def test_a_drone_that_returns_within_a_day_keeps_all_its_frames(first, back, away_h):
    before = [HOUR + k for k in range(first)]
    assert refused([*before, *(before[-1] + away_h * HOUR + k for k in range(back))]) == {}


def test_a_drone_that_returns_twice_keeps_all_its_frames():
    flights = [0, 10, 2 * HOUR, 2 * HOUR + 10, 25 * HOUR, 25 * HOUR + 10, 25 * HOUR + 20]
    assert refused(flights) == {}


@pytest.mark.parametrize(
    ("stamps", "left_out"),
    [
        # More than a day later, recorded before, and one frame alone: clocks that are set or damaged.
        ([HOUR, HOUR + 1, HOUR + 2, 26 * HOUR, 26 * HOUR + 1], [3, 4]),
        ([5 * HOUR, 5 * HOUR + 1, HOUR, HOUR + 1, HOUR + 2], [0, 1]),
        ([HOUR, HOUR + 1, 5 * HOUR], [2]),
        # What lies between is no part of either flight.
        ([HOUR, HOUR + 1, 3 * HOUR, 5 * HOUR, 5 * HOUR + 1, 5 * HOUR + 2], [2]),
    ],
)
def test_what_no_return_explains_is_refused(stamps, left_out):
    faults = refused(stamps)
    assert list(faults) == left_out and all("jumps" in fault for fault in faults.values())


def test_a_frame_alone_between_two_flights_tells_how_far_it_is_from_the_nearer():
    faults = refused([0, 1, 3 * HOUR, 5 * HOUR, 5 * HOUR + 1])
    assert "jumps 2.00 h away from the 4 frames" in faults[2]


@pytest.mark.parametrize("stamp", [-1, LAST_STAMP_NS + 1, 2**70])
def test_stamps_out_of_range(stamp):
    assert "is outside [0," in refused([stamp])[0]


@given(st.lists(st.integers(-5, 60), max_size=40))
def test_what_is_believed_increases_and_nothing_could_be_added(stamps):
    faults = stamp_faults(stamps, float("inf"))
    believed = [stamp for stamp, fault in zip(stamps, faults, strict=True) if fault is None]
    assert all(earlier < later for earlier, later in pairwise(believed))
    assert len(believed) == longest_increasing_by_trying([stamp for stamp in stamps if stamp >= 0])


def longest_increasing_by_trying(values):
    """Quadratic dynamic programme over the first occurrences."""
    first = list(dict.fromkeys(values))
    best = []
    for index, value in enumerate(first):
        best.append(1 + max((best[before] for before in range(index) if first[before] < value), default=0))
    return max(best, default=0)


@given(fleets, st.integers(0, 120), st.integers(0, 200), st.randoms(use_true_random=False))
def test_arrival_in_any_order_within_the_delay_gives_the_instants_of_the_recording(
    fleet, tolerance, delay, random
):
    frames = [Shot(drone, stamp) for drone, stamps in fleet.items() for stamp in stamps]
    arrivals = sorted(frames, key=lambda shot: shot.stamp_ns + random.uniform(0, delay))
    grouper = InstantGrouper(tolerance, delay)
    steps = [grouper.push(shot) for shot in arrivals]
    groups = [group for step in [*steps, grouper.flush()] for group in step.instants]
    assert not any(step.late for step in steps)
    assert [sorted(group, key=lambda s: (s.stamp_ns, s.drone)) for group in groups] == [
        sorted(group, key=lambda s: (s.stamp_ns, s.drone)) for group in group_instants(frames, tolerance)
    ]
