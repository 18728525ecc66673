"""All zones in a fence of few items, nothing uncovered."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence.zones.capacity import Fence, circle_around, fitted
from crowdfence.zones.simplify import vertex_count


def ground_of(fence: Fence) -> shapely.Geometry:
    """What a fence closes; circles by polygons that lie inside them."""
    circles = [shapely.Point(c.east_m, c.north_m).buffer(c.radius_m, 4096) for c in fence.circles]
    return shapely.union_all([*fence.polygons, *circles])


def blobs(seed: int, count: int, spread_m: float) -> list[shapely.Polygon]:
    """Outlines of crowds of 2 to 20 m, some of which meet."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        corners = rng.uniform(0.0, spread_m, 2) + rng.uniform(-10.0, 10.0, (rng.integers(4, 30), 2))
        made.append(shapely.concave_hull(shapely.MultiPoint(corners), 0.5).buffer(1.0, quad_segs=3))
    return made


def test_what_fits_is_left_as_it_is() -> None:
    square, house = shapely.box(0, 0, 9, 9), shapely.Polygon([(20, 0), (30, 0), (30, 9), (25, 14), (20, 9)])
    fence = fitted([square, house], 9)
    assert (fence.items, fence.circles, fence.over_coverage_m2) == (9, (), 0.0)
    assert shapely.union_all(fence.polygons).equals(shapely.union_all([square, house]))


def test_a_round_crowd_becomes_a_circle() -> None:
    crowd = shapely.Point(5.0, 7.0).buffer(10.0, quad_segs=16)
    fence = fitted([crowd], 3)
    ((circle,), ()) = fence.circles, fence.polygons
    assert (circle.east_m, circle.north_m, circle.radius_m) == pytest.approx((5.0, 7.0, 10.0), abs=2e-3)
    polygon = fitted([crowd], 3, circles=False)
    assert polygon.items == 3 and polygon.polygons[0].covers(crowd)


def test_the_cheapest_ground_is_closed_first() -> None:
    """A house of five corners beside a square: its roof costs 25 m2, anything else more."""
    square, house = shapely.box(0, 0, 9, 9), shapely.Polygon([(20, 0), (30, 0), (30, 9), (25, 14), (20, 9)])
    fence = fitted([square, house], 8, circles=False)
    assert fence.items == 8 and fence.over_coverage_m2 == pytest.approx(25.0, abs=1e-3)


def test_holes_are_closed_and_zones_that_overlap_are_one() -> None:
    ring = shapely.box(0, 0, 9, 9) - shapely.box(3, 3, 6, 6)
    fence = fitted([ring, shapely.box(8, 0, 12, 9)], 60)
    assert len(fence.polygons) == 1 and fence.polygons[0].equals(shapely.box(0, 0, 12, 9))
    assert (fence.zone_area_m2, fence.over_coverage_m2) == (99.0, 9.0)


def test_an_outline_of_thousands_of_corners_is_covered_and_stays_its_shape() -> None:
    """As of a coast or a park. Its corners were left out one by one, and 20,000 took two minutes, in which a
    watch closed nothing new."""
    angle = np.linspace(0.0, 2 * np.pi, 20_000, endpoint=False)
    reach_m = 1000.0 * (1.0 + 0.3 * np.cos(5 * angle) + np.random.default_rng(1).uniform(0, 1e-3, 20_000))
    outline = shapely.Polygon(reach_m[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))
    fence = fitted([outline], 63)
    assert fence.items <= 63 and ground_of(fence).covers(outline)
    # Of its area, 3.28 km2, no more than 2 %: a circle around it would take 60 %.
    assert fence.over_coverage_m2 < 0.02 * outline.area
    assert fence.zone_area_m2 == pytest.approx(outline.area)


@settings(max_examples=20)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 25),
    max_items=st.sampled_from([3, 4, 7, 16, 63]),
    circles=st.booleans(),
)
def test_a_budget_never_uncovers(seed: int, count: int, max_items: int, circles: bool) -> None:
    zones = blobs(seed, count, 150.0)
    fence = fitted(zones, max_items, circles=circles)
    assert fence.items <= max_items
    assert circles or not fence.circles
    closed = ground_of(fence)
    union = shapely.union_all(zones)
    assert union.difference(closed.buffer(1e-5)).area < 1e-9
    assert fence.zone_area_m2 == pytest.approx(union.area)
    assert fence.over_coverage_m2 == pytest.approx(closed.area - union.area, rel=2e-3, abs=1.0)


@pytest.mark.parametrize("max_items", [1, 2, 5])
def test_fewer_items_than_zones(max_items: int) -> None:
    zones = [shapely.box(i, j, i + 2, j + 2) for i in range(0, 50, 10) for j in range(0, 50, 10)]
    fence = fitted(zones, max_items)
    assert fence.items <= max_items
    assert ground_of(fence).covers(shapely.union_all(zones))


def test_ten_thousand_zones() -> None:
    rng = np.random.default_rng(4)
    corners = rng.uniform(0.0, 5000.0, (10_000, 2))
    zones = [shapely.box(x, y, x + 2.0, y + 3.0) for x, y in corners]
    fence = fitted(zones, 63)
    assert fence.items <= 63
    closed = ground_of(fence)
    shapely.prepare(closed)
    assert shapely.covers(closed, zones).all()


def test_an_outline_that_crosses_itself_is_closed_as_a_whole() -> None:
    """A star drawn in one line: by the even-odd rule its middle would be open."""
    angles = np.radians(144.0 * np.arange(5))
    star = shapely.Polygon(np.stack([np.cos(angles), np.sin(angles)], axis=1))
    line = shapely.Polygon([(5, 0), (9, 0), (7, 0)])
    fence = fitted([star, line], 63)
    assert ground_of(fence).covers(shapely.union_all([shapely.convex_hull(star), shapely.convex_hull(line)]))
    assert fitted([shapely.Polygon()], 63).items == 0
    with pytest.raises(ValueError, match="not finite"):
        fitted([shapely.Polygon([(0, 0), (1, 0), (1, np.inf)])], 63)


@pytest.mark.parametrize("width_m", [0.0, 8.6e-59, 1e-12])
def test_a_needle_is_closed_beside_another_outline(width_m: float) -> None:
    """GEOS leaves it out of their union."""
    needle = shapely.Polygon([(0.0, 0.0), (0.0, width_m), (1.0, 1.0)])
    point = shapely.Polygon([(0.0, 0.0)] * 3)
    assert ground_of(fitted([point, needle], 1)).covers(shapely.LineString([(0.0, 0.0), (1.0, 1.0)]))


def test_a_fence_without_room_is_refused() -> None:
    with pytest.raises(ValueError, match="a fence of 0 items holds no zone; it takes 1"):
        fitted([shapely.box(0, 0, 1, 1)], 0)
    with pytest.raises(ValueError, match="it takes 3"):
        fitted([shapely.box(0, 0, 1, 1)], 2, circles=False)
    nothing = fitted([], 5)
    assert nothing.items == 0 and nothing.over_coverage_m2 == 0.0


def test_a_circle_covers_every_corner() -> None:
    for outline in blobs(1, 20, 50.0):
        circle = circle_around(outline)
        corners = shapely.get_coordinates(outline)
        assert (np.hypot(*(corners - (circle.east_m, circle.north_m)).T) <= circle.radius_m).all()
        assert circle.radius_m <= shapely.minimum_bounding_radius(outline) * 1.001 + 2e-3
        assert vertex_count(outline) > 3
