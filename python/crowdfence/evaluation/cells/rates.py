"""Rates of a detector from its heatmaps and labelled masks: what equation 1 needs to know about it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import zip_longest
from math import isfinite, nan, sqrt
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence._core import Rates


class RateEstimate(NamedTuple):
    """A share of counted cells with its Wilson interval."""

    rate: float
    """NaN when nothing was counted; the interval is then [0, 1]."""
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Confusion:
    """Cells by what the detector called them (positive, negative) and whether that was right."""

    true_positives: int
    false_positives: int
    true_negatives: int
    false_negatives: int

    @classmethod
    def of(cls, called: NDArray[np.bool_], crowd: NDArray[np.bool_]) -> Confusion:
        """Count two bool arrays of equal shape: called crowd, and truly crowd.

        The cells may be pixels or voxels: `Confusion.of(seen.mean > 0.5, truth[seen.voxel_ids])` with
        `seen` an `Observation` counts voxels.
        """
        if called.shape != crowd.shape or called.dtype != np.bool_ or crowd.dtype != np.bool_:
            raise ValueError(
                "called and crowd must be bool arrays of one shape, got "
                f"{called.dtype} {list(called.shape)} and {crowd.dtype} {list(crowd.shape)}"
            )
        both = int(np.count_nonzero(called & crowd))
        only_called = int(np.count_nonzero(called)) - both
        only_crowd = int(np.count_nonzero(crowd)) - both
        return cls(both, only_called, called.size - both - only_called - only_crowd, only_crowd)

    def __add__(self, other: Confusion) -> Confusion:
        return Confusion(
            self.true_positives + other.true_positives,
            self.false_positives + other.false_positives,
            self.true_negatives + other.true_negatives,
            self.false_negatives + other.false_negatives,
        )

    @property
    def positives(self) -> int:
        """Cells that are crowd."""
        return self.true_positives + self.false_negatives

    @property
    def negatives(self) -> int:
        """Cells that are not."""
        return self.true_negatives + self.false_positives

    def true_positive_rate(self, confidence: float = 0.95) -> RateEstimate:
        """TPR = P(B=1 | A=1). The intervals of both rates take cells for independent; neighbouring
        cells and frames are not, so the true uncertainty is larger."""
        return wilson_estimate(self.true_positives, self.positives, confidence)

    def false_positive_rate(self, confidence: float = 0.95) -> RateEstimate:
        """FPR = P(B=1 | A=0)."""
        return wilson_estimate(self.false_positives, self.negatives, confidence)

    def rates(self, *, smoothing: float = 0.0) -> Rates:
        """TPR and FPR as equation 1 takes them: (count + smoothing) / (total + 2 smoothing).

        A rate of exactly 0 or 1 would make a single look final, so it is refused. `smoothing` = 0.5
        (Jeffreys) keeps the rates inside (0, 1) however few cells were counted. ValueError also when there
        is no crowd cell or no other cell: then nothing was measured.
        """
        if not (isfinite(smoothing) and smoothing >= 0.0):
            raise ValueError(f"smoothing must be a finite number of at least 0, got {smoothing}")
        if self.positives == 0 or self.negatives == 0:
            missing = "crowd" if self.positives == 0 else "crowd-free"
            total = self.positives + self.negatives
            raise ValueError(f"no {missing} cells among {total}: add labelled frames that show some")
        return Rates(
            _inside_unit_interval("true-positive", self.true_positives, self.positives, smoothing),
            _inside_unit_interval("false-positive", self.false_positives, self.negatives, smoothing),
        )


def detector_rates(
    heatmaps: Iterable[ArrayLike],
    masks: Iterable[ArrayLike],
    threshold: float = 0.5,
    *,
    smoothing: float = 0.0,
) -> Rates:
    """Detector rates per heatmap cell, for equation 1. See `confusion` for the input and `Confusion.rates`
    for `smoothing`.

    Measure on frames that the detector was not trained on. These are rates per pixel; rates per voxel of
    the map differ and can be counted with `Confusion.of` after projection.
    """
    return confusion(heatmaps, masks, threshold).rates(smoothing=smoothing)


def confusion(heatmaps: Iterable[ArrayLike], masks: Iterable[ArrayLike], threshold: float = 0.5) -> Confusion:
    """Count the cells of all frames.

    Heatmaps: float [h, w] in [0, 1] or uint8 [h, w] (value / 255). Masks: bool or integer [H, W], non-zero
    is crowd. A heatmap may have any stride of its mask; a cell is crowd when more than half of its area is.
    A cell is called crowd when its value is above `threshold`, as b_i in equation 1.
    Sequences or iterators of equal length, one frame in memory at a time.

    Raises ValueError, with the frame, for masked cells, NaN or values outside [0, 1], masks of another type
    or proportion, and sequences that differ in length or are empty.
    """
    if not 0.0 <= threshold < 1.0:
        raise ValueError(f"threshold must lie in [0, 1), got {threshold}")
    total = Confusion(0, 0, 0, 0)
    for values, crowd in labelled_cells(heatmaps, masks):
        total += Confusion.of(values > threshold, crowd)
    return total


def labelled_cells(
    heatmaps: Iterable[ArrayLike], masks: Iterable[ArrayLike]
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.bool_]]]:
    """Checked frames one by one: cell values float64 [h, w] in [0, 1] and whether each cell is crowd."""
    missing = object()
    count = 0
    for heatmap, mask in zip_longest(heatmaps, masks, fillvalue=missing):
        if heatmap is missing or mask is missing:
            ended = "heatmaps" if heatmap is missing else "masks"
            raise ValueError(f"{ended} ended after {count} frames, the other sequence did not")
        try:
            for name, cells in (("heatmap", heatmap), ("mask", mask)):
                if np.ma.is_masked(cells):
                    raise ValueError(f"cells of the {name} are masked; rates are those of whole heatmaps")
            values = heatmap_values(np.asarray(heatmap))
            yield values, crowd_cells(np.asarray(mask), values.shape)
        except ValueError as error:
            raise ValueError(f"frame {count}: {error}") from error
        count += 1
    if count == 0:
        raise ValueError("no frames: give at least one heatmap with its mask")


def crowd_cells(
    mask: NDArray[np.generic], shape: tuple[int, ...], stride: int | None = None
) -> NDArray[np.bool_]:
    """Mask [H, W], bool or integer, non-zero is crowd -> bool [h, w] of `shape` = (h, w): cells with more
    than half of their area crowd. The two grids cover the same image; the stride need not be whole. Cells
    whose stride is whole and that reach beyond the image count by the part inside.
    `stride`: that of a detector whose cells these are, in pixels of the image. Of a mask of other cells than
    pixels it says nothing."""
    if mask.ndim != 2 or mask.size == 0 or mask.dtype.kind not in "bui":
        raise ValueError(f"mask must be bool or integer [H, W], got {mask.dtype} {list(mask.shape)}")
    rows, columns = shape
    if stride is not None and (-(-mask.shape[0] // stride), -(-mask.shape[1] // stride)) == (rows, columns):
        return _most_of_the_inside(mask, rows, columns, stride)
    stride_y, stride_x = mask.shape[0] / rows, mask.shape[1] / columns
    # A network that pads its input to whole cells is off by less than one cell.
    if abs(mask.shape[0] / stride_x - rows) >= 1.0 or abs(mask.shape[1] / stride_y - columns) >= 1.0:
        whole = _whole_stride(mask, rows, columns)
        if whole is None:
            raise ValueError(
                f"mask {list(mask.shape)} and heatmap {[rows, columns]} differ in proportion: "
                f"stride {stride_y:g} down but {stride_x:g} across"
            )
        return _most_of_the_inside(mask, rows, columns, whole)
    return 2 * _per_cell((mask != 0).astype(np.int64), rows, columns) > mask.size


def _whole_stride(mask: NDArray[np.generic], rows: int, columns: int) -> int | None:
    """Pixels of cells that cover the image and reach beyond."""
    for stride in sorted((-(-mask.shape[0] // rows), -(-mask.shape[1] // columns))):
        if (-(-mask.shape[0] // stride), -(-mask.shape[1] // stride)) == (rows, columns):
            return stride
    return None


def _most_of_the_inside(mask: NDArray[np.generic], rows: int, columns: int, stride: int) -> NDArray[np.bool_]:
    """Cells of `stride` pixels that are crowd by the part of them inside the image."""
    padding = [(0, count * stride - side) for count, side in zip((rows, columns), mask.shape, strict=True)]
    crowd, inside = (
        _per_cell(np.pad(pixels, padding), rows, columns)
        for pixels in ((mask != 0).astype(np.int64), np.ones(mask.shape, np.int64))
    )
    return np.asarray(2 * crowd > inside)


def _per_cell(pixels: NDArray[np.int64], rows: int, columns: int) -> NDArray[np.int64]:
    return _binned(_binned(pixels, rows).T, columns).T


def wilson_estimate(count: int, total: int, confidence: float = 0.95) -> RateEstimate:
    """Share `count` / `total` with the Wilson score interval for independent trials."""
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence must lie inside (0, 1), got {confidence}")
    if total == 0:
        return RateEstimate(nan, 0.0, 1.0)
    z = NormalDist().inv_cdf(0.5 + confidence / 2.0)
    rate = count / total
    scale = 1.0 + z * z / total
    centre = (rate + z * z / (2 * total)) / scale
    half_width = z * sqrt(rate * (1.0 - rate) / total + z * z / (4 * total * total)) / scale
    return RateEstimate(rate, max(0.0, centre - half_width), min(1.0, centre + half_width))


def heatmap_values(heatmap: NDArray[np.generic]) -> NDArray[np.float64]:
    """Heatmap [h, w], floating point in [0, 1] or uint8 (value / 255) -> float64 [h, w]. ValueError says what
    is wrong with any other."""
    if heatmap.ndim != 2 or heatmap.size == 0:
        raise ValueError(f"heatmap must be [h, w] with at least one cell, got shape {list(heatmap.shape)}")
    if heatmap.dtype == np.uint8:
        return heatmap.astype(np.float64) / 255.0
    if heatmap.dtype.kind != "f":
        raise ValueError(f"heatmap must be floating point or uint8, got {heatmap.dtype}")
    values = heatmap.astype(np.float64)
    wrong = ~((values >= 0.0) & (values <= 1.0))  # also true for NaN
    if wrong.any():
        row, column = (int(index) for index in np.argwhere(wrong)[0])
        raise ValueError(
            f"heatmap value {values[row, column]} at row {row}, column {column} is not in [0, 1]"
        )
    return values


def _binned(values: NDArray[np.int64], cells: int) -> NDArray[np.int64]:
    """Sums of `values` [n, m] over `cells` equal parts of the first axis, times `cells`.

    A part may end inside a row, which then counts by its share; integers keep "exactly half" exact.
    """
    zeros = np.zeros_like(values[:1])
    before = np.concatenate([zeros, np.cumsum(values, axis=0)])
    whole, rest = np.divmod(np.arange(cells + 1) * values.shape[0], cells)
    up_to_edge = cells * before[whole] + rest[:, None] * np.concatenate([values, zeros])[whole]
    return np.diff(up_to_edge, axis=0)


def _inside_unit_interval(name: str, count: int, total: int, smoothing: float) -> float:
    rate = (count + smoothing) / (total + 2.0 * smoothing)
    if not 0.0 < rate < 1.0:
        raise ValueError(
            f"{name} rate is {count} of {total} cells = {rate:g}, equation 1 needs it inside (0, 1): "
            "use more labelled frames, or smoothing=0.5"
        )
    return rate
