"""Method `evidence` from Python: arrays in, what they mean, and what is refused."""

import math

import numpy as np
import pytest

from crowdfence import (
    CrowdfenceError,
    CrowdMap,
    Evidence,
    LikelihoodRatio,
    Observation,
    Or,
    Paper,
    Rates,
    StampError,
    Terrain,
    VoxelState,
)

SECOND = 1_000_000_000
FLOOR = Terrain.from_occupancy(np.ones((4, 1, 1), bool), 1.0)
# Up to .5 a look says -2, above it 3, from .2 m a pixel on both half as much.
RATIO = LikelihoodRatio([0.2], [], [0.5], [[[-2.0, 3.0]], [[-1.0, 1.5]]])
SETTINGS = {
    "prior": 0.2,
    "memory_s": 10.0,
    "sharp_gsd_m": 0.1,
    "doubt": 1.0,
    "agreement": 0.5,
    "threshold": 0.5,
    "cleared": 0.1,
    "focal_px": 100.0,
}
EVIDENCE = Evidence(RATIO, **SETTINGS)


def look(
    drone: str,
    mean: float,
    *,
    range_m: float = 10.0,
    focal_px: float = 100.0,
    tilt_deg: float = 90.0,
    at: int = 0,
) -> Observation:
    """At voxel 0."""
    return Observation(
        FLOOR,
        drone,
        at,
        voxel_ids=[0],
        mean=[mean],
        pixel_count=[1],
        range_m=[range_m],
        tilt_deg=[tilt_deg],
        occluded_ids=[],
        focal_px=focal_px,
    )


def log_ratio(*looks: Observation) -> float:
    """Log odds against the prior after one instant."""
    crowd_map = CrowdMap(FLOOR, EVIDENCE)
    crowd_map.integrate_observations(list(looks), 0)
    p = float(crowd_map.probability(0)[0])
    return float(np.log(p / (1.0 - p)) - np.log(0.2 / 0.8))


def test_a_look_is_read_in_metres_per_pixel() -> None:
    assert log_ratio(look("a", 0.9)) == pytest.approx(3.0 / 2.0, abs=1e-5)
    # 20 m away at 100 px: .2 m a pixel, where a look says half and has a quarter of the pixels.
    far = 0.25 * 1.5 / 1.25
    assert log_ratio(look("a", 0.9, range_m=20.0)) == pytest.approx(far, abs=1e-5)
    assert log_ratio(look("a", 0.9, range_m=10.0, focal_px=50.0)) == pytest.approx(far, abs=1e-5)
    # Without a focal length, that of the calibration.
    assert log_ratio(look("a", 0.9, range_m=20.0, focal_px=0.0)) == pytest.approx(far, abs=1e-5)


def test_drones_add_up() -> None:
    assert log_ratio(look("a", 0.9), look("b", 0.9)) == pytest.approx(2.0 * np.sqrt(2.0), abs=1e-5)


def test_of_looks_from_below_those_count_that_show_what_is_dangerous_to_overlook() -> None:
    """A crowd; or, of what opens ground, that it is not there."""
    for counts, shows in (("for", 0.9), ("against", 0.1)):
        crowd_map = CrowdMap(FLOOR, Evidence(RATIO, **SETTINGS, from_below=counts))
        crowd_map.integrate_observations([look("a", 1.0 - shows, tilt_deg=-5.0)], 0)
        assert crowd_map.state(0)[0] == VoxelState.OCCLUDED
        crowd_map.integrate_observations([look("a", shows, tilt_deg=-5.0, at=1)], 1)
        assert crowd_map.last_seen_ns([0])[0] == 1
        assert (crowd_map.probability(1)[0] > 0.2) == (counts == "for")
    with pytest.raises(ValueError, match='from_below is "both"; it must be "for" or "against"'):
        Evidence(RATIO, **SETTINGS, from_below="both")  # type: ignore[arg-type]


def test_what_a_look_could_not_show_is_not_cleared() -> None:
    crowd_map = CrowdMap(FLOOR, EVIDENCE)
    crowd_map.integrate_observations([look("a", 0.0, range_m=50.0)], 0)
    assert crowd_map.state(0).tolist() == [VoxelState.NOT_CLEARED] + 3 * [VoxelState.NEVER_SEEN]
    crowd_map.integrate_observations([look("a", 0.0, at=SECOND)], SECOND)
    assert crowd_map.state(SECOND)[0] == VoxelState.EMPTY
    assert crowd_map.state(40 * SECOND)[0] == VoxelState.STALE


def test_what_no_look_left_empty_never_becomes_stale_by_waiting() -> None:
    crowd_map = CrowdMap(FLOOR, EVIDENCE)
    crowd_map.integrate_observations([look("a", 0.0, range_m=50.0)], 0)
    assert crowd_map.state(3600 * SECOND)[0] == VoxelState.NOT_CLEARED
    assert crowd_map.knowledge([0], 3600 * SECOND).state.tolist() == [VoxelState.NOT_CLEARED]
    # Crowd is forgotten towards the prior, .2 and below the threshold: nobody found the place empty.
    crowd_map.integrate_observations([look("a", 0.9, at=3600 * SECOND)], 3600 * SECOND)
    assert crowd_map.state(3600 * SECOND)[0] == VoxelState.CROWD
    assert crowd_map.state(7200 * SECOND)[0] == VoxelState.NOT_CLEARED


def test_all_that_is_known_about_a_voxel() -> None:
    crowd_map = CrowdMap(FLOOR, EVIDENCE)
    crowd_map.integrate_observations([look("a", 0.9), look("b", 0.9)], 0)
    known = crowd_map.knowledge([0, 3], 10 * SECOND)
    assert len(known) == 2
    assert known.state.tolist() == [VoxelState.CROWD, VoxelState.NEVER_SEEN]
    np.testing.assert_array_equal(known.probability, crowd_map.probability(10 * SECOND, [0, 3]))
    np.testing.assert_array_equal(known.age_s, [10.0, np.nan])
    np.testing.assert_allclose(known.looks, [2.0 / np.e, np.nan], rtol=1e-6)
    assert known.drones.tolist() == [2, 0]
    with pytest.raises(ValueError, match="voxel id 4 does not exist"):
        crowd_map.knowledge([4], 0)


def test_a_saved_map_comes_back_with_its_method() -> None:
    crowd_map = CrowdMap(FLOOR, EVIDENCE)
    crowd_map.integrate_observations([look("b", 0.9), look("a", 0.1)], 0)
    again = CrowdMap.from_bytes(crowd_map.to_bytes(), FLOOR)
    assert again.method == EVIDENCE
    assert again.to_bytes() == crowd_map.to_bytes()
    np.testing.assert_array_equal(again.probability(5 * SECOND), crowd_map.probability(5 * SECOND))


def test_the_table_says_what_it_was_told() -> None:
    assert RATIO.of(0.1, 45.0, 0.5) == -2.0  # a value on a border of the mean belongs to the bin below
    assert RATIO.of(0.2, 45.0, 0.6) == 1.5  # a distance on a border to the bin above
    assert RATIO.log_ratio.shape == (2, 1, 2)
    for name, column in (("gsd_m", [0.2]), ("tilt_deg", []), ("mean", [0.5])):
        np.testing.assert_array_equal(getattr(RATIO, name), np.array(column, np.float32))


@pytest.mark.parametrize(
    "look", [(0.0, 45.0, 0.5), (0.1, -90.5, 0.5), (0.1, 45.0, 1.5), (math.inf, 45.0, 0.5)]
)
def test_a_ratio_of_what_is_no_look_is_refused(look: tuple[float, float, float]) -> None:
    """NaN fell into some bin, and spoke for or against crowd as a look does."""
    with pytest.raises(CrowdfenceError, match=r"(gsd_m|tilt_deg|mean) is .*; it must be (finite|inside)"):
        RATIO.of(*look)
    for at, name in enumerate(("gsd_m", "tilt_deg", "mean")):
        with pytest.raises(CrowdfenceError, match=f"{name} is NaN"):
            RATIO.of(*(math.nan if number == at else value for number, value in enumerate((0.1, 45.0, 0.5))))
    assert RATIO.of(0.1, 90.0, 1.0) == RATIO.of(0.1, 45.0, 0.6)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (([0.2], [], [0.5], [[[-2.0, 3.0]]]), r"log_ratio has shape \[1, 1, 2\]; it must be \[2, 1, 2\]"),
        (([0.2, 0.1], [], [], np.zeros((3, 1, 1))), "gsd_m is 0.1"),
        (([], [], [0.5], [[[np.nan, 3.0]]]), "log_ratio is NaN"),
        (([], [], [0.5], [[[-30.0, 3.0]]]), r"log_ratio is -30; it must be inside \[-20, 20\]"),
    ],
)
def test_a_table_that_is_none_is_refused(table: tuple[object, ...], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        LikelihoodRatio(*table)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("prior", 1.0),
        ("memory_s", 0.0),
        ("sharp_gsd_m", -1.0),
        ("doubt", np.inf),
        ("agreement", 1.1),
        ("threshold", 0.0),
        ("cleared", 0.2),
        ("focal_px", np.nan),
    ],
)
def test_parameters_out_of_bounds_are_named(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"^{name} is"):
        Evidence(RATIO, **SETTINGS | {name: value})


def test_an_interval_narrows_with_looks_and_widens_with_time() -> None:
    crowd_map = CrowdMap(FLOOR, EVIDENCE)
    crowd_map.integrate_observations([look("a", 0.9)], 0)
    log_odds = np.log(0.2 / 0.8) + 3.0 / 2.0
    # 9 in 10: ln 19 scales to either side, sqrt(.9^2 + .6^2 / 2) and sqrt(1.1^2 + .8^2 / 2) after a look and
    # the doubt.
    reach = np.log(19.0) * np.array([-np.sqrt(1.21 + 0.64 / 2), np.sqrt(0.81 + 0.36 / 2)])
    bounds = crowd_map.interval(0)
    assert bounds is not None and bounds.shape == (4, 2)
    np.testing.assert_allclose(bounds[0], 1.0 / (1.0 + np.exp(-(log_odds + reach))), rtol=1e-5)
    assert bounds[1:].tolist() == 3 * [[0.0, 1.0]]  # nobody has looked

    def width(stamp_ns: int, level: float = 0.9) -> float:
        found = crowd_map.interval(stamp_ns, [0], level=level)
        assert found is not None
        low, high = found[0]
        return float(np.log(high / (1.0 - high)) - np.log(low / (1.0 - low)))

    assert width(0, 0.5) < width(0, 0.9) < width(0, 0.99)
    assert width(0) < width(5 * SECOND) < width(50 * SECOND)
    crowd_map.integrate_observations([look("b", 0.9, at=SECOND)], SECOND)
    assert width(SECOND) < reach[1] - reach[0]


def test_an_interval_is_refused_where_it_means_nothing() -> None:
    crowd_map = CrowdMap(FLOOR, EVIDENCE)
    crowd_map.integrate_observations([look("a", 0.9, at=SECOND)], SECOND)
    for level in (0.0, 1.0, float("nan")):
        with pytest.raises(CrowdfenceError, match="level .* strictly between 0 and 1"):
            crowd_map.interval(SECOND, level=level)
    with pytest.raises(StampError):
        crowd_map.interval(0)
    with pytest.raises(CrowdfenceError):
        crowd_map.interval(SECOND, [4])
    for method in (Or(b_threshold=0.5), Paper(Rates(0.9, 0.1), 0.5, alpha=1.0, decay=0.0, fleet_size=1)):
        assert CrowdMap(FLOOR, method).interval(0) is None
        assert CrowdMap(FLOOR, method).interval(0, []) is None
