"""Rays end on the ground itself, wherever in a voxel it lies."""

import numpy as np
import pytest
from numpy.typing import NDArray

from crowdfence import Camera, Terrain, View, project

SIDE_M = 80.0
WITHIN_M = 0.01
VOXEL_SIZES_M = (0.1, 0.25, 0.5, 1.0, 2.0)

Array = NDArray[np.float64]


def plane(voxel_size_m: float, height_m: float, slope: tuple[float, float] = (0.0, 0.0)) -> Terrain:
    """z = height_m + slope . (x, y) on a square around the origin."""
    along_m = (np.arange(round(SIDE_M / voxel_size_m)) + 0.5) * voxel_size_m - SIDE_M / 2
    heights_m = height_m + slope[0] * along_m[:, None] + slope[1] * along_m
    return Terrain.from_height_map(heights_m, voxel_size_m, origin=(-SIDE_M / 2, -SIDE_M / 2, 0.0))


def directions(tilt_deg: float) -> Array:
    """Unit vectors [36, 3] that far below the horizon, all around, along no axis and no diagonal."""
    azimuth, down = np.radians(np.arange(36) * 10.0 + 3.0), np.radians(tilt_deg)
    level = np.cos(down) * np.ones(36)
    return np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), np.full(36, -np.sin(down))])


@pytest.mark.parametrize("height_m", [0.0, 0.37, -1.21])
@pytest.mark.parametrize("tilt_deg", [5.0, 10.0, 20.0, 45.0, 90.0])
@pytest.mark.parametrize("voxel_size_m", VOXEL_SIZES_M)
def test_a_plain_is_hit_at_its_height(voxel_size_m: float, tilt_deg: float, height_m: float) -> None:
    """3 m up, so that the camera of the largest voxels is inside the air of one at some heights."""
    terrain = plane(voxel_size_m, height_m)
    rays = directions(tilt_deg)
    origins = np.tile([0.013, -0.021, height_m + 3.0], (len(rays), 1))
    ids, distance_m = terrain.raycast(origins, rays, 100.0)
    assert (ids >= 0).all()
    hit = origins + distance_m[:, None] * rays
    assert np.abs(hit[:, 2] - height_m).max() <= WITHIN_M
    assert (terrain.voxel_indices(ids)[:, :2] == columns_of(terrain, hit)).all()


@pytest.mark.parametrize("voxel_size_m", VOXEL_SIZES_M)
def test_a_slope_is_hit_at_its_height(voxel_size_m: float) -> None:
    slope = (0.31, -0.17)
    terrain = plane(voxel_size_m, 0.2, slope)
    for tilt_deg in (30.0, 45.0, 90.0):
        rays = directions(tilt_deg)
        origins = np.tile([0.013, -0.021, 9.0], (len(rays), 1))
        ids, distance_m = terrain.raycast(origins, rays, 100.0)
        assert (ids >= 0).all()
        hit = origins + distance_m[:, None] * rays
        # A quantised slope leaves the plane by no more than the height does.
        assert np.abs(hit[:, 2] - 0.2 - hit[:, :2] @ slope).max() <= 2 * WITHIN_M


@pytest.mark.parametrize("voxel_size_m", VOXEL_SIZES_M)
def test_a_low_camera_finds_the_foot_of_every_pixel(voxel_size_m: float) -> None:
    """A hand-held or pole camera, 2 m above a plain: the foot is where the pixel's ray meets z = 0.37."""
    terrain, (camera, pose) = plane(voxel_size_m, 0.37), low_camera(2.37)
    pixels = np.array([[u, v] for u in (40.5, 320.5, 599.5) for v in (250.5, 300.5, 400.5, 479.5)])
    rays = camera.unproject(pixels) @ pose[:3, :3].T
    foot = pose[:3, 3] - rays * (2.0 / rays[:, 2:])
    _, distance_m = terrain.raycast(np.tile(pose[:3, 3], (len(rays), 1)), rays, 100.0)
    hit = pose[:3, 3] + distance_m[:, None] * rays
    error_m = np.linalg.norm(hit[:, :2] - foot[:, :2], axis=1)
    # A centimetre of height is so much along the ground.
    assert (error_m <= WITHIN_M * np.linalg.norm(rays[:, :2], axis=1) / -rays[:, 2]).all()


@pytest.mark.parametrize("coverage", ["rays", "full"])
@pytest.mark.parametrize("voxel_size_m", VOXEL_SIZES_M)
def test_a_marked_pixel_of_a_low_camera_marks_the_column_of_its_foot(
    voxel_size_m: float, coverage: str
) -> None:
    terrain, (camera, pose) = plane(voxel_size_m, 0.37), low_camera(2.37)
    for u, v in ((104, 320), (324, 416), (595, 461)):  # feet in the middle of columns of 0.1 m
        heatmap = np.zeros((480, 640), np.uint8)
        heatmap[v, u] = 255
        ray = pose[:3, :3] @ camera.unproject([[u + 0.5, v + 0.5]])[0]
        foot = pose[:3, 3] - ray * (2.0 / ray[2])
        seen = project(View("pole", 0, camera, pose, heatmap), terrain, max_range_m=60.0, coverage=coverage)
        marked = terrain.voxel_indices(seen.voxel_ids[seen.mean > 0.0])[:, :2]
        assert (marked == columns_of(terrain, foot[None])[0]).all(axis=1).any()


def low_camera(height_m: float) -> tuple[Camera, Array]:
    """Camera over the origin, looking north and 10 degrees down."""
    level, drop = np.cos(np.radians(10.0)), np.sin(np.radians(10.0))
    pose = np.eye(4)
    pose[:3, :3] = [[1.0, 0.0, 0.0], [0.0, -drop, level], [0.0, -level, -drop]]
    pose[:3, 3] = (0.013, -0.021, height_m)
    return Camera.pinhole(640, 480, 381.0, 381.0, 320.0, 240.0), pose


def columns_of(terrain: Terrain, points: Array) -> NDArray[np.int64]:
    return np.floor((points[:, :2] - np.asarray(terrain.origin)[:2]) / terrain.voxel_size_m).astype(np.int64)
