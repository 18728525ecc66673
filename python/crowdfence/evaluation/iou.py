"""Mean intersection over union inside what the fleet has seen so far (equation 4)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import zip_longest
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.unmasked import require_unmasked

BothEmpty = Literal["skip", "one"]


class MeanIou(NamedTuple):
    """Result of equation 4: `mean, std, per_frame = mean_iou(...)`."""

    mean: float
    """Mean over the frames that count; NaN when none does."""
    std: float
    """Population standard deviation (ddof 0) over the same frames."""
    per_frame: NDArray[np.float64]
    """[T]; NaN for a frame that was skipped."""


def instants_left_out(named: Sequence[tuple[str, MeanIou]]) -> str:
    """One sentence on how many instants are in no mean, by name; nothing where all count. Means of which
    others are left out are of other instants: a false alarm makes an instant without crowd count as 0."""
    skipped = {name: int(np.count_nonzero(np.isnan(iou.per_frame))) for name, iou in named}
    if not any(skipped.values()):
        return ""
    each = ", ".join(f"{name} {count:,}" for name, count in skipped.items())
    return (
        f"Of {len(named[0][1].per_frame):,} instants those without crowd in both map and truth are in no "
        f"mean IoU: {each}."
    )


class IouAccumulator:
    """Equation 4 one frame at a time: keeps the union of the fields of view and one number per frame.

    `both_empty` decides about frames in which neither the map nor the truth has a crowd voxel inside the
    union, where the IoU is 0/0: "skip" leaves them out (NaN in `per_frame`), "one" counts them as 1.
    """

    def __init__(self, *, both_empty: BothEmpty = "skip") -> None:
        if both_empty not in get_args(BothEmpty):
            raise ValueError(f'both_empty must be "skip" or "one", got {both_empty!r}')
        self._value_of_empty = np.nan if both_empty == "skip" else 1.0
        self._field_of_view: NDArray[np.bool_] | None = None
        self._per_frame: list[float] = []

    def update(self, prediction: ArrayLike, truth: ArrayLike, footprint: ArrayLike) -> float:
        """Count one frame and return its IoU (NaN when skipped).

        All bool [V], indexed by voxel id: voxels that the map calls crowd, voxels that are crowd, voxels
        that some drone sees in this frame. `CrowdMap.seen()`, already the union, does as a footprint.
        ValueError for anything but bool [V] of one length; the accumulator is then as it was.
        """
        named = {"prediction": prediction, "truth": truth, "footprint": footprint}
        called, crowd, seen = (self._labels(name, labels) for name, labels in named.items())
        self._field_of_view = seen.copy() if self._field_of_view is None else self._field_of_view | seen
        called = called & self._field_of_view
        crowd = crowd & self._field_of_view
        intersection = np.count_nonzero(called & crowd)
        union = np.count_nonzero(called) + np.count_nonzero(crowd) - intersection
        self._per_frame.append(intersection / union if union else self._value_of_empty)
        return self._per_frame[-1]

    def result(self) -> MeanIou:
        """Mean, standard deviation and IoU per frame so far. ValueError before the first frame."""
        if not self._per_frame:
            raise ValueError("mean IoU of no frames: give at least one frame")
        per_frame = np.array(self._per_frame)
        counted = per_frame[~np.isnan(per_frame)]
        if counted.size == 0:
            return MeanIou(np.nan, np.nan, per_frame)
        return MeanIou(float(counted.mean()), float(counted.std()), per_frame)

    def _labels(self, name: str, labels: ArrayLike) -> NDArray[np.bool_]:
        frame = len(self._per_frame)
        require_unmasked(labels, f"frame {frame}: voxels of the {name}")
        array = np.asarray(labels)
        if array.dtype != np.bool_ or array.ndim != 1:
            raise ValueError(
                f"frame {frame}: {name} must be bool [V], got {array.dtype} {list(array.shape)}; "
                "compare probabilities with a threshold first"
            )
        expected = array.size if self._field_of_view is None else self._field_of_view.size
        if array.size != expected:
            raise ValueError(f"frame {frame}: {name} has {array.size} voxels, frame 0 had {expected}")
        return array


def mean_iou(
    predictions: Iterable[ArrayLike],
    truths: Iterable[ArrayLike],
    footprints: Iterable[ArrayLike],
    *,
    both_empty: BothEmpty = "skip",
) -> MeanIou:
    """Mean IoU of a sequence (equation 4 of the paper).

    Three sequences of equal length T, or iterators that yield one frame at a time: bool [V] per frame.
    Frame t is evaluated inside the union of the footprints of the frames up to and including t; the union
    is taken here, so footprints of single frames and already accumulated ones give the same result.

    A frame with no crowd voxel in either set is left out of the mean (`both_empty="skip"`, NaN in
    `per_frame`) or counts as 1 (`both_empty="one"`). The paper does not say which; report the choice.

    Raises ValueError for arrays that are not bool [V], lengths that differ, or no frames at all.
    """
    accumulator = IouAccumulator(both_empty=both_empty)
    for index, frame in enumerate(zip_longest(predictions, truths, footprints)):
        named = zip(("predictions", "truths", "footprints"), frame, strict=True)
        ended = [name for name, labels in named if labels is None]
        if ended:
            raise ValueError(f"{' and '.join(ended)} ended after {index} frames, the other sequences did not")
        accumulator.update(*frame)
    return accumulator.result()
