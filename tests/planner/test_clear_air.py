"""Points and paths in space and time against zones drawn by hand, and against slow answers."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence.planner import ClearAir, Conflict, safe_route
from crowdfence.zones import AltitudeBand, Zone, ZoneSet
from crowdfence.zones.history import ZoneHistory

SECOND_NS = 1_000_000_000


def zone(name: str, polygon: shapely.Polygon, **changes: object) -> Zone:
    """On ground between 10 and 12 m."""
    plain = Zone(name, polygon, 1, 1.0, 0.9, 0.9, 10.0, 12.0, 0, 0, ("uav1",))
    return replace(plain, band=AltitudeBand(0.0, 100.0, "AGL"), **changes)  # type: ignore[arg-type]


def zone_set(*zones: Zone) -> ZoneSet:
    return ZoneSet(zones, 0.5, 0.0, 0, 0.0)


SQUARE = zone("Z1", shapely.box(0, 0, 10, 10))


def test_a_point_is_clear_beside_above_and_below_a_raised_band() -> None:
    air = ClearAir(zone_set(SQUARE))
    points = [(5, 5, 50), (5, 5, 112), (5, 5, 112.1), (5, 5, -3), (11, 5, 50), (10, 5, 50)]
    assert air.is_clear(points, 0).tolist() == [False, False, True, False, True, False]
    raised = ClearAir(zone_set(replace(SQUARE, band=AltitudeBand(50.0, 100.0, "AGL"))))
    assert raised.is_clear([(5, 5, 59), (5, 5, 60)], 0).tolist() == [True, False]


def test_one_point_by_itself_is_asked_like_several() -> None:
    air = ClearAir(zone_set(SQUARE))
    assert air.is_clear((5, 5, 50), 0).tolist() == [False]
    assert air.clearance_m((15, 5, 50), 0).tolist() == [5.0]


def test_zones_of_others_are_closed_at_every_height() -> None:
    static = replace(SQUARE, kind="static", band=AltitudeBand(0.0, 100.0, "AGL"))
    air = ClearAir(ZoneSet((), 0.5, 0.0, 0, 0.0, static=(static,)))
    assert air.is_clear([(5, 5, 5000.0), (5, 15, 0.0)], 0).tolist() == [False, True]


def test_a_zone_that_closes_ground_which_the_map_lacks_is_closed_at_every_height() -> None:
    """Its ground may be higher, or lower, than what the map knows of it."""
    beyond = replace(SQUARE, leaves_map=True, band=AltitudeBand(50.0, 100.0, "AGL"))
    for known in (zone_set(beyond), replace(history(zone_set(beyond)), ground=shapely.box(0, 0, 6, 10))):
        air = ClearAir(known, beyond_map=True)
        assert air.is_clear([(9, 5, 500.0), (9, 5, 20.0), (11, 5, 50.0)], 0).tolist() == [False, False, True]


def history(*sets: ZoneSet) -> ZoneHistory:
    return ZoneHistory([k * SECOND_NS for k in range(len(sets))], sets, None, {})


def test_nothing_is_clear_beyond_the_ground_of_the_map() -> None:
    """A map of 100 x 100 m with the square in its south-western corner."""
    known = replace(history(zone_set(SQUARE)), ground=shapely.box(0, 0, 100, 100))
    air = ClearAir(known)
    points = [(50, 50, 50), (50, 50, 5000), (103, 50, 5000), (100, 50, 50), (5, 5, 50), (-3, -4, 50)]
    assert air.is_clear(points, 0).tolist() == [True, True, False, True, False, False]
    # The rim is nearer than the square; 3 m beyond it; on it; in the square, on its edge; 3-4-5 beyond.
    assert air.clearance_m([(90, 50, 50), (103, 50, 50), (100, 50, 50), (-3, -4, 50)], 0).tolist() == [
        10.0,
        -3.0,
        0.0,
        -5.0,
    ]
    out_and_back = [(50, 50, 50), (120, 50, 50), (60, 50, 50), (50, 5, 50), (5, 5, 50)]
    stamps_ns = np.arange(5) * SECOND_NS
    assert air.first_conflict(out_and_back, stamps_ns) == Conflict(0, None, beyond_map=True)
    assert air.first_conflict(out_and_back[2:], stamps_ns[2:]) == Conflict(1, "Z1")
    hover = [(150, 50, 50), (150, 50, 50)], [(50, 50, 50), (50, 50, 50)]
    assert [air.path_is_clear(place, stamps_ns[:2]) for place in hover] == [False, True]
    assert air.legs_are_clear(out_and_back[:-1], out_and_back[1:], 0, 1).tolist() == [
        False,
        False,
        True,
        False,
    ]
    anywhere = ClearAir(known, beyond_map=True)
    assert anywhere.is_clear(points, 0).tolist() == [True, True, True, True, False, True]
    smaller = ClearAir(zone_set(SQUARE), within=shapely.box(0, 0, 40, 40))
    assert smaller.is_clear([(30, 30, 0), (50, 50, 0)], 0).tolist() == [True, False]


def test_threads_may_ask_at_once() -> None:
    """A lake of 3 m around (20, 20) is no ground. Where they ask one prepared shape, the process dies."""
    ground = shapely.box(0, 0, 60, 60).difference(shapely.Point(20, 20).buffer(3.0, quad_segs=500))
    known = replace(history(zone_set(SQUARE)), ground=ground)
    points = np.random.default_rng(1).uniform(0, 60, (2000, 3))
    in_lake = np.hypot(*(points[:, :2] - 20.0).T) < 3.0
    expected = ~in_lake & ~(points[:, :2] <= 10.0).all(axis=1)
    for _ in range(20):
        air = ClearAir(known)
        with ThreadPoolExecutor(8) as threads:
            for answer in threads.map(lambda _, air=air: air.is_clear(points, 0), range(8)):
                np.testing.assert_array_equal(answer, expected)
    safe_route((15, 0), (60, 60), zone_set(SQUARE).closed, within=ground)
    # Of all who hold the shape nobody else may be asking it meanwhile.
    assert not shapely.is_prepared(ground)


def test_of_a_map_without_ground_nothing_is_clear() -> None:
    air = ClearAir(zone_set(SQUARE), within=shapely.Polygon())
    assert air.is_clear([(50, 50, 5)], 0).tolist() == [False]
    assert air.clearance_m([(50, 50, 5), (5, 5, 5)], 0).tolist() == [-np.inf, -np.inf]


def test_what_counts_is_what_was_known_at_the_stamp() -> None:
    air = ClearAir(history(zone_set(), zone_set(SQUARE), zone_set()))
    stamps_ns = [-1, 0, SECOND_NS - 1, SECOND_NS, 2 * SECOND_NS - 1, 2 * SECOND_NS, 10**15]
    inside = np.tile((5.0, 5.0, 50.0), (7, 1))
    assert air.is_clear(inside, stamps_ns).tolist() == [False, True, True, False, False, True, True]
    assert air.clearance_m(inside, stamps_ns).tolist() == pytest.approx(
        [-np.inf, np.inf, np.inf, -5.0, -5.0, np.inf, np.inf]
    )


def test_after_the_mission_a_zone_stays_closed_unless_asked_otherwise() -> None:
    ends = replace(SQUARE, valid_until_ns=5 * SECOND_NS)
    inside, stamps_ns = [(5, 5, 50)] * 2, [5 * SECOND_NS - 1, 5 * SECOND_NS]
    assert ClearAir(history(zone_set(ends))).is_clear(inside, stamps_ns).tolist() == [False, False]
    expiring = ClearAir(history(zone_set(ends)), expires=True)
    assert expiring.is_clear(inside, stamps_ns).tolist() == [False, True]
    assert expiring.clearance_m(inside, stamps_ns).tolist() == [-5.0, np.inf]


def test_clearance_by_hand() -> None:
    air = ClearAir(zone_set(SQUARE))
    points = [(13, 14, 50), (5, 9, 50), (5, 5, 110), (5, 5, 116), (13, 5, 116), (5, 5, 60)]
    # 3-4-5 beside; 1 m from an edge; 2 m below the top; 4 m above; 3 beside and 4 above; the middle.
    assert air.clearance_m(points, 0).tolist() == pytest.approx([5.0, -1.0, -2.0, 4.0, 5.0, -5.0])


def test_a_path_meets_what_is_there_when_it_passes() -> None:
    """A zone that appears after 1 s and moves on after 2 s; the path crosses its place in 4 s."""
    air = ClearAir(history(zone_set(), zone_set(SQUARE), zone_set(zone("Z2", shapely.box(20, 0, 30, 10)))))
    path = [(-5, 5, 50), (15, 5, 50)]
    at = np.array([0, 4]) * SECOND_NS  # 5 m/s: in the square from 1 to 3 s
    assert not air.path_is_clear(path, at)
    assert air.first_conflict(path, at) == Conflict(0, "Z1")
    assert air.path_is_clear(path, at // 4)  # over before it appears
    assert air.path_is_clear(path, at + 2 * SECOND_NS)  # and after it went
    assert air.first_conflict([*path, (25, 5, 50)], [*(at + 2 * SECOND_NS), 10 * SECOND_NS]) == Conflict(
        1, "Z2"
    )
    assert air.path_is_clear([(-5, 5, 130), (15, 5, 130)], at)  # above
    assert air.first_conflict(path, at - 1) == Conflict(0, None)  # begins before anything is known


@pytest.mark.parametrize(("path", "stamps_ns"), [([(0, 0, 0)], [0]), ([(0, 0, 0), (1, 1, 1)], [1, 0])])
def test_what_is_no_path_is_refused(path: list[tuple[float, ...]], stamps_ns: list[int]) -> None:
    with pytest.raises(ValueError, match="at least two waypoints and stamps that do not go back"):
        ClearAir(zone_set()).path_is_clear(path, stamps_ns)


def _asked(air: ClearAir) -> list[Callable[[object, object], object]]:
    """Each question about places and stamps."""

    def a_leg(places: object, stamps_ns: object) -> object:
        return air.legs_are_clear(places, places, stamps_ns, stamps_ns)  # type: ignore[arg-type]

    return [air.is_clear, air.clearance_m, air.path_is_clear, a_leg]  # type: ignore[list-item]


@pytest.mark.parametrize(
    ("places", "message"),
    [
        ([(0.0, 0.0, 0.0), (0.0, np.nan, 0.0)], r"point 1 is \(0, nan, 0\); places lie within 2e\+07 m"),
        ([(0.0, 0.0, 1e300), (0.0, 0.0, 0.0)], r"point 0 is \(0, 0, 1e\+300\)"),
        ([(-np.inf, 0.0, 0.0)] * 2, r"point 0 is \(-inf, 0, 0\)"),
        ([(0.0, 0.0)] * 2, r"points must be \[N, 3\], got shape \[2, 2\]"),
        (
            np.ma.masked_less([(30.0, 0.0, 5.0), (-1.0, 0.0, 5.0)], 0.0),
            "points are masked; leave out what nobody knows",
        ),
    ],
)
def test_what_is_no_place_is_refused_and_not_called_clear(
    places: list[tuple[float, ...]], message: str
) -> None:
    for asked in _asked(ClearAir(zone_set(SQUARE))):
        with pytest.raises(ValueError, match=message):
            asked(places, [0, 1])


@pytest.mark.parametrize(
    ("stamps_ns", "message"),
    [
        ([0.0, np.nan], "stamps are whole nanoseconds between .*, got nan"),
        ([0.0, 1764086400.5], r"got 1764086400\.5"),  # a clock in seconds
        ([0, 2**62 + 1], f"got {2**62 + 1}"),
        ([-(2**63), 0], f"got {-(2**63)}"),
        (np.array([0, 2**63 + 5], dtype=np.uint64), f"got {2**63 + 5}"),
        ([0, 2**70], f"got {2**70}"),
        ([False, True], "got bool"),
        (["now", "then"], "got <U4"),
        # In single precision 1760000000123456789 is 55.2 s earlier: the zones of then were asked.
        (np.float32([0, 1760000000123456789]), "got float32"),
        # 584.554 years before, numpy's round of nanoseconds: in June 2015.
        (np.array(["1970-01-01", "2600-01-01"], dtype="datetime64[s]"), "got 2600-01-01T00:00:00"),
        (np.array(["1970-01-01", "NaT"], dtype="datetime64[ns]"), "got NaT"),
        ([0, 1, 2], r"2 points have 2 stamps or one, got shape \[3\]"),
        (np.ma.masked_equal([0, 1], 1), "stamps are masked"),
    ],
)
def test_what_is_no_stamp_is_refused_and_not_called_clear(stamps_ns: object, message: str) -> None:
    for asked in _asked(ClearAir(zone_set(SQUARE))):
        with pytest.raises(ValueError, match=message):
            asked([(20.0, 0.0, 5.0), (30.0, 0.0, 5.0)], stamps_ns)


BOW_TIE = shapely.Polygon([(0, 0), (60, 60), (60, 0), (0, 60)])


def test_what_is_no_area_or_no_zones_is_refused() -> None:
    with pytest.raises(ValueError, match=r"within is no area: Self-intersection\[30 30\]"):
        ClearAir(zone_set(), within=BOW_TIE)
    with pytest.raises(ValueError, match=r"zone A is no area: Self-intersection\[30 30\]"):
        # Of this one, larger by a clearance, half was open.
        Zone.of_no_look("A", BOW_TIE, "static", "given")
    with pytest.raises(TypeError, match=r"within is 'x'; it must be a Polygon or MultiPolygon of shapely"):
        ClearAir(zone_set(), within="x")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"zones are \[Zone\('Z1'.*; they must be a ZoneHistory or a ZoneSet"):
        ClearAir([SQUARE])  # type: ignore[arg-type]


def test_stamps_may_be_dates_and_whole_floats() -> None:
    air = ClearAir(history(zone_set(), zone_set(SQUARE)))  # known from 0 s and from 1 s on
    inside = [(5.0, 5.0, 50.0)] * 2
    assert air.is_clear(inside, [0.0, 1e9]).tolist() == [True, False]
    assert air.is_clear(
        inside, np.array(["1970-01-01T00:00:00", "1970-01-01T00:00:01"], "M8[s]")
    ).tolist() == [
        True,
        False,
    ]


def random_history(rng: np.random.Generator) -> ZoneHistory:
    sets = []
    for _ in range(4):
        zones = []
        for number in range(rng.integers(0, 6)):
            corners = rng.uniform(0.0, 100.0, 2) + rng.uniform(-15.0, 15.0, (6, 2))
            lower = rng.choice([0.0, 20.0])
            zones.append(
                zone(
                    f"Z{number + 1}",
                    shapely.convex_hull(shapely.MultiPoint(corners)),
                    valid_until_ns=int(rng.integers(0, 8 * SECOND_NS)),
                )
            )
            zones[-1] = replace(zones[-1], band=AltitudeBand(lower, 60.0, "AGL"))
        sets.append(zone_set(*zones))
    return history(*sets)


def is_closed(zones: ZoneHistory, point: np.ndarray, stamp_ns: int, expires: bool) -> bool:
    """One point and one zone after the other."""
    for one in zones.at(stamp_ns):
        lower = -np.inf if one.band.lower_m == 0.0 else 10.0 + one.band.lower_m
        alive = not expires or stamp_ns < one.valid_until_ns
        if alive and lower <= point[2] <= 72.0 and one.polygon.intersects(shapely.Point(point[:2])):
            return True
    return False


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), expires=st.booleans())
def test_answers_agree_with_slow_ones(seed: int, expires: bool) -> None:
    rng = np.random.default_rng(seed)
    zones = random_history(rng)
    air = ClearAir(zones, expires=expires)
    points = rng.uniform((0, 0, 0), (100, 100, 100), (60, 3))
    stamps_ns = rng.integers(0, 6 * SECOND_NS, 60)
    expected = [is_closed(zones, p, int(t), expires) for p, t in zip(points, stamps_ns, strict=True)]
    assert (~air.is_clear(points, stamps_ns)).tolist() == expected
    clearance = air.clearance_m(points, stamps_ns)
    np.testing.assert_array_equal(clearance <= 0.0, expected)
    # Nothing within the clearance is closed (of a zone alive at that stamp).
    for point, stamp_ns, reach in zip(points, stamps_ns, clearance, strict=True):
        if 0.0 < reach < np.inf:
            way = rng.normal(size=(10, 3))
            near = point + way / np.linalg.norm(way, axis=1)[:, None] * reach * 0.999
            assert air.is_clear(near, int(stamp_ns)).all()
    # A path is clear only if every place on it is.
    order = np.sort(stamps_ns[:5])
    if air.path_is_clear(points[:5], order):
        share = rng.random((4, 50, 1))
        places = points[:4, None] + share * (points[1:5] - points[:4])[:, None]
        stamps = order[:4, None] + (share[..., 0] * np.diff(order)[:, None]).astype(np.int64)
        assert air.is_clear(places.reshape(-1, 3), stamps.ravel()).all()


def test_legs_are_what_single_paths_are() -> None:
    rng = np.random.default_rng(5)
    for expires in (False, True):
        air = ClearAir(random_history(rng), expires=expires)
        start, end = rng.uniform((0, 0, 0), (100, 100, 100), (2, 200, 3))
        begin_ns = rng.integers(-SECOND_NS, 5 * SECOND_NS, 200)
        end_ns = begin_ns + rng.integers(0, 3 * SECOND_NS, 200)
        single = [
            air.path_is_clear([a, b], [s, t]) for a, b, s, t in zip(start, end, begin_ns, end_ns, strict=True)
        ]
        assert air.legs_are_clear(start, end, begin_ns, end_ns).tolist() == single
        assert 0 < sum(single) < 200
    with pytest.raises(ValueError, match="does not end before it begins"):
        air.legs_are_clear([(0, 0, 0)], [(1, 1, 1)], 1, 0)


def test_a_leg_may_reach_a_zone_after_its_end() -> None:
    """At 10 m/s from 30 m before the square: it is reached after 3 s and left after 4."""
    path, at = [(-30, 5, 50), (20, 5, 50)], [0, 5 * SECOND_NS]
    for end_s, clear in ((2.9, True), (3.1, False), (3.9, False), (9.0, False)):
        ends = replace(SQUARE, valid_until_ns=int(end_s * SECOND_NS))
        assert ClearAir(history(zone_set(ends)), expires=True).path_is_clear(path, at) is clear
        assert not ClearAir(history(zone_set(ends))).path_is_clear(path, at)


def odd_zones(rng: np.random.Generator) -> list[Zone]:
    """Outlines whose middle lies beside them, in a hole, between parts, or in them."""
    ring = shapely.Point(0, 0).buffer(9, 6).difference(shapely.Point(2, 0).buffer(5, 3))
    hook = shapely.Polygon([(0, 0), (20, 0), (20, 3), (3, 3), (3, 20), (0, 20)])
    parts = shapely.MultiPolygon([shapely.box(-8, 0, -5, 6), shapely.box(4, 0, 9, 3)])
    shapes = [ring, hook, parts, shapely.box(0, 0, 30, 0.5), shapely.Polygon()]
    zones = []
    for number in range(25):
        turned = shapely.affinity.rotate(shapes[number % len(shapes)], rng.uniform(0, 360), origin=(0, 0))
        placed = shapely.affinity.translate(turned, *rng.uniform(0, 120, 2))
        ends = int(rng.integers(0, 4 * SECOND_NS)) if rng.random() < 0.7 else None
        one = zone(f"Z{number}", placed, valid_until_ns=ends, upper_m=rng.uniform(10.0, 60.0))
        zones.append(replace(one, band=AltitudeBand(rng.choice([0.0, 15.0]), 20.0, "AGL")))
    return zones


def apart_m(one: Zone, point: np.ndarray) -> float:
    """By shapely, one zone at one point: distance, or how deep."""
    here = shapely.Point(point[:2])
    lower = -np.inf if one.band.lower_m == 0.0 else 10.0 + one.band.lower_m
    over = max(lower - point[2], point[2] - (one.upper_m + 20.0))
    if over <= 0.0 and one.polygon.intersects(here):
        return -float(min(one.polygon.boundary.distance(here), -over))
    return float(np.hypot(one.polygon.distance(here), max(over, 0.0)))


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), expires=st.booleans(), far_m=st.sampled_from([0.0, 40.0, 5000.0]))
def test_any_shape_is_judged_as_shapely_judges_it_alone(seed: int, expires: bool, far_m: float) -> None:
    rng = np.random.default_rng(seed)
    zones = odd_zones(rng)
    air = ClearAir(zone_set(*zones), expires=expires)
    points = rng.uniform((-far_m, 0, -10), (120 + far_m, 120, 100 + far_m), (80, 3))
    stamps_ns = rng.integers(0, 5 * SECOND_NS, 80)
    clearance = air.clearance_m(points, stamps_ns)
    expected = []
    for point, stamp_ns in zip(points, stamps_ns, strict=True):
        alive = [
            one
            for one in zones
            if not one.polygon.is_empty
            and (not expires or one.valid_until_ns is None or stamp_ns < one.valid_until_ns)
        ]
        expected.append(min((apart_m(one, point) for one in alive), default=np.inf))
    np.testing.assert_allclose(clearance, expected, atol=1e-9)
    np.testing.assert_array_equal(air.is_clear(points, stamps_ns), np.array(expected) > 0.0)
    if not expires:
        ends = points + rng.uniform(-20, 20, points.shape)
        clear = air.legs_are_clear(points, ends, 0, SECOND_NS)
        shares = np.linspace(0.0, 1.0, 200)[:, None]
        for start, end, told in zip(points, ends, clear, strict=True):
            nearest_m = air.clearance_m(start + shares * (end - start), 0).min()
            # Every place on a clear leg is clear, and one that is not comes as near as places are apart.
            assert nearest_m > 0.0 if told else nearest_m <= np.linalg.norm(end - start) / 199


def test_a_leg_that_climbs_over_a_zone_is_clear() -> None:
    """The square, 10 m wide, is closed up to 112 m. A leg over 40 m that begins 20 m before it at 60 m must
    be higher than that where it reaches it, half way: it ends at 164.1 m or above."""
    air = ClearAir(zone_set(SQUARE))
    assert air.path_is_clear([(-20, 5, 60), (20, 5, 164.1)], [0, SECOND_NS])
    assert air.first_conflict([(-20, 5, 60), (20, 5, 163.9)], [0, SECOND_NS]) == Conflict(0, "Z1")
    assert air.legs_are_clear([(20, 5, 164.1)], [(-20, 5, 60)], 0, SECOND_NS).tolist() == [True]
    # It climbs on the spot: beside the square, and above it, but not out of it.
    assert air.path_is_clear([(11, 5, 0), (11, 5, 200)], [0, SECOND_NS])
    assert air.path_is_clear([(5, 5, 112.1), (5, 5, 200)], [0, SECOND_NS])
    assert not air.path_is_clear([(5, 5, 111.9), (5, 5, 200)], [0, SECOND_NS])
    # Below a raised band and up behind it.
    raised = ClearAir(zone_set(replace(SQUARE, band=AltitudeBand(50.0, 100.0, "AGL"))))
    assert raised.path_is_clear([(-5, 5, 0), (25, 5, 110)], [0, SECOND_NS])
    assert not raised.path_is_clear([(-5, 5, 0), (25, 5, 122)], [0, SECOND_NS])


def test_a_leg_that_climbs_meets_a_zone_that_ends_while_it_is_low_and_not_after() -> None:
    """On the spot in the square from 12 m at 50 m/s: above 112 m after 2 s."""
    climb, at = [(5, 5, 12), (5, 5, 212)], [0, 4 * SECOND_NS]
    raised = replace(
        SQUARE, band=AltitudeBand(50.0, 100.0, "AGL")
    )  # from 60 m up, which is reached after .96 s
    for end_s, clear in ((0.9, True), (1.0, False), (5.0, False)):
        ends = replace(raised, valid_until_ns=int(end_s * SECOND_NS))
        assert ClearAir(zone_set(ends), expires=True).path_is_clear(climb, at) is clear


def test_no_question_takes_more_than_ten_microseconds_at_ten_thousand_zones() -> None:
    rng = np.random.default_rng(0)
    places = shapely.points(rng.uniform(0, 5000, (10_000, 2)))
    outlines = shapely.buffer(places, rng.uniform(2, 20, 10_000), quad_segs=15)
    air = ClearAir(history(zone_set(*(zone(f"Z{k}", outline) for k, outline in enumerate(outlines)))))
    start = rng.uniform((0, 0, 20), (5000, 5000, 150), (10_000, 3))
    end = start + rng.uniform(-20, 20, (10_000, 3))
    questions: list[Callable[[], object]] = [
        lambda: air.is_clear(start, 0),
        lambda: air.clearance_m(start, 0),
        lambda: air.legs_are_clear(start, end, 0, 5 * SECOND_NS),
        lambda: air.path_is_clear(np.cumsum(end - start, axis=0) + 2500.0, np.arange(10_000)),
    ]
    for ask in questions:
        ask()
        seconds = []
        for _ in range(3):
            started = time.process_time()
            ask()
            seconds.append(time.process_time() - started)
        assert min(seconds) / len(start) < 10e-6
