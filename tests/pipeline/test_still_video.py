"""A video that stands still while the drone flies on is told; one that shows nothing new is not."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import crowdfence as cf
from crowdfence.pipeline.still_video import StillVideo

CAMERA = cf.Camera.pinhole(64, 48, 40.0, 40.0, 32.0, 24.0)
BEGIN_NS = 1_760_000_000_000_000_000


def picture(seed: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(0.0, 0.3, (12, 16)).astype(np.float32)


def looked(heatmaps: list[NDArray[np.float32]], *, east_m: float, turned_deg: float = 0.0) -> StillVideo:
    """Views straight down, so far apart from one to the next."""
    video = StillVideo()
    for number, heatmap in enumerate(heatmaps):
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, :3] = Rotation.from_euler("z", turned_deg * number, degrees=True).as_matrix() @ pose[:3, :3]
        pose[:3, 3] = (east_m * number, 0.0, 30.0)
        video.look(cf.View("uav1", BEGIN_NS + number * 200_000_000, CAMERA, pose, heatmap))
    return video


@pytest.mark.parametrize(("east_m", "turned_deg"), [(0.6, 0.0), (0.0, 1.1), (0.2, 0.4)])
def test_the_same_picture_of_a_camera_that_moves_is_told(east_m: float, turned_deg: float) -> None:
    moving = [picture(number) for number in range(5)]
    video = looked(moving + [picture(4)] * 8, east_m=east_m, turned_deg=turned_deg)
    (warning,) = video.warnings
    # 0.2 m and 0.4 degrees a view add up to enough with the third one: 1.2 degrees.
    repeated = 6 if east_m == 0.2 else 8
    assert f"uav1: {repeated} of its 13 heatmaps are those of the picture before" in warning
    assert f"the last {repeated} heatmaps of uav1 are the same" in (video.standing()["uav1"] or "")


def test_a_video_that_goes_on_is_told_afterwards_and_is_no_alarm_any_more() -> None:
    video = looked([picture(1)] * 6 + [picture(2)], east_m=1.0)
    assert len(video.warnings) == 1 and video.standing() == {"uav1": None}


@pytest.mark.parametrize(
    ("heatmaps", "east_m"),
    [
        ([picture(number) for number in range(10)], 1.0),
        ([picture(1)] * 10, 0.0),  # a hover in a simulation without noise
        ([np.zeros((12, 16), np.float32)] * 10, 1.0),  # nobody anywhere
        ([np.eye(12, 16, dtype=np.float32) / 255] * 10, 1.0),  # and next to nothing
        ([picture(number // 2) for number in range(4)], 1.0),  # a hiccup now and then
    ],
)
def test_what_may_be_is_not_told(heatmaps: list[NDArray[np.float32]], east_m: float) -> None:
    video = looked(heatmaps, east_m=east_m)
    assert video.warnings == [] and video.standing() == {"uav1": None}
