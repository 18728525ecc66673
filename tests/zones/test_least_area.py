"""Which regions are large enough for a zone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from crowdfence import find_zones
from crowdfence.zones.least_area import columns_with_nearby, least_columns, of_those_kept
from crowdfence.zones.regions import Runs, largest_first
from crowdfence.zones.tracker import column_keys
from support.small_crowd_maps import flat_crowd_map
from support.small_zones import DrawnZones, ids


def drawn(picture: str) -> NDArray[np.int64]:
    """Columns (i, j) of the marks, sorted; i to the right, j downwards."""
    rows = picture.split()
    return np.array(sorted((i, j) for j, row in enumerate(rows) for i, mark in enumerate(row) if mark == "#"))


def regions_of(columns: NDArray[np.int64]) -> NDArray[np.int64]:
    runs = Runs.of(columns)
    return np.repeat(largest_first(runs), runs.length)


@pytest.mark.parametrize(
    ("area_m2", "voxel_size_m", "columns"),
    [
        (3.0, 0.5, 12),
        (4.0, 0.1, 400),
        (49.0, 0.7, 100),
        (3.0, 1.0, 3),
        (3.1, 1.0, 4),
        (3.0, 2.0, 1),
        (0.0, 0.5, 0),
    ],
)
def test_an_area_is_so_many_columns(area_m2: float, voxel_size_m: float, columns: int) -> None:
    assert least_columns(area_m2, voxel_size_m) == columns


def test_small_regions_are_measured_with_what_lies_within_two_metres() -> None:
    """Columns of 1 m: 2 m from middle to middle leave one column free."""
    columns = drawn("""
        ####.#....#.#.#....#
        ####...............#
        ....................""")
    found = columns_with_nearby(column_keys(columns), regions_of(columns), 3, 1.0)
    # The large region keeps its own 8, beside which one column counts as 9; three in a row hold each other's.
    # The two at the east end are alone.
    assert sorted(found.tolist()) == [2, 3, 3, 3, 8, 9]


def test_large_regions_do_not_chain_small_ones_beyond_their_reach() -> None:
    """Without any small region nothing is looked for; a small one 3 m away from all stays alone."""
    columns = drawn("####..#")
    assert columns_with_nearby(column_keys(columns), regions_of(columns), 3, 1.0).tolist() == [4, 1]
    assert columns_with_nearby(column_keys(columns), regions_of(columns), 1, 1.0).tolist() == [4, 1]


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    share=st.sampled_from([0.02, 0.1, 0.25]),
    least=st.integers(0, 12),
    voxel_size_m=st.sampled_from([0.3, 0.5, 1.0, 1.9, 2.5]),
)
def test_nearby_is_what_looking_at_every_pair_says(
    seed: int, share: float, least: int, voxel_size_m: float
) -> None:
    rng = np.random.default_rng(seed)
    columns = np.argwhere(rng.random((30, 30)) < share) - 15
    region = regions_of(columns) if len(columns) else np.empty(0, np.int64)
    size = np.bincount(region)
    linked = {number: {number} for number in range(len(size))}
    for one, other in np.argwhere(size[region][:, None] + size[region][None] > 0):
        a, b = region[one], region[other]
        if min(size[a], size[b]) < least:
            apart_m = np.hypot(*(columns[one] - columns[other])) * voxel_size_m
            if apart_m <= 2.0 and linked[a] is not linked[b]:
                linked[a] |= linked[b]
                for number in linked[a]:
                    linked[number] = linked[a]
    expected = [
        sum(size[list(linked[number])]) if size[number] < least else size[number]
        for number in range(len(size))
    ]
    found = columns_with_nearby(column_keys(columns), region, least, voxel_size_m)
    assert found.tolist() == expected


def test_regions_are_numbered_anew_without_those_left_out() -> None:
    region = np.array([0, 0, 1, 2, 3, -1])[:5]
    assert of_those_kept(region, np.array([True, False, True, True])).tolist() == [0, 0, -1, 1, 2]


def test_a_crowd_that_comes_apart_is_a_zone_and_a_lone_speck_is_none() -> None:
    """Seen through leaves: four pieces, none of 3 m2, a metre apart."""
    zones = DrawnZones((16, 3), min_area_m2=3.0)
    first = zones.drawn("""
        #.#.......##....
        ................
        #.#.............""")
    assert ids(first) == ["Z1", "Z2", "Z3", "Z4"]
    assert (first.dropped_count, first.dropped_area_m2) == (1, 2.0)


def test_one_look_at_a_map_measures_as_zones_that_last_do() -> None:
    probability = np.zeros((16, 3))
    probability[[0, 2, 0, 2, 10, 11], [0, 0, 2, 2, 0, 0]] = 0.9
    zones = find_zones(flat_crowd_map(probability), 0, threshold=0.5, min_area_m2=3.0)
    assert [zone.cell_count for zone in zones] == [1, 1, 1, 1]
    assert (zones.dropped_count, zones.dropped_area_m2) == (1, 2.0)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.sampled_from([0.05, 0.2, 0.5]), steps=st.integers(1, 4))
def test_all_crowd_is_in_a_zone_or_told_as_left_out(seed: int, share: float, steps: int) -> None:
    """Whatever comes and goes: no column that is held closed is in neither."""
    rng = np.random.default_rng(seed)
    zones = DrawnZones((20, 20), min_area_m2=3.0)
    for _ in range(steps):
        crowd = rng.random((20, 20)) < share
        step = zones.step(crowd.astype(float))
        assert sum(zone.cell_count for zone in step) + step.dropped_area_m2 == np.count_nonzero(crowd)
