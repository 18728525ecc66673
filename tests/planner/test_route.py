"""Ways round zones: as short as they can be worked out by hand, and always clear."""

import time
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from scipy.sparse.csgraph import dijkstra

from crowdfence.planner import ClearAir, NoRoute, Route, corners, safe_route
from crowdfence.planner.corners import TURN_M
from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.grow import grown
from crowdfence.zones.history import ZoneHistory


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


def test_round_all_that_a_zone_set_closes() -> None:
    """A set is a sequence of its crowds; ground that nobody saw and zones of others are closed too."""
    unseen = Zone.of_no_look("UNSEEN", WALL.polygon, "unseen", "never_seen")
    static = Zone.of_no_look("CTR", shapely.box(40, 20, 60, 50), "static", "given")
    zones = ZoneSet((), 0.5, 0.0, 0, 0.0, unseen=(unseen,), static=(static,))
    around = safe_route((0, 0), (100, 0), zones)
    assert around.length_m == pytest.approx(2 * np.hypot(40, 30) + 20, abs=0.3)
    assert (around.waypoints[1:-1, 1] < -30.0).all()


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


def test_a_way_turns_round_the_rim_of_its_area() -> None:
    """A U: from the one arm to the other round its inner corners, 30 + 20 + 30 m and a hair."""
    arms = shapely.box(0, 0, 60, 60) - shapely.box(20, 30, 40, 60)
    route = safe_route((20, 60), (40, 60), [], within=arms)
    assert route.length_m == pytest.approx(80.0, abs=0.3)
    assert arms.covers(shapely.LineString(route.waypoints))
    islands = shapely.MultiPolygon([shapely.box(0, 0, 10, 10), shapely.box(20, 0, 30, 10)])
    with pytest.raises(NoRoute, match="there is no way within the area"):
        safe_route((5, 5), (25, 5), [], within=islands)


def test_what_is_no_place_is_refused() -> None:
    with pytest.raises(ValueError, match=r"two places .* within 2e\+07 m, got \(0, nan\) and \(1, 1\)"):
        safe_route((0, np.nan), (1, 1), [])
    with pytest.raises(ValueError, match=r"got \(0, 0\) and \(1e\+300, 0\)"):
        safe_route((0, 0), (1e300, 0), [])
    with pytest.raises(ValueError, match=r"clearance_m is 1e\+308; it must lie between 0 and 1e\+06"):
        safe_route((0.0, 0.0), (1.0, 0.0), [], clearance_m=1e308)
    with pytest.raises(ValueError, match="clearance_m is -1"):
        safe_route((0, 0), (1, 1), [], clearance_m=-1.0)
    with pytest.raises(ValueError, match="start and goal are masked"):
        safe_route(np.ma.masked_less([-1.0, 0.0], 0.0), (1, 1), [])
    bow_tie = shapely.Polygon([(0, 0), (60, 60), (60, 0), (0, 60)])
    with pytest.raises(ValueError, match=r"within is no area: Self-intersection\[30 30\]"):
        safe_route((1, 30), (59, 30), [], within=bow_tie)


@settings(max_examples=15)
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


def field_of_many_zones() -> list[Zone]:
    """3000 m wide, 3000 zones of cells: of 1000 m2 three are closed, and ways lead everywhere."""
    rng = np.random.default_rng(0)
    return [
        zone(
            f"Z{k}",
            shapely.union_all(shapely.box(cells[:, 0], cells[:, 1], cells[:, 0] + 1, cells[:, 1] + 1)),
        )
        for k, cells in enumerate(rng.integers(0, 3000, (3000, 1, 2)) + rng.integers(0, 3, (3000, 4, 2)))
    ]


def test_a_way_through_thousands_of_zones_is_about_straight() -> None:
    """Over coarser outlines around all of them there was none within the area, and without one 5.8 km."""
    zones, within = field_of_many_zones(), shapely.box(-100, -100, 3100, 3100)
    started = time.process_time()
    for clearance_m in (0.0, 5.0):
        route = safe_route((-50, 1500), (3050, 1500), zones, clearance_m=clearance_m, within=within)
        assert route.length_m < 1.002 * route.direct_m
        way = shapely.LineString(route.waypoints)
        apart_m = shapely.distance(way, [one.polygon for one in zones])
        assert apart_m.min() >= clearance_m and apart_m.min() > 0.0
    assert time.process_time() - started < 10.0


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), clearance_m=st.sampled_from([0.0, 1.0]), bounded=st.booleans())
def test_a_way_is_the_shortest_over_all_corners_of_all_zones(
    seed: int, clearance_m: float, bounded: bool
) -> None:
    """Beside a search that looks along all pairs of corners at once, whatever they touch."""
    rng = np.random.default_rng(seed)
    zones = [
        zone(f"Z{k}", shapely.box(x, y, x + width, y + height))
        for k, (x, y, width, height) in enumerate(np.round(rng.uniform(0, 40, (7, 4)) / (1, 1, 2, 2)))
        if width and height
    ]
    within = shapely.box(-5, -5, 65, 65) if bounded else None
    closed = shapely.union_all([grown(one.polygon, clearance_m) for one in zones])
    expected = length_over_all_pairs((-4, 20), (64, 30), closed, within)
    if expected is None:
        with pytest.raises(NoRoute):
            safe_route((-4, 20), (64, 30), zones, clearance_m=clearance_m, within=within)
    else:
        route = safe_route((-4, 20), (64, 30), zones, clearance_m=clearance_m, within=within)
        # It may turn at any angle so far from the zones, and has no corners where those of two meet.
        turns_m = TURN_M * len(route.waypoints)
        assert expected - turns_m < route.length_m < expected + turns_m


def length_over_all_pairs(
    start: tuple[float, float],
    goal: tuple[float, float],
    closed: shapely.Polygon,
    within: shapely.Polygon | None,
) -> float | None:
    turns = shapely.get_coordinates(shapely.buffer(closed, TURN_M, join_style="mitre", mitre_limit=5.0))
    if within is not None:
        turns = turns[shapely.covers(within, shapely.points(turns))]
    places = np.vstack([start, goal, turns[~shapely.intersects(closed, shapely.points(turns))]])
    lengths = np.linalg.norm(places[:, None] - places, axis=2)
    first, second = np.triu_indices(len(places), 1)
    meets = shapely.intersects(closed, shapely.linestrings(places[np.stack([first, second], axis=1)]))
    lengths[first[meets], second[meets]] = lengths[second[meets], first[meets]] = 0.0
    shortest = dijkstra(lengths, indices=0)[1]
    return float(shortest) if np.isfinite(shortest) else None


def test_where_outlines_have_too_many_corners_a_way_is_found_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A gate of 3 m in a long comb: to its corner in the south-west, (40, 3), and on from that in the
    north-east, (60, 6)."""
    monkeypatch.setattr(corners, "MOST_PAIRS", 10)
    monkeypatch.setattr(corners, "MOST_CORNERS", 40)
    teeth = [shapely.box(40, y, 60, y + 3.0) for y in range(-60, 60, 6)]
    wall = shapely.union_all([*teeth, shapely.box(49, -60, 50, 3), shapely.box(49, 6, 50, 60)])
    area = shapely.box(-10, -59, 110, 58)
    # Without the area there is a way round the comb, half as long again.
    for within in (area, None):
        route = safe_route((0, -30), (100, 30), [zone("Z1", wall)], within=within)
        way = shapely.LineString(route.waypoints)
        assert not way.intersects(wall) and area.covers(way)
        assert route.length_m == pytest.approx(np.hypot(40, 33) + np.hypot(20, 3) + np.hypot(40, 24), abs=0.3)
    with pytest.raises(NoRoute, match="there is no way within the area: zones close every one"):
        safe_route(
            (0, -30), (100, 30), [zone("Z1", wall), zone("Z2", shapely.box(44, 2, 46, 7))], within=area
        )


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.sampled_from([0.2, 0.4, 0.5]), timed=st.booleans())
def test_over_open_ground_there_is_a_way_where_cells_join(seed: int, share: float, timed: bool) -> None:
    """Cells that are open join over their edges, and not over a corner where two that are closed touch."""
    rng = np.random.default_rng(seed)
    closed = rng.random((12, 12)) < share
    closed[0, 0] = closed[-1, -1] = False
    cells = 2.0 * np.argwhere(closed) + 1000.0
    parts = shapely.box(cells[:, 0], cells[:, 1], cells[:, 0] + 2.0, cells[:, 1] + 2.0)
    zones = [ends_after(zone(f"Z{k}", part), 1e6) for k, part in enumerate(parts)]
    ends = np.add(rng.uniform(0.1, 1.9, (2, 2)), [[1000.0], [1022.0]])
    clock = {"departure_ns": DEPARTURE_NS, "speed_m_s": 2.0} if timed else {}
    joined, _ = ndimage.label(~closed)
    area = shapely.box(1000, 1000, 1024, 1024)
    with pytest.MonkeyPatch.context() as limits:
        limits.setattr(corners, "MOST_PAIRS", 0)
        limits.setattr(corners, "MOST_CORNERS", 0)
        if joined[0, 0] != joined[-1, -1]:
            with pytest.raises(NoRoute, match="zones close every one of them"):
                safe_route(*ends, zones, within=area, **clock)  # type: ignore[arg-type]
            return
        route = safe_route(*ends, zones, within=area, **clock)  # type: ignore[arg-type]
    way = shapely.LineString(route.waypoints)
    assert not shapely.intersects(way, parts).any() and area.covers(way)
    assert route.waypoints[[0, -1]].tolist() == ends.tolist()
    # Where two zones meet, corners of the shortest way may stick out further by as much as they lie outside.
    turns_m = TURN_M * len(route.waypoints)
    assert route.length_m > safe_route(*ends, zones, within=area).length_m - turns_m
    if timed:
        assert route.stamps_ns is not None
        assert (route.stamps_ns[-1] - DEPARTURE_NS) / 1e9 == pytest.approx(route.length_m / 2.0, abs=1e-6)


def ends_after(one: Zone, seconds: float) -> Zone:
    return replace(one, valid_until_ns=DEPARTURE_NS + round(seconds * 1e9))


DEPARTURE_NS = 1_000_000_000_000


def flown(zones: list[Zone], **options: object) -> Route:
    return safe_route((0, 0), (100, 0), zones, departure_ns=DEPARTURE_NS, speed_m_s=10.0, **options)


def test_a_way_says_when_it_is_where() -> None:
    route = flown([WALL])
    assert route.stamps_ns is not None
    legs_m = np.linalg.norm(np.diff(route.waypoints, axis=0), axis=1)
    np.testing.assert_allclose(np.diff(route.stamps_ns) / 1e9, legs_m / 10.0, atol=1e-6)
    assert route.stamps_ns[0] == DEPARTURE_NS


def test_zones_stay_closed_beyond_their_end_unless_asked() -> None:
    """The wall from 40 to 60 m ends before the vehicle gets there, after 4 s."""
    gone = ends_after(WALL, 3.0)
    np.testing.assert_array_equal(flown([gone]).waypoints, flown([WALL]).waypoints)
    direct = flown([gone], expires=True)
    assert direct.waypoints.tolist() == [[0, 0], [100, 0]]
    assert direct.stamps_ns is not None
    assert (direct.stamps_ns[-1] - DEPARTURE_NS) / 1e9 == pytest.approx(10.0)
    assert flown([WALL], expires=True).length_m > 110.0  # it has no end


def test_it_waits_where_that_is_earlier_than_going_round() -> None:
    """Round the wall is 120 m, 12 s. Ending after 5 s it costs a second of waiting, ending after 9 s it is
    gone round."""
    waits = flown([ends_after(WALL, 5.0)], expires=True)
    assert waits.waypoints.tolist() == [[0, 0], [0, 0], [100, 0]]
    assert waits.stamps_ns is not None
    assert (waits.stamps_ns - DEPARTURE_NS) / 1e9 == pytest.approx([0.0, 1.0, 11.0], abs=0.01)
    round_it = flown([ends_after(WALL, 9.0)], expires=True)
    assert round_it.length_m == pytest.approx(2 * np.hypot(40, 30) + 20, abs=0.3)


def test_ends_open_the_only_way_there_is() -> None:
    ring = ends_after(RING, 60.0)
    with pytest.raises(NoRoute, match="there is no way"):
        flown([ring])
    with pytest.raises(NoRoute, match="there is no way"):
        flown([RING], expires=True)
    route = flown([ring], expires=True)
    assert route.stamps_ns is not None and route.waypoints[0].tolist() == route.waypoints[1].tolist()
    assert (route.stamps_ns[1] - DEPARTURE_NS) / 1e9 == pytest.approx(60.0 - 3.0, abs=0.01)
    with pytest.raises(NoRoute, match="the start .* lies in zone Z1"):
        safe_route((50, 0), (9, 9), [WALL], departure_ns=0, speed_m_s=1.0, expires=True)


@pytest.mark.parametrize("end_ns", [2**62 + 1, 2**63 - 1])
def test_a_zone_that_ends_in_another_century_is_gone_round(end_ns: int) -> None:
    """Who waited for it arrived in the year 1677, where stamps of 64 bits begin anew."""
    wall, ring = replace(WALL, valid_until_ns=end_ns), replace(RING, valid_until_ns=end_ns)
    assert flown([wall], expires=True).length_m == pytest.approx(2 * np.hypot(40, 30) + 20, abs=0.3)
    with pytest.raises(NoRoute, match="there is no way"):
        flown([ring], expires=True)


def test_a_zone_that_has_ended_by_the_departure_is_open_at_the_start_too() -> None:
    """As the other half of the planner has it: closed before its end, open from it on."""
    in_wall = {"departure_ns": DEPARTURE_NS, "speed_m_s": 10.0, "expires": True}
    for seconds in (-30.0, 0.0):
        ended = ends_after(WALL, seconds)
        assert ClearAir(ZoneSet((ended,), 0.5, 0.0, 0, 0.0), expires=True).is_clear((50, 0, 5), DEPARTURE_NS)
        assert safe_route((50, 0), (100, 0), [ended], **in_wall).length_m == 50.0  # type: ignore[arg-type]
    with pytest.raises(NoRoute, match="the start .* lies in zone Z1"):
        safe_route((50, 0), (100, 0), [ends_after(WALL, 0.1)], **in_wall)  # type: ignore[arg-type]
    with pytest.raises(NoRoute, match="the start .* lies in zone Z1"):
        safe_route((50, 0), (100, 0), [ends_after(WALL, -30.0)], departure_ns=DEPARTURE_NS, speed_m_s=10.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"departure_ns": 0}, "belong together"),
        ({"speed_m_s": 3.0}, "belong together"),
        ({"expires": True}, "expires needs both"),
        ({"departure_ns": 0, "speed_m_s": 0.0}, r"speed_m_s is 0; it must lie between 0\.01 and 10000"),
        ({"departure_ns": 0, "speed_m_s": 1e-300}, "speed_m_s is 1e-300"),
        ({"departure_ns": np.nan, "speed_m_s": 3.0}, "stamps are whole nanoseconds .* got nan"),
        ({"departure_ns": 1764086400.5, "speed_m_s": 3.0}, r"got 1764086400\.5"),
        ({"departure_ns": 2**70, "speed_m_s": 3.0}, f"got {2**70}"),
    ],
)
def test_a_clock_needs_a_speed(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        safe_route((0, 0), (1, 1), [], **options)  # type: ignore[arg-type]


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), clearance_m=st.sampled_from([0.0, 2.0]))
def test_a_timed_way_is_clear_and_no_later_than_one_that_waits_for_nothing(
    seed: int, clearance_m: float
) -> None:
    rng = np.random.default_rng(seed)
    zones = []
    for number in range(rng.integers(1, 9)):
        corners = rng.uniform(20.0, 180.0, 2) + rng.uniform(-40.0, 40.0, (6, 2))
        polygon = shapely.convex_hull(shapely.MultiPoint(corners)).buffer(0.5)
        one = zone(f"Z{number}", polygon)
        zones.append(ends_after(one, rng.uniform(0, 40)) if rng.random() < 0.6 else one)
    ends = {"departure_ns": DEPARTURE_NS, "speed_m_s": 10.0, "clearance_m": clearance_m}
    timed = safe_route((-30, -30), (230, 230), zones, expires=True, **ends)
    patient = safe_route((-30, -30), (230, 230), zones, **ends)
    assert timed.stamps_ns is not None and patient.stamps_ns is not None
    # The corners of one union of zones and of two lie less than a centimetre apart: a millisecond.
    assert timed.stamps_ns[-1] <= patient.stamps_ns[-1] + 1_000_000
    # An independent look at it: every 0.1 s the vehicle is in no zone that has not ended.
    stamps_ns = np.arange(timed.stamps_ns[0], timed.stamps_ns[-1], 100_000_000)
    place = [np.interp(stamps_ns, timed.stamps_ns, timed.waypoints[:, axis]) for axis in (0, 1)]
    for x, y, stamp_ns in zip(*place, stamps_ns, strict=True):
        for one in zones:
            if one.valid_until_ns is None or stamp_ns < one.valid_until_ns:
                assert one.polygon.distance(shapely.Point(x, y)) >= clearance_m - 1e-6
    # And so says the other half of the planner.
    high = np.column_stack([timed.waypoints, np.full(len(timed.waypoints), 5.0)])
    history = ZoneHistory([DEPARTURE_NS], [ZoneSet(tuple(zones), 0.5, 0.0, 0, 0.0)], None, {})
    assert ClearAir(history, expires=True).path_is_clear(high, timed.stamps_ns)
