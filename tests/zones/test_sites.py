"""Landing sites: level ground that was found fit lately, with room, and in nobody's zone."""

import json

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from crowdfence import CrowdMap, Georeference, Or, Terrain
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.sites_geojson import sites_geojson
from crowdfence.zones.sites import PAD_M, find_sites
from support.fence_zones import zone
from support.small_crowd_maps import crowd_map_of, flat_crowd_map, look

S = 10**9


def meadow(shape=(12, 12), value=0.9):
    return np.full(shape, value)


def test_all_of_a_meadow_is_one_site():
    (site,) = find_sites(flat_crowd_map(meadow((12, 9))), 0, threshold=0.5)
    # The disc that is nearest to the corner stands at (2.5, 2.5) and ends 0.71 m before the corner column's
    # middle, at its inner corner: the four corner columns are cut.
    assert site.id == "L1" and site.seen_by == ("uav1",)
    assert site.area_m2 == shapely.area(site.polygon) == 12 * 9 - 4
    # 9 wide: from the middle of the middle column to the middle beyond the edge, less half a diagonal.
    assert site.radius_m == pytest.approx(5.0 - 0.5**0.5) and site.centre[1] == 4.5
    assert site.probability_min == pytest.approx(0.9) and site.slope_deg == pytest.approx(0.0, abs=1e-3)


def test_what_is_not_fit_or_never_seen_is_no_site():
    ground = meadow((20, 8))
    ground[9] = 0.1
    ground[10] = np.nan
    west, east = sorted(
        find_sites(flat_crowd_map(ground), 0, threshold=0.5), key=lambda site: site.polygon.bounds
    )
    assert west.polygon.bounds[2] == 9.0 and east.polygon.bounds[0] == 11.0


def test_ground_is_fit_by_default_where_that_is_more_likely_than_not():
    """The default threshold of paper, a quarter for one drone, is rounded towards the class."""
    doubtful = flat_crowd_map(meadow(value=0.45))
    assert doubtful.default_threshold() == pytest.approx(0.25)
    assert find_sites(doubtful, 0) == () and len(find_sites(doubtful, 0, threshold=0.45)) == 1
    assert len(find_sites(flat_crowd_map(meadow(value=0.55)), 0)) == 1


def test_ground_without_room_for_a_drone_is_no_site():
    # 4 columns of 1 m: a middle is 1.5 m from the edge; 5: one is 2.5 m.
    assert find_sites(flat_crowd_map(meadow((4, 30))), 0, threshold=0.5) == ()
    assert len(find_sites(flat_crowd_map(meadow((5, 30))), 0, threshold=0.5)) == 1


def test_a_path_too_narrow_to_land_on_joins_no_two_sites():
    ground = np.full((30, 10), 0.1)
    ground[:10], ground[20:], ground[:, 5] = 0.9, 0.9, 0.9
    assert len(find_sites(flat_crowd_map(ground), 0, threshold=0.5)) == 2


def test_ground_that_was_seen_too_long_ago_is_no_site():
    seen = np.zeros((20, 10), np.int64)
    seen[10:] = 100 * S
    (site,) = find_sites(flat_crowd_map(meadow((20, 10)), last_seen_ns=seen), 110 * S, threshold=0.5)
    assert site.polygon.bounds[0] == 10.0 and site.last_seen_ns == site.oldest_look_ns == 100 * S
    assert find_sites(flat_crowd_map(meadow()), 31 * S, threshold=0.5) == ()


def test_a_slope_is_no_site_whatever_the_looks_say():
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(20), np.arange(12), indexing="ij"))
    for rise, expected in ((8, 1), (2, 0)):  # 1 m up in so many metres: 7 and 27 degrees
        steps = np.stack([i, j, i // rise], axis=1)
        found = find_sites(crowd_map_of(steps, np.full(len(steps), 0.9)), 0, threshold=0.5)
        assert len(found) >= expected if expected else found == ()


@pytest.mark.parametrize("metres", [0.5, 1.5, 6.0])
def test_a_post_that_the_map_holds_stands_in_no_site_though_no_plane_shows_it(metres):
    """The plane that fits 2.5 m around a thin post best is level, whatever its height."""
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(80), np.arange(80), indexing="ij"))
    ground = np.stack([i, j, np.zeros_like(i)], axis=1)
    post = [[40, 40, k] for k in range(1, round(metres / 0.25) + 1)]
    columns = np.concatenate([ground, post])
    sites = find_sites(crowd_map_of(columns, np.full(len(columns), 0.9), voxel_size_m=0.25), 0, threshold=0.5)
    standing = shapely.box(10.0, 10.0, 10.25, 10.25)
    assert sites and not any(site.polygon.intersects(standing) for site in sites)


def test_a_narrow_ditch_is_in_no_site():
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(80), np.arange(80), indexing="ij"))
    ditch = np.where(i == 40, 0, 2)
    columns = np.stack([i, j, ditch], axis=1)
    sites = find_sites(crowd_map_of(columns, np.full(len(i), 0.9), voxel_size_m=0.25), 0, threshold=0.5)
    assert len(sites) == 2
    assert not any(site.polygon.intersects(shapely.box(10.0, 0.0, 10.25, 20.0)) for site in sites)


def test_a_single_voxel_among_bare_ones_may_be_rounding():
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(24), np.arange(24), indexing="ij"))
    columns = np.stack([i, j, (i == 12) & (j == 12)], axis=1)
    (site,) = find_sites(crowd_map_of(columns, np.full(len(i), 0.9), voxel_size_m=0.5), 0, threshold=0.5)
    assert site.polygon.covers(shapely.box(6.0, 6.0, 6.5, 6.5))


def test_fit_ground_below_something_is_no_site():
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(12), np.arange(12), indexing="ij"))
    ground = np.stack([i, j, np.zeros_like(i)], axis=1)
    roof = ground + np.array([0, 0, 6])
    both = np.concatenate([ground, roof])
    probability = np.concatenate([np.full(144, 0.9), np.full(144, 0.1)])
    assert find_sites(crowd_map_of(both, probability), 0, threshold=0.5) == ()
    probability[144:] = np.nan
    assert find_sites(crowd_map_of(both, probability), 0, threshold=0.5) == ()


def test_what_is_seen_below_a_roof_makes_it_neither_newer_nor_fitter():
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(12), np.arange(12), indexing="ij"))
    ground = np.stack([i, j, np.zeros_like(i)], axis=1)
    both = np.concatenate([ground, ground + np.array([0, 0, 6])])
    probability, seen = np.repeat([0.9, 0.6], 144), np.repeat([100 * S, 0], 144)
    crowd_map = crowd_map_of(both, probability, seen)
    assert find_sites(crowd_map, 100 * S, threshold=0.5) == ()  # nobody saw the roof for 100 s
    (site,) = find_sites(crowd_map, 100 * S, threshold=0.5, stale_after_s=120.0)
    assert site.probability_min == site.probability_mean == pytest.approx(0.6)
    assert site.last_seen_ns == site.oldest_look_ns == 0


def test_a_method_that_never_takes_back_gives_no_sites():
    """The crowd that walked onto the meadow is seen at every look, and `or` goes on calling it fit."""
    terrain = Terrain.from_indices(np.stack([*np.nonzero(meadow()), np.zeros(144, int)], axis=1), 1.0)
    landing_map, ids = CrowdMap(terrain, Or()), np.arange(144)
    look(landing_map, "uav1", 0, ids, 0.9)
    for second in range(1, 10):
        look(landing_map, "uav1", second * S, ids, 0.0)
    assert landing_map.probability(9 * S).min() == 1.0
    with pytest.raises(ValueError, match="never takes back"):
        find_sites(landing_map, 9 * S)


def test_no_site_touches_a_closed_zone():
    closed = zone(shapely.box(5.9, -5.0, 7.0, 30.0))
    found = find_sites(flat_crowd_map(meadow((20, 12))), 0, threshold=0.5, closed=[closed])
    assert len(found) == 2
    assert all(shapely.disjoint(site.polygon, closed.polygon) for site in found)


def test_small_sites_are_left_out_and_roomy_ones_come_first():
    ground = np.full((40, 12), 0.1)
    ground[:6, :6] = ground[10:] = 0.9
    both = find_sites(flat_crowd_map(ground), 0, threshold=0.5)
    assert [site.id for site in both] == ["L1", "L2"] and both[0].radius_m > both[1].radius_m
    assert find_sites(flat_crowd_map(ground), 0, threshold=0.5, min_area_m2=100.0) == both[:1]
    with pytest.raises(ValueError, match="min_area_m2"):
        find_sites(flat_crowd_map(ground), 0, min_area_m2=-1.0)


@given(arrays.arrays(np.bool_, (16, 14)), st.integers(0, 12), st.integers(0, 10))
@settings(max_examples=40)
def test_sites_hold_nothing_but_fit_open_ground(unfit, x, y):
    ground = np.where(unfit & (np.arange(16) % 4 == 0)[:, None], 0.1, 0.9)
    closed = zone(shapely.box(x + 0.3, y + 0.3, x + 2.2, y + 1.1))
    for site in find_sites(flat_crowd_map(ground), 0, threshold=0.5, closed=[closed]):
        assert shapely.disjoint(site.polygon, closed.polygon)
        for i, j in np.argwhere(ground < 0.5):
            assert shapely.intersection(site.polygon, shapely.box(i, j, i + 1, j + 1)).area == 0.0
        disc = shapely.Point(*site.centre[:2]).buffer(PAD_M)
        assert shapely.covers(shapely.buffer(site.polygon, 1e-9), disc)


def test_sites_as_geojson_lie_inside_what_they_were_locally():
    sites = find_sites(flat_crowd_map(meadow()), 0, threshold=0.5)
    description = MapDescription(0, 0.5, "evidence", layer="landing-site", mission="m")
    local = json.loads(sites_geojson(sites, description, None, ["Z1"]))
    (feature,) = local["features"]
    assert local["crs"] is None and local["crowdfence"]["closed_zones"] == ["Z1"]
    assert shapely.covers(sites[0].polygon, shapely.geometry.shape(feature["geometry"]))
    anchor = Georeference(46.5, 8.0, 1200.0)
    (feature,) = json.loads(sites_geojson(sites, description, anchor))["features"]
    corners = shapely.get_coordinates(shapely.geometry.shape(feature["geometry"]))
    height_m = np.full(len(corners), 1200.0 + sites[0].centre[2])
    back = anchor.local_from_geodetic(corners[:, 1], corners[:, 0], height_m)[:, :2]
    assert shapely.covers(sites[0].polygon, shapely.MultiPoint(back))
    assert feature["properties"]["centre"]["latitude_deg"] == pytest.approx(46.5, abs=1e-3)


def test_a_site_across_the_antimeridian_is_cut_there():
    """As zones are: a ring from 180 to -180 would be a strip around the Earth, all of it fit for landing."""
    sites = find_sites(flat_crowd_map(meadow((12, 12), 0.9), origin=(-6.0, -6.0, 0.0)), 0, threshold=0.5)
    description = MapDescription(0, 0.5, "evidence", layer="landing-site", mission="m")
    (feature,) = json.loads(sites_geojson(sites, description, Georeference(-16.8, 180.0, 0.0)))["features"]
    written = shapely.geometry.shape(feature["geometry"])
    assert len(written.geoms) == 2 and written.is_valid
    assert written.area < (15.0 / 106_000.0) ** 2  # a degree of longitude is 106.6 km there
