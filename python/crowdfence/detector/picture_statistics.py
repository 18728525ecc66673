"""Whether a picture looks like those that a model was tested on, by a few statistics of its pixels.

A network answers to anything. What it was tested on has a range of brightness, colour, sharpness and texture,
and a picture far outside of it (in the covariance of the tested ones) is one that nobody has measured it on.
The opposite does not hold: a picture inside may still fool it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.contract.json_section import JsonSection
from crowdfence.errors import DetectorError

NAMES = (
    "red",
    "green",
    "blue",
    "contrast",
    "red_green_spread",
    "yellow_blue_spread",
    "edges",
    "edges_of_2px",
    "edges_of_4px",
    "edge_sparsity",
)
ALIKE_SHARE = 0.95
_ROW_STEP = 4
"""Every fourth row of pixels is looked at: a picture of 640 x 480 takes about a millisecond."""
_DARK = 1e-3


@dataclass(frozen=True, slots=True)
class PictureRange:
    """The pictures that a model was tested on."""

    mean: tuple[float, ...]
    """Of each statistic in `NAMES`."""
    precision: tuple[tuple[float, ...], ...]
    """Inverse of their covariance."""
    limit: float
    """Largest Mahalanobis distance that still counts as alike."""

    @staticmethod
    def of(statistics: NDArray[np.float64], limit: float) -> PictureRange:
        """Of the statistics [N, 10] of tested pictures, N > 10."""
        spread = np.cov(statistics, rowvar=False) + 1e-6 * np.eye(len(NAMES))
        return PictureRange(
            tuple(float(value) for value in statistics.mean(axis=0)),
            tuple(tuple(float(value) for value in row) for row in np.linalg.inv(spread)),
            limit,
        )

    @staticmethod
    def from_json(section: JsonSection | None) -> PictureRange | None:
        if section is None:
            return None
        count = len(NAMES)
        mean = section.numbers("mean", count, ())
        rows = section.raw("precision")
        if not isinstance(rows, (list, tuple)) or len(rows) != count:
            raise section.refuse("precision", f"{count} rows of {count} finite numbers")
        precision = tuple(
            JsonSection({"row": row}, section.key("precision")).numbers("row", count, ()) for row in rows
        )
        value = PictureRange(mean, precision, section.number("limit", 0.0, above=True))
        section.done()
        if np.linalg.eigvalsh(np.array(precision)).min() <= 0.0:
            raise DetectorError(f"{section.key('precision')} is no inverse of a covariance")
        return value

    def to_json(self) -> dict[str, Any]:
        return {
            "mean": list(self.mean),
            "precision": [list(row) for row in self.precision],
            "limit": self.limit,
        }

    def distance(self, image: NDArray[np.uint8]) -> float:
        """Mahalanobis distance of a picture [H, W, 3] from the tested ones."""
        return float(self.distances(picture_statistics(image)[None])[0])

    def distances(self, statistics: NDArray[np.float64]) -> NDArray[np.float64]:
        """The same [N] of statistics [N, 10]."""
        away = statistics - np.array(self.mean)
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", away, np.array(self.precision), away)))

    def is_unlike(self, image: NDArray[np.uint8]) -> bool:
        return self.distance(image) > self.limit


def picture_statistics(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """The statistics [10] of a picture uint8 [H, W, 3] RGB: mean colour; spread of brightness, of red against
    green and of yellow against blue; logarithm of the mean difference of pixels 1, 2 and 4 apart; how few
    edges make up most of it."""
    rows = image[::_ROW_STEP].astype(np.float32) / np.float32(255)
    red, green, blue = rows[..., 0], rows[..., 1], rows[..., 2]
    bright = 0.299 * red + 0.587 * green + 0.114 * blue
    step = np.abs(np.diff(bright, axis=1)) if bright.shape[1] > 1 else np.zeros((1, 1), np.float32)
    edges = [float(step.mean())]
    for apart in (2, 4):
        pairs = np.abs(bright[:, apart:] - bright[:, :-apart])
        edges.append(float(pairs.mean()) if pairs.size else 0.0)
    sparsity = np.sqrt(float((step**2).mean())) / max(edges[0], _DARK)
    return np.array(
        [
            float(red.mean()),
            float(green.mean()),
            float(blue.mean()),
            float(bright.std()),
            float((red - green).std()),
            float(((red + green) / 2 - blue).std()),
            *np.log(np.maximum(edges, _DARK)),
            np.log(max(sparsity, _DARK)),
        ],
        np.float64,
    )


def range_of_missions(statistics: Mapping[str, NDArray[np.float64]]) -> PictureRange | None:
    """The range of the pictures [N, 10] of several missions. Its limit is the distance that 95 % of the
    pictures keep from the missions other than their own. None for a single mission, or too few to tell."""
    if len(statistics) < 2 or min(map(len, statistics.values())) < 2:
        return None
    away = []
    for held_out, pictures in statistics.items():
        others = np.concatenate([one for name, one in statistics.items() if name != held_out])
        if len(others) <= 2 * len(NAMES):
            return None
        away.append(PictureRange.of(others, 1.0).distances(pictures))
    limit = float(np.quantile(np.concatenate(away), ALIKE_SHARE))
    return PictureRange.of(np.concatenate(list(statistics.values())), limit)
