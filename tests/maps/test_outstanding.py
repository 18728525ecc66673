"""Height models at voxels larger than their pixels: what stands out of a column hides what is behind it."""

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine, from_origin
from scipy.spatial.transform import Rotation

from crowdfence import Camera, CrowdMap, EvidenceConfig, Terrain, View, VoxelState
from crowdfence._core import raised

pytestmark = pytest.mark.filterwarnings(
    "ignore::PendingDeprecationWarning", "ignore::rasterio.errors.NotGeoreferencedWarning"
)


def write_local(path, heights, transform):
    """`heights` [rows from the north, columns] in local metres."""
    rows, columns = heights.shape
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "nodata": -9999.0}
    with rasterio.open(path, "w", height=rows, width=columns, transform=transform, **profile) as dataset:
        dataset.write(heights.astype(np.float32), 1)
    return path


def top_voxels(terrain):
    """Grid index k of the highest voxel of each column, by (i, j)."""
    tops = {}
    for i, j, k in terrain.voxel_indices(np.arange(terrain.voxel_count)).tolist():
        tops[i, j] = max(k, tops.get((i, j), k))
    return tops


def test_a_column_is_as_high_as_its_highest_pixel_wherever_that_lies(tmp_path):
    rng = np.random.default_rng(7)
    heights = np.full((40, 60), 0.5)
    poles = rng.choice(heights.size, 30, replace=False)
    heights.flat[poles] = 9.5
    path = write_local(tmp_path / "a.tif", heights, from_origin(0, 40, 1, 1))
    expected = {(i, j): 0 for i in range(15) for j in range(10)}
    for row, column in zip(*np.unravel_index(poles, heights.shape), strict=True):
        expected[int(column) // 4, (39 - int(row)) // 4] = 2  # 9.5 m in voxels of 4 m
    assert top_voxels(Terrain.open(path, voxel_size_m=4.0, assume_local=True)) == expected


def test_no_wall_slips_between_the_columns_of_a_turned_file(tmp_path):
    """A wall 5 m high and one pixel wide in a file turned by 30 degrees: in voxels it is a closed line, up to
    the metre by which something must stand out."""
    heights = np.full((200, 200), 0.5)
    heights[:, 97] = 5.5
    turned = Affine.translation(0, 0) @ Affine.rotation(30) @ Affine.scale(0.25, -0.25)
    path = write_local(tmp_path / "a.tif", heights, turned)
    terrain = Terrain.open(path, voxel_size_m=1.0, assume_local=True)
    tops = top_voxels(terrain)
    along_m = np.arange(2.0, 48.0, 0.01)  # of the wall's 50 m, to the south
    east, north = 97.5 * 0.25 * np.array([np.cos(np.pi / 6), 0.5])[:, None] - along_m * np.array(
        [[-0.5], [np.cos(np.pi / 6)]]
    )
    west, south, base = np.rint(terrain.origin).astype(int)
    under = {(int(i), int(j)) for i, j in zip(np.floor(east) - west, np.floor(north) - south, strict=True)}
    assert len(under) > 40 and min(tops[column] + base for column in under) >= 4


def test_slopes_steps_and_holes_stay_as_they_are():
    east = np.arange(12.0)
    slope = np.repeat((2.5 * east)[:, None], 8, axis=1).astype(np.float32)  # 2.5 m a cell of 2 m
    np.testing.assert_array_equal(raised(slope, slope + 1.25, 2.0), slope)  # the upper edges of the cells
    wall = slope + 1.25
    wall[5, 3] += 2.0
    expected = slope.copy()
    expected[5, 3] = wall[5, 3]
    np.testing.assert_array_equal(raised(slope, wall, 2.0), expected)
    flat = np.zeros((6, 6), np.float32)
    kerbs = flat + np.float32(0.9)  # a person is seen over it
    np.testing.assert_array_equal(raised(flat, kerbs, 1.0), flat)
    np.testing.assert_array_equal(raised(flat, kerbs + 0.2, 1.0), kerbs + np.float32(0.2))
    np.testing.assert_array_equal(raised(flat, kerbs + 0.2, 4.0), flat)  # less than half a voxel
    holed = flat.copy()
    holed[2, 2] = np.nan
    beside = raised(holed, kerbs + np.float32(0.2), 1.0)
    assert np.isnan(beside[2, 2]) and np.isnan(beside).sum() == 1 and np.nanmin(beside) > 1.0


def test_many_rows_are_raised_like_few():
    rng = np.random.default_rng(3)
    heights = rng.uniform(0, 5, (2500, 4)).astype(np.float32)
    tops = heights + rng.uniform(0, 4, heights.shape).astype(np.float32)
    whole = raised(heights, tops, 1.0)
    for first in range(0, 2400, 400):
        np.testing.assert_array_equal(
            raised(heights[first : first + 100], tops[first : first + 100], 1.0)[1:-1],
            whole[first + 1 : first + 99],
        )


@pytest.mark.parametrize("voxel_size_m", [0.5, 1.0, 2.0])
def test_ground_behind_a_thin_wall_is_never_called_empty(tmp_path, voxel_size_m):
    """Walls 3 m high and half a metre thick every 20 m. From 30 m above, a wall 35 m away hides 4 m behind it
    and one further away more."""
    n = 400
    north_m = (np.arange(n)[::-1] + 0.5) * 0.25
    heights = np.repeat(np.where(north_m % 20 < 0.5, 3.5, 0.5)[:, None], n, axis=1)
    path = write_local(tmp_path / "walls.tif", heights, from_origin(-50, 100, 0.25, 0.25))
    terrain = Terrain.open(path, voxel_size_m=voxel_size_m, assume_local=True)
    level = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    pose = np.eye(4)
    pose[:3, :3] = (level * Rotation.from_euler("x", -20, degrees=True)).as_matrix()
    pose[:3, 3] = [0, 5, 30.5]
    camera = Camera.pinhole(640, 480, 500, 500, 320, 240)
    crowd_map = CrowdMap(terrain, EvidenceConfig().fusion_method(terrain, drones=1), max_range_m=150)
    for k in range(10):
        stamp_ns = 1_760_000_000_000_000_000 + k * 200_000_000
        crowd_map.integrate([View("u", stamp_ns, camera, pose, np.zeros((48, 64), np.float32))], stamp_ns)
    places = terrain.standing_places()
    x, y, _ = terrain.voxel_centers(places).T
    state = crowd_map.state(stamp_ns)[places]
    near, beyond_m = (np.abs(x) < 12) & (y > 40) & (y < 90), y % 20
    assert set(state[near & (beyond_m > 1.5) & (beyond_m < 3.5)]) == {VoxelState.OCCLUDED}
    assert set(state[near & (beyond_m > 10) & (beyond_m < 19)]) == {VoxelState.EMPTY}
