"""Drones that see nobody where others clearly show a crowd."""

import numpy as np
import pytest
from shapely import Point

import crowdfence as cf
from crowdfence.pipeline.denied_crowd import DeniedCrowd
from support.small_service import CONFIG, plain, recording, sharp, views

SECOND_NS = 10**9
PLAIN = cf.Terrain.from_occupancy(np.ones((10, 10, 1), bool), 0.5)
CROWD = np.arange(40)


def view(
    stamp_s: float, mean: float = 0.0, *, range_m: float = 40.0, tilt_deg: float = 60.0
) -> cf.Observation:
    """A look of uav2 at the whole plain that shows `mean` everywhere; 40 m are a tenth of a metre a pixel."""
    return cf.Observation(
        PLAIN,
        "uav2",
        round(stamp_s * SECOND_NS),
        voxel_ids=np.arange(100),
        mean=np.full(100, mean),
        pixel_count=np.ones(100, int),
        range_m=np.full(100, range_m),
        tilt_deg=np.full(100, tilt_deg),
        occluded_ids=[],
        focal_px=400.0,
    )


def after(*views: cf.Observation, shown: np.ndarray[tuple[int], np.dtype[np.int64]] = CROWD) -> DeniedCrowd:
    denied = DeniedCrowd()
    for one in views:
        denied.look([one], shown)
    return denied


def test_five_looks_over_three_seconds_that_see_nobody_there_are_told() -> None:
    looks = [view(number * 0.8) for number in range(5)]  # 0 to 3.2 s
    assert after(*looks[:4]).now() == {"uav2": None}
    denied = after(*looks)
    (told,) = denied.warnings
    assert told.startswith(
        "uav2 saw nobody in 5 looks in a row, over 3 s, where other drones clearly showed a crowd: "
    )
    assert denied.now() == {"uav2": told}
    # Ten a second are one false alarm of another drone, which stands for two seconds.
    assert not after(*[view(number / 10) for number in range(30)]).warnings


@pytest.mark.parametrize(
    "sees",
    [
        view(2.0, 0.06),  # somebody there, faintly
        view(2.0, 0.6),  # a crowd
    ],
)
def test_one_look_that_shows_somebody_there_ends_the_row(sees: cf.Observation) -> None:
    denied = after(*map(view, (0, 1)), sees, *map(view, (5, 6, 7)))
    assert denied.now() == {"uav2": None} and not denied.warnings
    # What was told of a row that ended stays told of the run.
    denied = after(*map(view, (0, 1, 2, 3, 4)), view(5.0, 0.6))
    assert denied.now() == {"uav2": None} and len(denied.warnings) == 1


def test_false_alarms_that_flash_up_now_and_then_are_no_row() -> None:
    """A minute apart, each stands for 2 s and is looked at twenty times by a drone that is right."""
    flashes = [view(60.0 * minute + number / 10) for minute in range(5) for number in range(20)]
    denied = after(*flashes)
    assert denied.now() == {"uav2": None} and not denied.warnings
    # A picture every few seconds is a row all the same.
    assert after(*[view(5.0 * number) for number in range(5)]).warnings
    # And one that was told goes on when the drone comes back.
    assert after(*[view(number) for number in range(5)], view(60.0)).now()["uav2"] is not None


def test_what_a_drone_showed_itself_is_not_denied_while_it_stands() -> None:
    """Somebody looked, saw a crowd, and it is gone: what the drone showed counts as shown for 2 s."""
    denied = after(view(0.0, 0.9), *[view(0.4 * number) for number in range(1, 6)])
    assert denied.now() == {"uav2": None}


@pytest.mark.parametrize(
    ("look", "shown"),
    [
        ({"range_m": 121.0}, CROWD),  # .3025 m a pixel: people may be missed
        ({"tilt_deg": -5.0}, CROWD),  # from below
        ({}, CROWD[:19]),  # a few voxels may be anything
        ({}, np.empty(0, np.int64)),
        ({}, np.arange(1000, 1100)),  # elsewhere
    ],
)
def test_looks_that_say_nothing_are_not_counted(
    look: dict[str, float], shown: np.ndarray[tuple[int], np.dtype[np.int64]]
) -> None:
    denied = after(*[view(number, **look) for number in range(20)], shown=shown)
    assert denied.now() == {} and not denied.warnings


def test_a_run_warns_of_a_drone_that_sees_nobody() -> None:
    flown = [sharp(one, blind=one.drone == "uav2") for one in views(20, ["uav1", "uav2"])]
    run = cf.run(recording(flown), plain(), CONFIG)
    (told,) = [one for one in run.warnings if "saw nobody" in one]
    assert told.startswith("uav2 saw nobody in 20 looks in a row, over 4 s, ")
    # It has the crowd below it all the time and looks at it as closely as the other: closed all the same.
    assert any(zone.polygon.contains(Point(20.0, 22.0)) for zone in run.zones)
    both_see = cf.run(recording([sharp(one) for one in views(20, ["uav1", "uav2"])]), plain(), CONFIG)
    assert not [one for one in both_see.warnings if "saw nobody" in one]
