"""Frames of labelled missions on one page, with what a model says and what is so."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from crowdfence.evaluation.detector_rates import crowd_cells, heatmap_values

TRUTH_COLOUR = (0, 255, 255)
COLUMNS = 4
TILE_PX = (480, 360)


class ExamplePage:
    """Keeps two frames of every mission: the one with most crowd and the one with most wrong cells. Where a
    model fails is what examples are for."""

    def __init__(self) -> None:
        self._most_crowd: dict[str, tuple[int, NDArray[np.uint8]]] = {}
        self._most_wrong: dict[str, tuple[int, NDArray[np.uint8]]] = {}

    def offer(
        self,
        mission: str,
        image: NDArray[np.uint8],
        heatmap: NDArray[np.generic],
        mask: NDArray[np.bool_],
        ignored: NDArray[np.bool_] | None,
    ) -> None:
        """Consider one frame: image [H, W, 3], heatmap [h, w], crowd and what does not count as bool
        arrays of any resolution."""
        values = heatmap_values(heatmap)
        crowd = crowd_cells(mask, values.shape)
        wrong = (values > 0.5) != crowd
        if ignored is not None:
            wrong &= ~crowd_cells(ignored, values.shape)
        for kept, amount in ((self._most_crowd, int(crowd.sum())), (self._most_wrong, int(wrong.sum()))):
            if mission not in kept or amount > kept[mission][0]:
                kept[mission] = amount, _tile(image, values, mask)

    def picture(self) -> NDArray[np.uint8]:
        """The page [H, W, 3]: mission after mission, most crowd before most errors. ValueError before the
        first frame."""
        if not self._most_crowd:
            raise ValueError("no frames: a page of examples needs at least one")
        tiles = [
            tile
            for mission in self._most_crowd
            for tile in (self._most_crowd[mission][1], self._most_wrong[mission][1])
        ]
        tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % COLUMNS)
        rows = [np.hstack(tiles[first : first + COLUMNS]) for first in range(0, len(tiles), COLUMNS)]
        return np.vstack(rows)


def _tile(
    image: NDArray[np.uint8], values: NDArray[np.float64], mask: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """The picture with its heatmap, and the true outline in cyan."""
    from PIL import Image

    from crowdfence.detector.overlay import overlay

    drawn = overlay(image, values.astype(np.float32))
    height, width = drawn.shape[:2]
    truth = np.asarray(Image.fromarray(mask).resize((width, height), Image.Resampling.NEAREST))
    drawn[binary_dilation(truth, iterations=2) & ~truth] = TRUTH_COLOUR
    return np.asarray(Image.fromarray(drawn).resize(TILE_PX))
