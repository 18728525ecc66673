"""Zones over time: what is closed, which zone is which, until when and why."""

import dataclasses
import io
import json

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import ndimage

from crowdfence import Camera, CrowdMap, Evidence, Observation, Or, Paper, Rates, Terrain, View
from crowdfence.config import EvidenceConfig, ZoneConfig
from crowdfence.planner import ClearAir
from crowdfence.voxel_state import VoxelState
from crowdfence.zones import Zone, ZoneEngine, ZoneSet, find_zones
from crowdfence.zones.tracker import column_keys
from crowdfence.zones.unseen import UnseenGround
from support.small_crowd_maps import crowd_map_of, flat_crowd_map, look
from support.small_zones import SECOND_NS, DrawnZones, drawing, ids, told

PLAIN = Terrain.from_occupancy(np.ones((30, 30, 1), bool), 1.0)


def cells_inside(zones: ZoneSet, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Columns of a 1 m grid that a set of zones covers whole [X, Y]."""
    closed = shapely.union_all([zone.polygon for zone in zones.closed])
    i, j = np.indices(shape)
    return np.asarray(shapely.covers(closed, shapely.box(i, j, i + 1, j + 1)))


def test_the_first_instant_gives_what_one_look_gives() -> None:
    rng = np.random.default_rng(3)
    crowd_map = flat_crowd_map(rng.random((12, 12)))
    engine = ZoneEngine(crowd_map, ZoneConfig(threshold=0.8, min_area_m2=2.0).rules(0.5))
    zones, expected = engine.step(0), find_zones(crowd_map, 0, threshold=0.8, min_area_m2=2.0)
    assert ids(zones) == ids(expected) and len(zones) > 2
    for zone, other in zip(zones, expected, strict=True):
        assert zone.polygon.equals(other.polygon)
        assert (zone.cell_count, zone.probability_max, zone.seen_by) == (
            other.cell_count,
            other.probability_max,
            other.seen_by,
        )
    assert (zones.dropped_count, zones.dropped_area_m2) == (expected.dropped_count, expected.dropped_area_m2)


def test_ids_live_through_merge_split_and_end() -> None:
    zones = DrawnZones((7, 3))
    first = zones.drawn("""
        ##...##
        #.....#
        .......""")
    assert told(first) == [("created", "Z1"), ("created", "Z2")]
    west, east = first
    assert west.polygon.bounds[0] == 0.0 and east.polygon.bounds[2] == 7.0
    same = zones.drawn("""
        ##...##
        #.....#
        .......""")
    assert told(same) == [] and same[0].polygon is west.polygon
    merged = zones.drawn("""
        #######
        #.....#
        .......""")
    assert told(merged) == [("merged", "Z2", "Z1"), ("updated", "Z1")]
    assert ids(merged) == ["Z1"] and merged[0].created_ns == 0
    split = zones.drawn("""
        .##..##
        .#....#
        .......""")
    # Parts of the same size: the westernmost keeps the id. What was Z2 is a new zone, ids are not used twice.
    assert told(split) == [("split", "Z3", "Z1"), ("updated", "Z1")]
    assert {zone.id: zone.created_ns for zone in split} == {"Z1": 0, "Z3": 3 * SECOND_NS}
    over = zones.drawn("""
        .......
        .......
        .......""")
    assert told(over) == [("expired", "Z1"), ("expired", "Z3")] and len(over) == 0


def test_the_older_id_is_kept_though_its_zone_is_smaller() -> None:
    zones = DrawnZones((6, 1))
    zones.drawn("#.....")
    zones.drawn("#..###")
    assert told(zones.drawn("######")) == [("merged", "Z2", "Z1"), ("updated", "Z1")]


def test_what_evidence_forgets_stays_closed_until_somebody_looks() -> None:
    terrain = Terrain.from_occupancy(np.ones((6, 1, 1), bool), 1.0)
    crowd_map = CrowdMap(terrain, EvidenceConfig(memory_s=5.0).fusion_method(terrain, drones=1))
    engine = ZoneEngine(crowd_map, ZoneConfig(min_area_m2=0.0).rules(crowd_map.method.default_threshold))
    ids_of = np.arange(6)
    for second in range(3):
        look(crowd_map, "uav1", second * SECOND_NS, ids_of[:3], 0.95)
        zones = engine.step(second * SECOND_NS)
    assert [zone.cell_count for zone in zones] == [3]
    forgotten_ns, bounds = zones[0].forgotten_ns, crowd_map.interval(2 * SECOND_NS, [0, 1, 2])
    assert forgotten_ns is not None and bounds is not None
    assert zones[0].interval == tuple(bounds.max(axis=0).tolist())
    # Unseen since, the map still holds crowd until then, and not a millisecond longer.
    threshold = crowd_map.method.default_threshold
    assert (crowd_map.probability(forgotten_ns - 1_000_000, [0, 1, 2]) >= threshold).all()
    assert (crowd_map.probability(forgotten_ns + 1_000_000, [0, 1, 2]) < threshold).all()
    # The drone looks elsewhere for two minutes. The map has forgotten, the ground is closed.
    for second in range(3, 120, 3):
        look(crowd_map, "uav1", second * SECOND_NS, ids_of[3:], 0.0)
        zones = engine.step(second * SECOND_NS)
    (zone,) = zones
    assert (zone.cell_count, zone.reason, zone.valid_until_ns) == (3, "not_looked_at", None)
    assert zone.forgotten_ns == 117 * SECOND_NS  # it is not known any more
    assert zone.probability_max < crowd_map.method.default_threshold
    # It looks again at two of the three, and sees nobody.
    look(crowd_map, "uav1", 120 * SECOND_NS, ids_of[:2], 0.0)
    assert [zone.cell_count for zone in engine.step(120 * SECOND_NS)] == [1]
    look(crowd_map, "uav1", 121 * SECOND_NS, ids_of[2:3], 0.0)
    assert told(engine.step(121 * SECOND_NS)) == [("expired", "Z1")]


def test_a_look_at_the_roof_opens_nothing_below_it() -> None:
    terrain = Terrain.from_indices([(i, 0, k) for i in range(3) for k in (0, 9)], 1.0)
    ground, roof = (terrain.voxel_ids([(i, 0, k) for i in range(3)]) for k in (0, 9))
    crowd_map = CrowdMap(terrain, EvidenceConfig().fusion_method(terrain, drones=1))
    engine = ZoneEngine(crowd_map, ZoneConfig(min_area_m2=0.0).rules(crowd_map.method.default_threshold))
    for second, seen, mean in [(0, ground, 0.95), (1, ground, 0.95), (60, roof, 0.0)]:
        look(crowd_map, "uav1", second * SECOND_NS, seen, mean)
        zones = engine.step(second * SECOND_NS)
    (zone,) = zones
    assert (zone.id, zone.cell_count, zone.reason) == ("Z1", 3, "not_looked_at")
    assert zone.last_seen_ns == SECOND_NS
    look(crowd_map, "uav1", 61 * SECOND_NS, ground, 0.0)
    assert told(engine.step(61 * SECOND_NS)) == [("expired", "Z1")]


def test_a_look_that_could_not_have_shown_anybody_opens_nothing() -> None:
    """A minute after a crowd was seen from near, it is forgotten, and a drone far away sees nothing there. At
    0.75 m a pixel its looks weigh (.15 / .75)^2 = .04: five within half a second .192 together, less than the
    doubt of .2, and with the sixth .228."""
    terrain = Terrain.from_occupancy(np.ones((6, 1, 1), bool), 1.0)
    config = EvidenceConfig(memory_s=5.0, sharp_gsd_m=0.15, doubt=0.2)
    crowd_map = CrowdMap(terrain, config.fusion_method(terrain, drones=2))
    engine = ZoneEngine(crowd_map, ZoneConfig(min_area_m2=0.0).rules(crowd_map.method.default_threshold))
    for second in range(2):
        look(crowd_map, "uav1", second * SECOND_NS, np.arange(6), 0.95)
        engine.step(second * SECOND_NS)
    for number in range(6):
        stamp_ns = 60 * SECOND_NS + number * SECOND_NS // 10
        far = Observation(
            terrain,
            "uav2",
            stamp_ns,
            voxel_ids=np.arange(6),
            mean=np.zeros(6),
            pixel_count=np.ones(6, dtype=int),
            range_m=np.full(6, 300.0),
            tilt_deg=np.full(6, 90.0),
            occluded_ids=[],
            focal_px=400.0,
        )
        crowd_map.integrate_observations([far], stamp_ns)
        zones = engine.step(stamp_ns, [far])
        assert crowd_map.probability(stamp_ns).max() < crowd_map.method.default_threshold
        if number < 5:
            (zone,) = zones
            assert (zone.id, zone.cell_count, zone.reason) == ("Z1", 6, "held")
    assert told(zones) == [("expired", "Z1")]


def test_the_wall_below_a_terrace_says_nothing_of_who_stands_on_it() -> None:
    """Crowd at the edge of a terrace 4 m high is seen from above. A minute later a drone flies before its
    wall, lower than the edge, and sees nobody."""
    heights_m = np.zeros((20, 20))
    heights_m[:, 10:] = 4.3
    terrain = Terrain.from_height_map(heights_m, 1.0)
    crowd_map = CrowdMap(terrain, EvidenceConfig().fusion_method(terrain, drones=1))
    engine = ZoneEngine(crowd_map, ZoneConfig(min_area_m2=0.0).rules(crowd_map.method.default_threshold))
    camera = Camera.pinhole(64, 48, 32.0, 32.0, 32.0, 24.0)
    above, level = np.eye(4), np.eye(4)
    above[:3, :3] = np.diag([1.0, -1.0, -1.0])
    above[:3, 3] = (10.0, 10.5, 14.3)
    level[:3, :3] = np.column_stack([(1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)])
    level[:3, 3] = (10.0, 2.0, 2.0)
    crowd = np.zeros((48, 64), np.float32)
    crowd[21:24, 30:34] = 0.97  # a pixel is a third of a metre of the terrace; north is up
    for second, pose, heatmap in [(0, above, crowd), (1, above, crowd), (60, level, 0.0 * crowd)]:
        stamp_ns = second * SECOND_NS
        update = crowd_map.integrate([View("uav1", stamp_ns, camera, pose, heatmap)], stamp_ns)
        zones = engine.step(stamp_ns, update.observations)
    edge = terrain.voxel_ids([(9, 10, 4), (10, 10, 4)])
    assert (edge >= 0).all() and np.isin(edge, update.observations[0].voxel_ids).all()
    assert not np.isin(edge, update.voxel_ids).any()
    (zone,) = zones
    assert (zone.id, zone.reason, zone.last_seen_ns) == ("Z1", "not_looked_at", SECOND_NS)
    assert [(one.last_look_ns, one.looks) for one in zone.evidence] == [(SECOND_NS, 2)]


def test_a_look_that_speaks_for_crowd_opens_nothing_however_weak_it_is() -> None:
    """A minute after the crowd a close look finds .08 there: more than on ground without crowd, and less than
    the threshold. The same look at nothing opens the ground."""
    terrain = Terrain.from_occupancy(np.ones((3, 1, 1), bool), 1.0)

    def zones_after(mean: float) -> ZoneSet:
        crowd_map = CrowdMap(terrain, EvidenceConfig().fusion_method(terrain, drones=1))
        threshold = crowd_map.method.default_threshold
        engine = ZoneEngine(crowd_map, ZoneConfig(min_area_m2=0.0).rules(threshold))
        for second, seen in [(0, 0.95), (1, 0.95), (60, mean)]:
            observation = Observation(
                terrain,
                "uav1",
                second * SECOND_NS,
                voxel_ids=np.arange(3),
                mean=np.full(3, seen),
                pixel_count=np.ones(3, dtype=int),
                range_m=np.full(3, 20.0),
                tilt_deg=np.full(3, 60.0),
                occluded_ids=[],
                focal_px=376.0,
            )
            crowd_map.integrate_observations([observation], second * SECOND_NS)
            zones = engine.step(second * SECOND_NS)
        assert (crowd_map.probability(60 * SECOND_NS) < threshold).all()
        return zones

    assert [zone.cell_count for zone in zones_after(0.08)] == [3]
    assert len(zones_after(0.0)) == 0


def test_crowd_of_a_late_view_is_closed_as_if_it_had_come_in_time() -> None:
    """A link was down for half a minute: what it brings is forgotten, but nobody has looked since."""
    terrain = Terrain.from_occupancy(np.ones((6, 1, 1), bool), 1.0)
    crowd = ("uav1", 0, np.arange(3), 0.99)
    elsewhere = [("uav2", second * SECOND_NS, np.arange(3, 6), 0.0) for second in range(1, 31)]

    def zones_after(looks: list[tuple[str, int, NDArray[np.int64], float]]) -> ZoneSet:
        crowd_map = CrowdMap(terrain, EvidenceConfig(memory_s=5.0).fusion_method(terrain, drones=2))
        engine = ZoneEngine(crowd_map, ZoneConfig(min_area_m2=0.0).rules(crowd_map.method.default_threshold))
        newest_ns = 0
        for drone, stamp_ns, seen, mean in looks:
            newest_ns = max(newest_ns, stamp_ns)
            look(crowd_map, drone, stamp_ns, seen, mean)
            zones = engine.step(newest_ns)
        return zones

    (in_time,), (late,) = zones_after([crowd, *elsewhere]), zones_after([*elsewhere, crowd])
    assert (late.cell_count, late.reason, late.last_seen_ns) == (3, "not_looked_at", 0)
    assert late.polygon.equals(in_time.polygon)


def test_a_drone_whose_views_always_come_late_opens_ground_as_if_they_came_in_time() -> None:
    """One drone shows a crowd and leaves. A second one, 1.5 s behind because of its link, sees nobody there,
    while the first looks elsewhere: each of its looks is older than the newest instant."""
    terrain = Terrain.from_occupancy(np.ones((6, 1, 1), bool), 1.0)
    crowd_map = CrowdMap(terrain, EvidenceConfig().fusion_method(terrain, drones=2))
    engine = ZoneEngine(crowd_map, ZoneConfig(min_area_m2=0.0).rules(crowd_map.method.default_threshold))
    closed = {}
    for half_second in range(80):
        stamp_ns = half_second * SECOND_NS // 2
        here = half_second < 4
        look(crowd_map, "uav1", stamp_ns, np.arange(3) if here else np.arange(3, 6), 0.99 if here else 0.0)
        engine.step(stamp_ns)
        if half_second >= 40:
            look(crowd_map, "uav2", stamp_ns - 3 * SECOND_NS // 2, np.arange(3), 0.0)
            engine.restore(engine.to_bytes())  # as a service that was started again goes on
        closed[half_second] = sum(zone.cell_count for zone in engine.step(stamp_ns))
    assert closed[3] == closed[39] == 3  # nobody has looked again
    assert closed[50] == closed[79] == 0


def test_a_state_of_a_build_that_kept_when_it_stepped_is_gone_on_from() -> None:
    """In place of when each voxel was last looked at: what was seen after that step is new."""
    terrain = Terrain.from_occupancy(np.ones((6, 1, 1), bool), 1.0)
    crowd_map = CrowdMap(terrain, EvidenceConfig().fusion_method(terrain, drones=1))
    rules = ZoneConfig(min_area_m2=0.0).rules(crowd_map.method.default_threshold)
    engine = ZoneEngine(crowd_map, rules)
    look(crowd_map, "uav1", 0, np.arange(3), 0.99)
    engine.step(60 * SECOND_NS)
    with np.load(io.BytesIO(engine.to_bytes())) as state:
        arrays = dict(state)
    del arrays["closed_looked_ns"]
    kept = {**json.loads(arrays["told"].tobytes()), "stepped_ns": 60 * SECOND_NS}
    file = io.BytesIO()
    np.savez(file, **{**arrays, "told": np.frombuffer(json.dumps(kept).encode(), np.uint8)})
    later = ZoneEngine(crowd_map, rules)
    later.restore(file.getvalue())
    assert [zone.cell_count for zone in later.step(61 * SECOND_NS)] == [3]
    look(crowd_map, "uav1", 62 * SECOND_NS, np.arange(3), 0.0)
    assert len(later.step(62 * SECOND_NS)) == 0


@pytest.mark.parametrize("late", [False, True])
def test_a_clear_look_is_not_outweighed_for_having_come_late(late: bool) -> None:
    """A drone clearly shows a crowd, and half a second later two that are blind see nobody. Whether the link
    of the first was down for a minute or not, nobody has looked since: its ground is closed, not empty."""
    terrain = Terrain.from_occupancy(np.ones((3, 1, 1), bool), 1.0)
    crowd_map = CrowdMap(terrain, EvidenceConfig().fusion_method(terrain, drones=3))
    engine = ZoneEngine(crowd_map, ZoneConfig(min_area_m2=0.0).rules(crowd_map.method.default_threshold))
    half_ns = SECOND_NS // 2
    views = [("near1", 0, 0.0), ("near2", 0, 0.0), ("clear", half_ns, 0.99)]
    views += [("near1", 2 * half_ns, 0.0), ("near2", 2 * half_ns, 0.0), ("", 60 * SECOND_NS, 0.0)]
    newest_ns = 0
    for drone, stamp_ns, mean in sorted(views, key=lambda view: late and view[0] == "clear"):
        if drone:
            look(crowd_map, drone, stamp_ns, np.arange(3), mean)
        else:
            crowd_map.integrate_observations([], stamp_ns)  # a minute later
        newest_ns = max(newest_ns, stamp_ns)
        zones = engine.step(newest_ns)
    assert len(crowd_map.crowd_ids_at_last_looks()) == 0
    assert [zone.cell_count for zone in zones] == [3]
    for now_ns in (60 * SECOND_NS, 600 * SECOND_NS):
        assert (crowd_map.state(now_ns, stale_after_s=100.0) == VoxelState.NOT_CLEARED).all()
    look(crowd_map, "near1", 62 * SECOND_NS, np.arange(3), 0.0)
    assert len(engine.step(62 * SECOND_NS)) == 0
    assert (crowd_map.state(63 * SECOND_NS) == VoxelState.EMPTY).all()


def test_a_drone_that_sees_nobody_does_not_open_at_once_what_another_shows() -> None:
    """The nearer drone is blind from the first instant on, and weighs more. What the other shows is closed
    all the same, and for 2 s after its last look; then the blind one is believed."""
    terrain = Terrain.from_occupancy(np.ones((3, 1, 1), bool), 1.0)
    crowd_map = CrowdMap(terrain, EvidenceConfig().fusion_method(terrain, drones=2))
    threshold = crowd_map.method.default_threshold
    engine = ZoneEngine(crowd_map, ZoneConfig(min_area_m2=0.0).rules(threshold))

    def seen(drone: str, stamp_ns: int, mean: float, range_m: float) -> Observation:
        return Observation(
            terrain,
            drone,
            stamp_ns,
            voxel_ids=np.arange(3),
            mean=np.full(3, mean),
            pixel_count=np.ones(3, dtype=int),
            range_m=np.full(3, range_m),
            tilt_deg=np.full(3, 45.0),
            occluded_ids=[],
            focal_px=376.0,
        )

    closed = {}
    for number in range(18):
        stamp_ns = number * SECOND_NS // 2
        views = [seen("near", stamp_ns, 0.0, 20.0)]
        if 2 <= number <= 10:  # from 1 to 5 s
            views.append(seen("far", stamp_ns, 0.95, 75.0))
        crowd_map.integrate_observations(views, stamp_ns)
        zones = engine.step(stamp_ns, views)
        engine.restore(engine.to_bytes())  # as a service that was started again goes on
        assert (crowd_map.probability(stamp_ns) < threshold).all()
        closed[stamp_ns / SECOND_NS] = [zone.reason for zone in zones]
        assert not zones or not (crowd_map.state(stamp_ns) == VoxelState.EMPTY).any()
    assert closed == {
        second: ["seen"] if 1.0 <= second <= 5.0 else ["held"] if 5.0 < second <= 7.0 else []
        for second in np.arange(18) / 2
    }


def test_two_looks_in_a_row_open_ground_where_two_are_asked_for() -> None:
    terrain = Terrain.from_occupancy(np.ones((3, 1, 1), bool), 1.0)
    crowd_map = CrowdMap(terrain, EvidenceConfig(memory_s=0.5).fusion_method(terrain, drones=1))
    rules = dataclasses.replace(
        ZoneConfig(min_area_m2=0.0).rules(crowd_map.method.default_threshold), opening_looks=2
    )
    engine = ZoneEngine(crowd_map, rules)
    seconds = iter(range(0, 600, 60))  # so far apart that each look stands alone

    def closed_after(mean: float | None) -> int:
        stamp_ns = next(seconds) * SECOND_NS
        if mean is not None:
            look(crowd_map, "uav1", stamp_ns, np.arange(3), mean)
        zones = engine.step(stamp_ns)
        engine.restore(engine.to_bytes())  # as a service that was started again goes on
        return sum(zone.cell_count for zone in zones)

    # Crowd; a look that finds none; crowd again; nobody looks; none twice.
    assert [closed_after(mean) for mean in (0.95, 0.0, 0.95, 0.0, None, 0.0)] == [3, 3, 3, 3, 3, 0]
    with pytest.raises(ValueError, match="opening_looks is 0; it must be at least 1"):
        dataclasses.replace(rules, opening_looks=0)


def test_ground_stays_closed_between_the_two_thresholds() -> None:
    zones = DrawnZones((4, 1), off_threshold=0.3)
    assert [zone.cell_count for zone in zones.drawn("##..")] == [2]
    held = zones.drawn("++++")  # 0.4: above the lower threshold, below the upper one
    assert [(zone.id, zone.cell_count, zone.reason) for zone in held] == [("Z1", 2, "held")]
    assert len(zones.drawn("....")) == 0
    assert len(zones.drawn("++++")) == 0  # nothing begins there


def test_small_regions_are_counted_and_a_zone_ends_at_half_the_area() -> None:
    zones = DrawnZones((9, 1), min_area_m2=4.0)
    small = zones.drawn("###......")
    assert (len(small), small.dropped_count, small.dropped_area_m2) == (0, 1, 3.0)
    assert ids(zones.drawn("####.....")) == ["Z1"]
    shrunk = zones.drawn("##.....##")
    assert ids(shrunk) == ["Z1"] and (shrunk.dropped_count, shrunk.dropped_area_m2) == (1, 2.0)
    gone = zones.drawn("#........")
    assert told(gone) == [("expired", "Z1")] and gone.dropped_area_m2 == 1.0


def test_a_crowd_that_walks_stays_a_zone_down_to_half_of_the_least_area() -> None:
    """As one that stands does: it walks 4 m between two looks, closer together than before, and shares no
    ground with its zone. 4 m further on its zone has ended, and what appears there is a small region."""
    zones = DrawnZones((14, 2), min_area_m2=4.0)
    steps = [
        zones.drawn(picture)
        for picture in (
            "##............\n##............",
            ".....##.......\n..............",
            ".....#........\n..............",
            ".........##...\n..............",
        )
    ]
    assert [ids(step) for step in steps] == [["Z1"], ["Z1"], [], []]
    assert [step.dropped_area_m2 for step in steps] == [0.0, 0.0, 1.0, 2.0]
    assert told(steps[1]) == [("updated", "Z1")]


def test_ground_in_several_zones_is_closed_once() -> None:
    """Two columns with two between them, and 3 m around each: 1 + 4 * 3 + pi 3^2 m2, in part the same."""
    assert ZoneSet((), 0.5, 0.0, 0, 0.0).closed_m2 == 0.0
    zones = DrawnZones((9, 7), buffer_m=3.0).drawn("""
        .........
        .........
        .........
        ...#..#..
        .........
        .........
        .........""")
    one, other = (shapely.box(x, 3, x + 1, 4).buffer(3.0, 64) for x in (3, 6))
    assert len(zones) == 2
    assert zones.closed_m2 == pytest.approx((one | other).area, rel=0.03)
    assert zones.closed_m2 < 0.8 * sum(zone.polygon.area for zone in zones)


@given(
    seen=hnp.arrays(bool, (7, 9)),
    crowd=hnp.arrays(bool, (7, 9)),
    static=st.sampled_from([None, (2.5, 1.5, 12.0, 3.0), (20.0, 20.0, 21.0, 22.0)]),
    buffer_m=st.sampled_from([0.0, 1.5]),
)
def test_ground_that_is_closed_for_several_reasons_counts_once(
    seen: NDArray[np.bool_],
    crowd: NDArray[np.bool_],
    static: tuple[float, float, float, float] | None,
    buffer_m: float,
) -> None:
    """Crowd, 1.5 m around it, ground that nobody knows, and a zone of somebody else."""
    probability = np.where(seen, np.where(crowd, 1.0, 0.0), np.nan)
    step = DrawnZones((7, 9), buffer_m=buffer_m, close_unseen=True).step(probability)
    if static is not None:
        theirs = Zone.of_no_look("S1", shapely.box(*static), "static", "given")
        step = dataclasses.replace(step, static=(theirs,))
    together = shapely.union_all([zone.polygon for zone in step.closed])
    assert step.closed_m2 == pytest.approx(together.area, rel=1e-9, abs=1e-9)


def test_thousands_of_zones_of_others_are_put_together_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """At every instant it took a third of a second, and the map of a live service fell behind the fleet."""
    theirs = tuple(
        Zone.of_no_look(f"S{number}", shapely.box(3 * number, 0, 3 * number + 2, 2), "static", "given")
        for number in range(3000)
    )
    given: list[int] = []
    together = shapely.disjoint_subset_union_all

    def counted(outlines: list[shapely.Polygon]) -> shapely.Geometry:
        given.append(len(outlines))
        return together(outlines)

    monkeypatch.setattr(shapely, "disjoint_subset_union_all", counted)
    for east in range(3):  # crowd 1 m beside a zone, over one, and over two
        crowd = Zone.of_no_look("Z1", shapely.box(2 + east, 0, 3 + east, 2), "static", "given")
        step = ZoneSet((crowd,), 0.5, 0.0, 0, 0.0, static=(*theirs,))
        assert step.closed_m2 == pytest.approx(12000.0 + (2.0 if east == 0 else 0.0))
    assert given.count(3000) == 1


def test_holes_are_filled_up_to_an_area() -> None:
    ring = np.ones((5, 4))
    ring[1:4, 1] = 0.0
    for limit, area in ((0.0, 17.0), (2.9, 17.0), (3.0, 20.0), (np.inf, 20.0)):
        (zone,) = DrawnZones((5, 4), max_hole_m2=limit).step(ring)
        assert zone.polygon.area == area and zone.area_m2 == 17.0
        assert (zone.crowd_outline is None) == (area == 17.0)


def test_a_zone_that_jumps_a_step_of_motion_keeps_its_id_and_one_far_away_does_not() -> None:
    zones = DrawnZones((30, 1))
    zones.step(np.eye(30)[[2]].T)
    assert ids(zones.step(np.eye(30)[[7]].T)) == ["Z1"]
    assert told(zones.step(np.eye(30)[[13]].T)) == [("expired", "Z1"), ("created", "Z2")]


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32 - 1), speed=st.floats(0.0, 1.5))
def test_ids_survive_slow_motion(seed: int, speed: float) -> None:
    """Crowds of 3 to 6 m that walk, less than their own width a second, in lanes of their own."""
    rng = np.random.default_rng(seed)
    lanes = 3
    size, start = rng.integers(3, 7, lanes), rng.uniform(0.0, 10.0, lanes)
    direction = rng.choice([-1.0, 1.0], lanes)
    zones = DrawnZones((60, lanes * 10))
    at = np.where(direction > 0, start, 50.0 - start)
    for second in range(20):
        crowd = np.zeros((60, lanes * 10))
        for lane in range(lanes):
            west = round(at[lane] + direction[lane] * speed * second)
            crowd[max(west, 0) : west + size[lane], lane * 10 : lane * 10 + 4] = 1.0
        step = zones.step(crowd)
        by_lane = {int(zone.polygon.bounds[1]) // 10: zone.id for zone in step}
        if second == 0:
            first = by_lane
        assert by_lane == first
        assert all(event.kind == "updated" for event in step.events) or second == 0


RULES = st.builds(
    dict,
    off_threshold=st.sampled_from([None, 0.3]),
    max_hole_m2=st.sampled_from([0.0, 3.0, np.inf]),
    buffer_m=st.sampled_from([0.0, 0.3, 2.5]),
    simplify_m=st.sampled_from([0.0, 0.8, 4.0]),
    max_vertices=st.sampled_from([None, 3, 4, 7, 20]),
    close_unseen=st.booleans(),
)


@settings(max_examples=150)
@given(
    maps=st.lists(hnp.arrays(float, (9, 8), elements=st.sampled_from([0.0, 0.4, 0.7, np.nan])), max_size=4),
    rules=RULES,
)
def test_zones_always_cover_every_voxel_above_the_threshold(
    maps: list[NDArray[np.float64]], rules: dict[str, object]
) -> None:
    zones = DrawnZones((9, 8), **rules)
    held = np.zeros((9, 8), bool)
    seen = np.zeros((9, 8), bool)
    for probability in maps:
        step = zones.step(probability)
        now = zones.probability()
        held = (now >= 0.5) | (held & (now >= (rules["off_threshold"] or 0.5)))
        seen |= ~np.isnan(probability)
        inside = cells_inside(step, (9, 8))
        assert inside[held].all()
        if rules["close_unseen"]:
            assert inside[~seen].all()
        elif not rules["buffer_m"] and not rules["simplify_m"] and rules["max_vertices"] is None:
            filled = ndimage.binary_fill_holes(held) if rules["max_hole_m2"] == np.inf else None
            if filled is not None:
                np.testing.assert_array_equal(inside & filled, inside)
            elif rules["max_hole_m2"] == 0.0:
                np.testing.assert_array_equal(inside, held)
        assert len({zone.id for zone in step.closed}) == len(step.closed)
        assert all(zone.polygon.is_valid and len(zone.id) <= 7 for zone in step.closed)


def decaying(decay: float, unit: str = "second") -> CrowdMap:
    method = Paper(Rates(0.9, 0.05), 0.2, alpha=1.0, decay=decay, decay_unit=unit, fleet_size=1)
    return CrowdMap(PLAIN, method)


def test_a_zone_expires_when_it_said_it_would() -> None:
    crowd_map = decaying(0.1)
    ground = PLAIN.voxel_ids([(i, j, 0) for i in range(4) for j in range(4)])
    look(crowd_map, "uav1", 5 * SECOND_NS, ground, np.linspace(0.8, 1.0, 16))
    engine = ZoneEngine(crowd_map, ZoneConfig(threshold=0.3, min_area_m2=0.0).rules(0.5))
    (zone,) = engine.step(5 * SECOND_NS)
    until_ns = zone.valid_until_ns
    # Equation 3 by hand: exp(-0.1 t) takes the largest P to the threshold.
    assert until_ns == pytest.approx((5 + np.log(zone.probability_max / 0.3) / 0.1) * SECOND_NS, abs=100)
    assert len(find_zones(crowd_map, until_ns - 1000, threshold=0.3)) == 1
    assert len(find_zones(crowd_map, until_ns, threshold=0.3)) == 0
    (later,) = engine.step(until_ns - 1000)
    assert later.valid_until_ns == pytest.approx(until_ns, abs=100)  # told again, not put off
    assert told(engine.step(until_ns)) == [("expired", "Z1")]


@pytest.mark.parametrize("crowd_map", [decaying(0.0), decaying(0.1, "frame"), CrowdMap(PLAIN, Or())])
def test_what_never_decays_or_nobody_knows_when_has_no_expiry(crowd_map: CrowdMap) -> None:
    look(crowd_map, "uav1", 0, np.arange(9), 1.0)
    (zone, *_) = ZoneEngine(crowd_map, ZoneConfig(threshold=0.3, min_area_m2=0.0).rules(0.5)).step(0)
    assert zone.valid_until_ns is None


def observation(drone: str, stamp_ns: int, ids: list[int], mean: float, range_m: float) -> Observation:
    count = len(ids)
    return Observation(
        PLAIN,
        drone,
        stamp_ns,
        voxel_ids=ids,
        mean=np.full(count, mean),
        pixel_count=np.ones(count, int),
        range_m=np.full(count, range_m),
        tilt_deg=np.full(count, 60.0),
        occluded_ids=[],
    )


def test_a_zone_tells_who_showed_what_and_why_it_is_still_closed() -> None:
    crowd_map = CrowdMap(PLAIN, Paper(Rates(0.9, 0.05), 0.2, alpha=1.0, fleet_size=2))
    engine = ZoneEngine(crowd_map, ZoneConfig(threshold=0.002, min_area_m2=0.0).rules(0.5))
    ids = sorted(PLAIN.voxel_ids([(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]).tolist())

    def step(second: int, *views: Observation) -> ZoneSet:
        crowd_map.integrate_observations(list(views), second * SECOND_NS)
        return engine.step(second * SECOND_NS, views)

    (zone,) = step(1, observation("bravo", SECOND_NS, ids, 0.9, 40.0))
    (look,) = zone.evidence
    assert zone.reason == "seen"
    assert dataclasses.astuple(look) == ("bravo", SECOND_NS, 0.9, 1.0, 40.0, 1)
    # A second look at half of it: 0.4 is no crowd, yet P = 0.2 * 0.0256 / 2 by hand is above the threshold.
    half = [ids[0], ids[1]]
    (zone,) = step(2, observation("bravo", 2 * SECOND_NS, half, 0.4, 30.0))
    (look,) = zone.evidence
    assert zone.reason == "not_cleared"
    assert dataclasses.astuple(look) == ("bravo", 2 * SECOND_NS, 0.4, 0.5, 30.0, 2)
    far = PLAIN.voxel_ids([(20, 20, 0)]).tolist()
    zone = step(3, observation("alpha", 3 * SECOND_NS, far, 0.0, 70.0))[0]
    assert zone.reason == "not_looked_at" and [look.drone for look in zone.evidence] == ["bravo"]


def test_the_last_look_of_a_drone_is_not_one_that_came_late() -> None:
    """A view of 8 s reaches the zones after that of 10 s: it is one look more, and not the last one."""
    crowd_map = CrowdMap(PLAIN, EvidenceConfig().fusion_method(PLAIN, drones=1))
    engine = ZoneEngine(crowd_map, ZoneConfig(min_area_m2=0.0).rules(crowd_map.method.default_threshold))
    ids = sorted(PLAIN.voxel_ids([(0, 0, 0), (1, 0, 0)]).tolist())
    for second, mean in ((10, 0.95), (8, 0.9)):
        view = observation("a", second * SECOND_NS, ids, mean, 20.0)
        crowd_map.integrate_observations([view], second * SECOND_NS)
        (zone,) = engine.step(10 * SECOND_NS, [view])
    (look,) = zone.evidence
    assert dataclasses.astuple(look) == ("a", 10 * SECOND_NS, 0.95, 1.0, 20.0, 2)
    assert zone.reason == "seen"


def test_zones_that_merge_keep_what_was_seen_of_both() -> None:
    crowd_map = CrowdMap(PLAIN, Or())
    engine = ZoneEngine(crowd_map, ZoneConfig(min_area_m2=0.0).rules(0.5))
    near, far = (PLAIN.voxel_ids([(i, 0, 0)]).tolist() for i in (0, 8))
    both = [observation("a", 0, near, 1.0, 10.0), observation("b", 0, far, 1.0, 20.0)]
    crowd_map.integrate_observations(both, 0)
    assert [[look.drone for look in zone.evidence] for zone in engine.step(0, both)] == [["a"], ["b"]]
    between = sorted(PLAIN.voxel_ids([(i, 0, 0) for i in range(1, 8)]).tolist())
    bridge = [observation("c", 1, between, 1.0, 30.0)]
    crowd_map.integrate_observations(bridge, 1)
    (zone,) = engine.step(1, bridge)
    assert [(look.drone, look.range_m) for look in zone.evidence] == [("a", 10.0), ("b", 20.0), ("c", 30.0)]


@pytest.mark.parametrize(
    ("memory_s", "knows_when"), [(5.0, True), (1e6, True), (1e10, False), (1e12, False), (1e300, False)]
)
def test_crowd_is_forgotten_later_than_it_was_seen_or_nobody_knows_when(
    memory_s: float, knows_when: bool
) -> None:
    """1e10 s are 317 years, and a stamp in nanoseconds ends in 2262."""
    seen_ns = 1_760_000_000 * SECOND_NS
    terrain = Terrain.from_occupancy(np.ones((3, 1, 1), bool), 1.0)
    crowd_map = CrowdMap(terrain, EvidenceConfig(memory_s=memory_s).fusion_method(terrain, 1))
    engine = ZoneEngine(crowd_map, ZoneConfig(min_area_m2=0.0).rules(crowd_map.default_threshold()))
    look(crowd_map, "uav1", seen_ns, np.arange(3), 0.95)
    (zone,) = engine.step(seen_ns)
    assert (zone.forgotten_ns is not None) == knows_when
    assert zone.forgotten_ns is None or seen_ns < zone.forgotten_ns < 2 * seen_ns


def test_crowd_that_stays_above_an_off_threshold_below_the_prior_is_never_forgotten() -> None:
    """What nobody looks at returns to the prior, .015, and no further."""
    terrain = Terrain.from_occupancy(np.ones((3, 1, 1), bool), 1.0)
    crowd_map = CrowdMap(terrain, EvidenceConfig(prior=0.015).fusion_method(terrain, 1))
    for off_threshold, is_forgotten in [(0.02, True), (0.015, False), (0.01, False)]:
        config = ZoneConfig(off_threshold=off_threshold, min_area_m2=0.0)
        engine = ZoneEngine(crowd_map, config.rules(crowd_map.default_threshold()))
        look(crowd_map, "uav1", 0, np.arange(3), 0.95)
        (zone,) = engine.step(0)
        assert (zone.forgotten_ns is not None) == is_forgotten


def test_unseen_ground_is_closed_by_option_and_opens_nothing() -> None:
    probability = np.full((6, 5), np.nan)
    probability[:4, :3] = 0.0
    probability[1, 1] = 1.0
    zones = DrawnZones((6, 5), close_unseen=True, stale_after_s=10.0)
    step = zones.step(probability)
    (crowd,), (unseen,) = step.zones, step.unseen
    assert crowd.polygon.equals(shapely.box(1, 1, 2, 2))
    assert unseen.polygon.area == 30 - 12 and unseen.kind == "unseen" and unseen.id == "UNSEEN"
    assert unseen.reason == "never_cleared" and step.area_m2 == 1.0
    # 11 s later everything but the crowd is stale.
    later = zones.engine.step(zones.stamp_ns + 11 * SECOND_NS)
    assert sum(zone.polygon.area for zone in later.unseen) == 29.0
    assert ids(later) == ["Z1"] and ids(later.unseen) == ["UNSEEN"]


def test_crowd_too_small_for_a_zone_is_closed_as_ground_that_is_not_known_to_be_empty() -> None:
    zones = DrawnZones((7, 3), min_area_m2=3.0, close_unseen=True)
    picture = """
        .......
        .#.....
        ......."""
    step = zones.drawn(picture)
    assert step.dropped_count == 1 and step.dropped_area_m2 == 1.0 and not step.zones
    (unseen,) = step.unseen
    assert unseen.polygon.equals(shapely.box(1, 1, 2, 2)) and unseen.area_m2 == 1.0
    assert zones.drawn(picture.replace("#", ".")).unseen == ()


def test_crowd_that_a_lower_threshold_keeps_is_closed_as_well_where_it_is_too_small() -> None:
    zones = DrawnZones((7, 3), min_area_m2=3.0, off_threshold=0.3, close_unseen=True)
    zones.step(drawing("......#\n.......\n......."))
    held = zones.step(drawing("......+\n.......\n......."))  # 0.4: above the threshold that opens
    assert [one.polygon.bounds for one in held.unseen] == [(6.0, 2.0, 7.0, 3.0)]


def test_what_the_map_calls_crowd_is_closed_by_a_zone_or_as_ground_that_is_not_known() -> None:
    """Six columns are seen empty, and then by nobody: ten minutes later they are at the prior, .1. That is
    crowd by a threshold of .08, though nobody saw any."""
    terrain = Terrain.from_occupancy(np.ones((6, 1, 1), bool), 1.0)
    crowd_map = CrowdMap(terrain, EvidenceConfig(prior=0.1).fusion_method(terrain, drones=1))
    look(crowd_map, "uav1", 0, np.arange(6), 0.0)
    ground, columns = UnseenGround(terrain), column_keys(np.argwhere(np.ones((6, 1))))

    def unknown(second: int, in_zones: NDArray[np.int64]) -> list[int]:
        runs = ground.at(crowd_map, second * SECOND_NS, 0.08, 30.0, in_zones, nowhere)
        return np.repeat(runs.i, runs.length).tolist()

    nowhere, east = columns[:0], columns[4:]
    assert unknown(0, nowhere) == []
    assert (crowd_map.state(600 * SECOND_NS, threshold=0.08) == VoxelState.CROWD).all()
    assert unknown(600, nowhere) == [0, 1, 2, 3, 4, 5]
    assert unknown(600, east) == [0, 1, 2, 3]
    assert unknown(600, columns) == []


@settings(max_examples=200)
@given(data=st.data())
def test_what_is_unknown_is_what_the_states_of_its_places_say(data: st.DataObject) -> None:
    """Roofs over ground, holes, crowd on either, in a zone or not: column by column, place by place."""
    coordinate = st.integers(-2, 4)
    places = sorted(data.draw(st.sets(st.tuples(coordinate, coordinate, st.integers(0, 3)), min_size=1)))
    value = st.sampled_from([np.nan, 0.0, 0.0, 1.0])
    crowd_map = crowd_map_of(places, np.array([data.draw(value) for _ in places]))
    columns = sorted({place[:2] for place in places})
    in_zones, in_no_zone = (sorted(data.draw(st.sets(st.sampled_from(columns)))) for _ in range(2))

    def keys(of: list[tuple[int, int]]) -> NDArray[np.int64]:
        return column_keys(np.array(of, np.int64).reshape(-1, 2))

    unseen = UnseenGround(crowd_map.terrain)
    runs = unseen.at(crowd_map, 0, 0.5, 30.0, keys(in_zones), keys(in_no_zone))

    state = crowd_map.state(0, threshold=0.5)[crowd_map.terrain.voxel_ids(places)]
    expected = set(in_no_zone)
    for (i, j, k), one in zip(places, state, strict=True):
        if (i, j, k + 1) in places:
            continue  # nobody can stand there
        if one == VoxelState.CROWD and (i, j) not in in_zones:
            expected.add((i, j))
        if one not in (VoxelState.CROWD, VoxelState.EMPTY):
            expected.add((i, j))
    ground = np.zeros((7, 7), np.bool_)
    ground[tuple(np.array(columns).T + 2)] = True
    expected |= {(i - 2, j - 2) for i, j in np.argwhere(ndimage.binary_fill_holes(ground) & ~ground)}

    found = [
        (i, j)
        for i, south, north in zip(runs.i, runs.south, runs.north, strict=True)
        for j in range(south, north)
    ]
    assert found == sorted(expected)
    assert all(
        (i, north) not in expected and (i, south - 1) not in expected
        for i, south, north in zip(runs.i, runs.south, runs.north, strict=True)
    ), "runs go on as far as the unknown does"


@pytest.mark.parametrize("close_unseen", [False, True])
def test_a_threshold_that_ground_reaches_by_being_forgotten_is_refused(close_unseen: bool) -> None:
    def engine(config: EvidenceConfig, threshold: float | None) -> ZoneEngine:
        crowd_map = CrowdMap(PLAIN, config.fusion_method(PLAIN, drones=1))
        zones = ZoneConfig(threshold=threshold, close_unseen=close_unseen)
        return ZoneEngine(crowd_map, zones.rules(crowd_map.default_threshold()))

    for threshold in (0.08, 0.1):
        with pytest.raises(ValueError, match=f"threshold is {threshold:g}; it must be above the prior, 0.1,"):
            engine(EvidenceConfig(prior=0.1), threshold)
    # Nobody who gave no threshold looks for it.
    own = "^zone_log_odds must be above 0: .* must be above the prior, 0.015, which method evidence forgets"
    with pytest.raises(ValueError, match=own):
        engine(EvidenceConfig(zone_log_odds=-0.5), None)
    assert engine(EvidenceConfig(prior=0.1), 0.1001).rules.threshold == 0.1001
    # Methods that forget towards "free" reach no threshold by it.
    paper = CrowdMap(PLAIN, Paper(Rates(0.9, 0.02), 0.2, fleet_size=1))
    assert ZoneEngine(paper, ZoneConfig(threshold=0.1).rules(0.5)).rules.threshold == 0.1


def test_a_hole_of_the_map_is_not_known_to_be_empty_whatever_lies_around() -> None:
    places = [(i, j, 0) for i in range(7) for j in range(7) if (i, j) not in [(3, 3), (3, 4), (0, 5)]]
    hole = shapely.box(3, 3, 4, 5)  # (0, 5) is on the rim: outside, of which no zone speaks
    rules = ZoneConfig(threshold=0.5, close_unseen=True).rules(0.5)
    never, cleared = (
        ZoneEngine(crowd_map_of(places, np.full(46, probability)), rules).step(0)
        for probability in (np.nan, 0.0)
    )
    assert never.unseen[0].polygon.equals(shapely.box(0, 0, 7, 7) - shapely.box(0, 5, 1, 6))
    assert cleared.unseen[0].polygon.equals(hole) and cleared.unseen[0].area_m2 == 2.0


def test_nobody_knows_how_high_the_ground_lies_in_a_hole_of_the_map() -> None:
    """It may have been cut out around a tower, or be water: unseen ground with a hole has no known height."""
    places = [(i, j, 0) for i in range(7) for j in range(7)]
    rules = ZoneConfig(threshold=0.5, close_unseen=True).rules(0.5)
    for missing, known in ([], True), ([(0, 5)], True), ([(3, 3)], False):
        ground = [place for place in places if place[:2] not in missing]
        zones = ZoneEngine(crowd_map_of(ground, np.full(len(ground), np.nan)), rules).step(0)
        assert zones.unseen[0].ground_is_known == known
        above = ClearAir(zones).is_clear([(3.5, 3.5, 500.0)], 0)
        assert above.tolist() == [known]


def test_a_buffer_beyond_the_map_leaves_nobody_the_heights_of_all_its_ground() -> None:
    """2.5 m around one column: in the middle of the map, beyond its rim, and over its one hole at (12, 9)."""
    places = [(i, j, 300) for i in range(20) for j in range(20) if (i, j) != (12, 9)]

    def closed(crowd: tuple[int, int], **options: float) -> Zone:
        probability = np.array([float((i, j) == crowd) for i, j, _ in places])
        rules = ZoneConfig(threshold=0.5, min_area_m2=0.0, **options).rules(0.5)  # type: ignore[arg-type]
        (zone,) = ZoneEngine(crowd_map_of(places, probability), rules).step(0)
        assert (zone.lower_m, zone.upper_m) == (300.0, 301.0)
        return zone

    cases = {(5, 5): True, (3, 16): True, (2, 9): False, (9, 17): False, (8, 9): True, (9, 9): False}
    assert {crowd: closed(crowd, buffer_m=2.5).ground_is_known for crowd in cases} == cases
    # What is closed ends at the rim, or a hair beyond it for the sake of rounding.
    assert closed((0, 0)).ground_is_known and closed((19, 19), max_vertices=12).ground_is_known


@settings(max_examples=200)
@given(ground=hnp.arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9))).filter(np.any))
def test_holes_of_the_map_are_what_is_missing_inside_it(ground: NDArray[np.bool_]) -> None:
    i, j = np.nonzero(ground)
    places = np.column_stack([i, j, np.zeros(len(i), int)])
    rules = ZoneConfig(threshold=0.5, close_unseen=True).rules(0.5)
    closed = ZoneEngine(crowd_map_of(places, np.zeros(len(i))), rules).step(0)
    missing = ndimage.binary_fill_holes(ground) & ~ground  # four neighbours
    squares = shapely.union_all([shapely.box(x, y, x + 1, y + 1) for x, y in np.argwhere(missing)])
    assert shapely.union_all([zone.polygon for zone in closed.unseen]).equals(squares)


def test_the_same_instants_give_the_same_zones_to_the_bit() -> None:
    def history() -> list[tuple[object, ...]]:
        zones, rng = DrawnZones((20, 20), buffer_m=1.0, max_vertices=12), np.random.default_rng(9)
        steps = (
            zones.step((ndimage.gaussian_filter(rng.random((20, 20)), 1.5) * 2.0 - 0.5).clip(0.0, 1.0))
            for _ in range(6)
        )
        return [(told(step), [(zone.id, zone.polygon.wkb) for zone in step]) for step in steps]

    first = history()
    assert any(zones for _, zones in first) and first == history()


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("off_threshold", 0.6, "off_threshold is 0.6; it must be at most the threshold, 0.5"),
        ("off_threshold", 0.0, "off_threshold is 0"),
        ("buffer_m", -1.0, "buffer_m is -1; it must be finite and >= 0"),
        ("buffer_m", 1e9, "buffer_m is 1e+09; it must be at most 100000 m"),
        ("simplify_m", np.inf, "simplify_m is inf"),
        ("max_hole_m2", -1.0, "max_hole_m2 is -1"),
        ("max_vertices", 2, "max_vertices is 2; it must be at least 3"),
        ("upper_m", -5.0, "band 0 to -5 m must be finite, lower before upper"),
        ("restriction", "forbidden", "restriction 'forbidden' is neither"),
    ],
)
def test_rules_out_of_bounds_are_refused(field: str, value: object, message: str) -> None:
    with pytest.raises(ValueError) as refused:
        ZoneConfig(threshold=0.5, **{field: value})  # type: ignore[arg-type]
        ZoneConfig(**{field: value}).rules(0.5)  # type: ignore[arg-type]
    assert message in str(refused.value)


def test_ten_thousand_zones_at_once() -> None:
    crowd = np.zeros((300, 300))
    crowd[::3, ::3] = 1.0  # zones of one voxel
    zones = DrawnZones((300, 300))
    first = zones.step(crowd, evidence_of="uav1")
    again = zones.step(crowd, evidence_of="uav1")
    assert len(first) == len({zone.id for zone in first}) == 10_000
    assert max(len(zone.id) for zone in first) == 4  # "Z7PS"
    assert ids(again) == ids(first) and told(again) == []
    assert all(zone.area_m2 == 1.0 and zone.evidence[0].looks == 2 for zone in again)


class EverythingRead:
    """Which voxels are closed, from every voxel of the map at every instant. What a voxel was at its last
    look is read from maps that end there; what a look spoke for, from the map just before it."""

    def __init__(
        self, terrain: Terrain, method: Evidence | Paper | Or, closes: float, stays: float, looks: int
    ) -> None:
        self._terrain, self._method = terrain, method
        self._closes, self._stays, self._looks = closes, stays, looks
        self._map = CrowdMap(terrain, method)
        self._given: list[tuple[str, int, NDArray[np.int64], NDArray[np.float64]]] = []
        self._shown_ns = np.full(terrain.voxel_count, -(10**18))
        self._spoke_for_crowd = np.zeros(terrain.voxel_count, dtype=bool)
        self._below = np.zeros(terrain.voxel_count, dtype=np.int64)
        self._looked_ns = np.full(terrain.voxel_count, -1)
        self.closed = np.zeros(terrain.voxel_count, dtype=bool)

    def look(self, drone: str, stamp_ns: int, seen: NDArray[np.int64], mean: NDArray[np.float64]) -> None:
        before, was_seen = CrowdMap.from_bytes(self._map.to_bytes(), self._terrain), self._map.seen()
        look(self._map, drone, stamp_ns, seen, mean)
        self._given.append((drone, stamp_ns, seen, mean))
        assert self._map.span_ns is not None
        _, now_ns = self._map.span_ns
        after = self._map.probability(now_ns)
        more = ~was_seen | (after > before.probability(now_ns))
        prior = self._method.parameters.get("prior", 0.0)
        self._spoke_for_crowd[seen] = (more & (after > prior))[seen]
        if self._method.name == "evidence":
            alone = CrowdMap(self._terrain, self._method)
            look(alone, drone, stamp_ns, seen, mean)
            odds = alone.probability(stamp_ns) / (1.0 - alone.probability(stamp_ns))
            shown = seen[odds[seen] >= np.exp(2.0) * self._closes / (1.0 - self._closes)]
            self._shown_ns[shown] = np.maximum(self._shown_ns[shown], stamp_ns)

    def _at_last_looks(self) -> NDArray[np.float64]:
        last_ns = self._map.last_seen_ns()
        probability = np.full(self._terrain.voxel_count, -1.0)
        for end_ns in np.unique(last_ns[last_ns >= 0]).tolist():
            until_then = CrowdMap(self._terrain, self._method)
            for one in sorted(self._given, key=lambda one: one[1]):
                if one[1] <= end_ns:
                    look(until_then, *one)
            ends_there = last_ns == end_ns
            probability[ends_there] = until_then.probability(end_ns)[ends_there]
        return probability

    def step(self, stamp_ns: int) -> None:
        now = self._map.probability(stamp_ns)
        if self._method.name == "evidence":
            at_last_look = self._at_last_looks()
            crowd, is_below = at_last_look >= self._closes, at_last_look < self._stays
            last_ns = self._map.last_seen_ns()
            crowd |= last_ns - self._shown_ns <= 2 * SECOND_NS
            is_below &= ~self._spoke_for_crowd
            looked, self._looked_ns = last_ns > self._looked_ns, last_ns
            self._below[looked] = np.where(is_below, self._below + 1, 0)[looked]
            now_known = self._map.knowledge(np.arange(len(looked)), stamp_ns).looks
            enough = np.nan_to_num(now_known) >= self._method.parameters["doubt"]
            opens = looked & enough & (self._below >= self._looks)
        else:
            crowd, opens = now >= self._closes, now < self._stays
        self.closed = (crowd & self._map.seen()) | (self.closed & ~opens)
        self._below[crowd | ~self.closed] = 0


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    name=st.sampled_from(["evidence", "paper", "or"]),
    low=st.sampled_from([1.0, 0.6, 0.1]),
    looks=st.sampled_from([1, 2, 3]),
)
def test_what_changed_gives_the_zones_of_everything(seed: int, name: str, low: float, looks: int) -> None:
    """Over any history: looks anywhere, late ones too, times without a look, ground that is forgotten. At
    each instant an engine on a map that was read from bytes, which knows nothing of what was read before,
    makes the same zones, and every voxel is judged as a scan of all voxels judges it."""
    rng = np.random.default_rng(seed)
    occupied = np.ones((40, 40, 2), bool)
    occupied[rng.random((40, 40)) < 0.7, 1] = False
    terrain = Terrain.from_occupancy(occupied, 1.0)
    method = {
        "evidence": EvidenceConfig(memory_s=4.0).fusion_method(terrain, drones=2),
        "paper": Paper(Rates(0.9, 0.1), 0.2, alpha=0.7, decay=0.1, fleet_size=2),
        "or": Or(b_threshold=0.5),
    }[name]
    crowd_map = CrowdMap(terrain, method)
    threshold = method.default_threshold
    config = ZoneConfig(off_threshold=low * threshold, opening_looks=looks, min_area_m2=2.0, buffer_m=1.0)
    rules = config.rules(threshold)
    engine = ZoneEngine(crowd_map, rules)
    slow = EverythingRead(terrain, method, threshold, low * threshold, looks)
    centres = terrain.voxel_centers(np.arange(terrain.voxel_count))[:, :2]
    stamp_ns = newest_ns = 1000 * SECOND_NS
    ever = 0
    for _ in range(9):
        in_order = name == "paper"
        stamp_ns += int(rng.uniform(0.1 if in_order else -2.0, 6.0) * SECOND_NS)
        newest_ns = max(newest_ns, stamp_ns)
        corner, size = rng.uniform(0, 40, 2), rng.uniform(1, 25)
        seen = np.flatnonzero(((centres >= corner) & (centres < corner + size)).all(axis=1))
        if len(seen):
            crowd = np.hypot(*(centres[seen] - corner - size / 2).T) < size / rng.uniform(2, 6)
            mean = np.where(crowd, rng.choice([0.95, 0.3]), rng.choice([0.0, 0.1, 0.02]))
            drone = f"uav{rng.integers(2)}"
            look(crowd_map, drone, stamp_ns, seen, mean)
            slow.look(drone, stamp_ns, seen, mean)
        step_ns = newest_ns + int(rng.choice([0, 0, 1, 20]) * SECOND_NS)
        if step_ns > newest_ns and in_order:
            stamp_ns = newest_ns = step_ns
        other = ZoneEngine(CrowdMap.from_bytes(crowd_map.to_bytes(), terrain), rules)
        other.restore(engine.to_bytes())
        zones = engine.step(step_ns)
        assert zones == other.step(step_ns)
        slow.step(step_ns)
        np.testing.assert_array_equal(engine._ground.closed.voxel_ids, np.flatnonzero(slow.closed))
        ever += len(zones)
        expected = np.flatnonzero((crowd_map.probability(step_ns) >= threshold) & crowd_map.seen())
        np.testing.assert_array_equal(engine.crowd_voxel_ids, expected)
    assume(ever)


def test_zones_of_others_that_overlap_touch_or_stand_apart_are_closed_once() -> None:
    """Two that overlap, two that touch, one in two parts, one far away; crowd and unseen ground over some."""
    two_parts = shapely.MultiPolygon([shapely.box(40, 0, 43, 3), shapely.box(46, 0, 49, 3)])
    outlines = [shapely.box(0, 0, 10, 10), shapely.box(5, 5, 15, 15), shapely.box(20, 0, 25, 5)]
    outlines += [shapely.box(25, 0, 30, 5), two_parts, shapely.box(1e5, 1e5, 2e5, 2e5)]
    theirs = tuple(Zone.of_no_look(f"S{k}", one, "static", "given") for k, one in enumerate(outlines))
    crowd = Zone.of_no_look("Z1", shapely.box(14, 2, 22, 8), "crowd", "seen")
    unseen = Zone.of_no_look("UNSEEN", shapely.box(42, -5, 60, 5), "unseen", "never_seen")
    step = ZoneSet((crowd,), 0.5, 0.0, 0, 0.0, unseen=(unseen,), static=theirs)
    # 12 of the 18 of the two parts lie on unseen ground, which has 180; of 48 of crowd 3 and 6 are theirs.
    assert step.closed_m2 == pytest.approx(1e10 + 175.0 + 50.0 + 18.0 - 3.0 - 9.0 + 180.0 + 48.0 - 3.0 - 6.0)
    together = shapely.union_all([zone.polygon for zone in step.closed])
    assert step.closed_m2 - 1e10 == pytest.approx(together.area - 1e10, abs=1e-4)
