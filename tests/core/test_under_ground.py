"""Lines of sight that go under the ground, through a hole of the map or from beside it, clear nothing."""

from __future__ import annotations

import numpy as np
import pytest

import crowdfence as cf
from crowdfence.voxel_state import VoxelState

SHAPE = (64, 64)
Y = np.arange(SHAPE[1]) + 0.5
HILL = np.maximum(0.0, 20.0 - np.abs(Y - 20.0))
"""A ridge across the map at y = 20, 20 m high; from y = 40 on a plain lies behind it."""
BEGIN_NS = 1_760_000_000_000_000_000


def states(
    heights: np.ndarray,
    position: tuple[float, float, float],
    tilt: float,
    coverage: str,
    *,
    towards_y: float = 1.0,
) -> np.ndarray:
    """Of every column's top [i, j], after a second without crowd; the camera looks along y, up or down."""
    terrain = cf.Terrain.from_height_map(heights, cell_size_m=1.0)
    forward = np.array([0.0, towards_y * np.cos(tilt), -np.sin(tilt)])
    right = np.array([towards_y, 0.0, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = position
    camera = cf.Camera.pinhole(width=320, height=240, fx=200, fy=200, cx=160, cy=120)
    method = cf.EvidenceConfig().fusion_method(terrain, drones=1)
    crowd_map = cf.CrowdMap(terrain, method, max_range_m=100.0, coverage=coverage)
    for number in range(10):
        stamp_ns = BEGIN_NS + number * 100_000_000
        view = cf.View("uav1", stamp_ns, camera, pose, np.zeros((12, 16), np.float32))
        crowd_map.integrate([view], stamp_ns)
    top = np.full(SHAPE, -(2**31))
    found = np.full(SHAPE, int(VoxelState.NEVER_SEEN))
    state = crowd_map.state(stamp_ns)
    for (i, j, k), one in zip(terrain.voxel_indices(np.arange(terrain.voxel_count)), state, strict=True):
        if k > top[i, j]:
            top[i, j], found[i, j] = k, one
    return found


@pytest.mark.parametrize("coverage", ["full", "rays"])
def test_nothing_behind_a_hill_is_seen_empty_through_a_hole_in_it(coverage: str) -> None:
    heights = np.repeat(HILL[None], SHAPE[0], 0)
    whole = states(heights, (30.0, -5.0, 12.0), 0.25, coverage)
    assert (whole[:, :15] == VoxelState.EMPTY).sum() > 100, "the near slope is in view"
    heights[20:40, 5:14] = np.nan
    holed = states(heights, (30.0, -5.0, 12.0), 0.25, coverage)
    for found in (whole, holed):
        assert not (found[:, 21:] == VoxelState.EMPTY).any()


@pytest.mark.parametrize("coverage", ["full", "rays"])
@pytest.mark.parametrize("is_north", [False, True])
@pytest.mark.parametrize("slope", [0.5, 1.0, 1.5, 2.5])
def test_a_camera_beside_the_map_sees_nothing_of_a_slope_that_falls_away_from_it(
    slope: float, is_north: bool, coverage: str
) -> None:
    """It stands lower than the map's edge, so that it looks under the ground; south or north of the map."""
    heights = np.repeat((60.0 - slope * Y)[None], SHAPE[0], 0)
    if is_north:
        found = states(heights[:, ::-1], (30.0, 76.0, 45.0), 0.6, coverage, towards_y=-1.0)
    else:
        found = states(heights, (30.0, -12.0, 45.0), 0.6, coverage)
    assert not (found == VoxelState.EMPTY).any()


@pytest.mark.parametrize("coverage", ["full", "rays"])
@pytest.mark.parametrize("is_north", [False, True])
def test_a_camera_beside_the_map_sees_nothing_of_a_plain_behind_the_ridge_at_its_edge(
    is_north: bool, coverage: str
) -> None:
    heights = np.repeat(np.maximum(0.0, 24.0 - Y)[None], SHAPE[0], 0)
    if is_north:
        found = states(heights[:, ::-1], (30.0, 76.0, 12.0), 0.25, coverage, towards_y=-1.0)
    else:
        found = states(heights, (30.0, -12.0, 12.0), 0.25, coverage)
    assert not (found == VoxelState.EMPTY).any()


@pytest.mark.parametrize("coverage", ["full", "rays"])
@pytest.mark.parametrize("width", [3, 8, 16])
def test_a_camera_beside_the_map_sees_nothing_of_the_ground_behind_a_terrace_at_its_edge(
    width: int, coverage: str
) -> None:
    """The terrace is 10 m high and the camera 1.5 m higher, so that it hides all of the plain behind it."""
    heights = np.repeat(np.where(width > Y, 10.5, 0.5)[None], SHAPE[0], 0)
    found = states(heights, (30.3, -10.0, 12.0), 0.45, coverage)
    assert (found[:, :width] == VoxelState.EMPTY).any()
    assert not (found[:, width + 1 :] == VoxelState.EMPTY).any()
