"""Buffers against examples worked out by hand and the published tables."""

import math

import pytest

from crowdfence.zones import safety_distance as distance
from crowdfence.zones.safety_distance import safety_distance_m


def test_formulas_by_hand() -> None:
    assert distance.one_to_one(60.0) == 60.0
    assert distance.one_to_one(60.0, size_m=3.0) == 61.5
    # sqrt(2 * 60 / 9.81) = 3.4975 s of fall at 10 m/s; sqrt(240 / 9.81) = 4.9462 s at 15 m/s.
    assert distance.ballistic(10.0, 60.0) == pytest.approx(34.975, abs=1e-3)
    assert distance.ballistic(15.0, 120.0, size_m=1.0) == pytest.approx(74.693, abs=1e-3)
    # 10 m/s for 2 s, then 120 m at 4 m/s down are 30 s in 5 m/s of wind.
    assert distance.parachute(10.0, 120.0, opening_s=2.0, descent_mps=4.0, wind_mps=5.0) == 170.0
    assert distance.parachute(0.0, 40.0, 0.0, 4.0, wind_mps=0.0) == 30.0  # never less than 3 m/s of wind
    assert distance.glide(100.0, 12.0) == 1200.0
    assert distance.map_resolution(2.0) == pytest.approx(math.sqrt(2.0))
    assert distance.crowd_motion(1.5, 4.0) == 6.0
    # 3 + 3 + 1 m, 1 s at 10 m/s, and 100 / (2 * 9.81) at 45 degrees.
    assert distance.contingency(10.0) == pytest.approx(17.0 + 5.0968, abs=1e-4)


def test_the_pose_error_holds_95_percent() -> None:
    # Rayleigh: P(r <= k sigma) = 1 - exp(-k^2 / 2).
    assert 1.0 - math.exp(-((distance.pose_error(2.0) / 2.0) ** 2) / 2) == pytest.approx(0.95)
    assert distance.pose_error(2.0, sigmas=3.0) == 6.0


@pytest.mark.parametrize(
    ("height_m", "low_speed", "expected"), [(10, False, 30), (50, False, 50), (3, True, 5), (20, True, 20)]
)
def test_subcategory_a2(height_m: float, low_speed: bool, expected: float) -> None:
    assert distance.eu_a2(height_m, low_speed) == expected


@pytest.mark.parametrize("row", [(30, 10, 20), (60, 15, 30), (90, 20, 45), (120, 25, 60)])
def test_the_table_of_sts_01(row: tuple[float, float, float]) -> None:
    top_m, light_m, heavy_m = row
    for height_m in (top_m - 29.0, top_m):
        assert distance.sts01(height_m, 9.99) == light_m
        assert distance.sts01(height_m, 10.0) == heavy_m
    with pytest.raises(ValueError, match="STS-01 ends at 120 m"):
        distance.sts01(120.1, 5.0)


def test_rules_as_text_are_added() -> None:
    rules = ["one-to-one:height_m=60", "motion:speed_mps=1.5,latency_s=2", "eu-a2:height_m=3,low_speed=true"]
    assert safety_distance_m(rules) == 60.0 + 3.0 + 5.0
    assert safety_distance_m([]) == 0.0


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        # Whatever is not 0 is true, and made 5 m of 30.
        ("eu-a2:height_m=3,low_speed=nan", "low_speed is 'nan'; it must be true or false"),
        ("eu-a2:height_m=3,low_speed=1", "low_speed is '1'; it must be true or false"),
        ("fixed:distance_m=true", "'true' is not a number"),
        (
            "parachute:speed_mps=10,height_m=60,opening_s=1,descent_mps=inf",
            "descent_mps is inf; it must be finite and > 0",
        ),
        ("sts-01:height_m=60,mass_kg=25.5", "mass_kg is 25.5; STS-01 ends at 25 kg"),
        ("magic", "buffer 'magic' is none of fixed, one-to-one"),
        ("fixed", "buffer 'fixed' needs distance_m="),
        ("fixed:distance_m=1,distance_m=2", "says distance_m= twice"),
        ("fixed:distance_m=1e308", "is 1e+308 m; it must be at most 100000 m"),
        ("contingency:speed_mps=1e308", "is inf m"),
        ("glide:height_m=1e300,ratio=1e300", "is inf m"),
        ("fixed:distance_m", "'distance_m' is none of distance_m="),
        ("fixed:metres=3", "'metres=3' is none of distance_m="),
        ("fixed:distance_m=far", "'far' is not a number"),
        ("fixed:distance_m=-1", "distance_m is -1; it must be finite and >= 0"),
        ("fixed:distance_m=inf", "distance_m is inf"),
        ("fixed:distance_m=nan", "distance_m is nan"),
        ("parachute:speed_mps=1,height_m=1,opening_s=1,descent_mps=0", "descent_mps is 0; it must be finite"),
        ("contingency:speed_mps=1,pitch_deg=90", "pitch_deg is 90"),
    ],
)
def test_what_cannot_be_computed_is_refused(rule: str, message: str) -> None:
    with pytest.raises(ValueError) as refused:
        safety_distance_m([rule])
    assert message in str(refused.value)
