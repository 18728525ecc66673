"""A crowd on the first row of the map, seen from beside it, is not thinned out by what lies before it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import crowdfence as cf
from crowdfence.voxel_state import VoxelState

SIDE_M = 64.0
BEGIN_NS = 1_760_000_000_000_000_000
CAMERA = cf.Camera.pinhole(width=640, height=480, fx=400, fy=400, cx=320, cy=240)

Array = NDArray[np.float64]


def look_north(edge_m: float, height_m: float, tilt_deg: float, distance_m: float = 30.0) -> Array:
    """Pose whose middle pixel shows the ground on the line y = `edge_m`."""
    tilt = np.radians(tilt_deg)
    pose = np.eye(4)
    pose[:3, 1] = 0.0, -np.sin(tilt), -np.cos(tilt)
    pose[:3, 2] = 0.0, np.cos(tilt), -np.sin(tilt)
    pose[:3, 3] = np.array([32.0, edge_m, height_m]) - distance_m * pose[:3, 2]
    return pose


def perfect_heatmap(pose: Array, height_m: float, from_m: float, to_m: float, value: float) -> Array:
    """`value` where a pixel shows level ground between two lines of y."""
    u, v = np.meshgrid(np.arange(640) + 0.5, np.arange(480) + 0.5)
    rays = CAMERA.unproject(np.column_stack([u.ravel(), v.ravel()])) @ pose[:3, :3].T
    north_m = pose[1, 3] + (height_m - pose[2, 3]) / rays[:, 2] * rays[:, 1]
    is_crowd = (rays[:, 2] < 0) & (north_m >= from_m) & (north_m < to_m)
    return value * is_crowd.reshape(480, 640).astype(np.float32)


def first_row(terrain: cf.Terrain, edge_m: float, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which voxels lie in the first row behind the edge, well inside the picture."""
    x, y, _ = terrain.voxel_centers(ids).T
    return (y > edge_m) & (y < edge_m + terrain.voxel_size_m) & (np.abs(x - 32.0) < 8.0)


@pytest.mark.parametrize("place", ["edge", "hole"])
@pytest.mark.parametrize("tilt_deg", [10.0, 20.0, 45.0, 80.0])
@pytest.mark.parametrize(("voxel_size_m", "share"), [(0.5, 0.5), (1.0, 0.9), (2.0, 0.1)])
def test_nothing_beside_the_map_thins_out_a_crowd_on_its_first_row(
    voxel_size_m: float, share: float, tilt_deg: float, place: str
) -> None:
    """`share` of a voxel is how high in it the ground lies."""
    columns, height_m = round(SIDE_M / voxel_size_m), share * voxel_size_m
    heights = np.full((columns, columns), height_m)
    edge_m = 0.0
    if place == "hole":
        edge_m = 16.0
        heights[:, round(8.0 / voxel_size_m) : round(edge_m / voxel_size_m)] = np.nan
    terrain = cf.Terrain.from_height_map(heights, cell_size_m=voxel_size_m)
    pose = look_north(edge_m, height_m, tilt_deg)
    crowd_map = cf.CrowdMap(
        terrain, cf.EvidenceConfig().fusion_method(terrain, drones=1), max_range_m=200.0, surface="planes"
    )
    heatmap = perfect_heatmap(pose, height_m, edge_m, edge_m + 2.0, 0.4)
    for number in range(10):
        stamp_ns = BEGIN_NS + number * 100_000_000
        crowd_map.integrate([cf.View("uav1", stamp_ns, CAMERA, pose, heatmap)], stamp_ns)
    seen = cf.project(cf.View("uav1", 0, CAMERA, pose, heatmap), terrain, max_range_m=200.0)
    ids = np.arange(terrain.voxel_count)
    assert (seen.mean[first_row(terrain, edge_m, seen.voxel_ids)] > 0.35).all()
    assert set(crowd_map.state(stamp_ns)[first_row(terrain, edge_m, ids)]) == {VoxelState.CROWD}


def test_crowd_beside_the_map_counts_for_its_first_row() -> None:
    terrain = cf.Terrain.from_height_map(np.full((64, 64), 0.5), cell_size_m=1.0)
    pose = look_north(0.0, 0.5, 30.0)
    view = cf.View("uav1", 0, CAMERA, pose, perfect_heatmap(pose, 0.5, -2.0, 0.0, 1.0))
    seen = cf.project(view, terrain, max_range_m=200.0)
    assert (seen.mean[first_row(terrain, 0.0, seen.voxel_ids)] > 0.35).all()
    assert (seen.crowd_mass.hole, seen.crowd_mass.out_of_range) == (0.0, 0.0)
