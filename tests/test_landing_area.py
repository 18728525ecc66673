"""Slope, suitable area and prior on surfaces whose answer is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence import landing_area as module
from crowdfence._core import Terrain
from crowdfence.landing_area import (
    column_surface_m,
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
    """Bare voxels of a plane of up to 10 degrees pass a limit of 15, those of one of 20 do not."""

    def voxel_slopes(slope: float) -> np.ndarray:
        closed = Terrain.from_height_map(plane(slope, azimuth), 1.0)
        bare = Terrain.from_indices(closed.voxel_indices(np.arange(closed.voxel_count)), 1.0)
        return slope_deg(column_surface_m(bare), 1.0)[5:-5, 5:-5]

    assert (voxel_slopes(gentle) <= 15.0).all()
    assert (voxel_slopes(steep) > 15.0).all()


# Columns of 2 m: level up to i = 19, then 0.4 m up per column to i = 29, then 4 m.
TERRACE_M = np.cumsum([0.0] * 20 + [0.4] * 10 + [4.0] * 10)


def terrace_terrain() -> Terrain:
    """40 x 20 columns; the first of them is not at index 0."""
    height_m = np.full((43, 21), np.nan)
    height_m[3:, 1:] = TERRACE_M[:, None]
    return Terrain.from_height_map(height_m, 2.0, origin=(-500.0, 1000.0, 300.0))


def test_column_surface() -> None:
    """The level ground lies in the lowest face of its voxels."""
    surface_m = column_surface_m(terrace_terrain())
    np.testing.assert_allclose(surface_m, TERRACE_M[:, None].repeat(20, axis=1), atol=0.001)


@pytest.mark.parametrize("is_bare", [False, True], ids=["mesh", "bare voxels"])
def test_the_surface_of_a_slope_is_what_a_ray_from_above_meets(is_bare: bool) -> None:
    """There a column has voxels below the one in which its surface lies, and these reach no higher."""
    rise = 40.0 * np.tan(np.radians(40.0))
    corners = np.array([[0, 0, 0], [40, 0, rise], [40, 40, rise], [0, 40, 0]], dtype=float)
    terrain = Terrain.from_triangles(corners, np.array([[0, 1, 2], [0, 2, 3]]), 1.0)
    if is_bare:
        terrain = Terrain.from_indices(terrain.voxel_indices(np.arange(terrain.voxel_count)), 1.0)
    surface_m = column_surface_m(terrain)
    at = np.stack(np.meshgrid(*(np.arange(side) for side in surface_m.shape), indexing="ij"), -1)
    (west, south, lowest), (_, _, highest) = terrain.bounds
    above = np.empty((surface_m.size, 3))
    above[:, :2] = at.reshape(-1, 2) + np.array([west + 0.5, south + 0.5])
    above[:, 2] = highest + 10.0
    down = np.tile([0.0, 0.0, -1.0], (len(above), 1))
    _, distance_m = terrain.raycast(above, down, 1000.0)
    np.testing.assert_allclose(surface_m.ravel(), above[:, 2] - distance_m - lowest, atol=1e-4)


def test_the_highest_voxel_of_a_column_counts_and_gaps_are_holes() -> None:
    """Bare voxels without neighbours: their surface is taken to be half way up."""
    occupied = np.zeros((5, 1, 4), np.bool_)
    occupied[0, 0, [0, 3]] = True
    occupied[4, 0, 1] = True
    surface_m = column_surface_m(Terrain.from_occupancy(occupied, 0.5))[:, 0]
    np.testing.assert_array_equal(surface_m, [1.75, np.nan, np.nan, np.nan, 0.75])


def test_prior_of_a_terrace() -> None:
    """Column 19 has 0.4 m over the 4 m between its neighbours, 5.7 degrees; those up to 28 have 0.8 m, 11.3
    degrees; column 29 has 4.4 m, 48 degrees. So 29 of 40 columns up to 15 degrees, 19 up to 5."""
    terrain = terrace_terrain()
    assert landing_prior(terrain) == pytest.approx(29 / 40)
    assert landing_prior(terrain, 5.0, 100.0) == pytest.approx(19 / 40)
    assert landing_prior(terrain, 15.0, 29 * 20 * 4.0) == pytest.approx(29 / 40)


def test_a_prior_of_zero_or_one_is_refused() -> None:
    with pytest.raises(ValueError, match=r"0 of 800 columns .* must lie inside \(0, 1\)"):
        landing_prior(terrace_terrain(), 15.0, 29 * 20 * 4.0 + 1.0)
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
        ({"height_m": np.ma.masked_all((3, 3))}, r"heights \(NaN marks a hole\) are masked"),
    ],
)
def test_bad_input(change: dict[str, object], message: str) -> None:
    arguments = {"height_m": np.zeros((5, 5)), "cell_size_m": 1.0} | change
    with pytest.raises(ValueError, match=message):
        landing_suitable(**arguments)  # type: ignore[arg-type]
