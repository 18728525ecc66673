"""Truth that maps are scored against: remembered labels, and where people stand."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from crowdfence import Camera, Terrain
from crowdfence.evaluation.replay import measured_rates
from crowdfence.pipeline import open_terrain
from crowdfence.sources import open_recording
from crowdfence.sources.recording import Frame, PixelSources, Recording
from crowdfence.truth.over_time import CrowdsOfTheWorld, ProjectedLabels

DEMO = Path(__file__).parents[2] / "python" / "crowdfence" / "demo_data" / "race.mcap"


def test_the_crowds_of_the_demo_stand_where_its_people_do() -> None:
    """Everybody who is recorded as part of a crowd stands on it, and it ends 1 m from people, or within the
    gaps of 2 m that are closed: never 3 m away, half a voxel's diagonal added."""
    recording = open_recording(DEMO)
    terrain = open_terrain(recording, None)
    truth = CrowdsOfTheWorld(recording, terrain)
    for instant in list(recording.instants())[::10]:
        crowd = truth.at(instant)
        people = recording.people_truth(instant.frames[-1].exposure_ns())
        assert people is not None
        feet = np.asarray(people.position[people.crowd > 0], np.float64)
        centres = terrain.voxel_centers(np.flatnonzero(crowd))[:, :2]
        half_diagonal_m = terrain.voxel_size_m * np.sqrt(0.5)
        assert cKDTree(centres).query(feet[:, :2])[0].max() <= half_diagonal_m + 1e-6
        assert cKDTree(feet[:, :2]).query(centres)[0].max() <= 3.0 + half_diagonal_m


def test_a_label_stays_until_the_place_is_seen_again() -> None:
    """From 10 m above a plain of 1 m voxels, 10 px show one voxel: two looks at places that do not overlap,
    then a second look at the first, now empty."""
    plain = Terrain.from_height_map(np.zeros((40, 20)), 1.0)
    camera = Camera.pinhole(100, 100, 100.0, 100.0, 50.0, 50.0)

    def look(stamp_ns: int, east_m: float, crowd: bool) -> Frame:
        down = np.array([[1.0, 0, 0, east_m], [0, -1, 0, 10.0], [0, 0, -1, 10.0], [0, 0, 0, 1]])
        mask = np.full((100, 100), crowd)
        return Frame("a", stamp_ns, camera, down, PixelSources(silhouettes=lambda: mask))

    frames = (look(10**9, 10.0, True), look(2 * 10**9, 30.0, False), look(3 * 10**9, 10.0, False))
    recording = Recording("looks", ("a",), frames, None, None, (), (), {}, {})
    labels = ProjectedLabels(recording, plain, max_range_m=300.0, target_height_m=0.0, coverage="rays")
    first, second, third = (labels.at(instant) for instant in recording.instants())
    east = plain.voxel_indices(np.flatnonzero(first))[:, 0]
    assert first.sum() == 100 and (east.min(), east.max()) == (5, 14)
    np.testing.assert_array_equal(second, first)
    assert not third.any()


def test_truth_that_is_not_recorded_is_refused() -> None:
    nothing = Recording("bare", ("a",), (), None, None, (), (), {}, {})
    terrain = Terrain.from_occupancy(np.ones((2, 2, 1), np.bool_), 1.0)
    with pytest.raises(ValueError, match="bare does not record where people are"):
        CrowdsOfTheWorld(nothing, terrain)
    with pytest.raises(ValueError, match="bare holds no truth"):
        ProjectedLabels(nothing, terrain, max_range_m=300.0, target_height_m=0.0, coverage="rays")
    with pytest.raises(ValueError, match="bare holds no truth"):
        measured_rates(nothing)
