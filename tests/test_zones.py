"""Zones outline exactly the cells at or above the threshold."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from crowdfence.surface_grid import SurfaceGrid
from crowdfence.zones import ZoneSet, find_zones
from support.small_grids import flat_grid


def zones_of(picture: str, **grid: object) -> ZoneSet:
    """Zones of a map drawn with # for crowd, north up."""
    rows = [line.strip() for line in picture.strip().splitlines()]
    crowd = np.array([[cell == "#" for cell in row] for row in rows[::-1]]).T
    return find_zones(flat_grid(crowd.astype(float), **grid), 0.5)  # type: ignore[arg-type]


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
        ##.#.##
        .......
        #.....#
        """
    )
    assert [zone.id for zone in zones] == ["Z1", "Z2", "Z3", "Z4", "Z5"]
    # Equal sizes go from west to east, then from south to north.
    assert [zone.polygon.bounds[:2] for zone in zones] == [(0, 2), (5, 2), (0, 0), (3, 2), (6, 0)]


def test_a_zone_says_how_sure_how_high_and_how_long_ago() -> None:
    probability = np.array([[0.6, 0.9], [np.nan, 0.4]])
    grid = flat_grid(probability, last_seen_ns=np.array([[30, 10], [-1, 99]]))
    (zone,) = find_zones(grid, 0.6)
    assert (zone.probability_max, zone.probability_mean) == (0.9, 0.75)
    assert (zone.last_seen_ns, zone.oldest_look_ns) == (30, 10)
    (unstamped,) = find_zones(flat_grid(probability), 0.6)
    assert unstamped.last_seen_ns is None and unstamped.oldest_look_ns is None


def test_the_height_range_covers_every_voxel_of_the_columns() -> None:
    grid = SurfaceGrid.from_voxels(
        [(0, 0, 3), (0, 0, 7), (1, 0, -2)], 0.5, (0.0, 0.0, 100.0), [0.9, 0.0, 0.9], [4, 2, 4]
    )
    (zone,) = find_zones(grid, 0.5)
    assert (zone.lower_m, zone.upper_m) == (99.0, 104.0)


def test_small_regions_are_counted_not_lost_silently() -> None:
    probability = np.zeros((9, 1))
    probability[[0, 1, 2, 4, 6, 7]] = 1.0
    zones = find_zones(flat_grid(probability, cell_size_m=2.0), 0.5, min_area_m2=8.0)
    assert [zone.cell_count for zone in zones] == [3, 2]  # 8 m2 is not smaller than 8 m2
    assert (zones.dropped_count, zones.dropped_area_m2) == (1, 4.0)
    assert zones.area_m2 == 20.0


def test_nothing_above_the_threshold_and_nothing_seen() -> None:
    assert len(find_zones(flat_grid(np.zeros((3, 3))), 0.5)) == 0
    assert len(find_zones(flat_grid(np.full((3, 3), np.nan)), 0.5)) == 0


@pytest.mark.parametrize(("threshold", "min_area_m2"), [(0.0, 0.0), (1.1, 0.0), (np.nan, 0.0), (0.5, -1.0)])
def test_bad_arguments_are_refused(threshold: float, min_area_m2: float) -> None:
    with pytest.raises(ValueError, match=r"threshold|min_area_m2"):
        find_zones(flat_grid(np.zeros((1, 1))), threshold, min_area_m2=min_area_m2)


@given(
    crowd=hnp.arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))),
    cell_size_m=st.sampled_from([0.1, 0.5, 1.0, 0.3]),
    origin=st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)),
)
def test_zones_cover_the_crowd_cells_and_nothing_else(
    crowd: NDArray[np.bool_], cell_size_m: float, origin: tuple[float, float]
) -> None:
    grid = flat_grid(np.where(crowd, 0.8, 0.2), cell_size_m, (*origin, 0.0))
    zones = find_zones(grid, 0.5)
    assert all(zone.polygon.is_valid for zone in zones)
    assert sum(zone.cell_count for zone in zones) == crowd.sum()
    for zone in zones:
        # Edges at 1e6 m are rounded to 1e-10 m.
        assert zone.polygon.area == pytest.approx(zone.cell_count * cell_size_m**2, rel=1e-6)
    everything = shapely.MultiPolygon(
        [part for zone in zones for part in getattr(zone.polygon, "geoms", [zone.polygon])]
    )
    east, north = np.meshgrid(
        *(_centres(edges) for edges in (grid.east_edges_m, grid.north_edges_m)), indexing="ij"
    )
    np.testing.assert_array_equal(shapely.intersects_xy(everything, east, north), crowd)


def _centres(edges: NDArray[np.float64]) -> NDArray[np.float64]:
    return (edges[:-1] + edges[1:]) / 2
