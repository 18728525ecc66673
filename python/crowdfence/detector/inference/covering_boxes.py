"""Cells of a picture -> few rectangles that hold all of them and little else.

Far ground is a ragged band with specks around it, and a rectangle around all of it is most of the picture. So
a box is cut in two, straight across, wherever that leaves less to be looked at.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Box(NamedTuple):
    """Rows and columns of cells."""

    rows: slice
    columns: slice


def covering_boxes(cells: NDArray[np.bool_], margin: int, cost: float) -> list[Box]:
    """Boxes that hold all of `cells` [h, w] between them, none of them twice; none where there are no cells.

    margin  cells around a box that are looked at with it, as far as the picture reaches
    cost    what a further box costs, as so many cells that are looked at
    """
    picture = (cells.shape[0], cells.shape[1])
    return list(_covering(cells, 0, 0, picture, margin, cost)) if cells.any() else []


def _covering(
    cells: NDArray[np.bool_], top: int, left: int, picture: tuple[int, int], margin: int, cost: float
) -> Iterator[Box]:
    """Of a part of the cells that begins at (top, left) and holds at least one."""
    rows, columns = (_span(np.asarray(cells.any(axis=axis))) for axis in (1, 0))
    cells = cells[rows, columns]
    top, left = top + rows.start, left + columns.start
    height, width = cells.shape
    whole = _reach(top, top + height, margin, picture[0]) * _reach(left, left + width, margin, picture[1])
    row, by_row = _best_cut(cells, top, left, picture, margin)
    column, by_column = _best_cut(cells.T, left, top, picture[::-1], margin)
    if min(by_row, by_column) + cost >= whole:
        yield Box(slice(top, top + height), slice(left, left + width))
    elif by_row <= by_column:
        yield from _covering(cells[:row], top, left, picture, margin, cost)
        yield from _covering(cells[row:], top + row, left, picture, margin, cost)
    else:
        yield from _covering(cells[:, :column], top, left, picture, margin, cost)
        yield from _covering(cells[:, column:], top, left + column, picture, margin, cost)


def _best_cut(
    cells: NDArray[np.bool_], top: int, left: int, picture: tuple[int, int], margin: int
) -> tuple[int, float]:
    """The row before which to cut, and the cells that are then looked at; infinite where there is no cut."""
    rows = np.flatnonzero(cells.any(axis=1))
    if len(rows) < 2:
        return 0, np.inf
    first = left + cells[rows].argmax(axis=1)
    end = left + cells.shape[1] - cells[rows, ::-1].argmax(axis=1)
    rows = rows + top
    above = _reach(rows[0], rows[:-1] + 1, margin, picture[0]) * _reach(
        np.minimum.accumulate(first)[:-1], np.maximum.accumulate(end)[:-1], margin, picture[1]
    )
    below = _reach(rows[1:], rows[-1] + 1, margin, picture[0]) * _reach(
        np.minimum.accumulate(first[::-1])[-2::-1],
        np.maximum.accumulate(end[::-1])[-2::-1],
        margin,
        picture[1],
    )
    best = int((above + below).argmin())
    return int(rows[best + 1] - top), float(above[best] + below[best])


def _reach(first: ArrayLike, end: ArrayLike, margin: int, most: int) -> NDArray[np.int64]:
    """Cells from `first` up to `end` with a margin on both sides, inside a picture."""
    return np.minimum(np.add(end, margin), most) - np.maximum(np.subtract(first, margin), 0)


def _span(has: NDArray[np.bool_]) -> slice:
    """From the first to the last that has any."""
    return slice(int(has.argmax()), len(has) - int(has[::-1].argmax()))
