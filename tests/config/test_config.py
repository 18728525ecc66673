"""The configuration: bounds, what is left to a detector, and what reports show."""

import json
import re
from collections.abc import Callable
from dataclasses import asdict, fields, replace
from typing import Any, get_args

import numpy as np
import pytest

from crowdfence import Georeference, Terrain
from crowdfence.config import (
    EvidenceConfig,
    GroupingConfig,
    LinearPoolConfig,
    LogOddsConfig,
    LogPoolConfig,
    MethodConfig,
    MovingAverageConfig,
    PaperConfig,
    ProjectionConfig,
    RunConfig,
    ZoneConfig,
)

PLAIN = RunConfig(
    EvidenceConfig(prior=0.25, memory_s=10.0, focal_px=400.0),
    ProjectionConfig(max_range_m=200.0, target_height_m=1.0),
    GroupingConfig(tolerance_ms=50.0),
    ZoneConfig(0.5, 0.25, 2, 4.0, 3.0, 5.0, 0.5, 50, 0.0, 100.0, close_unseen=True, stale_after_s=20.0),
)
FLOOR = Terrain.from_occupancy(np.ones((20, 20, 1), bool), 1.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ZoneConfig(threshold=0.0), "threshold is 0; it must be in (0, 1]"),
        (lambda: ZoneConfig(threshold=1.1), "threshold is 1.1; it must be in (0, 1]"),
        (lambda: ZoneConfig(min_area_m2=-1.0), "min_area_m2 is -1; it must be finite and >= 0"),
        (lambda: ZoneConfig(min_area_m2=float("nan")), "min_area_m2 is nan; it must be finite and >= 0"),
        (lambda: ZoneConfig(stale_after_s=-1.0), "stale_after_s is -1; it must be finite and >= 0"),
        (lambda: ZoneConfig(stale_after_s=float("inf")), "stale_after_s is inf; it must be finite and >= 0"),
        (
            lambda: ZoneConfig(upper_m=1e-300),
            "zones from 0 to 1e-300 m above ground; they must be at least 1 m",
        ),
        (lambda: ZoneConfig(lower_m=1e9, upper_m=2e9), "they must be at least 1 m high and lie within -1000"),
        (lambda: ZoneConfig(lower_m=-1e300), "zones from -1e+300 to 120 m above ground; they must"),
        (lambda: ZoneConfig(upper_m=1e300), "zones from 0 to 1e+300 m above ground; they must"),
        (lambda: ProjectionConfig(max_range_m=-5.0), "max_range_m is -5; it must be finite and > 0"),
        (lambda: GroupingConfig(tolerance_ms=-1.0), "tolerance_ms is -1; it must be finite and not negative"),
    ],
)
def test_what_is_used_late_is_checked_early(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        make()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"threshold": True}, "threshold of a ZoneConfig is True; it must be a number"),
        ({"buffer_m": True}, "buffer_m of a ZoneConfig is True; it must be a number"),
        ({"stale_after_s": "5"}, "stale_after_s of a ZoneConfig is '5'; it must be a number"),
        ({"opening_looks": 2.5}, "opening_looks of a ZoneConfig is 2.5; it must be a whole number"),
        ({"max_vertices": True}, "max_vertices of a ZoneConfig is True; it must be a whole number"),
        ({"close_unseen": "no"}, "close_unseen of a ZoneConfig is 'no'; it must be True or False"),
        ({"close_unseen": 0}, "close_unseen of a ZoneConfig is 0; it must be True or False"),
    ],
)
def test_values_of_another_kind_are_no_settings_of_zones(wrong: dict[str, Any], message: str) -> None:
    """`threshold: yes` in a file was 1, and there were no zones."""
    with pytest.raises(TypeError, match=f"^{re.escape(message)}$"):
        ZoneConfig(**wrong)


def test_what_the_core_uses_is_checked_by_the_core() -> None:
    for config, message in (
        (RunConfig(PaperConfig(prior=0.2, alpha=2.0)), "alpha is 2; it must be in (0, 1]"),
        (RunConfig(PaperConfig(prior=0.2, decay=-1.0)), "decay is -1; it must be finite and >= 0"),
        (RunConfig(LinearPoolConfig(alpha=0.0)), "alpha is 0; it must be in (0, 1]"),
        (RunConfig(LogPoolConfig(prior=1.0)), "prior is 1; it must be strictly between 0 and 1"),
        (RunConfig(LogOddsConfig(clamp_low=1.0)), "clamp_low is 1; it must be finite and below 0"),
        (RunConfig(MovingAverageConfig(memory_s=0.0)), "memory_s is 0; it must be finite and > 0"),
        (RunConfig(EvidenceConfig(clear_log_odds=1e3)), "clear_log_odds is 1000; it must be in (0, 12]"),
        (RunConfig(EvidenceConfig(clear_log_odds=0.0)), "clear_log_odds is 0; it must be in (0, 12]"),
        (
            RunConfig(EvidenceConfig(zone_log_odds=-1e300)),
            "zone_log_odds is -1e+300; it must be in [-12, 12]",
        ),
        (
            RunConfig(EvidenceConfig(zone_log_odds=-5.0)),
            "zone_log_odds is -5; it must be above -2.5, from which on ground is empty (clear_log_odds)",
        ),
        (RunConfig(EvidenceConfig(zone_log_odds=30.0)), "zone_log_odds is 30; it must be in [-12, 12]"),
        (
            RunConfig(LogPoolConfig(zone_log_odds=float("nan"))),
            "zone_log_odds is nan; it must be in [-12, 12]",
        ),
        (
            RunConfig(MovingAverageConfig(zone_log_odds=-1e3)),
            "zone_log_odds is -1000; it must be in [-12, 12]",
        ),
        (
            RunConfig(PaperConfig(prior=0.2, true_positive_rate=0.01)),
            "true_positive is 0.01 and false_positive 0.02",
        ),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            config.crowd_map(FLOOR, 3)


def test_what_is_compared_with_evidence_calls_ground_crowd_from_where_it_does() -> None:
    """In Python too: with 1.3 there and 1.2 on the command line, one recording had two figures."""
    for config in (LogPoolConfig(), MovingAverageConfig()):
        assert config.zone_log_odds == EvidenceConfig().zone_log_odds
    assert MovingAverageConfig().memory_s == EvidenceConfig().memory_s


def test_reports_show_what_the_map_was_told() -> None:
    config = RunConfig(PaperConfig(prior=0.2, decay=0.25, decay_unit="frame"), ProjectionConfig(150.0))
    assert config.parameters(config.crowd_map(FLOOR, 3)) == {
        "true_positive_rate": 0.9,
        "false_positive_rate": 0.02,
        "prior": 0.2,
        "b_threshold": 0.5,
        "fleet_size": 3,
        "unseen": "fleet",
        "normalise": False,
        "alpha": 0.1,
        "decay": 0.25,
        "decay_unit": "frame",
        "initial": "zero",
        "max_range_m": 150.0,
        "target_height_m": 0.0,
        "coverage": "full",
        "surface": "planes",
        "tolerance_ms": 100.0,
    }


def test_no_field_of_one_part_hides_that_of_another() -> None:
    for method in get_args(MethodConfig):
        parts = (method, ProjectionConfig, GroupingConfig, ZoneConfig)
        names = [field.name for part in parts for field in fields(part)]
        assert len(names) == len(set(names))
        assert set(RunConfig(method()).to_json()) == {"method", *names}


def test_numbers_of_numpy_reach_the_files_as_those_of_python() -> None:
    """A run of hours would end in a TypeError: what is written after the last frame is JSON."""
    of_numpy = RunConfig(*(replace(part, **numpy_numbers(part)) for part in parts(PLAIN)))
    plain_map, its_map = PLAIN.crowd_map(FLOOR, 1), of_numpy.crowd_map(FLOOR, 1)
    assert json.dumps(of_numpy.to_json()) == json.dumps(PLAIN.to_json())
    assert json.dumps(of_numpy.parameters(its_map)) == json.dumps(PLAIN.parameters(plain_map))
    assert json.dumps(of_numpy.zone_parameters()) == json.dumps(PLAIN.zone_parameters())
    for part in parts(of_numpy)[1:]:
        assert not any(isinstance(getattr(part, field.name), np.generic) for field in fields(part))
    place = Georeference(np.float32(46.5), np.float32(8.0), np.int64(1200))
    assert json.dumps(asdict(place)) == (
        '{"latitude_deg": 46.5, "longitude_deg": 8.0, "height_m": 1200, "of_map": false}'
    )


def parts(config: RunConfig) -> tuple[Any, ...]:
    return config.method, config.projection, config.grouping, config.zones


def numpy_numbers(part: Any) -> dict[str, np.generic]:
    """Those of its numbers that are given, as numpy has them; all of these are exact in 32 bits."""
    kinds = {float: np.float32, int: np.int64, bool: np.bool_}
    given = {field.name: getattr(part, field.name) for field in fields(part)}
    return {
        name: kinds[type(value)](value)
        for name, value in given.items()
        if type(value) in kinds and float(np.float32(value)) == value
    }


def test_zones_have_three_square_metres_unless_rays_leave_ground_between_them() -> None:
    """Cells that single rays hit are no area, however large the crowd: any of them closes."""
    assert [ZoneConfig().rules(0.5, coverage).min_area_m2 for coverage in ("full", "rays")] == [3.0, 0.0]
    given = ZoneConfig(min_area_m2=8.0)
    assert [given.rules(0.5, coverage).min_area_m2 for coverage in ("full", "rays")] == [8.0, 8.0]
    rays = RunConfig(projection=ProjectionConfig(coverage="rays"))
    assert (RunConfig().to_json()["min_area_m2"], rays.to_json()["min_area_m2"]) == (3.0, 0.0)
