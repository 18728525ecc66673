"""The frame loop by itself: views in, what happened out."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from crowdfence import Camera, CrowdMap, CrowdMass, Or, Paper, Rates, StampError, Terrain, View
from crowdfence.config import ZoneConfig
from crowdfence.pipeline import FrameLoop
from crowdfence.pipeline.run import frame_row
from crowdfence.sources.recording import RefusedFrame

SECOND_NS = 1_000_000_000
START_NS = 1_760_000_000 * SECOND_NS
CAMERA = Camera.pinhole(8, 6, 8.0, 8.0, 4.0, 3.0)
FLOOR = Terrain.from_occupancy(np.ones((40, 20, 1), bool), 1.0)


def view(drone: str, x: float, crowd: NDArray[np.float32], stamp_ns: int = START_NS) -> View:
    """8 m above the floor, straight down: 8 x 6 voxels, a pixel each, north up."""
    world_from_camera = np.diag([1.0, -1.0, -1.0, 1.0])
    world_from_camera[:3, 3] = (x, 10.0, 9.0)
    return View(drone, stamp_ns, CAMERA, world_from_camera, crowd)


def crowd_in(rows: slice, columns: slice) -> NDArray[np.float32]:
    heatmap = np.zeros((6, 8), np.float32)
    heatmap[rows, columns] = 1.0
    return heatmap


NONE = crowd_in(slice(0), slice(0))


def test_a_step_says_what_was_seen_what_is_crowd_and_where_the_fence_stands() -> None:
    loop = FrameLoop(CrowdMap(FLOOR, Or()), ZoneConfig(min_area_m2=2.0))
    lost = RefusedFrame("c", START_NS, "its picture is damaged")
    # a sees x 4 to 12 and y 7 to 13, b sees x 24 to 32. a: 2 x 3 m of crowd in its corner, b: one cell.
    views = [
        view("a", 8.0, crowd_in(slice(0, 2), slice(0, 3))),
        view("b", 28.0, crowd_in(slice(5, 6), slice(7, 8))),
    ]
    step = loop.step(views, START_NS, [lost])
    assert (step.stamp_ns, step.drones, step.refused) == (START_NS, ("a", "b"), (lost,))
    assert step.seen_count == len(step.update.voxel_ids) == 2 * 48
    x, y, _ = FLOOR.voxel_indices(step.crowd_ids).T
    assert set(zip(x.tolist(), y.tolist(), strict=True)) == {
        *((i, j) for i in (4, 5, 6) for j in (11, 12)),
        (31, 7),
    }
    (zone,) = step.zones
    assert zone.polygon.bounds == (4.0, 11.0, 7.0, 13.0) and zone.area_m2 == 6.0
    assert zone.seen_by == ("a",)
    assert (step.zones.dropped_count, step.zones.dropped_area_m2) == (1, 1.0)


@pytest.mark.parametrize(
    ("coverage", "zones", "left_out_m2"), [("full", 1, (1.0, 1.5)), ("rays", 2, (0.0, 0.0))]
)
def test_crowd_that_rays_hit_here_and_there_is_closed_whatever_its_area(
    coverage: Literal["full", "rays"], zones: int, left_out_m2: tuple[float, float]
) -> None:
    """Voxels of 0.1 m, a ray a metre: 4 x 4 m of crowd are 16 voxels, a zone of 16 parts and 0.16 m2 in all,
    and a pixel by itself is one of one voxel. Where the ground between counts too it is one zone of 16 m2,
    and a pixel, of 1 m2 and the columns that it cuts, is too little for one."""
    fine = Terrain.from_occupancy(np.ones((160, 200, 1), bool), 0.1)
    loop = FrameLoop(CrowdMap(fine, Or(), coverage=coverage), ZoneConfig())
    crowd = crowd_in(slice(1, 5), slice(0, 4)) + crowd_in(slice(5, 6), slice(7, 8))
    step = loop.step([view("a", 8.0, crowd)], START_NS)
    assert len(step.zones) == zones
    least_m2, most_m2 = left_out_m2
    assert least_m2 <= step.zones.dropped_area_m2 <= most_m2


def test_the_figures_of_a_step_tell_crowd_and_what_is_closed_apart() -> None:
    """6 m2 of crowd and one column too small for a zone; then all of it is looked at and found below the
    threshold, but not below the one for opening."""
    method = Paper(Rates(0.9, 0.05), 0.2, alpha=1.0, decay=0.0, fleet_size=1)
    config = ZoneConfig(threshold=0.5, off_threshold=0.01, min_area_m2=2.0)
    loop = FrameLoop(CrowdMap(FLOOR, method), config)
    crowd = crowd_in(slice(0, 2), slice(0, 3)) + crowd_in(slice(5, 6), slice(7, 8))
    rows = [
        frame_row(loop.step([view("a", 8.0, shown, stamp_ns)], stamp_ns), FLOOR)
        for shown, stamp_ns in ((crowd, START_NS), (NONE, START_NS + SECOND_NS))
    ]
    told = [(row.crowd_voxels, row.crowd_area_m2, row.zones, row.zones_area_m2) for row in rows]
    assert told == [(7, 7.0, 1, 6.0), (0, 0.0, 1, 6.0)]


def test_zones_follow_the_map_from_step_to_step() -> None:
    method = Paper(Rates(0.9, 0.05), 0.2, alpha=1.0, decay=0.0, fleet_size=1)
    loop = FrameLoop(CrowdMap(FLOOR, method), ZoneConfig(threshold=0.5))
    crowd = view("a", 8.0, crowd_in(slice(0, 2), slice(0, 3)))
    first = loop.step([crowd], START_NS)
    away = loop.step([view("a", 28.0, NONE, START_NS + SECOND_NS)], START_NS + SECOND_NS)
    back = loop.step([view("a", 8.0, NONE, START_NS + 2 * SECOND_NS)], START_NS + 2 * SECOND_NS)
    assert [len(step.zones) for step in (first, away, back)] == [1, 1, 0]
    assert [step.seen_count for step in (first, away, back)] == [48, 96, 96]


def test_the_loop_knows_where_each_drones_crowd_went() -> None:
    """b hangs over the floor's edge: 2 of its 3 columns of crowd lie beside it."""
    loop = FrameLoop(CrowdMap(FLOOR, Or()), ZoneConfig())
    for second in range(2):
        stamp_ns = START_NS + second * SECOND_NS
        views = [
            view("a", 8.0, crowd_in(slice(0, 2), slice(0, 3)), stamp_ns),
            view("b", 39.0, crowd_in(slice(0, 1), slice(4, 7)), stamp_ns),
        ]
        step = loop.step(views, stamp_ns)
        assert step.crowd_mass == CrowdMass(ground=7.0, off_map=2.0)
    assert loop.crowd_mass == {"a": CrowdMass(ground=12.0), "b": CrowdMass(ground=2.0, off_map=4.0)}


def test_a_loop_that_is_given_observations_is_where_the_other_is() -> None:
    loops = [FrameLoop(CrowdMap(FLOOR, Or()), ZoneConfig()) for _ in range(2)]
    step = loops[0].step([view("a", 8.0, crowd_in(slice(2, 4), slice(2, 4)))], START_NS)
    same = loops[1].step_observed(step.update.observations, START_NS)
    assert same.update == step.update and same.zones == step.zones
    assert loops[0].crowd_map.to_bytes() == loops[1].crowd_map.to_bytes()


def test_an_instant_that_cannot_be_integrated_changes_nothing() -> None:
    method = Paper(Rates(0.9, 0.05), 0.2, fleet_size=1)
    loop = FrameLoop(CrowdMap(FLOOR, method), ZoneConfig())
    loop.step([view("a", 8.0, NONE)], START_NS)
    before = loop.crowd_map.to_bytes()
    with pytest.raises(StampError, match="not after the last instant"):
        loop.step([view("a", 8.0, NONE)], START_NS)
    assert loop.crowd_map.to_bytes() == before


def test_a_thread_for_every_drone_may_call_one_loop() -> None:
    """As callbacks of a fleet do: each step stays whole, its zones are those of the map behind it."""
    crowd = crowd_in(slice(2, 4), slice(2, 4))
    loop = FrameLoop(CrowdMap(FLOOR, Or()), ZoneConfig())

    def fly(drone: str, x: float, offset_ns: int) -> None:
        for k in range(40):
            stamp_ns = START_NS + k * SECOND_NS // 10 + offset_ns
            assert len(loop.step([view(drone, x, crowd, stamp_ns)], stamp_ns).zones) > 0

    fleet = [("a", 8.0, 0), ("b", 20.0, 1_000_000), ("c", 32.0, 2_000_000)]
    with ThreadPoolExecutor(len(fleet)) as threads:
        for flown in [threads.submit(fly, *drone) for drone in fleet]:
            flown.result()
    assert loop.crowd_map.instant_count == 120
    assert loop.crowd_mass == {drone: CrowdMass(ground=160.0) for drone, *_ in fleet}
    zones = loop.look_again(START_NS + 5 * SECOND_NS)
    assert [zone.evidence[0].looks for zone in sorted(zones, key=lambda zone: zone.seen_by)] == [40] * 3


def test_an_instant_that_comes_late_changes_the_zones_of_now() -> None:
    crowd = crowd_in(slice(2, 4), slice(2, 4))
    loop = FrameLoop(CrowdMap(FLOOR, Or()), ZoneConfig())
    assert len(loop.step([view("a", 8.0, NONE)], START_NS).zones) == 0
    late = loop.step([view("b", 30.0, crowd, START_NS - SECOND_NS)], START_NS - SECOND_NS)
    (zone,) = late.zones
    assert (late.stamp_ns, late.update.stamp_ns) == (START_NS, START_NS - SECOND_NS)
    assert (zone.cell_count, zone.evidence[0].drone) == (4, "b")
    assert loop.crowd_map.instant_count == 2


def test_the_threshold_is_the_methods_own_unless_told() -> None:
    assert FrameLoop(CrowdMap(FLOOR, Or()), ZoneConfig()).threshold == 0.5
    assert FrameLoop(CrowdMap(FLOOR, Or()), ZoneConfig(threshold=0.9)).threshold == 0.9


@pytest.mark.parametrize(
    "damage",
    [
        lambda kept: b"",
        lambda kept: b"abc",
        lambda kept: kept[:-3],
        lambda kept: kept[3:],
        lambda kept: kept[:60],
    ],
)
def test_what_is_no_state_is_refused_and_changes_nothing(damage: Callable[[bytes], bytes]) -> None:
    loop, other = (FrameLoop(CrowdMap(FLOOR, Or()), ZoneConfig()) for _ in range(2))
    loop.step([view("a", 8.0, crowd_in(slice(2, 4), slice(2, 4)))], START_NS)
    with pytest.raises(ValueError, match="that is no state of "):
        other.restore(damage(loop.to_bytes()))
    assert other.crowd_mass == {}


def test_zones_do_not_go_on_from_another_map() -> None:
    """What is closed stays so until somebody looks; where nobody has, it would be in no zone."""
    loop = FrameLoop(CrowdMap(FLOOR, Or()), ZoneConfig())
    loop.step([view("a", 8.0, crowd_in(slice(2, 4), slice(2, 4)))], START_NS)
    smaller = Terrain.from_occupancy(np.ones((4, 4, 1), bool), 1.0)
    for terrain, told in (
        (FLOOR, "it closes what nobody has seen here"),
        (smaller, "voxel id .* does not exist"),
    ):
        with pytest.raises(ValueError, match=told):
            FrameLoop(CrowdMap(terrain, Or()), ZoneConfig()).restore(loop.to_bytes())
    again = FrameLoop(CrowdMap.from_bytes(loop.crowd_map.to_bytes(), FLOOR), ZoneConfig())
    again.restore(loop.to_bytes())
    assert len(again.look_again(START_NS + SECOND_NS)) == 1


def test_a_loop_that_goes_on_with_a_larger_buffer_has_it_at_once() -> None:
    """Its ground does not change, and only zones whose ground does are outlined at a step."""
    loop = FrameLoop(CrowdMap(FLOOR, Or()), ZoneConfig(buffer_m=1.0))
    loop.step([view("a", 20.0, crowd_in(slice(2, 4), slice(3, 5)))], START_NS)
    saved, map_bytes = loop.to_bytes(), loop.crowd_map.to_bytes()

    def bounds_after(config: ZoneConfig) -> tuple[float, ...]:
        again = FrameLoop(CrowdMap.from_bytes(map_bytes, FLOOR), config)
        again.restore(saved)
        (zone,) = again.look_again(START_NS).zones
        return zone.polygon.bounds

    # Crowd from x 19 to 21 and y 9 to 11; corners are rounded outward.
    assert bounds_after(ZoneConfig(buffer_m=1.0)) == pytest.approx((18.0, 8.0, 22.0, 12.0), abs=0.1)
    assert bounds_after(ZoneConfig(buffer_m=5.0)) == pytest.approx((14.0, 4.0, 26.0, 16.0), abs=0.1)
    assert bounds_after(ZoneConfig()) == (19.0, 9.0, 21.0, 11.0)
