"""Columns from voxels: which state, probability and height a column shows, worked out by hand."""

import itertools

import numpy as np
import pytest

from crowdfence import Camera, CrowdMap, Or, Terrain, View, surface_grid
from crowdfence.surface_grid import SurfaceGrid, read_crowd_map
from crowdfence.voxel_state import VoxelState

NEVER, OCCLUDED, EMPTY, STALE, CROWD, NOT_CLEARED = VoxelState
ORIGIN = (0.0, 0.0, 0.0)


def one_column(*states: VoxelState, spacing: int = 2) -> VoxelState:
    """State of a column of voxels from the ground up, `spacing` levels apart (1 = stacked)."""
    indices = [(0, 0, k * spacing) for k in range(len(states))]
    grid = SurfaceGrid.from_voxels(indices, 1.0, ORIGIN, np.full(len(states), 0.5), states)
    return VoxelState(grid.state[0, 0])


def test_a_column_shows_its_most_dangerous_then_its_least_known_level() -> None:
    assert one_column(EMPTY, EMPTY) == EMPTY
    assert one_column(EMPTY, STALE) == STALE
    assert one_column(STALE, OCCLUDED) == OCCLUDED
    assert one_column(OCCLUDED, NEVER) == NEVER
    assert one_column(NEVER, CROWD) == CROWD


@pytest.mark.parametrize("states", list(itertools.combinations_with_replacement(VoxelState, 3)))
def test_missing_data_never_becomes_empty(states: tuple[VoxelState, ...]) -> None:
    for order in itertools.permutations(states):
        assert (one_column(*order) == EMPTY) == (set(states) == {EMPTY})


def test_a_buried_voxel_does_not_count_unless_it_is_crowd() -> None:
    # A step of a slope: what is inside the ground can never be seen and nobody stands there.
    assert one_column(NEVER, NEVER, EMPTY, spacing=1) == EMPTY
    assert one_column(EMPTY, EMPTY, NEVER, spacing=1) == NEVER
    assert one_column(CROWD, EMPTY, EMPTY, spacing=1) == CROWD


def test_columns_of_a_small_map() -> None:
    # Two columns: (3, -1) with an empty roof over unseen ground, (4, -1) with two seen voxels.
    indices = [(3, -1, 9), (3, -1, 2), (4, -1, 2), (4, -1, 3)]
    grid = SurfaceGrid.from_voxels(
        indices, 0.5, (10.0, 20.0, 100.0), [0.1, 0.9, 0.3, 0.2], [EMPTY, NEVER, EMPTY, STALE], [7, -1, 5, 6]
    )
    assert grid.shape == (2, 1)
    assert grid.bounds_m == (11.5, 19.5, 12.5, 20.0)
    # The 0.9 belongs to a voxel that nobody saw: an initial value, not a probability of anything.
    assert grid.probability[:, 0].tolist() == [0.1, 0.3]
    assert grid.state[:, 0].tolist() == [NEVER, STALE]
    assert grid.last_seen_ns[:, 0].tolist() == [7, 6]
    assert grid.top_m[:, 0].tolist() == [105.0, 102.0]
    assert grid.height_m(grid.bottom_index[:, 0]).tolist() == [101.0, 101.0]
    assert grid.area_m2(STALE) == 0.25


def test_a_column_without_terrain_is_unknown() -> None:
    grid = SurfaceGrid.from_voxels([(0, 0, 0), (2, 0, 0)], 1.0, ORIGIN, [0.0, 0.0], [EMPTY, EMPTY])
    assert grid.state[:, 0].tolist() == [EMPTY, NEVER, EMPTY]
    assert grid.has_surface[:, 0].tolist() == [True, False, True]
    assert np.isnan(grid.top_m[1, 0]) and np.isnan(grid.probability[1, 0])
    assert grid.area_m2(NEVER) == 0.0


def test_crop_keeps_what_was_seen_and_a_margin() -> None:
    indices = [(i, 0, 0) for i in range(100)]
    state = np.full(100, NEVER, dtype=np.uint8)
    state[[40, 42]] = EMPTY
    state[41] = OCCLUDED
    grid = SurfaceGrid.from_voxels(indices, 2.0, ORIGIN, np.zeros(100), state, crop="seen", margin_m=5.0)
    assert grid.first_column == (37, 0)  # 5 m are two and a half cells: three are kept
    assert grid.shape == (9, 1)
    assert grid.state[:, 0].tolist() == [0, 0, 0, EMPTY, OCCLUDED, EMPTY, 0, 0, 0]
    nothing_seen = SurfaceGrid.from_voxels(
        indices, 2.0, ORIGIN, np.zeros(100), np.zeros(100, dtype=np.uint8), crop="seen"
    )
    assert nothing_seen.shape == (100, 1)


def test_blocks_give_the_same_grid_as_one_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    indices = rng.integers(-5, 5, (500, 3))
    arrays = (rng.random(500), rng.integers(0, 5, 500), rng.integers(0, 1000, 500))
    whole = SurfaceGrid.from_voxels(indices, 1.0, ORIGIN, *arrays, crop="seen")
    monkeypatch.setattr(surface_grid, "_VOXELS_PER_BLOCK", 7)
    blocks = SurfaceGrid.from_voxels(indices, 1.0, ORIGIN, *arrays, crop="seen")
    for name in ("probability", "state", "top_index", "bottom_index", "last_seen_ns"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(blocks, name), err_msg=name)


def test_a_crowd_map_gives_the_grid_of_its_arrays() -> None:
    # Flat ground under half a roof, seen once from straight above.
    occupied = np.zeros((12, 8, 4), dtype=bool)
    occupied[:, :, 0] = True
    occupied[:6, :, 3] = True
    terrain = Terrain.from_occupancy(occupied, 1.0, (-6.0, -4.0, 100.0))
    crowd_map = CrowdMap(terrain, Or())
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = (0.0, 0.0, 125.0)
    camera = Camera.pinhole(60, 40, 250.0, 250.0, 30.0, 20.0)
    heatmap = np.zeros((40, 60), dtype=np.float32)
    heatmap[:, 44:] = 1.0
    crowd_map.integrate([View("uav1", 7, camera, pose, heatmap)], 7)
    grid = SurfaceGrid.from_crowd_map(crowd_map, 7, crop="surface")
    ids = np.arange(terrain.voxel_count)
    expected = SurfaceGrid.from_voxels(
        terrain.voxel_indices(ids),
        1.0,
        terrain.origin,
        crowd_map.probability(7),
        crowd_map.state(7),
        crowd_map.last_seen_ns(),
    )
    for name in ("probability", "state", "top_index", "bottom_index", "last_seen_ns"):
        np.testing.assert_array_equal(getattr(grid, name), getattr(expected, name), err_msg=name)
    # The ground is 24.5 m below: the picture shows x from -2.94 to 2.94, and the crowd begins at 1.37. The
    # western half of it is hidden by the roof.
    hidden, unseen = [OCCLUDED] * 3, [NEVER] * 3
    assert grid.state[:, 4].tolist() == [*unseen, *hidden, EMPTY, CROWD, CROWD, *unseen]
    assert grid.seen[3:6, 4].all()  # the roof, whose column stays unknown for the ground below
    cropped = SurfaceGrid.from_crowd_map(crowd_map, 7, margin_m=0.0)
    assert cropped.bounds_m == (-3.0, -2.0, 3.0, 2.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"indices": np.zeros((0, 3), dtype=int), "probability": [], "state": []}, "no voxels"),
        ({"indices": [(0, 0)]}, r"shape \[V, 3\]"),
        ({"probability": [0.1, 0.2]}, "one value per voxel"),
        ({"probability": [1.5]}, r"1\.5 .*outside \[0, 1\]"),
        ({"probability": [np.nan]}, r"outside \[0, 1\]"),
        ({"state": [9]}, "state 9 is not a VoxelState"),
        # In a byte each of these is 2, EMPTY.
        ({"state": [258]}, "state 258 is not a VoxelState"),
        ({"state": [-254]}, "state -254 is not a VoxelState"),
        ({"state": [2.9]}, r"state 2\.9 is not a VoxelState"),
        ({"state": np.ma.masked_all(1, int)}, "states are masked"),
        ({"probability": np.ma.masked_all(1)}, "probabilities are masked"),
        ({"voxel_size_m": 0.0}, "voxel_size_m must be positive"),
        ({"crop": "everything"}, "crop must be"),
        ({"crop": "seen", "margin_m": -1.0}, "margin_m"),
    ],
)
def test_bad_input_names_the_value(change: dict[str, object], message: str) -> None:
    good: dict[str, object] = {"indices": [(0, 0, 0)], "probability": [0.1], "state": [EMPTY]}
    arguments = {"voxel_size_m": 1.0, "origin": ORIGIN, **good, **change}
    with pytest.raises(ValueError, match=message):
        SurfaceGrid.from_voxels(**arguments)  # type: ignore[arg-type]


def test_a_map_too_wide_for_a_grid_is_refused_before_memory_is_taken() -> None:
    with pytest.raises(ValueError, match="columns, more than"):
        SurfaceGrid.from_voxels(
            [(0, 0, 0), (10**8, 10**8, 0)], 1.0, ORIGIN, [0.1, 0.1], [EMPTY, EMPTY], crop="surface"
        )


def test_a_map_that_goes_on_after_it_was_read_changes_no_grid() -> None:
    terrain = Terrain.from_height_map(np.zeros((40, 40)), cell_size_m=1.0)
    crowd_map = CrowdMap(terrain, Or())
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    down[:3, 3] = (15.0, 15.0, 10.0)
    camera = Camera.pinhole(8, 8, 8.0, 8.0, 4.0, 4.0)
    crowd_map.integrate([View("uav1", 1_000_000_000, camera, down, np.zeros((8, 8), np.float32))], 10**9)
    then = SurfaceGrid.from_crowd_map(crowd_map, 10**9)
    read = read_crowd_map(crowd_map, 10**9)
    crowd_map.integrate([View("uav1", 2_000_000_000, camera, down, np.ones((8, 8), np.float32))], 2 * 10**9)
    grid = read()
    assert (then.state == EMPTY).any() and not (then.state == CROWD).any()
    for name in ("state", "probability", "top_index", "bottom_index", "last_seen_ns"):
        np.testing.assert_array_equal(getattr(grid, name), getattr(then, name))
    assert (SurfaceGrid.from_crowd_map(crowd_map, 2 * 10**9).state == CROWD).any()
