"""Slope, suitable area and prior on surfaces whose answer is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence import landing_area as module
from crowdfence._core import Terrain
from crowdfence.landing_area import (
    VOXEL_SLOPE_WINDOW,
    column_tops_m,
    landing_prior,
    landing_suitable,
    slope_deg,
)


def plane(slope: float, azimuth: float, size: int = 30, cell_size_m: float = 1.0) -> np.ndarray:
    """Height map of a tilted plane: `slope` and `azimuth` in degrees."""
    x, y = np.mgrid[0:size, 0:size] * cell_size_m
    towards = np.cos(np.radians(azimuth)) * x + np.sin(np.radians(azimuth)) * y
    return np.asarray(np.tan(np.radians(slope)) * towards)


@given(
    st.floats(0, 80),
    st.floats(0, 360),
    st.sampled_from([0.5, 2.0]),
    st.sampled_from([3, 7]),
    st.floats(-1e4, 1e4),
)
@settings(max_examples=30)
def test_a_plane_has_its_slope_everywhere(
    slope: float, azimuth: float, cell_size_m: float, window: int, offset_m: float
) -> None:
    """At the edges, in the corners and around a hole too; and on a map cut into many strips."""
    height = plane(slope, azimuth, 12, cell_size_m) + offset_m
    height[5, 6] = np.nan
    measured = slope_deg(height, cell_size_m, window_cells=window)
    assert np.isnan(measured[5, 6])
    measured[5, 6] = slope
    np.testing.assert_allclose(measured, slope, atol=2e-3)


def test_strips_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    height = np.random.default_rng(3).normal(size=(23, 17))
    whole = slope_deg(height, 1.0, window_cells=5)
    suitable = landing_suitable(height, 1.0, 30.0, 3.0)
    monkeypatch.setattr(module, "_CELLS_PER_STRIP", 40)
    np.testing.assert_allclose(slope_deg(height, 1.0, window_cells=5), whole, rtol=1e-5)
    np.testing.assert_array_equal(landing_suitable(height, 1.0, 30.0, 3.0), suitable)


def test_heights_beyond_a_hole_do_not_count() -> None:
    height = np.zeros((11, 6))
    height[5] = np.nan
    height[6:] = 100.0
    measured = slope_deg(height, 1.0)
    assert (measured[:5] == 0.0).all() and (measured[6:] == 0.0).all() and np.isnan(measured[5]).all()


def test_too_little_to_fit_is_unknown_not_flat() -> None:
    assert np.isnan(slope_deg(np.zeros((9, 1)), 1.0)).all()  # all in one line
    alone = np.full((9, 9), np.nan)
    alone[4, 4] = 0.0
    assert np.isnan(slope_deg(alone, 1.0)).all()
    assert not landing_suitable(alone, 1.0, 15.0, 0.0).any()


def test_terrace_above_a_steep_hill() -> None:
    """Columns 0-9 flat, then 45 degrees. Column 9 sees the first step (1 m over 2 m, 27 degrees)."""
    height = np.maximum(np.arange(20) - 9, 0)[:, None].repeat(10, axis=1)
    suitable = landing_suitable(height, 1.0, 15.0, min_area_m2=90.0)
    assert suitable[:9].all() and not suitable[9:].any()
    assert not landing_suitable(height, 1.0, 15.0, min_area_m2=91.0).any()
    assert landing_suitable(height, 2.0, 15.0, min_area_m2=360.0)[
        :9
    ].all()  # the same cells, four times the area


def test_touching_at_a_corner_is_not_connected() -> None:
    height = np.full((6, 6), np.nan)
    height[:3, :3] = height[3:, 3:] = 0.0
    assert np.count_nonzero(landing_suitable(height, 1.0, 15.0, 9.0)) == 18
    assert not landing_suitable(height, 1.0, 15.0, 10.0).any()


def test_the_limit_itself_is_allowed() -> None:
    assert landing_suitable(plane(15.0, 20.0), 1.0, 15.0, 0.0).all()
    assert not landing_suitable(plane(15.0, 20.0), 1.0, 14.99, 0.0).any()


@given(st.integers(0, 2**32 - 1), st.floats(0, 200), st.floats(0, 200), st.floats(0, 60), st.floats(0, 60))
@settings(max_examples=30)
def test_stricter_limits_never_add_ground(
    seed: int, area: float, other_area: float, slope: float, other_slope: float
) -> None:
    height = np.random.default_rng(seed).normal(size=(20, 20)).cumsum(axis=0)
    lenient = landing_suitable(height, 1.0, max(slope, other_slope), min(area, other_area))
    strict = landing_suitable(height, 1.0, min(slope, other_slope), max(area, other_area))
    assert not (strict & ~lenient).any()


@given(st.floats(0, 10), st.floats(20, 60), st.floats(0, 360))
@settings(max_examples=20)
def test_steps_of_voxels_are_not_taken_for_slopes(gentle: float, steep: float, azimuth: float) -> None:
    """Rounded up to whole voxels, a plane of up to 10 degrees passes a limit of 15 and one of 20 does not."""

    def voxel_slopes(slope: float) -> np.ndarray:
        tops = np.ceil(plane(slope, azimuth))
        return slope_deg(tops, 1.0, window_cells=VOXEL_SLOPE_WINDOW)[5:-5, 5:-5]

    assert (voxel_slopes(gentle) <= 15.0).all()
    assert (voxel_slopes(steep) > 15.0).all()


def terrace_terrain() -> Terrain:
    """40 x 20 columns of 2 m: flat up to i = 19, then two voxels up per column; not at index 0."""
    occupied = np.zeros((43, 21, 48), np.bool_)
    for i in range(40):
        occupied[i + 3, 1:, 5 + 2 * max(i - 19, 0)] = True
    return Terrain.from_occupancy(occupied, 2.0, origin=(-500.0, 1000.0, 300.0))


def test_column_tops() -> None:
    """The top of the lowest voxel is one voxel, 2 m, above the lowest corner."""
    tops = column_tops_m(terrace_terrain())
    expected = 2.0 + 4.0 * np.maximum(np.arange(40) - 19, 0)
    np.testing.assert_array_equal(tops, expected[:, None].repeat(20, axis=1))


def test_the_highest_voxel_of_a_column_counts_and_gaps_are_holes() -> None:
    occupied = np.zeros((3, 1, 4), np.bool_)
    occupied[0, 0, [0, 3]] = True
    occupied[2, 0, 1] = True
    np.testing.assert_array_equal(
        column_tops_m(Terrain.from_occupancy(occupied, 0.5))[:, 0], [2.0, np.nan, 1.0]
    )


def test_prior_of_a_terrace() -> None:
    """Nine cells, sum of squared offsets 60. Column 16 has one raised, at offset 4: 2 * 4 / 60, 7.6 degrees.
    Column 17 has two: (2 * 3 + 4 * 4) / 60, 20 degrees. So 17 of 40 columns up to 15 degrees, 16 up to 5."""
    terrain = terrace_terrain()
    assert landing_prior(terrain) == pytest.approx(17 / 40)
    assert landing_prior(terrain, 5.0, 100.0) == pytest.approx(16 / 40)
    assert landing_prior(terrain, 15.0, 17 * 20 * 4.0) == pytest.approx(17 / 40)


def test_a_prior_of_zero_or_one_is_refused() -> None:
    with pytest.raises(ValueError, match=r"0 of 800 columns .* must lie inside \(0, 1\)"):
        landing_prior(terrace_terrain(), 15.0, 17 * 20 * 4.0 + 1.0)
    flat = Terrain.from_occupancy(np.ones((12, 12, 1), np.bool_), 1.0)
    with pytest.raises(ValueError, match="144 of 144 columns"):
        landing_prior(flat)


def test_a_map_that_spans_too_much_is_refused_before_it_is_gridded() -> None:
    far_apart = Terrain.from_points([[0.5, 0.5, 0.5], [50_000.5, 50_000.5, 0.5]], 1.0)
    with pytest.raises(ValueError, match="spans 50001 x 50001 columns"):
        landing_prior(far_apart)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"max_slope_deg": 90.0}, r"max_slope_deg must lie in \[0, 90\), got 90"),
        ({"max_slope_deg": np.nan}, "max_slope_deg"),
        ({"min_area_m2": -1.0}, "min_area_m2 must be a finite area"),
        ({"cell_size_m": 0.0}, "cell_size_m must be positive"),
        ({"window_cells": 4}, "window_cells must be odd and at least 3, got 4"),
        ({"height_m": np.zeros(4)}, r"height_m must be numbers \[X, Y\], got float64 \[4\]"),
        ({"height_m": np.full((3, 3), np.inf)}, "must not be infinite"),
    ],
)
def test_bad_input(change: dict[str, object], message: str) -> None:
    arguments = {"height_m": np.zeros((5, 5)), "cell_size_m": 1.0} | change
    with pytest.raises(ValueError, match=message):
        landing_suitable(**arguments)  # type: ignore[arg-type]
