"""The definition of a crowd on annotated pictures, worked out by hand."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from crowdfence.labelled_pictures.annotated_picture import (
    AnnotatedPicture,
    AnnotationError,
    people_in_boxes,
    rectangle,
)
from crowdfence.labelled_pictures.crowd_labels import in_crowds, picture_labels
from crowdfence.truth.crowd_ground import crowds_of


def picture(people: Any = (), **more: Any) -> AnnotatedPicture:
    return AnnotatedPicture(
        Path("p.jpg"), 200, 100, np.array(people, np.float64).reshape(-1, 4), **{"gsd_m": 0.1, **more}
    )


def test_three_within_two_metres_are_a_crowd_and_two_are_not() -> None:
    """At 0.1 m per pixel: three people 1 m apart, and two alone. The ground reaches 10 pixels around each."""
    crowd = [(50, 50, 0, 0), (60, 50, 0, 0), (70, 50, 0, 0)]
    alone = [(150, 50, 0, 0), (160, 50, 0, 0)]
    found = picture_labels(picture(crowd + alone)).crowd
    assert found.shape == (100, 200)
    assert found[50, 46] and found[50, 65] and found[50, 76] and not found[50, 120:].any()
    assert not found[:34].any() and not found[66:].any()
    assert found.sum() == pytest.approx(20 * 20 + np.pi * 100, rel=0.12)


def test_who_is_marked_twice_is_one_person() -> None:
    """As where two files were put together: a couple is no crowd."""
    couple = [(150, 50, 5, 17), (160, 50, 5, 17)]
    assert not picture_labels(picture(couple * 2)).crowd.any()
    assert picture_labels(picture([*couple, (155, 50, 5, 17)])).crowd.any()


def test_a_person_is_as_long_as_a_box_where_no_scale_is_given() -> None:
    """Boxes of 68 pixels: 0.025 m per pixel, 30 pixels are 0.75 m; boxes of 17: 0.1 m, 30 pixels are 3 m."""
    apart = np.array([(50, 90), (80, 90), (110, 90)])
    near = np.concatenate([apart, np.tile((20, 68), (3, 1))], axis=1)
    far = np.concatenate([apart, np.tile((5, 17), (3, 1))], axis=1)
    assert picture_labels(picture(near, gsd_m=None)).crowd.any()
    assert not picture_labels(picture(far, gsd_m=None)).crowd.any()


def test_points_without_a_scale_are_refused() -> None:
    with pytest.raises(AnnotationError, match=r"p.jpg: people are points and nothing tells the scale"):
        picture_labels(picture([(1, n, 0, 0) for n in range(3)], gsd_m=None))
    assert not picture_labels(picture([(1, 1, 0, 0)] * 2, gsd_m=None)).crowd.any()  # no crowd at any scale


def test_boxes_of_one_pixel_are_points() -> None:
    """RectLabel writes them for points: everybody was 1.7 m long in one pixel, 51 m from the next, and a
    crowd was no crowd. Others who have a size tell that of all."""
    points = [(50 + 30 * n, 50, 1, 1) for n in range(3)]
    with pytest.raises(AnnotationError, match=r"p.jpg: people are points and nothing tells the scale"):
        picture_labels(picture(points, gsd_m=None))
    tall = [(150.0, 90.0, 20.0, 68.0)]  # 0.025 m per pixel
    assert picture_labels(picture([*points, *tall], gsd_m=None)).crowd[50, 80]


def test_marks_in_other_units_than_its_pixels_leave_no_picture_empty_in_silence() -> None:
    """On 200 x 100 pixels: made on a copy four times as large, and as fractions. One mark alone is let be."""
    large = [(4.0 * x, 4.0 * y, 20, 60) for x, y in ((60, 50), (70, 50), (80, 50), (20, 20))]
    with pytest.raises(AnnotationError, match=r"p.jpg: 3 of 4 marks lie outside its 200 x 100 pixels"):
        picture_labels(picture(large))
    with pytest.raises(AnnotationError, match=r"p.jpg: all marks lie within one of its 200 x 100 pixels"):
        picture_labels(picture([(0.3, 0.5, 0.01, 0.1), (0.9, 0.95, 0.01, 0.1)]))
    with pytest.raises(AnnotationError, match=r"2 of 2 marks lie outside"):
        picture_labels(picture(crowds=(rectangle(300, 20, 5, 6),), ignored=(rectangle(100, 101, 3, 3),)))
    people = [(50, 50, 0, 0), (60, 50, 0, 0), (70, 50, 0, 0), (400, 50, 0, 0)]
    assert picture_labels(picture(people)).crowd.any()


@pytest.mark.parametrize("far", [1e12, -1e300])
def test_a_mark_beyond_all_pictures_is_refused_by_its_place(far: float) -> None:
    """An outline of a crowd that covers half of the picture was not drawn at all, and a person that far away
    ended in a traceback."""
    crowd = np.array([(0.0, 0.0), (far, 0.0), (far, far)])
    people = [(far, 20.0, 5.0, 17.0), (50, 50, 5, 17), (60, 50, 5, 17)]
    for marks in ({"crowds": (crowd,)}, {"people": people, "gsd_m": None}):
        with pytest.raises(AnnotationError, match=r"p.jpg: a mark reaches to pixel -?1e\+\d+; allowed: up "):
            picture_labels(picture(**marks))


def test_boxes_given_by_two_corners_are_refused() -> None:
    """Three people 6 x 17 pixels large: read as x, y, width and height the last was 166 pixels wide, and
    stood at (243, 137), outside of the picture."""
    corners = np.array([[20, 10, 26, 27], [80, 30, 86, 47], [160, 60, 166, 77]], np.float64)
    with pytest.raises(AnnotationError, match=r"p.jpg: all 3 boxes of people are .* given by two corners"):
        picture_labels(picture(people_in_boxes(corners)))
    sizes = np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1)
    assert not picture_labels(picture(people_in_boxes(sizes), gsd_m=None)).crowd.any()
    # One that fills the picture, or two in its corner.
    assert picture_labels(picture(people_in_boxes(np.array([[40, 10, 100, 90]])))).crowd.sum() == 0
    assert picture_labels(picture(people_in_boxes(np.array([[2, 2, 6, 17], [5, 1, 6, 17]])))).crowd.sum() == 0


def test_outlines_are_drawn_as_they_are() -> None:
    """Five pixels by six, and not a row and a column more, which was a tenth of a crowd of 30 pixels."""
    labels = picture_labels(picture(crowds=(rectangle(10, 20, 5, 6),), ignored=(rectangle(100, 0, 3, 3),)))
    rows, columns = np.nonzero(labels.crowd)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (20, 25, 10, 14)
    assert labels.crowd.sum() == 30
    assert labels.ignored[1, 101] and labels.ignored.sum() == 9


def test_a_triangle_is_the_pixels_whose_middle_it_holds() -> None:
    """Of a square of 8 x 8 pixels the half above its diagonal, and the middles of those on it just so."""
    triangle = np.array([(10.0, 20.0), (18.0, 20.0), (18.0, 28.1)])
    crowd = picture_labels(picture(crowds=(triangle,))).crowd
    assert [int(row.sum()) for row in crowd[20:28]] == [8, 7, 6, 5, 4, 3, 2, 1]
    assert crowd.sum() == 36


@given(hnp.arrays(np.float64, st.tuples(st.integers(1, 25), st.just(2)), elements=st.floats(0, 12)))
def test_the_crowds_are_those_of_the_terrain(places_m: np.ndarray) -> None:
    """On one scale it is DBSCAN, as `crowds_of` computes it from metres."""
    world = np.column_stack([places_m, np.zeros(len(places_m))])
    apart = np.linalg.norm(places_m[:, None] - places_m[None], axis=2)
    if (np.abs(apart - 2.0) < 1e-6).any():
        return  # a rounding decides
    expected = crowds_of(world, 2.0, 3) >= 0
    found = in_crowds(places_m / 0.05, np.full(len(places_m), 0.05))
    np.testing.assert_array_equal(found, expected)
