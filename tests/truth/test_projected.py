"""Labelled images projected onto a flat terrain that a camera looks straight down on."""

import numpy as np
import pytest
from numpy.typing import NDArray

from crowdfence._core import Camera, Terrain
from crowdfence.truth.projected import ProjectedTruth, TruthMap, project_truth

# 5 m above level ground of 8 x 8 voxels of 1 m: with f = 10 px a voxel shows as 2 x 2 pixels.
TERRAIN = Terrain.from_height_map(np.ones((8, 8)), 1.0)
CAMERA = Camera.pinhole(16, 16, 10.0, 10.0, 8.0, 8.0)
LOOKING_DOWN = np.array([[1, 0, 0, 4], [0, -1, 0, 4], [0, 0, -1, 6], [0, 0, 0, 1]], np.float64)


def project(mask: NDArray[np.generic]) -> ProjectedTruth:
    return project_truth(mask, CAMERA, LOOKING_DOWN, TERRAIN, max_range_m=50.0)


def test_a_voxel_is_crowd_when_half_of_its_pixels_are() -> None:
    mask = np.zeros((16, 16), np.bool_)
    mask[4:6, 6:8] = True  # column 3, row 2 from the north edge: voxel (3, 5), all four pixels
    mask[0, 0:2] = True  # voxel (0, 7): two of four
    mask[15, 15] = True  # voxel (7, 0): one of four
    truth = project(mask)
    np.testing.assert_array_equal(truth.voxel_ids, np.arange(64))
    crowd = {tuple(column) for column in TERRAIN.voxel_indices(truth.crowd_ids)[:, :2]}
    assert crowd == {(3, 5), (0, 7)}


def test_an_empty_mask_is_seen_as_empty() -> None:
    truth = project(np.zeros((16, 16), np.bool_))
    assert len(truth.voxel_ids) == 64 and len(truth.crowd_ids) == 0


@pytest.mark.parametrize("mask", [np.zeros((16, 16), np.uint8), np.zeros((8, 8), np.bool_)])
def test_masks_must_be_bool_and_of_the_size_of_the_image(mask: NDArray[np.generic]) -> None:
    with pytest.raises(ValueError, match=r"mask must be bool \[16, 16\], got"):
        project(mask)


def labels(**crowd_of_voxel: bool) -> ProjectedTruth:
    """labels(v2=True, v3=False): voxel 2 shown as crowd, voxel 3 as empty."""
    ids = np.array([int(name[1:]) for name in crowd_of_voxel], np.int64)
    return ProjectedTruth(ids, np.array(list(crowd_of_voxel.values()), np.bool_))


def test_a_voxel_keeps_the_label_it_was_last_seen_with() -> None:
    truth = TruthMap(4)
    truth.update([labels(v0=True, v1=True, v2=False)])
    truth.update([labels(v1=False, v2=True)])
    np.testing.assert_array_equal(truth.crowd, [True, False, True, False])
    np.testing.assert_array_equal(truth.seen, [True, True, True, False])
    truth.update([])
    np.testing.assert_array_equal(truth.crowd, [True, False, True, False])


@pytest.mark.parametrize("order", [1, -1])
def test_one_view_that_shows_crowd_is_enough_in_any_order(order: int) -> None:
    truth = TruthMap(2)
    truth.update([labels(v0=True, v1=False), labels(v0=False, v1=False)][::order])
    np.testing.assert_array_equal(truth.crowd, [True, False])


def test_a_refused_instant_changes_nothing() -> None:
    truth = TruthMap(2)
    with pytest.raises(ValueError, match="voxel ids 0 to 7 do not fit a map of 2 voxels"):
        truth.update([labels(v1=True), labels(v0=True, v7=True)])
    assert not truth.seen.any() and not truth.crowd.any()
    with pytest.raises(ValueError, match="voxel_count must be at least 1"):
        TruthMap(0)
