"""People in an image and metres per pixel -> P(crowd) of every cell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.contract.crowd_rules import PeopleRule
from crowdfence.detector.ground_scale import GroundScale
from crowdfence.detector.inference.map_output import Map, sigmoid
from crowdfence.detector.inference.people_output import People

_OWN_CELL = 0.7072
"""Half the diagonal of a cell, and a little: people count at least in the cell that they stand in."""


def crowd_from_people(people: People, scale: GroundScale, rule: PeopleRule, stride: int) -> Map:
    """P [h, w] of cells of `stride` x `stride` pixels; see `PeopleRule`."""
    count = _people_near(people, scale, rule.radius_m, stride)
    heatmap = sigmoid((count - (rule.min_people - 0.5)) / rule.softness_people).astype(np.float32)
    metres_per_cell = np.maximum(scale.right_m, scale.down_m) * np.float32(stride)
    return closed(heatmap, np.float32(rule.closing_m) / metres_per_cell)


def _people_near(people: People, scale: GroundScale, radius_m: float, stride: int) -> NDArray[np.float64]:
    """Sum of the scores of the people within `radius_m` of each cell's centre, at each person's own scale."""
    height, width = scale.right_m.shape
    count = np.zeros((height, width))
    # Cell (i, j) has its centre at (j, i) in these coordinates.
    x, y = people.x / stride - 0.5, people.y / stride - 0.5
    row = np.rint(y).clip(0, height - 1).astype(np.intp)
    column = np.rint(x).clip(0, width - 1).astype(np.intp)
    radius_x = np.maximum(radius_m / (scale.right_m[row, column] * stride), _OWN_CELL)
    radius_y = np.maximum(radius_m / (scale.down_m[row, column] * stride), _OWN_CELL)
    for x_i, y_i, rx, ry, score in zip(x, y, radius_x, radius_y, people.score, strict=True):
        left, right = max(0, int(np.ceil(x_i - rx))), min(width, int(np.floor(x_i + rx)) + 1)
        top, bottom = max(0, int(np.ceil(y_i - ry))), min(height, int(np.floor(y_i + ry)) + 1)
        if left >= right or top >= bottom:
            continue
        across = ((np.arange(left, right) - x_i) / rx) ** 2
        down = ((np.arange(top, bottom) - y_i) / ry) ** 2
        count[top:bottom, left:right] += score * (down[:, None] + across <= 1.0)
    return count


def closed(values: Map, radius_cells: Map) -> Map:
    """Grey closing with a disc (an octagon) whose radius [h, w] may differ from cell to cell.

    Gaps narrower than two radii are filled; no value falls, and the border is not eaten away.
    """
    steps = [_is_square(step) for step in range(int(min(np.rint(radius_cells).max(), max(values.shape))))]
    grown = values
    for step, square in enumerate(steps):
        grown = np.where(radius_cells > step + 0.5, _neighbourhood(grown, np.maximum, -np.inf, square), grown)
    for step, square in reversed(list(enumerate(steps))):
        grown = np.where(radius_cells > step + 0.5, _neighbourhood(grown, np.minimum, np.inf, square), grown)
    return np.maximum(values, grown)


def _is_square(step: int) -> bool:
    """Steps by a square and by a cross mixed as 0.414 : 0.586 make a regular octagon."""
    share = np.sqrt(2.0) - 1.0
    return bool(np.floor((step + 1) * share) > np.floor(step * share))


def _neighbourhood(values: Map, best: np.ufunc, outside: float, square: bool) -> Map:
    """Highest or lowest value of each cell and its 4 or 8 neighbours."""
    padded = np.pad(values, 1, constant_values=outside)
    across = best(best(padded[:, :-2], padded[:, 2:]), padded[:, 1:-1])
    if square:
        return np.asarray(best(best(across[:-2], across[2:]), across[1:-1]))
    return np.asarray(best(best(padded[:-2, 1:-1], padded[2:, 1:-1]), across[1:-1]))
