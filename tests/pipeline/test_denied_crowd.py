"""Drones that see nobody where others clearly show a crowd."""

import numpy as np
import pytest
from shapely import Point

import crowdfence as cf
from crowdfence.pipeline.close_look import CloseLook
from crowdfence.pipeline.denied_crowd import DeniedCrowd
from support.small_service import CONFIG, plain, recording, sharp, views

SECOND_NS = 10**9
PLAIN = cf.Terrain.from_occupancy(np.ones((10, 10, 1), bool), 0.5)
CROWD = np.arange(40)


def view(
    stamp_s: float,
    mean: float = 0.0,
    *,
    range_m: float = 40.0,
    tilt_deg: float = 60.0,
    drone: str = "uav2",
    voxels: int = 100,
) -> cf.Observation:
    """A look of uav2 at the whole plain that shows `mean` everywhere; 40 m are a tenth of a metre a pixel."""
    return cf.Observation(
        PLAIN,
        drone,
        round(stamp_s * SECOND_NS),
        voxel_ids=np.arange(voxels),
        mean=np.full(voxels, mean),
        pixel_count=np.ones(voxels, int),
        range_m=np.full(voxels, range_m),
        tilt_deg=np.full(voxels, tilt_deg),
        occluded_ids=[],
        focal_px=400.0,
    )


def after(*views: cf.Observation, shown: np.ndarray[tuple[int], np.dtype[np.int64]] = CROWD) -> DeniedCrowd:
    denied = DeniedCrowd()
    for one in views:
        denied.look([CloseLook(one)], shown, CROWD)
    return denied


def told_at(denied: DeniedCrowd, stamp_s: float = 60.0) -> dict[str, str | None]:
    now = denied.now(round(stamp_s * SECOND_NS))
    return {drone: None if denial is None else denial.text for drone, denial in now.items()}


def test_five_looks_over_three_seconds_that_see_nobody_there_are_told() -> None:
    looks = [view(number * 0.8) for number in range(5)]  # 0 to 3.2 s
    assert told_at(after(*looks[:4])) == {"uav2": None}
    denied = after(*looks)
    (told,) = denied.warnings
    assert told.startswith(
        "uav2 saw nobody in 5 looks in a row, over 3 s, where other drones clearly showed a crowd: "
    )
    assert told_at(denied) == {"uav2": told}
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
    assert told_at(denied) == {"uav2": None} and not denied.warnings
    # What was told of a row that ended stays told of the run.
    denied = after(*map(view, (0, 1, 2, 3, 4)), view(5.0, 0.6))
    assert told_at(denied) == {"uav2": None} and len(denied.warnings) == 1


def test_false_alarms_that_flash_up_now_and_then_are_no_row() -> None:
    """A minute apart, each stands for 2 s and is looked at twenty times by a drone that is right."""
    flashes = [view(60.0 * minute + number / 10) for minute in range(5) for number in range(20)]
    denied = after(*flashes)
    assert told_at(denied) == {"uav2": None} and not denied.warnings
    # A picture every few seconds is a row all the same.
    assert after(*[view(5.0 * number) for number in range(5)]).warnings
    # And one that was told goes on when the drone comes back.
    assert told_at(after(*[view(number) for number in range(5)], view(60.0)))["uav2"] is not None


def shows_and_misses(
    rounds: int, *, every_s: float = 15.0, between: dict[str, float] | None = None
) -> DeniedCrowd:
    """uav1 shows the crowd once in so long, and half of that later uav2 sees nobody there; or others do so
    `between` the two. What uav1 shows stands for 2 s: nothing of it does when uav2 looks."""
    denied, none = DeniedCrowd(), np.empty(0, np.int64)
    for number in range(rounds):
        stamp_s = every_s * number
        denied.look([CloseLook(view(stamp_s, 0.9, drone="uav1", voxels=40))], CROWD, CROWD)
        if between is not None:
            denied.look([CloseLook(view(**{"stamp_s": stamp_s + 4.0} | between))], none, none)  # type: ignore[arg-type]
        denied.look([CloseLook(view(stamp_s + every_s / 2.0))], none, none)
    return denied


@pytest.mark.parametrize("every_s", [5.0, 15.0, 300.0])
def test_crowd_that_stays_where_a_drone_sees_nobody_is_denied_however_seldom_others_look(
    every_s: float,
) -> None:
    assert not shows_and_misses(5, every_s=every_s).warnings, "shown again four times"
    denied = shows_and_misses(6, every_s=every_s)
    (told,) = denied.warnings
    assert told.startswith(
        f"uav2 saw nobody in 5 looks in a row, over {4.0 * every_s:.0f} s, where other drones "
    )
    assert told_at(denied, 5.5 * every_s)["uav2"] == told


@pytest.mark.parametrize(
    "between",
    [
        {"drone": "uav1"},  # who showed it sees nobody either: it has gone, or was a false alarm
        {"drone": "uav2", "mean": 0.06},  # somebody there, faintly
        {"drone": "uav2", "mean": 0.6},
    ],
)
def test_crowd_that_goes_and_comes_is_not_denied(between: dict[str, float]) -> None:
    assert not shows_and_misses(20, between=between).warnings


@pytest.mark.parametrize(
    "between",
    [
        {"drone": "uav3"},  # as blind: it never showed anybody
        {"drone": "uav1", "range_m": 121.0},  # people may be missed
        {"drone": "uav1", "tilt_deg": -5.0},
    ],
)
def test_who_may_miss_it_too_takes_no_crowd_away(between: dict[str, float]) -> None:
    assert "uav2" in {told.split()[0] for told in shows_and_misses(6, between=between).warnings}


@pytest.mark.parametrize("look", [{"range_m": 121.0}, {"tilt_deg": -5.0}, {"voxels": 19}])
def test_crowd_that_a_drone_may_miss_is_not_denied(look: dict[str, float]) -> None:
    denied = DeniedCrowd()
    for number in range(20):
        denied.look([CloseLook(view(15.0 * number, 0.9, drone="uav1", voxels=40))], CROWD, CROWD)
        late = view(**{"stamp_s": 15.0 * number + 7.0} | look)  # type: ignore[arg-type]
        denied.look([CloseLook(late)], np.empty(0, np.int64), CROWD)
    assert not denied.warnings


BLIND = [view(number) for number in range(5)]


def test_one_that_is_gone_is_told_until_others_have_looked_at_the_ground_in_question() -> None:
    hour_s = 3600.0
    assert told_at(after(*BLIND), hour_s)["uav2"] is not None, "time settles nothing"
    seen = view(10.0, 0.2, drone="uav1", voxels=40)
    assert told_at(after(*BLIND, seen), 63.0)["uav2"] is not None, "it may come back"
    assert told_at(after(*BLIND, seen), 65.0)["uav2"] is None
    assert told_at(after(*BLIND, seen), hour_s)["uav2"] is None
    # It goes on looking at it, whoever looks there too.
    assert told_at(after(*BLIND, seen, view(11.0)), hour_s)["uav2"] is not None
    # One that comes back may be as blind as it was.
    elsewhere = view(hour_s, voxels=10)
    assert told_at(after(*BLIND, seen, elsewhere), hour_s + 1.0)["uav2"] is not None


@pytest.mark.parametrize(
    "look",
    [
        {"voxels": 39},  # one voxel of the crowd that was denied is left
        {"range_m": 121.0},  # people may be missed
        {"tilt_deg": -5.0},
        {"drone": "uav2"},  # it agrees with itself
        {"stamp_s": 3.9},  # before it looked there last
    ],
)
def test_looks_that_settle_nothing(look: dict[str, float]) -> None:
    denied = after(*BLIND, view(**{"stamp_s": 10.0, "drone": "uav1"} | look))  # type: ignore[arg-type]
    assert told_at(denied, 3600.0)["uav2"] is not None


def test_two_blind_drones_do_not_settle_each_other() -> None:
    denied = after(*BLIND, *[view(10.0 + number, drone="uav3") for number in range(5)])
    assert {drone for drone, text in told_at(denied, 3600.0).items() if text} == {"uav2", "uav3"}


def test_another_occasion_is_known_from_the_one_before() -> None:
    first, *_ = after(*BLIND).now(0).values()
    few, *_ = after(*BLIND, *[view(60.0 + number) for number in range(4)]).now(0).values()
    again, *_ = after(*BLIND, *[view(60.0 + number) for number in range(5)]).now(0).values()
    assert first and few and again
    assert (first.since_ns, few.since_ns, again.since_ns) == (0, 0, 60 * SECOND_NS)


def test_what_a_drone_showed_itself_is_not_denied_while_it_stands() -> None:
    """Somebody looked, saw a crowd, and it is gone: what the drone showed counts as shown for 2 s."""
    denied = after(view(0.0, 0.9), *[view(0.4 * number) for number in range(1, 6)])
    assert told_at(denied) == {"uav2": None}


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
    assert told_at(denied) == {} and not denied.warnings


def test_a_run_warns_of_a_drone_that_sees_nobody() -> None:
    flown = [sharp(one, blind=one.drone == "uav2") for one in views(20, ["uav1", "uav2"])]
    run = cf.run(recording(flown), plain(), CONFIG)
    (told,) = [one for one in run.warnings if "saw nobody" in one]
    assert told.startswith("uav2 saw nobody in 20 looks in a row, over 4 s, ")
    # It has the crowd below it all the time and looks at it as closely as the other: closed all the same.
    assert any(zone.polygon.contains(Point(20.0, 22.0)) for zone in run.zones)
    both_see = cf.run(recording([sharp(one) for one in views(20, ["uav1", "uav2"])]), plain(), CONFIG)
    assert not [one for one in both_see.warnings if "saw nobody" in one]


def test_a_run_warns_of_a_drone_that_sees_nobody_where_another_looks_seldom() -> None:
    """A picture in 15 s each: what one shows stands for 2 s, and the other opens it 7 s later."""
    flown = []
    for number in range(7):
        for drone, late_s in (("uav1", 0.0), ("uav2", 7.0)):
            one = sharp(views(1, ["uav1"])[0], blind=drone == "uav2")
            stamp_ns = one.stamp_ns + round((15.0 * number + late_s) * SECOND_NS)
            flown.append(cf.View(drone, stamp_ns, one.camera, one.world_from_camera, one.heatmap))
    run = cf.run(recording(flown), plain(), CONFIG)
    assert not run.zones
    (told,) = [one for one in run.warnings if "saw nobody" in one]
    assert told.startswith("uav2 saw nobody in 6 looks in a row, over 75 s, ")
