"""Which frames a page of examples shows."""

import numpy as np
import pytest

from crowdfence.evaluation.cells.example_page import COLUMNS, TILE_PX, ExamplePage

WIDTH, HEIGHT = TILE_PX


def offer(page, grey, *, crowd, found, false, mission="one"):
    """A frame of 120 x 160 pixels and 30 x 40 cells with `crowd` cells of crowd, the first `found` of them
    marked, and `false` empty cells that are marked, none of them in the upper half."""
    truth, heatmap = np.zeros(600, bool), np.zeros(600)
    truth[:crowd] = True
    heatmap[:found] = 1.0
    heatmap[300 : 300 + false] = 1.0
    lower = [np.vstack([np.zeros((15, 40)), part.reshape(15, 40)]) for part in (truth, heatmap)]
    mask = np.kron(lower[0], np.ones((4, 4))) > 0
    page.offer(mission, np.full((120, 160, 3), grey, np.uint8), lower[1], mask, None)


def shown(page):
    """Grey values in the upper left corners of the tiles, row by row."""
    picture = page.picture()
    corners = picture[2::HEIGHT, 2::WIDTH]
    assert corners.shape[1] == COLUMNS
    return [int(corner[0]) for corner in corners.reshape(-1, 3)]


def test_the_frame_with_most_crowd_and_the_one_with_most_errors():
    page = ExamplePage()
    offer(page, 10, crowd=40, found=40, false=30)
    offer(page, 20, crowd=90, found=80, false=0)  # most crowd
    offer(page, 30, crowd=0, found=0, false=60)  # most errors
    offer(page, 40, crowd=50, found=20, false=20)
    assert shown(page) == [20, 30, 255, 255]  # the rest of the row is white


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)])
def test_no_frame_is_shown_twice(order):
    frames = [(10, 90, 0, 50), (20, 60, 60, 1), (30, 5, 5, 40)]  # the first has most of both
    page = ExamplePage()
    for which in order:
        grey, crowd, found, false = frames[which]
        offer(page, grey, crowd=crowd, found=found, false=false)
    assert shown(page) == [10, 30, 255, 255]


def test_every_mission_has_its_own_two():
    page = ExamplePage()
    offer(page, 10, crowd=9, found=9, false=0, mission="a")
    offer(page, 20, crowd=5, found=0, false=0, mission="b")
    offer(page, 30, crowd=8, found=8, false=1, mission="b")
    assert shown(page) == [10, 30, 20, 255]


def test_hidden_places_are_no_errors():
    page = ExamplePage()
    offer(page, 10, crowd=90, found=90, false=0)
    image, nothing = np.full((120, 160, 3), 20, np.uint8), np.zeros((120, 160), bool)
    page.offer("one", image, np.ones((30, 40)), nothing, ~nothing)  # marked everywhere, all of it hidden
    offer(page, 30, crowd=0, found=0, false=1)
    assert shown(page)[:2] == [10, 30]


def test_a_page_needs_a_frame():
    with pytest.raises(ValueError, match="at least one"):
        ExamplePage().picture()
