"""Which columns belong together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from crowdfence.zones.regions import Runs, largest_first, reach_columns
from support.small_zones import drawing


def region_of(columns: NDArray[np.int64], reach: float) -> list[int]:
    runs = Runs.of(columns)
    return np.repeat(largest_first(runs, reach), runs.length).tolist()


@pytest.mark.parametrize(
    ("picture", "reach", "regions"),
    [
        ("#.#", 0.0, [0, 1]),
        ("#.#", 2.0, [0, 0]),
        ("#.#", 1.99, [0, 1]),
        ("#..#", 2.0, [0, 1]),
        ("#\n.\n#", 2.0, [0, 0]),
        ("#\n.\n.\n#", 2.0, [0, 1]),
        # Corners touch at any reach: 1.41 columns.
        ("#.\n.#", 0.0, [0, 0]),
        ("#.\n.#", 0.4, [0, 0]),
        # A knight's move is 2.24 columns, two steps each way are 2.83.
        ("#..\n..#", 2.2, [0, 1]),
        ("#..\n..#", 2.3, [0, 0]),
        ("#..\n...\n..#", 2.8, [0, 1]),
        ("#..\n...\n..#", 2.9, [0, 0]),
        # 3, 4 and 5: a whole number as a root.
        ("#...\n....\n....\n....\n...#", 5.0, [0, 0]),
        ("#...\n....\n....\n....\n...#", 4.999, [0, 1]),
    ],
)
def test_columns_within_reach_are_one_region(picture: str, reach: float, regions: list[int]) -> None:
    assert region_of(np.argwhere(drawing(picture)), reach) == regions


def test_from_one_to_the_next_a_region_reaches_far() -> None:
    assert region_of(np.argwhere(drawing("#.#.#.#.#..##")), 2.0) == [0, 0, 0, 0, 0, 1, 1]


def test_two_metres_are_so_many_columns() -> None:
    assert [reach_columns(size) for size in (0.1, 0.5, 2.0, 4.0)] == [20.0, 4.0, 1.0, 0.5]


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    share=st.sampled_from([0.01, 0.05, 0.2, 0.6]),
    reach=st.one_of(st.floats(0.0, 9.0), st.sampled_from([1.0, 2.0, 2**0.5, 5**0.5, 5.0])),
)
def test_regions_are_those_that_looking_at_every_pair_finds(seed: int, share: float, reach: float) -> None:
    rng = np.random.default_rng(seed)
    columns = np.argwhere(rng.random((25, 30)) < share) - rng.integers(-40, 40, 2)
    apart = np.abs(columns[:, None] - columns[None])
    joined = (apart.max(axis=2) <= 1) | (np.hypot(*apart.transpose(2, 0, 1)) <= reach * (1.0 + 1e-13))
    region, before = np.arange(len(columns)), None
    while not np.array_equal(region, before):
        before, region = region, np.array([region[near].min() for near in joined], dtype=np.int64)
    size = np.bincount(region, minlength=len(columns))
    # The largest first; of equal ones that with the first column, which is its number here.
    order = sorted(set(region.tolist()), key=lambda first: (-size[first], first))
    assert region_of(columns, reach) == [order.index(first) for first in region]
