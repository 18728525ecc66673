"""Frames of labelled missions on one page, with what a model says and what is true."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from crowdfence.evaluation.cells.rates import crowd_cells, heatmap_values

TRUTH_COLOUR = (0, 255, 255)
COLUMNS = 4
TILE_PX = (480, 360)


class _Example(NamedTuple):
    """A frame, and how many of its cells are crowd and wrong."""

    crowd: int
    wrong: int
    image: NDArray[np.uint8]
    values: NDArray[np.float64]
    mask: NDArray[np.bool_]


MOST_MISSIONS = 48
"""Of more, or of more pictures, those with most crowd and those with most errors are shown."""


class ExamplePage:
    """Keeps two frames of every mission: the one with most crowd and, of the others, the one with most wrong
    cells. Where a model fails is what examples are for."""

    def __init__(self) -> None:
        self._kept: dict[str, list[_Example]] = {}

    def offer(
        self,
        mission: str,
        image: NDArray[np.uint8],
        heatmap: NDArray[np.generic],
        mask: NDArray[np.bool_],
        ignored: NDArray[np.bool_] | None,
        stride: int | None = None,
    ) -> None:
        """Consider one frame: image [H, W, 3], heatmap [h, w], crowd and what does not count as bool
        arrays of any resolution, and the `stride` of `crowd_cells`."""
        values = heatmap_values(heatmap)
        crowd = crowd_cells(mask, values.shape, stride)
        wrong = (values > 0.5) != crowd
        if ignored is not None:
            wrong &= ~crowd_cells(ignored, values.shape, stride)
        one = _Example(int(crowd.sum()), int(wrong.sum()), image, values, mask)
        self._kept[mission] = _most_crowd_and_most_wrong([*self._kept.get(mission, []), one])
        if len(self._kept) > MOST_MISSIONS:
            del self._kept[_least_telling(self._kept)]

    def picture(self) -> NDArray[np.uint8]:
        """The page [H, W, 3]: mission after mission, most crowd before most errors. ValueError before the
        first frame."""
        if not self._kept:
            raise ValueError("no frames: a page of examples needs at least one")
        tiles = [_tile(one) for kept in self._kept.values() for one in kept]
        tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % COLUMNS)
        rows = [np.hstack(tiles[first : first + COLUMNS]) for first in range(0, len(tiles), COLUMNS)]
        return np.vstack(rows)


def _least_telling(kept: dict[str, list[_Example]]) -> str:
    """The mission to leave out: of those beyond the half with most crowd the one with fewest errors."""
    by_crowd = sorted(kept, key=lambda name: -max(one.crowd for one in kept[name]))
    return min(by_crowd[MOST_MISSIONS // 2 :], key=lambda name: max(one.wrong for one in kept[name]))


def _most_crowd_and_most_wrong(examples: list[_Example]) -> list[_Example]:
    """Two of three at most; the earlier one where they are equal."""
    first = max(examples, key=lambda one: one.crowd)
    others = [one for one in examples if one is not first]
    return [first, *sorted(others, key=lambda one: -one.wrong)[:1]]


def _tile(one: _Example) -> NDArray[np.uint8]:
    """The picture with its heatmap, and the true outline in cyan."""
    from PIL import Image

    from crowdfence.detector.overlay import overlay

    drawn = overlay(one.image, one.values.astype(np.float32))
    height, width = drawn.shape[:2]
    truth = np.asarray(Image.fromarray(one.mask).resize((width, height), Image.Resampling.NEAREST))
    drawn[binary_dilation(truth, iterations=2) & ~truth] = TRUTH_COLOUR
    return np.asarray(Image.fromarray(drawn).resize(TILE_PX))
