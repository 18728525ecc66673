"""Sets of columns as sorted keys, against numpy's own."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from crowdfence.zones.sorted_keys import are_among, distinct, united
from crowdfence.zones.tracker import column_keys, column_places

# Few enough places that two drawn sets share some, both signs of i and j.
KEYS = st.lists(st.tuples(st.integers(-4, 4), st.integers(-4, 4)), max_size=60).map(
    lambda places: column_keys(np.array(places, dtype=np.int64).reshape(-1, 2))
)


@given(KEYS)
def test_distinct_keys_are_those_of_numpy(keys: np.ndarray) -> None:
    np.testing.assert_array_equal(distinct(keys), np.unique(keys))


@given(KEYS.map(np.unique), KEYS.map(np.unique))
def test_the_union_is_that_of_numpy(first: np.ndarray, second: np.ndarray) -> None:
    np.testing.assert_array_equal(united(first, second), np.union1d(first, second))
    assert united(first, second).dtype == np.int64


@given(KEYS, KEYS)
def test_what_is_among_others_is_that_of_numpy(keys: np.ndarray, others: np.ndarray) -> None:
    np.testing.assert_array_equal(are_among(keys, others), np.isin(keys, others))
    of_rows = np.stack([keys, keys + 1])
    np.testing.assert_array_equal(are_among(of_rows, others), np.isin(of_rows, others))


def test_many_columns_of_a_large_map() -> None:
    """160,000 columns around the origin, and 2000 that overlap them or lie beyond."""
    i, j = np.divmod(np.arange(400 * 400), 400)
    map_keys = column_keys(np.stack([i - 200, j - 200], axis=1))
    random = np.random.default_rng(1)
    some = np.unique(column_keys(random.integers(-250, 250, (2000, 2))))
    inside = are_among(some, map_keys)
    i, j = column_places(some).T
    np.testing.assert_array_equal(inside, (np.abs(i + 0.5) < 200) & (np.abs(j + 0.5) < 200))
    assert 0 < inside.sum() < len(some)
    both = united(map_keys, some)
    assert len(both) == len(map_keys) + (~inside).sum() and (np.diff(both) > 0).all()
