"""People of crowds in one picture, and pictures one by one: worked out by hand."""

from pathlib import Path

import numpy as np
import pytest

from crowdfence import Camera, FrameError
from crowdfence.evaluation.cells.people_found import PeopleFound
from crowdfence.evaluation.cells.picture_figures import PictureFigures
from crowdfence.sources.recorded_truth import FrameTruth, RecordedPeople
from crowdfence.sources.recording import Frame

CAMERA = Camera.pinhole(80, 40, 100.0, 100.0, 40.0, 20.0)
"""At 10 m a pixel is 0.1 m."""


def frame(positions: list[tuple[float, float, float]], crowd: list[int], pixels: list[int] | None) -> Frame:
    """A camera at the origin whose axes are those of the world: people at (x, y, z) lie z in front of it."""
    people = RecordedPeople(
        0,
        np.array(positions, np.float32).reshape(-1, 3),
        np.arange(1, len(crowd) + 1, dtype=np.uint32),
        np.array(crowd, np.uint32),
        None if pixels is None else np.array(pixels, np.uint32),
    )
    return Frame("a", 0, CAMERA, np.eye(4), truth=FrameTruth(people=lambda: people))


def test_feet_count_in_the_cell_that_they_stand_in() -> None:
    """Cells of 4 pixels. Feet at x = 1 m, 10 m away: pixel 50, column 12; y = 0.5 m: pixel 25, row 6. Of the
    four others one is in no crowd, one hidden, one beside the picture and one behind the camera."""
    here = (1.0, 0.5, 10.0)
    others = [here, here, (9.0, 0.0, 10.0), (0.0, 0.0, -10.0)]
    seen = frame([here, *others], [1, 0, 1, 1, 1], [5, 5, 0, 5, 5])
    heatmap = np.zeros((10, 20), np.float32)
    heatmap[6, 12] = 0.6
    crowd = heatmap > 0.0
    gsd_m = np.full((10, 20), 0.1)
    found = PeopleFound()
    found.add(seen, heatmap, crowd, gsd_m, None)
    assert (found.people, found.empty_cells) == (1, 199)
    assert (found.share_found(), found.share_called()) == (1.0, 0.0)
    found.add(seen, np.zeros_like(heatmap), crowd, gsd_m, None)
    assert found.share_found() == 0.5


def test_cells_that_reach_beyond_the_picture_are_as_large_as_the_others() -> None:
    """Cells of 32 pixels on 80 x 40: three and two. Feet at x = 2.3 m, 10 m away: pixel 63, the last one of
    column 1; laid evenly over the picture as three of 27 pixels, it would be column 2."""
    heatmap = np.zeros((2, 3), np.float32)
    heatmap[0, 1] = 0.9
    found = PeopleFound()
    seen = frame([(2.3, 0.0, 10.0)], [1], [5])
    found.add(seen, heatmap, heatmap > 0.0, np.full((2, 3), 0.1), None, 32)
    assert found.share_found() == 1.0


def test_only_the_tested_range_counts() -> None:
    """Distance sqrt(1 + 0.25 + 100) m over 100 pixels: 0.1006 m per pixel."""
    seen = frame([(1.0, 0.5, 10.0)], [1], [5])
    values, crowd = np.zeros((10, 20), np.float32), np.zeros((10, 20), np.bool_)
    gsd_m = np.where(np.arange(20) < 5, 0.2, np.nan) * np.ones((10, 1))
    found = PeopleFound()
    found.add(seen, values, crowd, gsd_m, (0.11, 0.3))
    assert (found.people, found.empty_cells) == (0, 50)
    assert found.to_json()["share_found"] is None
    found.add(seen, values, crowd, gsd_m, (0.1, 0.15))
    assert (found.people, found.empty_cells) == (1, 50)


def test_the_threshold_that_costs_one_percent() -> None:
    """Values 0.9, 0.4 and 0.3 of empty cells, 0.35 of the one person's."""
    heatmap = np.zeros((10, 20), np.float32)
    heatmap[0, :3] = 0.9, 0.4, 0.3
    heatmap[6, 12] = 0.35
    found = PeopleFound()
    crowd = np.zeros((10, 20), np.bool_)
    crowd[6, 12] = True
    found.add(frame([(1.0, 0.5, 10.0)], [1], [5]), heatmap, crowd, np.full((10, 20), 0.1), None)
    # 199 empty cells, 1.99 of them affordable: only the one at 0.9, so the threshold lies at 0.4.
    assert found.affordable_threshold() == pytest.approx(0.4, abs=1.5 / 960)
    assert found.share_found(0.3) == 1.0 and found.share_found(found.affordable_threshold()) == 0.0


def test_without_empty_ground_nobody_knows_what_one_percent_of_it_costs() -> None:
    """Everything would be affordable then, so all of the people would be found for nothing."""
    heatmap = np.zeros((10, 20), np.float32)
    found = PeopleFound()
    seen = frame([(1.0, 0.5, 10.0)], [1], [5])
    found.add(seen, heatmap, np.zeros((10, 20), np.bool_), np.full((10, 20), np.nan), None)
    told = found.to_json()
    assert (told["people_of_crowds"], told["empty_cells"], told["share_found"]) == (1, 0, 0.0)
    assert told["threshold_at_one_percent"] is None and told["share_found_at_one_percent"] is None


def test_people_without_pixel_counts_are_refused() -> None:
    values = np.zeros((10, 20), np.float32)
    with pytest.raises(FrameError, match="not how many pixels show them"):
        PeopleFound().add(frame([(0, 0, 10)], [1], None), values, values > 0, values + 0.1, None)


def test_every_picture_counts_the_same(tmp_path: Path) -> None:
    """Recall 1/2 of a crowd of 2 cells and 1 of one of 4; 0 and 1/50 of pictures without crowd."""
    figures = PictureFigures()
    known = np.ones((5, 10), np.bool_)
    marked, crowd = np.zeros((5, 10)), np.zeros((5, 10), np.bool_)
    marked[0, 0] = 1.0
    crowd[0, :2] = True
    figures.add(marked, crowd, known)
    figures.add(np.ones((5, 10)), np.pad(np.ones((2, 2), np.bool_), ((0, 3), (0, 8))), known)
    figures.add(np.zeros((5, 10)), ~known, known)
    figures.add(marked, ~known, known)
    figures.add(marked, ~known, ~known)  # nothing is known: no picture
    assert figures.to_json() == {
        "pictures_with_crowd": 2,
        "mean_recall": 0.75,
        "pictures_without_crowd": 2,
        "mean_share_marked": 0.01,
        "share_with_more_than_one_percent": 0.5,
    }
