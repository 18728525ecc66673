"""`crowdfence.Terrain` from Python: construction and raycast against brute force, and what is refused."""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from crowdfence import CrowdfenceError, Georeference, Terrain
from crowdfence._core import raised
from support.slow_projection import DenseTerrain

Array = NDArray[np.float64]

UTM = (691_607.86, 5_334_759.86, 519.25)
ORIGINS = pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (-3.3, 7.25, 1e3), UTM])

occupancies = arrays.arrays(
    np.bool_, st.tuples(*[st.integers(1, 9)] * 3), elements=st.sampled_from([True, False, False])
).filter(np.any)
# Steps up to 12 m between neighbours of 1 m: rougher than any terrain.
rough_heights = arrays.arrays(
    np.float32, st.tuples(st.integers(2, 8), st.integers(2, 8)), elements=st.floats(-6.0, 6.0, width=32)
)


def _indices(terrain: Terrain) -> NDArray[np.int64]:
    return terrain.voxel_indices(np.arange(terrain.voxel_count))


def _sorted(indices: NDArray[Any]) -> list[list[int]]:
    return sorted(indices.tolist())


# --- construction


@given(
    occupied=occupancies, origin=st.sampled_from([(0.0, 0.0, 0.0), UTM]), voxel_size_m=st.floats(0.05, 20.0)
)
def test_occupied_cells_become_voxels(
    occupied: NDArray[np.bool_], origin: tuple[float, float, float], voxel_size_m: float
) -> None:
    terrain = Terrain.from_occupancy(occupied, voxel_size_m, origin)
    indices = _indices(terrain)
    assert _sorted(indices) == np.argwhere(occupied).tolist()
    np.testing.assert_array_equal(terrain.voxel_ids(indices), np.arange(terrain.voxel_count))
    ids = np.arange(terrain.voxel_count)[::-1]
    expected = np.array(origin) + (terrain.voxel_indices(ids) + 0.5) * voxel_size_m
    np.testing.assert_allclose(terrain.voxel_centers(ids), expected, rtol=0, atol=1e-8)
    low, high = np.argwhere(occupied).min(axis=0), np.argwhere(occupied).max(axis=0) + 1
    expected = np.array(origin) + np.array([low, high]) * voxel_size_m
    np.testing.assert_allclose(terrain.bounds, expected, rtol=0, atol=1e-8)


@given(occupied=occupancies, probes=arrays.arrays(np.int64, (20, 3), elements=st.integers(-2, 10)))
def test_indices_without_a_voxel_have_no_id(occupied: NDArray[np.bool_], probes: NDArray[np.int64]) -> None:
    terrain = Terrain.from_occupancy(occupied, 1.0)
    dense = DenseTerrain(occupied, 1.0, (0.0, 0.0, 0.0))
    np.testing.assert_array_equal(terrain.voxel_ids(probes) >= 0, dense.is_occupied(probes))


def test_indices_beyond_every_grid_have_no_id() -> None:
    terrain = Terrain.from_occupancy(np.ones((1, 1, 1), bool), 1.0)
    far = [[2**31, 0, 0], [0, -(2**40), 0], [0, 0, 2**63 - 1], [-(2**63), 0, 0]]
    assert terrain.voxel_ids(far).tolist() == [-1, -1, -1, -1]


@ORIGINS
def test_points_become_the_voxels_that_hold_them(origin: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(1)
    offsets = rng.normal(0.0, 4.0, (500, 3))
    terrain = Terrain.from_points(np.array(origin) + offsets, 0.5, origin)
    expected = np.unique(np.floor((np.array(origin) + offsets - origin) / 0.5).astype(int), axis=0)
    assert _sorted(_indices(terrain)) == expected.tolist()


def test_a_point_on_a_plane_belongs_to_the_upper_voxel() -> None:
    points = [[0.5, 0.0, -0.5], [math.nextafter(0.5, 0.0), 0.0, -math.nextafter(0.5, 1.0)]]
    assert _sorted(_indices(Terrain.from_points(points, 0.5))) == [[0, 0, -2], [1, 0, -1]]


@given(
    heights=rough_heights, holes=st.randoms(use_true_random=False), voxel_size_m=st.sampled_from([1.0, 0.75])
)
def test_a_column_reaches_from_its_height_down_to_its_lowest_neighbour(
    heights: NDArray[np.float32], holes: Any, voxel_size_m: float
) -> None:
    for i, j in np.ndindex(heights.shape):
        if holes.random() < 0.2:
            heights[i, j] = np.nan
    if np.isnan(heights).all():
        heights[0, 0] = 1.0
    terrain = Terrain.from_height_map(heights, voxel_size_m)
    top = {
        cell: math.floor(float(heights[cell]) / voxel_size_m)
        for cell in np.ndindex(heights.shape)
        if not np.isnan(heights[cell])
    }
    expected = []
    for (i, j), level in top.items():
        around = ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1))
        lowest = min((top[cell] + 1 for cell in around if cell in top), default=level)
        expected += [[i, j, k] for k in range(min(lowest, level), level + 1)]
    assert _sorted(_indices(terrain)) == sorted(expected)


@ORIGINS
@pytest.mark.parametrize("voxel_size_m", [0.5, 1.0, 2.0])
def test_voxels_of_another_size_sample_the_height_between_cells(
    voxel_size_m: float, origin: tuple[float, float, float]
) -> None:
    """Cells of 2 m; what a vertical ray through a column's centre hits is the interpolated height."""
    rng = np.random.default_rng(2)
    heights = rng.uniform(-10.0, 10.0, (12, 9)).astype(np.float32)
    terrain = Terrain.from_height_map(heights, 2.0, voxel_size_m, origin)
    columns = np.array([2.0 * 12 / voxel_size_m, 2.0 * 9 / voxel_size_m], int)
    at_m = (np.mgrid[: columns[0], : columns[1]].reshape(2, -1) + 0.5) * voxel_size_m
    height = map_coordinates(heights.astype(float), at_m / 2.0 - 0.5, order=1, mode="nearest")
    above = np.column_stack([*at_m, np.full(at_m.shape[1], 50.0)]) + origin
    ids, distances = terrain.raycast(above, np.tile([0.0, 0.0, -1.0], (len(above), 1)), 1e3)
    top = np.floor(height / voxel_size_m)
    np.testing.assert_array_equal(terrain.voxel_indices(ids)[:, 2], top)
    # A plane keeps its height to half a step of 2^-13 voxels.
    np.testing.assert_allclose(distances, 50.0 - height, rtol=0, atol=voxel_size_m * 2.0**-14 + 1e-7)
    np.testing.assert_allclose(terrain.surface_heights(ids), 50.0 + origin[2] - distances, rtol=0, atol=1e-7)


@ORIGINS
@pytest.mark.parametrize("voxel_size_m", [2.0, 3.0, 4.5, 9.0])
def test_a_voxel_larger_than_the_cells_is_as_high_as_what_stands_out_of_it(
    voxel_size_m: float, origin: tuple[float, float, float]
) -> None:
    """By the rule for files (`_core.raised`): poles and a house, a hole, and a slope that stays one."""
    rng = np.random.default_rng(5)
    heights = np.repeat(0.3 * np.arange(36.0, dtype=np.float32)[:, None], 45, axis=1)
    heights.flat[rng.choice(heights.size, 40, replace=False)] += np.float32(9.5)
    heights[20:24, 30:33] += np.float32(6.0)
    heights[5:9, 5:9] = np.nan
    terrain = Terrain.from_height_map(heights, 1.0, voxel_size_m, origin)
    shape = [math.ceil(side / voxel_size_m) for side in heights.shape]
    middles, tops = np.full((2, *shape), np.nan, np.float32)
    for i, j in np.ndindex(*shape):
        at = (np.array([i, j]) + 0.5) * voxel_size_m - 0.5
        (i0, j0), (i1, j1) = (
            np.clip(at.astype(int) + step, 0, np.array(heights.shape) - 1) for step in (0, 1)
        )
        x, y = np.clip(at, 0, np.array(heights.shape) - 1) - (i0, j0)
        around = heights[np.ix_([i0, i1], [j0, j1])]
        weights = np.outer([1 - x, x], [1 - y, y])
        middles[i, j] = (around[weights > 0] * weights[weights > 0]).sum()
        low, high = (np.array([i + k, j + k]) * voxel_size_m for k in (0, 1))
        cells = heights[int(low[0]) : math.ceil(high[0]), int(low[1]) : math.ceil(high[1])]
        tops[i, j] = np.nan if np.isnan(cells).all() else np.nanmax(cells)
    expected = raised(middles, tops, voxel_size_m)
    assert (expected > middles).any()
    columns = np.argwhere(~np.isnan(expected))
    above = np.column_stack([(columns + 0.5) * voxel_size_m, np.full(len(columns), 90.0)]) + origin
    ids, distances = terrain.raycast(above, np.tile([0.0, 0.0, -1.0], (len(above), 1)), 1e3)
    np.testing.assert_array_equal(np.unique(terrain.columns()[:, :2], axis=0), columns)
    np.testing.assert_array_equal(terrain.voxel_indices(ids)[:, :2], columns)
    np.testing.assert_allclose(
        90.0 - distances, expected[tuple(columns.T)], rtol=0, atol=voxel_size_m * 2.0**-14 + 1e-5
    )


@given(
    heights=rough_heights,
    start=st.tuples(*[st.floats(0.0, 1.0)] * 2, st.floats(7.5, 15.0)),
    target=st.tuples(*[st.floats(0.0, 1.0)] * 2, st.floats(-8.0, 6.0)),
)
def test_no_ray_from_above_passes_below_a_closed_surface(
    heights: NDArray[np.float32], start: tuple[float, float, float], target: tuple[float, float, float]
) -> None:
    """Start and target lie over the map, as shares of it; before its hit the ray is in the air."""
    top = np.floor(heights).astype(int)
    size = np.array([*heights.shape, 1.0])
    origin, direction = start * size, (np.array(target) - start) * size
    _, (distance,) = Terrain.from_height_map(heights, 1.0).raycast(
        [origin], [direction], 100.0, surface="voxels"
    )
    along = np.arange(0.0, min(distance, 40.0), 0.003)
    points = origin + along[:, None] * direction / np.linalg.norm(direction)
    points = points[
        (np.abs(points - np.round(points)) > 1e-9).all(axis=1)
    ]  # on a plane rounding would decide
    points = points[((points[:, :2] > 0.0) & (points[:, :2] < heights.shape)).all(axis=1)]
    i, j, k = np.floor(points).astype(int).T
    assert (k > top[i, j]).all()


def test_a_hole_stays_open_and_its_rim_stays() -> None:
    heights = np.full((5, 5), 2.5, np.float32)
    heights[2, 2] = np.nan
    terrain = Terrain.from_height_map(heights, 1.0)
    assert terrain.voxel_count == 24
    ids, distances = terrain.raycast([[2.5, 2.5, 9.0], [2.5, 3.5, 9.0]], [[0, 0, -1.0]] * 2, 100.0)
    assert ids[0] == -1
    assert distances[0] == np.inf
    assert terrain.voxel_indices(ids[1:]).tolist() == [[2, 3, 2]]


def test_the_same_voxels_make_the_same_terrain_however_they_came() -> None:
    rng = np.random.default_rng(3)
    occupied = rng.random((20, 30, 10)) < 0.1
    by_cells = Terrain.from_occupancy(occupied, 0.25, UTM)
    centres = by_cells.voxel_centers(np.arange(by_cells.voxel_count))
    by_points = Terrain.from_points(rng.permutation(np.repeat(centres, 2, axis=0)), 0.25, UTM)
    assert by_points.fingerprint == by_cells.fingerprint
    assert by_points.tree_bytes == by_cells.tree_bytes > 0
    assert by_cells.with_origin((0.0, 0.0, 0.0)).fingerprint != by_cells.fingerprint
    assert Terrain.from_occupancy(occupied, 0.5, UTM).fingerprint != by_cells.fingerprint


def test_a_shifted_frame_moves_everything_but_the_ids() -> None:
    terrain = Terrain.from_occupancy(np.ones((2, 3, 4), bool), 0.5, (1.0, 2.0, 3.0))
    terrain.georeference = None
    moved = terrain.with_origin((101.0, 2.0, -3.0))
    ids = np.arange(terrain.voxel_count)
    np.testing.assert_array_equal(moved.voxel_indices(ids), terrain.voxel_indices(ids))
    np.testing.assert_allclose(
        moved.voxel_centers(ids) - terrain.voxel_centers(ids), [[100.0, 0.0, -6.0]] * 24
    )
    np.testing.assert_allclose(moved.bounds - terrain.bounds, [[100.0, 0.0, -6.0]] * 2)
    assert moved.origin == (101.0, 2.0, -3.0)


def test_terrains_of_two_places_on_earth_are_not_joined() -> None:
    """Tiles of one size that were opened by themselves have the same numbers: one lay upon the other."""
    west, east = (Terrain.from_height_map(np.zeros((4, 4)), cell_size_m=1.0) for _ in range(2))
    west.georeference = Georeference(46.5, 8.0, 500.0)
    assert west.joined(east).georeference == west.georeference
    east.georeference = Georeference(46.5, 8.0006, 500.0)
    with pytest.raises(CrowdfenceError, match=r"georeference is Georeference\(.*8\.0006.*\); it must be the"):
        west.joined(east)
    east.georeference = Georeference(46.5, 8.0, 500.0)
    assert west.joined(east).voxel_count == 16


def test_a_georeference_is_nothing_else() -> None:
    terrain = Terrain.from_height_map(np.zeros((4, 4)), cell_size_m=1.0)
    for place in ((46.5, 8.0, 500.0), "EPSG:32632"):
        with pytest.raises(TypeError, match="it must be a Georeference or None"):
            terrain.georeference = place  # type: ignore[assignment]
    assert terrain.georeference is None


def test_an_array_in_fortran_order_or_with_strides_is_read_as_numpy_shows_it() -> None:
    occupied = np.zeros((6, 8, 4), bool)
    occupied[1, 6, 2] = True
    for same in (np.asfortranarray(occupied), np.repeat(occupied, 2, axis=1)[:, ::2], occupied[::-1][::-1]):
        assert _indices(Terrain.from_occupancy(same, 1.0)).tolist() == [[1, 6, 2]]


# --- raycast


def _random_rays(rng: np.random.Generator, dense: DenseTerrain, count: int) -> tuple[Array, Array]:
    """Rays [count, 3] towards the map from within, near and far; some run along axes."""
    extent = np.array(dense.occupied.shape) * dense.voxel_size_m
    targets = rng.uniform(0.0, 1.0, (count, 3)) * extent
    from_middle = rng.uniform(-1.0, 1.0, (count, 3)) * rng.choice([0.5, 1.0, 40.0], (count, 1))
    origins = (0.5 + from_middle) * extent
    directions = (targets - origins) * 10.0 ** rng.uniform(-3, 3, (count, 1))
    directions[: count // 4, 1] = 0.0
    directions[: count // 8, 2] = 0.0
    return np.asarray(dense.origin) + origins, directions


@ORIGINS
@pytest.mark.parametrize("share", [0.01, 0.05, 0.3])
def test_raycast_agrees_with_a_dense_march(share: float, origin: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(int(1000 * share))
    dense = DenseTerrain(rng.random((23, 31, 12)) < share, 0.5, origin)
    terrain = dense.terrain()
    origins, directions = _random_rays(rng, dense, 800)
    for max_range_m in (4.0, 1e4):
        ids, distances = terrain.raycast(origins, directions, max_range_m, surface="voxels")
        march = [dense.first_hits(o, d[None], max_range_m) for o, d in zip(origins, directions, strict=True)]
        expected = np.array([cell[0] for cell, _ in march])
        np.testing.assert_array_equal(np.where(ids >= 0, dense.cells(terrain)[ids], -1), expected)
        np.testing.assert_allclose(distances, [distance[0] for _, distance in march], rtol=1e-9, atol=1e-6)
    assert (ids >= 0).sum() > 50
    assert (ids < 0).sum() > 50


def test_no_rays_hit_nothing() -> None:
    terrain = Terrain.from_occupancy(np.ones((1, 1, 1), bool), 1.0)
    ids, distances = terrain.raycast(np.empty((0, 3)), np.empty((0, 3)), 10.0)
    assert ids.shape == distances.shape == (0,)
    assert terrain.voxel_centers([]).shape == terrain.voxel_indices([]).shape == (0, 3)
    assert terrain.voxel_ids(np.empty((0, 3), int)).shape == (0,)


# --- what is refused

BOX = Terrain.from_occupancy(np.ones((2, 2, 2), bool), 1.0)
ONE_CELL = np.ones((1, 1, 1), bool)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: Terrain.from_occupancy(np.ones((2, 2), bool), 1.0),
            "occupied has shape [2, 2]; it must be [N, N, N]",
        ),
        (
            lambda: Terrain.from_height_map(np.ma.masked_equal([[0.0, -9999.0]], -9999.0), 1.0),
            "height_m is masked; it must have no masked elements",
        ),
        (
            lambda: Terrain.from_occupancy(np.full((2, 2, 2), np.nan), 1.0),
            "occupied has elements of type float64",
        ),
        (lambda: Terrain.from_occupancy(np.zeros((2, 2, 2), bool), 1.0), "terrain has no occupied voxel"),
        (lambda: Terrain.from_occupancy(np.zeros((0, 2, 2), bool), 1.0), "terrain has no occupied voxel"),
        (lambda: Terrain.from_occupancy(ONE_CELL, 0.0), "voxel_size_m is 0; it must be finite and > 0"),
        (lambda: Terrain.from_occupancy(ONE_CELL, -0.5), "voxel_size_m is -0.5; it must be finite and > 0"),
        (
            lambda: Terrain.from_occupancy(ONE_CELL, math.nan),
            "voxel_size_m is NaN; it must be finite and > 0",
        ),
        (
            lambda: Terrain.from_occupancy(ONE_CELL, 1.0, (0.0, math.inf, 0.0)),
            "origin y is inf; it must be finite",
        ),
        (lambda: Terrain.from_points([[0.0, 1.0]], 1.0), "points has shape [1, 2]; it must be [N, 3]"),
        (lambda: Terrain.from_points(np.empty((0, 3)), 1.0), "terrain has no occupied voxel"),
        (lambda: Terrain.from_points([[0.0, 0.0, 0.0], [0.0, math.nan, 0.0]], 1.0), "point 1 at (0, NaN, 0)"),
        (lambda: Terrain.from_points([[1e300, 0, 0]], 1.0), "within 2^31 voxels of the origin"),
        (lambda: Terrain.from_points([["a", "b", "c"]], 1.0), "points has elements of type"),
        (lambda: Terrain.from_points([[0, 0, 0], [0]], 1.0), "points: "),
        (
            lambda: Terrain.from_points([[0.0, 0.0, 0.0], [0.0, 2e6, 0.0]], 1.0),
            "terrain spans 2000001 voxels along y; the tree holds at most 1048576. Use larger voxels",
        ),
        (lambda: Terrain.from_height_map(np.zeros(4), 1.0), "height_m has shape [4]; it must be [N, N]"),
        (
            lambda: Terrain.from_height_map(np.zeros((2, 2)), 0.0),
            "cell_size_m is 0; it must be finite and > 0",
        ),
        (
            lambda: Terrain.from_height_map(np.zeros((2, 2)), 1.0, -1.0),
            "voxel_size_m is -1; it must be finite and > 0",
        ),
        (
            lambda: Terrain.from_height_map([[0.0, 0.0], [math.inf, 0.0]], 1.0),
            "height at cell (1, 0) is inf; heights must",
        ),
        (
            lambda: Terrain.from_height_map([[0.0, 1e10]], 1.0),
            "height at cell (0, 1) is 1e10; heights must be within 9000 m of the origin, or NaN for a hole",
        ),
        *(
            (
                lambda mark=mark: Terrain.from_height_map([[0.0, 1.0], [mark, 2.0]], 1.0),
                f"cell (1, 0) is {said};",
            )
            for mark, said in [(-32768, "-32768"), (-9999, "-9999"), (9999, "9999"), (1e30, "1e30")]
        ),
        (
            lambda: Terrain.from_height_map([[0.0, 8000.0]], 1e-6),
            "height at cell (0, 1) is 8000; heights must be within 2^31 voxels of the origin, or NaN",
        ),
        (
            lambda: Terrain.from_points([[0, 0, 0], [1, 0, -9999]], 1.0),
            "point 1 has the height -9999; heights of ground are within 9000 m. Is it a mark of missing data",
        ),
        (
            lambda: Terrain.from_triangles([[0, 0, 0], [1, 0, 0], [0, 1, 1e30]], [[0, 1, 2]], 1.0),
            "vertex 2 has the height 1e30; heights of ground are within 9000 m.",
        ),
        (lambda: Terrain.from_height_map([[math.nan]], 1.0), "terrain has no occupied voxel"),
        (lambda: Terrain.from_height_map(np.zeros((0, 3)), 1.0), "terrain has no occupied voxel"),
        (
            lambda: Terrain.from_height_map(np.zeros((100, 100)), 1.0, 1e-4),
            "terrain has 1000000000000 voxels; the bound is 2147483648. Use larger voxels",
        ),
        (lambda: BOX.voxel_centers([0, 8]), "voxel id 8 does not exist; the terrain has ids 0 to 7"),
        (lambda: BOX.voxel_centers([-1]), "voxel id -1 does not exist; the terrain has ids 0 to 7"),
        (lambda: BOX.voxel_indices([0.7]), "ids has elements of type float64; they must be int64"),
        (
            lambda: BOX.surface_heights(np.arange(8) > 5),
            "ids has elements of type bool; they must be int64: np.flatnonzero gives the places of a mask",
        ),
        (lambda: BOX.voxel_ids([[True, False, True]]), "indices has elements of type bool"),
        (lambda: BOX.voxel_indices([[0]]), "ids has shape [1, 1]; it must be [N]"),
        (lambda: BOX.voxel_ids([0, 0, 0]), "indices has shape [3]; it must be [N, 3]"),
        (lambda: BOX.with_origin((0.0, 0.0, math.nan)), "origin z is NaN; it must be finite"),
        (lambda: BOX.raycast([[0, 0]], [[0, 0, 1]], 1.0), "origins has shape [1, 2]; it must be [N, 3]"),
        (lambda: BOX.raycast([[0, 0, 0]], [[0, 0, 1]] * 2, 1.0), "directions has 2 values; 1 are needed"),
        (lambda: BOX.raycast([[0, 0, 0]], [[0, 0, 1]], -1.0), "max_range_m is -1; it must be >= 0"),
        (lambda: BOX.raycast([[0, 0, 0]], [[0, 0, 1]], math.nan), "max_range_m is NaN; it must be >= 0"),
        (lambda: BOX.raycast([[0, 0, 9]] * 2, [[0, 0, 1], [0, 0, 0]], 1.0), "ray 1: direction has no length"),
        (lambda: BOX.raycast([[0, 0, math.nan]], [[0, 0, 1]], 1.0), "ray 0: origin is not finite"),
        (lambda: BOX.raycast([[0, 0, 0]], [[0, math.inf, 1]], 1.0), "ray 0: direction is not finite"),
    ],
)
def test_what_cannot_be_used_is_refused_with_its_value(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        call()
