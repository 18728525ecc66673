"""Ways round zones: as short as they can be worked out by hand, and always clear."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence.planner import NoRoute, safe_route
from crowdfence.zones import Zone


def zone(name: str, polygon: shapely.Polygon) -> Zone:
    return Zone(name, polygon, 1, 1.0, 0.9, 0.9, 0.0, 1.0, 0, 0, ())


WALL = zone("Z1", shapely.box(40, -30, 60, 30))


def test_nothing_between_is_a_straight_line() -> None:
    route = safe_route((0, 0), (100, 0), [])
    assert route.waypoints.tolist() == [[0, 0], [100, 0]] and route.length_m == route.direct_m == 100.0
    beside = safe_route((0, 40), (100, 40), [WALL], clearance_m=5.0)
    assert len(beside.waypoints) == 2


def test_round_a_wall_by_hand() -> None:
    """To a corner of the wall, along its side, and down again: 2 * 50 + 20 m."""
    route = safe_route((0, 0), (100, 0), [WALL])
    assert route.length_m == pytest.approx(2 * np.hypot(40, 30) + 20, abs=0.3)
    assert len(route.waypoints) == 4
    # The shorter side of a wall that is not in the middle.
    upper = safe_route((0, 10), (100, 10), [WALL])
    assert (upper.waypoints[1:-1, 1] > 30.0).all()


def test_the_clearance_is_kept() -> None:
    route = safe_route((0, 0), (100, 0), [WALL], clearance_m=7.0)
    assert 7.0 <= shapely.LineString(route.waypoints).distance(WALL.polygon) < 7.5


def test_through_a_gap_and_round_it_where_it_is_too_narrow() -> None:
    gate = [zone("Z1", shapely.box(40, -300, 60, -5)), zone("Z2", shapely.box(40, 5, 60, 300))]
    assert safe_route((0, 0), (100, 0), gate, clearance_m=4.5).length_m == 100.0
    assert safe_route((0, 0), (100, 0), gate, clearance_m=5.5).length_m > 600.0


RING = zone("Z9", shapely.Point(0, 0).buffer(50) - shapely.Point(0, 0).buffer(30))


@pytest.mark.parametrize(
    ("start", "goal", "zones", "options", "message"),
    [
        ((50, 0), (100, 0), [WALL], {}, r"the start \(50\.0, 0\.0\) lies in zone Z1"),
        (
            (0, 0),
            (63, 0),
            [WALL],
            {"clearance_m": 5.0},
            r"the goal .* lies 3\.0 m from zone Z1; the clearance",
        ),
        ((0, 0), (100, 0), [RING], {}, "there is no way"),
        ((0, 0), (100, 0), [WALL], {"within": shapely.box(-5, -20, 105, 20)}, "there is no way"),
        ((0, 0), (200, 0), [WALL], {"within": shapely.box(-5, -90, 105, 90)}, "the goal .* outside the area"),
    ],
)
def test_where_there_is_no_way_it_says_why(
    start: tuple[float, float],
    goal: tuple[float, float],
    zones: list[Zone],
    options: dict[str, object],
    message: str,
) -> None:
    with pytest.raises(NoRoute, match=message):
        safe_route(start, goal, zones, **options)  # type: ignore[arg-type]


def test_what_is_no_place_is_refused() -> None:
    with pytest.raises(ValueError, match="two finite places"):
        safe_route((0, np.nan), (1, 1), [])
    with pytest.raises(ValueError, match="clearance_m is -1"):
        safe_route((0, 0), (1, 1), [], clearance_m=-1.0)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 12), clearance_m=st.sampled_from([0.0, 3.0]))
def test_a_way_is_clear_and_no_shorter_than_the_straight_one(
    seed: int, count: int, clearance_m: float
) -> None:
    rng = np.random.default_rng(seed)
    zones = []
    for number in range(count):
        corners = rng.uniform(20.0, 180.0, 2) + rng.uniform(-30.0, 30.0, (7, 2))
        zones.append(zone(f"Z{number}", shapely.concave_hull(shapely.MultiPoint(corners), 0.4).buffer(0.5)))
    route = safe_route((-40, -40), (240, 240), zones, clearance_m=clearance_m)
    way = shapely.LineString(route.waypoints)
    assert all(way.distance(one.polygon) >= clearance_m and not way.intersects(one.polygon) for one in zones)
    assert route.length_m >= route.direct_m
    assert route.waypoints[0].tolist() == [-40, -40] and route.waypoints[-1].tolist() == [240, 240]


def test_many_zones_are_gone_round() -> None:
    rng = np.random.default_rng(3)
    zones = [
        zone(f"Z{k}", shapely.box(x, y, x + 4, y + 4))
        for k, (x, y) in enumerate(rng.uniform(0, 900, (1_000, 2)))
    ]
    route = safe_route((-50, 450), (950, 450), zones)
    way = shapely.LineString(route.waypoints)
    assert not any(way.intersects(one.polygon) for one in zones)
