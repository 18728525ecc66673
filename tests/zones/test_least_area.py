"""Which regions are large enough for a zone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence import find_zones
from crowdfence.zones.least_area import least_columns, of_those_kept
from support.small_crowd_maps import flat_crowd_map
from support.small_zones import DrawnZones, ids


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


def test_regions_are_numbered_anew_without_those_left_out() -> None:
    region = np.array([0, 0, 1, 2, 3, -1])[:5]
    assert of_those_kept(region, np.array([True, False, True, True])).tolist() == [0, 0, -1, 1, 2]


def test_a_crowd_that_comes_apart_is_a_zone_and_a_lone_speck_is_none() -> None:
    """Seen through leaves: four pieces, none of 3 m2, a metre apart. They are one zone."""
    zones = DrawnZones((16, 3), min_area_m2=3.0)
    first = zones.drawn("""
        #.#.......##....
        ................
        #.#.............""")
    assert ids(first) == ["Z1"] and first.zones[0].cell_count == 4
    assert (first.dropped_count, first.dropped_area_m2) == (1, 2.0)


def test_one_look_at_a_map_measures_as_zones_that_last_do() -> None:
    probability = np.zeros((16, 3))
    probability[[0, 2, 0, 2, 10, 11], [0, 0, 2, 2, 0, 0]] = 0.9
    zones = find_zones(flat_crowd_map(probability), 0, threshold=0.5, min_area_m2=3.0)
    assert [zone.cell_count for zone in zones] == [4]
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
