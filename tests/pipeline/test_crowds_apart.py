"""Drones that each show crowd only where the other sees nobody."""

import numpy as np
import pytest

import crowdfence as cf
from crowdfence.pipeline.close_look import CloseLook
from crowdfence.pipeline.crowds_apart import CrowdsApart
from support.crowd_of_two import seen_by_two
from support.small_service import CONFIG, plain, recording

SECOND_NS = 10**9
PLAIN = cf.Terrain.from_occupancy(np.ones((10, 10, 1), bool), 0.5)
WEST, EAST, BOTH = range(40), range(60, 100), range(100)


def view(drone: str, stamp_s: float, crowd: range, *, faint: float = 0.0, **how: float) -> cf.Observation:
    """A look at the whole plain that shows crowd there, and `faint` elsewhere; 40 m are .1 m a pixel."""
    mean = np.full(100, faint)
    mean[crowd] = 0.9
    look = {"range_m": 40.0, "tilt_deg": 60.0} | how
    return cf.Observation(
        PLAIN,
        drone,
        round(stamp_s * SECOND_NS),
        voxel_ids=np.arange(100),
        mean=mean,
        pixel_count=np.ones(100, int),
        range_m=np.full(100, look["range_m"]),
        tilt_deg=np.full(100, look["tilt_deg"]),
        occluded_ids=[],
        focal_px=400.0,
    )


def after(*looks: cf.Observation) -> list[str]:
    """All that is shown stands, of whichever drone."""
    apart = CrowdsApart()
    for one in looks:
        apart.look([CloseLook(one)], np.arange(100))
    return apart.warnings


def pairs(
    count: int, second: range = EAST, *, every_s: float = 1.0, late_s: float = 0.0, **how: float
) -> list[cf.Observation]:
    """uav1 shows crowd in the west and uav2 the `second` at the same time, so often."""
    looks = []
    for number in range(count):
        looks.append(view("uav1", every_s * number, WEST))
        looks.append(view("uav2", every_s * number + late_s, second, **how))
    return looks


def test_a_crowd_that_two_drones_show_at_two_places_is_told() -> None:
    # Each look but the first is held against the other drone's last one: 7 from 0 to 3 s.
    (told,) = after(*pairs(4))
    assert told.startswith(
        "uav1 and uav2 each showed crowd only where the other saw nobody, in 7 looks in a row, over 3 s: "
    )
    assert not after(*pairs(3)), "2 s, as long as a false alarm stands"
    # A picture in a minute, of both within 1 s: only looks of the same moment are compared.
    (told,) = after(*pairs(6, every_s=60.0, late_s=0.9))
    assert ", in 6 looks in a row, over 300 s: " in told
    assert not after(*pairs(6, every_s=60.0, late_s=1.1))


@pytest.mark.parametrize(
    ("second", "how"),
    [
        (BOTH, {}),  # it shows that of the other too
        (range(35, 75), {}),  # an eighth of it: places that overlap
        (range(0), {}),  # it shows none: blind, or the other is wrong
        (EAST, {"faint": 0.06}),  # it sees somebody there, faintly
        (EAST, {"range_m": 121.0}),  # it may miss people
        (EAST, {"tilt_deg": -5.0}),
        (range(81, 100), {}),  # a few voxels may be anything
    ],
)
def test_what_is_not_apart_is_not_told(second: range, how: dict[str, float]) -> None:
    assert not after(*pairs(20, second, **how))


def test_one_look_that_shows_the_same_crowd_ends_the_row() -> None:
    same = view("uav2", 2.5, WEST)
    later = [
        view(drone, 3.0 + number, crowd)
        for number in range(3)
        for drone, crowd in (("uav1", WEST), ("uav2", EAST))
    ]
    assert not after(*pairs(3), same, *later)


def test_it_is_told_now_until_they_show_the_same_crowd_or_one_is_left_out() -> None:
    apart = CrowdsApart()

    def now(*looks: cf.Observation, left_out: tuple[str, ...] = ()) -> tuple[bool, bool]:
        for one in looks:
            apart.look([CloseLook(one)], np.arange(100))
        return apart.now(left_out) is not None, apart.is_undecided

    assert now(*pairs(3)) == (False, True), "too short to say"
    assert now(view("uav1", 3.0, WEST), view("uav2", 3.0, EAST)) == (True, False)
    assert now(left_out=("uav2",)) == (False, False)
    assert now(left_out=("uav3",)) == (True, False)
    assert now(view("uav2", 3.5, WEST)) == (False, False)
    assert apart.warnings, "of a whole flight"
    same = CrowdsApart()
    for one in (view("uav1", 0.0, WEST), view("uav2", 0.0, WEST)):
        same.look([CloseLook(one)], np.arange(100))
    assert same.now(()) is None and not same.is_undecided


def test_several_pairs_are_one_sentence() -> None:
    thirds = [view("uav3", float(number), range(40, 60)) for number in range(4)]
    looks = [look for pair in zip(pairs(4)[::2], pairs(4)[1::2], thirds, strict=True) for look in pair]
    (told,) = after(*looks)
    assert " and so did 2 other pairs of drones: " in told


def test_a_run_warns_of_poses_that_put_one_crowd_at_two_places() -> None:
    def told(off_m: float) -> list[str]:
        run = cf.run(recording(seen_by_two(off_m)), plain(), CONFIG)
        return [one for one in run.warnings if "each showed crowd" in one]

    (sentence,) = told(12.0)
    assert sentence.startswith("uav1 and uav2 ")
    assert not told(0.5)
