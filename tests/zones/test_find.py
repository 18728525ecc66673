"""Zones outline exactly the columns that hold a voxel at or above the threshold."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from crowdfence import CrowdMap, Or, Paper, Rates, StampError, Terrain
from crowdfence.zones import ZoneSet, find_zones
from support.slow_zones import slow_zones
from support.small_crowd_maps import crowd_map_of, flat_crowd_map, look

SECOND_NS = 1_000_000_000


def zones_of(picture: str, **options: object) -> ZoneSet:
    """Zones of a map drawn with # for crowd, north up."""
    rows = [line.strip() for line in picture.strip().splitlines()]
    crowd = np.array([[cell == "#" for cell in row] for row in rows[::-1]]).T
    return find_zones(flat_crowd_map(crowd.astype(float), **options), 0, threshold=0.5)  # type: ignore[arg-type]


def test_an_l_shape_has_the_six_corners_of_an_l() -> None:
    (zone,) = zones_of(
        """
        #..
        #..
        ###
        """,
        cell_size_m=2.0,
        origin=(100.0, -10.0, 5.0),
    )
    corners = {(100, -10), (106, -10), (106, -8), (102, -8), (102, -4), (100, -4)}
    assert set(zone.polygon.exterior.coords) == corners
    assert len(zone.polygon.exterior.coords) == 7  # no vertex in the middle of a straight edge
    assert (zone.cell_count, zone.area_m2, zone.polygon.area) == (5, 20.0, 20.0)
    assert (zone.lower_m, zone.upper_m) == (5.0, 7.0)


def test_a_straight_edge_far_from_the_origin_has_no_vertex_between_its_ends() -> None:
    # Simplifying the union of the cells left one here: it measures a distance, which rounding makes positive.
    columns = [(2, -1, 0), (3, -4, 0), (3, -3, 0), (3, -2, 0), (3, -1, 0), (4, -2, 0)]
    crowd_map = crowd_map_of(columns, np.ones(6), voxel_size_m=0.3, origin=(0.1, 5_334_760.3, 0.0))
    (zone,) = find_zones(crowd_map, 0, threshold=0.5)
    assert len(zone.polygon.exterior.coords) == 11


def test_ground_inside_a_ring_of_crowd_is_a_hole() -> None:
    (zone,) = zones_of(
        """
        ###
        #.#
        ###
        """
    )
    assert [set(ring.coords) for ring in zone.polygon.interiors] == [{(1, 1), (1, 2), (2, 2), (2, 1)}]
    assert zone.polygon.area == 8.0


def test_a_hole_may_touch_the_outside_at_a_corner() -> None:
    (zone,) = zones_of(
        """
        ###
        #.#
        ##.
        """
    )
    assert isinstance(zone.polygon, shapely.Polygon) and zone.polygon.is_valid
    assert [set(ring.coords) for ring in zone.polygon.interiors] == [{(1, 1), (1, 2), (2, 2), (2, 1)}]
    assert zone.polygon.area == 7.0


def test_cells_that_touch_at_a_corner_are_one_zone_and_valid() -> None:
    zones = zones_of(
        """
        .#.
        #.#
        """
    )
    assert len(zones) == 1
    assert isinstance(zones[0].polygon, shapely.MultiPolygon)
    assert zones[0].polygon.is_valid
    assert zones[0].polygon.area == 3.0


def test_zones_come_largest_first_with_short_ids() -> None:
    zones = zones_of(
        """
        ##..#..##
        .........
        .........
        #.......#
        """
    )
    assert [zone.id for zone in zones] == ["Z1", "Z2", "Z3", "Z4", "Z5"]
    # Equal sizes go from west to east, then from south to north.
    assert [zone.polygon.bounds[:2] for zone in zones] == [(0, 3), (7, 3), (0, 0), (4, 3), (8, 0)]


def test_ground_within_two_metres_is_one_zone_of_several_parts() -> None:
    """Columns of 1 m: one column between two leaves 2 m from middle to middle, two leave 3 m."""
    zones = zones_of(
        """
        ##.#..#
        .......
        #......
        """
    )
    assert [zone.polygon.geom_type for zone in zones] == ["MultiPolygon", "Polygon"]
    assert [zone.cell_count for zone in zones] == [4, 1]
    assert [zone.polygon.bounds for zone in zones] == [(0, 0, 4, 3), (6, 2, 7, 3)]


def test_a_zone_says_how_sure_how_long_ago_and_by_whom_it_was_seen() -> None:
    crowd_map = flat_crowd_map(
        np.array([[0.6, 0.9], [np.nan, 0.4]]), last_seen_ns=np.array([[30, 10], [0, 99]])
    )
    (zone,) = find_zones(crowd_map, 99, threshold=0.5)
    assert (zone.probability_max, zone.probability_mean) == pytest.approx((0.9, 0.75))
    assert (zone.last_seen_ns, zone.oldest_look_ns) == (30, 10)
    assert zone.seen_by == ("uav1",)


def test_a_column_at_the_threshold_is_crowd() -> None:
    crowd_map = flat_crowd_map(np.array([[0.6]]))
    at = float(crowd_map.probability(0)[0])
    assert len(find_zones(crowd_map, 0, threshold=at)) == 1
    assert len(find_zones(crowd_map, 0, threshold=np.nextafter(at, 1.0))) == 0


def test_seen_by_names_who_saw_the_crowd_and_not_what_lies_below_it() -> None:
    # A roof with crowd above empty ground, and crowd beside it.
    terrain = Terrain.from_indices([(0, 0, 0), (0, 0, 9), (1, 1, 0), (5, 0, 0)], 1.0)
    ground, roof, beside, far = terrain.voxel_ids([(0, 0, 0), (0, 0, 9), (1, 1, 0), (5, 0, 0)])[:, None]
    crowd_map = CrowdMap(terrain, Or())
    for stamp_ns, (drone, ids, mean) in enumerate(
        [("zulu", roof, 1.0), ("alpha", beside, 1.0), ("bravo", ground, 0.0), ("charlie", far, 1.0)]
    ):
        look(crowd_map, drone, stamp_ns, ids, mean)
    near, other = find_zones(crowd_map, 9)
    assert (near.cell_count, near.seen_by) == (2, ("alpha", "zulu"))
    assert near.last_seen_ns == 1  # the look at the ground below the roof, at 2, says nothing of the crowd
    assert other.seen_by == ("charlie",)


def test_the_height_range_covers_every_voxel_of_the_columns() -> None:
    crowd_map = crowd_map_of(
        [(0, 0, 3), (0, 0, 7), (1, 0, -2)], [0.9, np.nan, 0.9], voxel_size_m=0.5, origin=(0.0, 0.0, 100.0)
    )
    (zone,) = find_zones(crowd_map, 0, threshold=0.5)
    assert (zone.lower_m, zone.upper_m) == (99.0, 104.0)


def test_small_regions_are_counted_not_lost_silently() -> None:
    probability = np.zeros((9, 1))
    probability[[0, 1, 2, 4, 6, 7]] = 1.0
    zones = find_zones(flat_crowd_map(probability, cell_size_m=2.0), 0, threshold=0.5, min_area_m2=8.0)
    assert [zone.cell_count for zone in zones] == [3, 2]  # 8 m2 is not smaller than 8 m2
    assert (zones.dropped_count, zones.dropped_area_m2) == (1, 4.0)
    assert zones.area_m2 == 20.0


@pytest.mark.parametrize("probability", [0.0, np.nan])
def test_nothing_above_the_threshold_and_nothing_seen(probability: float) -> None:
    zones = find_zones(flat_crowd_map(np.full((3, 3), probability)), 0, threshold=0.5)
    assert len(zones) == zones.dropped_count == zones.area_m2 == zones.dropped_area_m2 == 0


def test_the_threshold_is_the_methods_unless_given() -> None:
    crowd_map = flat_crowd_map(np.array([[0.9]]))
    assert find_zones(crowd_map, 0).threshold == crowd_map.default_threshold()
    assert find_zones(crowd_map, 0, threshold=0.95).threshold == 0.95


@pytest.mark.parametrize(("threshold", "min_area_m2"), [(0.0, 0.0), (1.1, 0.0), (np.nan, 0.0), (0.5, -1.0)])
def test_bad_arguments_are_refused(threshold: float, min_area_m2: float) -> None:
    with pytest.raises(ValueError, match=r"threshold|min_area_m2"):
        find_zones(flat_crowd_map(np.zeros((1, 1))), 0, threshold=threshold, min_area_m2=min_area_m2)


def test_the_past_of_a_map_has_no_zones() -> None:
    with pytest.raises(StampError, match="cannot be read in its past"):
        find_zones(flat_crowd_map(np.ones((1, 1)), last_seen_ns=5), 4)


@given(
    crowd=hnp.arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))),
    cell_size_m=st.sampled_from([0.1, 0.5, 1.0, 0.3]),
    origin=st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)),
)
def test_zones_cover_the_crowd_cells_and_nothing_else(
    crowd: NDArray[np.bool_], cell_size_m: float, origin: tuple[float, float]
) -> None:
    crowd_map = flat_crowd_map(np.where(crowd, 0.8, 0.2), cell_size_m, (*origin, 0.0))
    zones = find_zones(crowd_map, 0, threshold=0.5)
    assert all(zone.polygon.is_valid for zone in zones)
    assert sum(zone.cell_count for zone in zones) == crowd.sum()
    for zone in zones:
        # Edges at 1e6 m are rounded to 1e-10 m.
        assert zone.polygon.area == pytest.approx(zone.cell_count * cell_size_m**2, rel=1e-6)
    everything = shapely.MultiPolygon(
        [part for zone in zones for part in getattr(zone.polygon, "geoms", [zone.polygon])]
    )
    centres = (origin[axis] + (np.arange(crowd.shape[axis]) + 0.5) * cell_size_m for axis in (0, 1))
    east, north = np.meshgrid(*centres, indexing="ij")
    np.testing.assert_array_equal(shapely.intersects_xy(everything, east, north), crowd)


@settings(max_examples=200)
@given(
    seed=st.integers(0, 2**32 - 1),
    side=st.integers(1, 14),
    share_seen=st.sampled_from([0.0, 0.3, 0.6, 0.9, 1.0]),
    is_paper=st.booleans(),
)
def test_zones_are_those_of_a_look_at_every_voxel(
    seed: int, side: int, share_seen: float, is_paper: bool
) -> None:
    """To the last bit, on slopes with walls below their steps, and under roofs."""
    rng = np.random.default_rng(seed)
    crowd_map = _seen_at_random(_slope_with_roofs(rng, side), rng, share_seen, is_paper)
    stamp_ns, threshold = 9 * SECOND_NS, 0.3
    zones = find_zones(crowd_map, stamp_ns, threshold=threshold)
    expected = slow_zones(crowd_map, stamp_ns, threshold)
    assert [replace(zone, polygon=None) for zone in zones] == [
        replace(zone, polygon=None) for zone in expected
    ]
    assert [zone.polygon.wkb for zone in zones] == [zone.polygon.wkb for zone in expected]


def _slope_with_roofs(rng: np.random.Generator, side: int) -> Terrain:
    ground = np.add.outer(rng.integers(0, 3, side).cumsum(), rng.integers(0, 3, side).cumsum())
    columns = [
        (i, j, k) for i, j in np.ndindex(side, side) for k in range(ground[i, j] - 2, ground[i, j] + 1)
    ]
    roofs = [(i, j, ground[i, j] + 5) for i, j in np.argwhere(rng.random((side, side)) < 0.4)]
    indices = np.array([*columns, *roofs]) + rng.integers(-50, 50, 3)
    origin = rng.uniform(-1e6, 1e6, 3)
    return Terrain.from_indices(indices, rng.choice([0.1, 0.5, 0.9, 1.0, 1.7, 2.5]), tuple(origin))


def _seen_at_random(
    terrain: Terrain, rng: np.random.Generator, share_seen: float, is_paper: bool
) -> CrowdMap:
    crowd_map = CrowdMap(terrain, Paper(Rates(0.9, 0.1), 0.5, alpha=0.8, fleet_size=3) if is_paper else Or())
    for second, drone in enumerate(["uav2", "uav1", "uav3"]):
        ids = np.flatnonzero(rng.random(terrain.voxel_count) < share_seen)
        look(crowd_map, drone, second * SECOND_NS, ids, rng.random(len(ids)))
    return crowd_map
