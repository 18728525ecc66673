"""Boxes given by two corners, read as a place and a size: told by all boxes together, or not at all."""

import numpy as np
import pytest
from numpy.typing import NDArray

from crowdfence.detector.contract.two_corners import are_two_corners

PICTURE = (1280.0, 720.0)

GROUP = np.array(
    [
        (600.0, 300.0, 10.0, 24.0),
        (613.0, 306.0, 11.0, 26.0),
        (626.0, 330.0, 9.0, 23.0),
        (604.0, 352.0, 10.0, 25.0),
        (640.0, 371.0, 11.0, 27.0),
    ]
)
"""Left, top, width and height of five people, 40 x 71 pixels apart and 9 to 11 x 23 to 27 large: within an
eleventh of the picture."""


def told(place: NDArray[np.float64], size: NDArray[np.float64]) -> bool:
    return are_two_corners(np.asarray(place, float), np.asarray(size, float), PICTURE)


@pytest.mark.parametrize("by", [1.0, 1.0 / 1280.0])
def test_the_corners_of_people_who_stand_together_are_told(by: float) -> None:
    corners = GROUP[:, :2] * by, (GROUP[:, :2] + GROUP[:, 2:]) * by
    assert are_two_corners(*corners, (PICTURE[0] * by, PICTURE[1] * by))


def test_the_same_people_by_place_and_size_are_not() -> None:
    assert not told(GROUP[:, :2], GROUP[:, 2:])
    assert not told(GROUP[:, :2] + GROUP[:, 2:] / 2.0, GROUP[:, 2:])


def test_few_or_nobody_proves_nothing() -> None:
    for count in range(5):
        assert not told(GROUP[:count, :2], GROUP[:count, :2] + GROUP[:count, 2:])


@pytest.mark.parametrize("seed", range(50))
def test_one_person_who_fills_the_picture_and_is_found_many_times_is_no_corners(seed: int) -> None:
    """A model without suppression finds it by tens, each a little elsewhere and a little larger."""
    random = np.random.default_rng(seed)
    place = (640.0, 360.0) * (1.0 + random.normal(0.0, 0.03, (40, 2)))
    assert not told(place, (900.0, 700.0) * (1.0 + random.normal(0.0, 0.05, (40, 2))))


def test_the_same_box_five_times_is_no_corners() -> None:
    for size in (300.0, 310.0):
        assert not told(np.full((5, 2), 300.0), np.full((5, 2), size))


def test_parts_of_one_person_are_no_corners() -> None:
    """Head, shoulders, and more of it down to the feet: tops alike, so that heights grow twice as fast as
    middles go down; sides alike, so that widths grow twice as fast as middles go right."""
    size = np.array([(80.0 + 20 * k, 200.0 + 60 * k) for k in range(6)])
    assert not told(size / 2.0, size)


def test_people_of_one_size_in_the_corner_of_the_picture_are_no_corners() -> None:
    place = np.array([(40.0, 60.0), (55.0, 90.0), (70.0, 75.0), (35.0, 110.0), (80.0, 130.0)])
    assert not told(place, np.full((5, 2), (90.0, 200.0)))
