"""Fewer corners and larger outlines, which never uncover anything."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import ndimage

from crowdfence.zones.grow import grown, without_small_holes
from crowdfence.zones.simplify import FewerCorners, simplified, vertex_count

CELLS = hnp.arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))).filter(np.any)
DECIMETRES = st.integers(-500, 500)


def same(outline: shapely.Geometry, expected: shapely.Geometry) -> bool:
    """Up to the micrometre by which changed outlines are larger."""
    return bool(outline.covers(expected) and shapely.symmetric_difference(outline, expected).area < 1e-4)


def outline(cells: NDArray[np.bool_]) -> shapely.Polygon | shapely.MultiPolygon:
    """Of cells that may touch at corners only."""
    return shapely.union_all([shapely.box(i, j, i + 1, j + 1) for i, j in np.argwhere(cells)])


def test_a_staircase_becomes_the_line_over_its_steps() -> None:
    steps = outline(np.tri(5, dtype=bool))
    result = simplified(steps, tolerance_m=0.8)
    # Five steps of 1 m: their inner corners lie 1 / sqrt(2) below the line.
    assert same(result, shapely.Polygon([(0, 0), (5, 0), (5, 5), (4, 5), (0, 1)]))
    assert same(simplified(steps, tolerance_m=0.7), steps)


def test_a_notch_deeper_than_the_tolerance_stays() -> None:
    notch = shapely.box(0, 0, 20, 9) - shapely.box(6, 5, 14, 9)
    # Leaving out an inner corner reaches 8 * 4 / sqrt(8^2 + 4^2) = 3.58 m into it.
    assert simplified(notch, tolerance_m=3.5).equals(notch)
    assert vertex_count(simplified(notch, tolerance_m=3.6)) < 8


def test_a_budget_takes_the_cheapest_ground_first() -> None:
    house = shapely.Polygon([(0, 0), (10, 0), (10, 9), (9, 10), (0, 10)])
    assert simplified(house, max_vertices=5).equals(house)
    assert same(simplified(house, max_vertices=4), shapely.box(0, 0, 10, 10))  # half a square metre
    triangle = simplified(house, max_vertices=3)
    assert vertex_count(triangle) == 3 and triangle.covers(house)
    assert triangle.area == pytest.approx(200.0, rel=1e-6)  # twice the square


def test_parts_and_holes_go_only_when_the_budget_asks() -> None:
    ring = shapely.box(0, 0, 9, 9) - shapely.box(3, 3, 6, 6)
    assert len(simplified(ring, max_vertices=7).interiors) == 1
    assert same(simplified(ring, max_vertices=4), shapely.box(0, 0, 9, 9))
    two = shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(5, 0, 6, 1)])
    assert simplified(two, max_vertices=8).equals(two)
    assert same(simplified(two, max_vertices=4), shapely.box(0, 0, 6, 1))


def test_parts_share_a_budget_without_closing_what_lies_between_them() -> None:
    """They became one convex shape as soon as they had a corner too many: loose crowds closed a third more
    ground."""
    chipped = [(0, 0), (10, 0), (10, 9), (9, 10), (0, 10)]  # half a square metre
    notched = [(20, 0), (29, 0), (29, 9), (25, 9), (25, 8), (24, 8), (24, 9), (20, 9)]  # one
    two = shapely.MultiPolygon([shapely.Polygon(chipped), shapely.Polygon(notched)])
    assert same(simplified(two, max_vertices=12), two.union(shapely.box(0, 0, 10, 10)))
    squares = shapely.box(0, 0, 10, 10).union(shapely.box(20, 0, 29, 9))
    assert same(simplified(two, max_vertices=8), squares)
    island = shapely.box(0, 0, 9, 9) - shapely.box(2, 2, 7, 7)
    both = shapely.MultiPolygon([island, shapely.box(4, 4, 5, 5)])
    assert same(simplified(both, max_vertices=7), shapely.box(0, 0, 9, 9))


@settings(max_examples=300)
@given(
    cells=CELLS,
    tolerance_m=st.sampled_from([0.0, 0.5, 0.8, 2.0, 50.0]),
    max_vertices=st.sampled_from([None, 3, 4, 5, 8, 30]),
    scale=st.sampled_from([1.0, 0.3]),
    angle=st.sampled_from([0.0, 30.0, 123.4]),
    buffer_m=st.sampled_from([0.0, 0.7]),
)
def test_simplification_and_budgets_never_uncover(
    cells: NDArray[np.bool_],
    tolerance_m: float,
    max_vertices: int | None,
    scale: float,
    angle: float,
    buffer_m: float,
) -> None:
    ground = outline(cells)
    ground = shapely.affinity.rotate(shapely.affinity.scale(ground, scale, scale), angle)
    ground = grown(ground, buffer_m)
    result = simplified(ground, tolerance_m=tolerance_m, max_vertices=max_vertices)
    assert result.is_valid and result.covers(ground)
    if max_vertices is None:
        assert result.buffer(-1e-2).difference(ground.buffer(tolerance_m, quad_segs=32)).is_empty
        assert vertex_count(result) <= vertex_count(ground)
    else:
        assert vertex_count(result) <= max_vertices


@settings(max_examples=100)
@given(cells=CELLS, distance_m=st.floats(0.01, 20.0), seed=st.integers(0, 2**32 - 1))
def test_a_buffer_covers_everything_within_its_distance(
    cells: NDArray[np.bool_], distance_m: float, seed: int
) -> None:
    ground = outline(cells)
    result = grown(ground, distance_m)
    rng = np.random.default_rng(seed)
    low, high = np.array(ground.buffer(distance_m).bounds).reshape(2, 2)
    points = shapely.points(rng.uniform(low, high, (500, 2)))
    distances = shapely.distance(ground, points)
    assert shapely.covers(result, points[distances <= distance_m]).all()
    # Notches are filled, and GEOS leaves out inward corners of less than a hundredth of the distance.
    assert (shapely.distance(ground, points[shapely.covers(result, points)]) <= 1.05 * distance_m).all()


def test_a_buffer_too_small_for_floats_loses_no_ground() -> None:
    """GEOS made nothing of an outline of many corners, and the run ended in "POLYGON EMPTY"."""
    ground = outline(np.indices((9, 9)).sum(axis=0) % 2 == 0)
    for distance_m in (1e-300, 1e-12, 1e-6):
        assert shapely.covers(shapely.buffer(grown(ground, distance_m), 1e-9), ground)


def test_a_buffer_fills_a_slanting_wedge_of_a_hole() -> None:
    """It is wide along both axes, and thin: without the corner at its broad end two corners are left, and
    shapely says that a ring needs at least four."""
    ground = shapely.Point(0, 0).buffer(50.0) - shapely.Polygon([(0, 0), (20, 20), (19.8, 20.2)])
    assert grown(ground, 1.0).covers(shapely.Point(0, 0).buffer(50.9))


@st.composite
def outlines_of_any_shape(draw: st.DrawFn) -> shapely.Polygon | shapely.MultiPolygon:
    """Cells of any proportions, stars that are hardly ever convex, hulls, corners of every sharpness."""
    kind = draw(st.sampled_from(["cells", "star", "hull", "wedge"]))
    if kind == "cells":
        width, height = draw(st.floats(0.1, 3.0)), draw(st.floats(0.1, 3.0))
        return shapely.affinity.scale(outline(draw(CELLS)), width, height)
    if kind == "wedge":
        turn = np.radians(draw(st.floats(1.0, 179.0)))
        return shapely.Polygon([(0, 0), (40, 0), (40 * np.cos(turn), 40 * np.sin(turn))])
    count = draw(st.integers(3, 40))
    radius_m = np.array(draw(st.lists(st.floats(1.0, 50.0), min_size=count, max_size=count)))
    angle = 2 * np.pi * np.arange(count) / count
    star = shapely.Polygon(radius_m[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return star if kind == "star" else shapely.convex_hull(star)


@settings(max_examples=500)
@given(ground=outlines_of_any_shape(), distance_m=st.sampled_from([0.5, 1.0, 5.0, 30.0, 120.0]))
def test_the_edge_of_a_buffer_is_nowhere_nearer_than_its_distance(
    ground: shapely.Polygon | shapely.MultiPolygon, distance_m: float
) -> None:
    edge = shapely.boundary(grown(ground, distance_m))
    assert shapely.distance(edge, ground) >= distance_m


def test_an_arc_that_gets_too_few_segments_keeps_its_distance() -> None:
    """A turn of 22.4 degrees is 1.49 of the 15 degrees of a segment, and GEOS gives it one."""
    turn = np.radians(22.4)
    ground = shapely.Polygon([(-50, 0), (0, 0), (50 * np.cos(turn), 50 * np.sin(turn)), (-50, 30)])
    edge = shapely.boundary(grown(ground, 60.0))
    # The corner at the origin turns left; its arc is on the right, half way between the two normals.
    middle = 70.0 * np.array([np.sin(turn / 2), -np.cos(turn / 2)])
    reached = shapely.intersection(edge, shapely.LineString([(0, 0), middle]))
    assert 60.0 <= shapely.distance(shapely.Point(0, 0), reached) <= 60.0 * 1.0005


@pytest.mark.parametrize("between_m", [1e-3, 5e-3, 0.0118])
def test_an_arc_right_behind_another_corner_keeps_its_distance(between_m: float) -> None:
    """GEOS leaves out the first corner of its arc, so near the last of the one before: what is left spans
    more than the one and a half segments of the turn, and its middle was up to a millimetre too near."""
    before, turn = np.radians(5.0), np.radians(22.4999)
    west = (-between_m - 50 * np.cos(before), 50 * np.sin(before))
    ground = shapely.Polygon(
        [west, (-between_m, 0), (0, 0), (50 * np.cos(turn), 50 * np.sin(turn)), (-50, 60)]
    )
    assert 120.0 <= shapely.distance(shapely.boundary(grown(ground, 120.0)), ground) <= 120.0 * 1.0005


def test_holes_are_filled_by_area() -> None:
    cells = np.ones((9, 9), bool)
    cells[1, 1] = cells[4:7, 4:7] = False
    ground = outline(cells)
    assert [len(without_small_holes(ground, limit).interiors) for limit in (0.0, 0.9, 1.0, 8.0, 9.0)] == [
        2,
        2,
        1,
        1,
        0,
    ]
    assert without_small_holes(ground, 1.0).area == 72.0
    # Crowd in the middle of a hole is swallowed with it.
    cells[5, 5] = True
    (hole,) = without_small_holes(outline(cells), 1.0).geoms[0].interiors
    assert shapely.Polygon(hole).area == 9.0
    assert without_small_holes(outline(cells), 9.0).equals(shapely.box(0, 0, 9, 9))


@pytest.mark.parametrize(
    ("ground", "options", "message"),
    [
        (shapely.Polygon([(0, 0), (2, 2), (2, 0), (0, 2)]), {}, "must be a valid polygon"),  # crosses itself
        (shapely.Polygon(), {}, "must be a valid polygon that is not empty"),
        (shapely.box(0, 0, 1, 1), {"max_vertices": 2}, "max_vertices is 2; a polygon has at least 3"),
    ],
)
def test_what_is_no_outline_is_refused(
    ground: shapely.Polygon, options: dict[str, int], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        simplified(ground, **options)


def test_a_large_outline_keeps_its_budget() -> None:
    field = ndimage.gaussian_filter(np.random.default_rng(0).random((120, 120)), 3) > 0.505
    ground = max(outline(field).geoms, key=lambda part: part.area)
    result = simplified(ground, max_vertices=60)
    assert vertex_count(ground) > 500 and vertex_count(result) <= 60
    assert result.covers(ground)
    assert result.area < shapely.convex_hull(ground).area


def test_three_corners_cover_an_outline_with_coordinates_as_large_as_those_of_utm() -> None:
    """South of the equator northings are just below 10,000 km: the triangle covered less than the outline,
    and the run ended."""
    outline = grown(shapely.box(9.9e6, -9.9e6, 9.9e6 + 1.0, -9.9e6 + 1.0), 7.3)
    triangle = simplified(outline, max_vertices=3)
    assert vertex_count(triangle) == 3 and triangle.covers(outline)
    # Half of a right-angled rectangle of twice the sides, which is that around the outline.
    assert triangle.area == pytest.approx(2.0 * 15.8862**2, rel=0.01)


def test_a_needle_fits_into_three_corners() -> None:
    """Its own triangle would be so sharp that its mitre is cut off."""
    needle = shapely.Polygon([(0, 0), (200, 1e-5), (200, 2e-5), (100, 2e-5)])
    triangle = simplified(needle, max_vertices=3)
    assert vertex_count(triangle) == 3 and triangle.covers(needle)


@settings(max_examples=30)
@given(
    # Whole decimetres: the hull that the outline is made of fails on corners 1e-170 m apart.
    corners=st.lists(st.tuples(DECIMETRES, DECIMETRES), min_size=8, max_size=40, unique=True),
    ratio=st.sampled_from([0.0, 0.3, 1.0]),
)
def test_ever_smaller_budgets_give_what_each_gives_alone(
    corners: list[tuple[int, int]], ratio: float
) -> None:
    """Convex outlines, where nothing can be in the way, and others."""
    points = shapely.MultiPoint(np.array(corners) / 10.0)
    outline = shapely.concave_hull(points, ratio).buffer(1.0, quad_segs=2)
    fewer = FewerCorners(outline)
    for budget in (20, 11, 7, 4, 3):
        assert fewer.within(budget).equals_exact(simplified(outline, max_vertices=budget), 0.0)
        assert fewer.within(budget).covers(outline)
