"""Drones that each show crowd only where the other sees nobody."""

import numpy as np
import pytest

import crowdfence as cf
from crowdfence.pipeline.crowds_apart import CrowdsApart
from support.small_service import CONFIG, START_NS, plain, recording

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
        apart.look([one], np.arange(100))
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


def test_several_pairs_are_one_sentence() -> None:
    thirds = [view("uav3", float(number), range(40, 60)) for number in range(4)]
    looks = [look for pair in zip(pairs(4)[::2], pairs(4)[1::2], thirds, strict=True) for look in pair]
    (told,) = after(*looks)
    assert " and so did 2 other pairs of drones: " in told


def flown(off_m: float) -> cf.Recording:
    """Two drones 30 m above a crowd of 4 m radius; the poses of one say that it is so far to the east."""
    camera = cf.Camera.pinhole(160, 120, 120.0, 120.0, 80.0, 60.0)
    u, v = np.meshgrid(np.arange(16) + 0.5, np.arange(12) + 0.5)
    below = np.hypot(u - 8.0, v - 6.0) * 2.5 < 4.0  # a cell is 2.5 m of ground
    views = []
    for number in range(8):
        for drone, east_m in (("uav1", 25.0), ("uav2", 25.0 + off_m)):
            pose = np.diag([1.0, -1.0, -1.0, 1.0])
            pose[:3, 3] = east_m, 30.0, 30.0
            stamp_ns = START_NS + number * SECOND_NS
            views.append(
                cf.View(drone, stamp_ns, camera, pose, np.where(below, 0.95, 0.0).astype(np.float32))
            )
    return recording(views)


def test_a_run_warns_of_poses_that_put_one_crowd_at_two_places() -> None:
    told = [one for one in cf.run(flown(12.0), plain(), CONFIG).warnings if "each showed crowd" in one]
    assert len(told) == 1 and told[0].startswith("uav1 and uav2 ")
    assert not [one for one in cf.run(flown(0.5), plain(), CONFIG).warnings if "each showed" in one]
