"""Who stands in a zone, and how much ground that closes: worked by hand on a plain."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence import CrowdMap, Observation, Or, Terrain
from crowdfence.detector.contract.contract import Validity
from crowdfence.evaluation.safety import (
    BUFFERS_M,
    CrowdsInView,
    CrowdWatch,
    Safety,
    _in_range,
    areas_m2,
    distance_m,
    states_range,
)
from crowdfence.sources.recording import Recording

PLAIN = Terrain.from_occupancy(np.ones((40, 40, 1), bool), 1.0)


def cells(*columns: tuple[int, int]) -> np.ndarray:
    return np.array(columns, np.int64).reshape(-1, 2)


def test_people_are_as_far_from_a_zone_as_from_its_edge() -> None:
    zone = cells((10, 10), (11, 10), (12, 10))
    people = cells((11, 10), (13, 10), (16, 10), (14, 13), (11, 8))
    # In it; beside its edge, half a column away; 3.5 columns; 1.5 and 2.5; 1.5.
    expected = [0.0, 0.5, 3.5, np.hypot(1.5, 2.5), 1.5]
    np.testing.assert_allclose(distance_m(people, zone, 1.0), expected)
    np.testing.assert_allclose(distance_m(people, zone, 0.5), np.array(expected) / 2.0)
    assert np.isinf(distance_m(people, cells(), 1.0)).all()


def test_ground_is_closed_as_far_as_the_buffer_reaches() -> None:
    none, two, *_ = areas_m2(cells((0, 0)), 1.0)
    assert none == 1.0
    assert two == 21.0  # columns whose middle is within 2 m of its edges: 5 x 5 without the corners
    np.testing.assert_array_equal(areas_m2(cells(), 1.0), np.zeros(len(BUFFERS_M)))


@pytest.mark.parametrize("size_m", [0.5, 1.0])
def test_as_much_ground_is_closed_as_a_buffer_around_the_outline_holds(size_m: float) -> None:
    """GEOS draws it around the columns themselves. From their middles it would be up to 29 % less."""
    zone = np.argwhere(np.random.default_rng(3).random((30, 20)) < 0.05)
    outline = shapely.union_all(shapely.box(*(zone * size_m).T, *((zone + 1) * size_m).T))
    drawn = [outline.buffer(buffer_m, quad_segs=64).area for buffer_m in BUFFERS_M]
    np.testing.assert_allclose(areas_m2(zone, size_m), drawn, rtol=0.02)


@given(st.integers(-700, 700), st.integers(-700, 700), st.sampled_from([0.05, 0.5, 1.0]))
@settings(max_examples=20, deadline=None)
def test_a_zone_closes_as_much_ground_wherever_it_lies(east: int, north: int, size_m: float) -> None:
    """Beside another one, 5000 columns away, so that it lies across the tiles in every way."""
    zone, other = cells((0, 0), (1, 0), (1, 1), (7, 3), (30, 2)), cells((-5000, -5000))
    both = areas_m2(np.vstack([other, zone + np.array([east, north])]), size_m)
    expected = areas_m2(zone, size_m) + areas_m2(other, size_m)
    np.testing.assert_allclose(both, expected, rtol=1e-12)


def test_zones_far_apart_close_the_ground_of_each() -> None:
    """The grid between them would be 10 GB."""
    zone = cells((0, 0), (1, 0))
    twice = areas_m2(np.vstack([zone, zone + 100_000]), 1.0)
    np.testing.assert_array_equal(twice, 2.0 * areas_m2(zone, 1.0))


def look(called: list[int]) -> Observation:
    """Every voxel seen, some called crowd."""
    ids = np.arange(PLAIN.voxel_count)
    return Observation(
        PLAIN,
        "a",
        0,
        voxel_ids=ids,
        mean=np.isin(ids, called).astype(float),
        pixel_count=np.ones(len(ids), int),
        range_m=np.full(len(ids), 10.0),
        tilt_deg=np.full(len(ids), 90.0),
        occluded_ids=[],
    )


def crowd_map(called: list[int]) -> CrowdMap:
    result = CrowdMap(PLAIN, Or())
    result.integrate_observations([look(called)], 0)
    return result


def test_shares_count_people_and_ground() -> None:
    # Four people stand at x = 10, 11, 13 and 20; the map calls x = 10 alone crowd. The last is out of range.
    people = cells((10, 5), (11, 5), (13, 5), (20, 5))
    ids = PLAIN.voxel_ids(np.column_stack([people, np.zeros(4, int)]))
    crowds = CrowdsInView(people, np.array([True, True, True, False]), ids, people)
    safety = Safety()
    safety.add(crowds, crowd_map([int(ids[0])]), 0, 0.5, people[:1])
    np.testing.assert_allclose(safety.share_in_zone, [1 / 4, 2 / 4, 3 / 4, 4 / 4])
    np.testing.assert_allclose(safety.share_in_zone_in_range, [1 / 3, 2 / 3, 1.0, 1.0])
    assert safety.share_on_empty == 3 / 4  # all but the first: `or` calls what it does not call crowd empty
    assert safety.blocked_per_own[0] == 1 / 4
    np.testing.assert_allclose(
        safety.blocked_per_own[2], areas_m2(people[:1], 1.0)[2] / areas_m2(people, 1.0)[2]
    )
    # Of four columns the zone holds one, with 2 m also the next, with 5 m the third, with 10 m all.
    np.testing.assert_allclose(safety.share_missed_m2, [3 / 4, 2 / 4, 1 / 4, 0.0])
    # A minute later nobody has looked again: that is empty for 90 s alone.
    for stale_after_s, on_empty in ((30.0, 0.0), (90.0, 3 / 4)):
        later = Safety()
        later.add(crowds, crowd_map([int(ids[0])]), 60 * 10**9, 0.5, people[:1], stale_after_s)
        assert later.share_on_empty == on_empty
    # A second moment without anybody changes no share.
    nobody = CrowdsInView(cells(), np.zeros(0, bool), np.zeros(0, np.int64), cells())
    safety.add(nobody, crowd_map([]), 0, 0.5, cells())
    np.testing.assert_allclose(safety.share_in_zone, [1 / 4, 2 / 4, 3 / 4, 4 / 4])


def test_what_is_closed_where_no_crowd_is_in_view_is_counted() -> None:
    """A multiple of the crowds' own ground says nothing of it: there is none of that."""
    nobody = CrowdsInView(cells(), np.zeros(0, bool), np.zeros(0, np.int64), cells())
    safety = Safety()
    safety.add_zone(nobody, cells((10, 10)), 1.0)
    safety.add_zone(nobody, cells(), 1.0)
    # One column at one of two moments, and the 21 whose middle lies within 2 m of it.
    np.testing.assert_allclose(safety.closed_m2[:2], [1 / 2, 21 / 2])
    assert np.isnan(safety.blocked_per_own).all()
    assert np.isnan(Safety().closed_m2).all()


def test_no_people_leave_the_shares_unknown() -> None:
    assert np.isnan(Safety().share_in_zone).all()
    assert np.isnan(Safety().share_on_empty)
    assert np.isnan(Safety().blocked_per_own).all()


@pytest.mark.parametrize(
    ("tested", "stated", "inside"),
    [
        (None, False, True),
        (Validity(), False, True),
        (Validity(distance_m=(1.0, 10.0)), True, True),
        (Validity(distance_m=(1.0, 9.0)), True, False),
        (Validity(tilt_deg=(20.0, 90.0)), True, True),
    ],
)
def test_in_range_is_what_the_detector_states_whichever_quantity(
    tested: Validity | None, stated: bool, inside: bool
) -> None:
    """One that states distances alone had every look in range."""
    assert states_range(tested) == stated
    assert _in_range(look([]), tested).all() == inside
    assert _in_range(look([]), tested).any() == inside


def test_a_recording_that_knows_nobody_is_refused() -> None:
    bare = Recording("bare", ("a",), (), None, None, (), (), {}, {})
    with pytest.raises(ValueError, match="bare does not record where people are"):
        CrowdWatch(bare, PLAIN, Validity())
