"""Truth from the world: people, crowds, what an image shows of them, and the ground that drones share."""

import numpy as np
import pytest
from numpy.typing import NDArray

from crowdfence._core import Camera, Terrain
from crowdfence.simulation.flight.gimbal import camera_attitude, rigid
from crowdfence.simulation.recording.footprint_overlap import OverlapStatistics, footprint_cells
from crowdfence.simulation.scene_truth import (
    PeopleTruth,
    Sight,
    crowd_ground,
    people_truth,
    region_mask,
    sight_of_people,
    visible_pixels,
)
from support.simulated_scenes import scene_of

CAMERA = Camera.pinhole(64, 48, 32.0, 32.0, 32.0, 24.0)
"""90 degrees wide."""


def nadir(x: float, y: float, z: float) -> NDArray[np.float64]:
    """Looks straight down, upper edge of the image north."""
    return rigid(camera_attitude(np.pi / 2, np.pi / 2), np.array([x, y, z]))


def test_people_truth_against_counting_neighbours() -> None:
    scene = scene_of("race")
    truth = people_truth(scene, 25.0)
    definition = scene.scenario.crowd_definition
    east_north = truth.position[:, :2]
    near = np.linalg.norm(east_north[:, None] - east_north[None], axis=-1) <= definition.radius_m
    core = near.sum(axis=1) >= definition.min_people
    np.testing.assert_array_equal(truth.crowd > 0, (near & core[None]).any(axis=1))
    members = truth.crowd > 0
    np.testing.assert_array_equal(truth.crowd[members], scene.people.crowd_id[members])
    np.testing.assert_array_equal(truth.position, scene.people.at(25.0).position)


def test_crowd_ground_lies_below_the_crowds_and_nowhere_else() -> None:
    scene = scene_of("race")
    truth = people_truth(scene, 25.0)
    first = truth.position[truth.crowd == 1]
    low, high = first.min(axis=0) - 15.0, first.max(axis=0) + 15.0
    x, y = (np.arange(low[axis], high[axis], 0.25) for axis in (0, 1))
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    points = np.column_stack([grid, scene.landscape.height_m(grid[:, 0], grid[:, 1])])
    terrain = Terrain.from_points(points, 1.0)
    with pytest.raises(ValueError, match="stand on no voxel of the terrain"):
        crowd_ground(scene, terrain, 25.0)  # the other crowds are off this small map

    everywhere = Terrain.from_points(np.concatenate([points, truth.position]), 1.0)
    ground = crowd_ground(scene, everywhere, 25.0)
    stood_on = everywhere.voxel_ids(np.floor(truth.position).astype(np.int64))
    assert ground[stood_on[truth.crowd > 0]].all()
    centres = everywhere.voxel_centers(np.flatnonzero(ground))[:, None, :2]
    apart = np.linalg.norm(centres - truth.position[truth.crowd > 0][None, :, :2], axis=-1).min(axis=1)
    assert apart.max() < 2.5


def test_visible_pixels_by_hand() -> None:
    image = np.array([[0, 1, 1], [3, 3, 3], [4, 0, 1]], np.uint16)
    np.testing.assert_array_equal(visible_pixels(image, 3), [3, 0, 3])
    np.testing.assert_array_equal(visible_pixels(np.zeros((2, 2), np.uint16), 2), [0, 0])


def test_seen_hidden_and_outside() -> None:
    """The drone hangs 20 m above person 0; the image shows persons 0 and 1, who have 3 pixels and 1."""
    scene = scene_of("race")
    truth = people_truth(scene, 0.0)
    x, y, z = truth.position[0]
    image = np.zeros((48, 64), np.uint16)
    image[20, 30:33], image[5, 5] = 1, 2
    sight = sight_of_people(scene, truth, image, CAMERA, nadir(x, y, z + 20.0))
    assert (sight[0], sight[1]) == (Sight.VISIBLE, Sight.VISIBLE)
    apart = np.linalg.norm(truth.position[:, :2] - truth.position[0, :2], axis=1)
    assert (sight[(apart < 10.0) & (np.arange(len(sight)) > 1)] == Sight.HIDDEN).all()
    assert (sight[apart > 100.0] == Sight.OUTSIDE).all()
    strict = sight_of_people(scene, truth, image, CAMERA, nadir(x, y, z + 20.0), min_pixels=2)
    assert (strict[0], strict[1]) == (Sight.VISIBLE, Sight.HIDDEN)
    with pytest.raises(ValueError, match="min_pixels must be at least 1, got 0"):
        sight_of_people(scene, truth, image, CAMERA, nadir(x, y, z + 20.0), min_pixels=0)


def test_region_mask_by_hand() -> None:
    """Crowd 1: two people two pixels apart, closed together. Crowd 2: one person. Person 4 is in none."""
    truth = PeopleTruth(np.zeros((4, 3)), np.array([1, 1, 2, 0]))
    image = np.zeros((48, 64), np.uint16)
    image[10:14, 10:12], image[10:14, 13:15], image[30:33, 40:43], image[40, 5] = 1, 2, 3, 4
    image[20, 20] = 9  # a cyclist
    depth = np.full(image.shape, 16.0, np.float32)  # 1 m is 2 pixels
    regions = region_mask(truth, image, depth, 32.0)
    np.testing.assert_array_equal(regions[11:13, 10:15], 1)  # the disc leaves the ends of the gap round
    assert set(np.unique(regions)) == {0, 1, 2}
    assert regions[40, 5] == regions[20, 20] == 0
    np.testing.assert_array_equal(regions[30:33, 40:43], 2)
    far = region_mask(
        truth, image, np.where(image > 0, 64.0, np.inf), 32.0
    )  # 1 m is half a pixel: no closing
    np.testing.assert_array_equal(far > 0, (image > 0) & (image < 4))
    assert not region_mask(truth, np.zeros_like(image), depth, 32.0).any()


def test_the_nearer_crowd_is_kept_where_regions_overlap() -> None:
    truth = PeopleTruth(np.zeros((3, 3)), np.array([1, 1, 2]))
    image = np.zeros((48, 64), np.uint16)
    image[20:23, 20:24], image[20:23, 28:32], image[20:23, 25:27] = 1, 2, 3
    depth = np.where(image == 3, 4.0, 8.0).astype(np.float32)
    regions = region_mask(truth, image, depth, 32.0)
    np.testing.assert_array_equal(regions[20:23, 25:27], 2)
    assert (regions[21, [20, 24, 28]] == 1).all()


def test_footprint_of_a_camera_that_looks_down() -> None:
    """From 32 m above flat ground the image is 64 x 48 m, a pixel a metre: 32 x 24 cells of 2 m."""
    flat = np.full((48, 64), 32.0, np.float32)
    cells = footprint_cells(flat, CAMERA, nadir(100.0, -50.0, 32.0))
    assert len(cells) == 32 * 24
    moved = footprint_cells(flat, CAMERA, nadir(132.0, -50.0, 32.0))
    assert len(np.intersect1d(cells, moved)) == 16 * 24
    assert len(footprint_cells(flat, CAMERA, nadir(0.0, 0.0, 32.0), max_range_m=31.0)) == 0
    assert len(footprint_cells(np.full_like(flat, np.inf), CAMERA, nadir(0.0, 0.0, 32.0))) == 0


def test_overlap_statistics_by_hand() -> None:
    statistics = OverlapStatistics(3)
    a, b, nothing = np.arange(10), np.arange(8, 12), np.zeros(0, np.int64)
    statistics.add(0.0, {0: a, 1: b})
    statistics.add(1.0, {0: a, 1: b, 2: nothing})
    statistics.add(2.0, {0: a, 2: b + 100})
    statistics.add(3.0, {1: a, 2: a})
    assert statistics.shares == {(0, 1): [0.5, 0.5], (0, 2): [0.0, 0.0], (1, 2): [0.0, 1.0]}
    assert statistics.spans_s() == [(0.0, 1.0), (3.0, 3.0)]
    manifest = statistics.manifest()
    assert manifest["overlapping_share_of_instants"] == 0.75
    assert [pair["mean_share_of_smaller"] for pair in manifest["pairs"]] == [0.5, 0.0, 0.5]
    assert OverlapStatistics(2).manifest()["overlapping_share_of_instants"] is None


def test_views_of_the_race_overlap_in_a_part_of_the_flight() -> None:
    """Footprints on a coarse height map: riders together at 4 s and 70 s, apart at 33 s."""
    scene = scene_of("race")
    west, south, east, north = scene.landscape.extent_m
    x, y = np.arange(west, east, 4.0) + 2.0, np.arange(south, north, 4.0) + 2.0
    columns, rows = np.meshgrid(x, y, indexing="ij")
    height = scene.landscape.height_m(columns.ravel(), rows.ravel()).reshape(columns.shape)
    terrain = Terrain.from_height_map(height, 4.0, 4.0, origin=(west, south, 0.0))
    row, column = np.mgrid[0:48, 0:64]
    rays = CAMERA.unproject(np.stack([column.ravel() + 0.5, row.ravel() + 0.5], axis=-1))
    statistics = OverlapStatistics(3)
    for t_s in (4.0, 33.0, 70.0):
        footprints = {}
        for drone in range(3):
            pose = scene.flight.at(drone, t_s).world_from_camera
            directions = rays @ pose[:3, :3].T
            origins = np.broadcast_to(pose[:3, 3], directions.shape)
            _, distance = terrain.raycast(origins, directions, 250.0)
            footprints[drone] = footprint_cells((distance * rays[:, 2]).reshape(48, 64), CAMERA, pose)
        statistics.add(t_s, footprints)
    together, apart, again = statistics.most
    assert min(together, again) > 0.4
    assert apart < 0.25
