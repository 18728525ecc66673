"""Boxes around the cells of one size: all of them, none twice, and little else."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from crowdfence.detector.inference.covering_boxes import Box, covering_boxes


def looked_at(box: Box, shape: tuple[int, ...], margin: int) -> int:
    cells = np.zeros(np.add(shape, 2 * margin), bool)
    rows, columns = box
    cells[rows.start : rows.stop + 2 * margin, columns.start : columns.stop + 2 * margin] = True
    inside = slice(margin, -margin or None)
    return int(cells[inside, inside].sum())


def test_a_box_is_cut_where_that_leaves_less_to_be_looked_at() -> None:
    """An L of 10 x 20 and 10 x 5 cells in 20 x 20: 400 in one box, 250 and the cost of one in two."""
    cells = np.zeros((20, 20), bool)
    cells[:10] = cells[10:, :5] = True
    upper, lower = Box(slice(0, 10), slice(0, 20)), Box(slice(10, 20), slice(0, 5))
    assert covering_boxes(cells, 0, 149) == [upper, lower]
    assert covering_boxes(cells, 0, 151) == [Box(slice(0, 20), slice(0, 20))]


def test_margins_count_as_far_as_the_picture_reaches() -> None:
    """Specks in two corners: 3 x 3 cells around each inside the picture, 20 x 20 around both."""
    cells = np.zeros((20, 20), bool)
    cells[0, 0] = cells[19, 19] = True
    assert len(covering_boxes(cells, 2, 400 - 2 * 9 - 1)) == 2
    assert len(covering_boxes(cells, 2, 400 - 2 * 9 + 1)) == 1


def test_no_cells_need_no_box() -> None:
    assert covering_boxes(np.zeros((4, 5), bool), 1, 1) == []


@given(
    hnp.arrays(bool, st.tuples(st.integers(1, 24), st.integers(1, 24))),
    st.integers(0, 5),
    st.integers(0, 60),
)
def test_every_cell_is_in_one_box_and_no_more_is_looked_at_than_in_one(
    cells: np.ndarray, margin: int, cost: int
) -> None:
    boxes = covering_boxes(cells, margin, cost)
    count = np.zeros(cells.shape, int)
    for box in boxes:
        count[box] += 1
    assert (count[cells] == 1).all()
    if cells.any():
        rows, columns = (np.flatnonzero(cells.any(axis=axis)) for axis in (1, 0))
        around = Box(slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        total = sum(looked_at(box, cells.shape, margin) + cost for box in boxes)
        assert total <= looked_at(around, cells.shape, margin) + cost
