"""Equation 4, on sequences of four voxels that can be worked out on paper."""

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from crowdfence.evaluation.iou import IouAccumulator, MeanIou, instants_left_out, mean_iou

Flags = NDArray[np.bool_]


def voxels(*ids: int) -> Flags:
    flags = np.zeros(4, np.bool_)
    flags[list(ids)] = True
    return flags


# frame 0: seen {0, 1}:    called {0, 1}, crowd {1}    -> 1/2  (crowd voxel 2 is not in view yet)
# frame 1: seen {0, 1, 2}: called {0, 2}, crowd {1, 2} -> 1/3  (voxels 0 and 1 are still part of the union)
# frame 2: seen {0, 1, 2}: nothing called, no crowd    -> 0/0  (crowd voxel 3 is never in view)
PREDICTIONS = [voxels(0, 1, 3), voxels(0, 2, 3), voxels()]
TRUTHS = [voxels(1, 2), voxels(1, 2), voxels(3)]
FOOTPRINTS = [voxels(0, 1), voxels(2), voxels()]


def test_three_frames_by_hand() -> None:
    mean, std, per_frame = mean_iou(PREDICTIONS, TRUTHS, FOOTPRINTS)
    np.testing.assert_allclose(per_frame, [1 / 2, 1 / 3, np.nan])
    assert mean == pytest.approx(5 / 12)
    assert std == pytest.approx(1 / 12)


def test_frames_without_crowd_can_count_as_one() -> None:
    mean, std, per_frame = mean_iou(PREDICTIONS, TRUTHS, FOOTPRINTS, both_empty="one")
    np.testing.assert_allclose(per_frame, [1 / 2, 1 / 3, 1])
    assert mean == pytest.approx(11 / 18)
    assert std == pytest.approx(np.sqrt(26) / 18)


def test_footprints_may_be_accumulated_already_and_everything_may_be_streamed() -> None:
    def stream(frames: list[Flags]) -> Iterator[Flags]:
        yield from frames

    accumulated = [voxels(0, 1), voxels(0, 1, 2), voxels(0, 1, 2)]
    once = mean_iou(PREDICTIONS, TRUTHS, FOOTPRINTS)
    again = mean_iou(stream(PREDICTIONS), stream(TRUTHS), stream(accumulated))
    np.testing.assert_array_equal(once.per_frame, again.per_frame)


def test_the_footprint_is_not_kept_by_reference() -> None:
    """A loop may reuse one array for every frame."""
    accumulator = IouAccumulator()
    footprint = voxels(0)
    assert accumulator.update(voxels(0), voxels(0), footprint) == 1.0
    footprint[:] = voxels(1)
    assert accumulator.update(voxels(0), voxels(0, 1), footprint) == 0.5


def test_only_frames_without_crowd_have_no_mean() -> None:
    result = mean_iou([voxels()], [voxels()], [voxels(0, 1, 2, 3)])
    assert np.isnan(result.mean) and np.isnan(result.std)


def test_a_refused_frame_changes_nothing() -> None:
    accumulator = IouAccumulator()
    accumulator.update(voxels(0), voxels(0), voxels(0))
    with pytest.raises(ValueError, match="frame 1: truth has 5 voxels, frame 0 had 4"):
        accumulator.update(voxels(1), np.zeros(5, np.bool_), voxels(1, 2, 3))
    accumulator.update(voxels(0, 1), voxels(0), voxels(0))  # voxel 1 must not have come into view
    np.testing.assert_array_equal(accumulator.result().per_frame, [1.0, 1.0])


def test_bad_input() -> None:
    with pytest.raises(ValueError, match=r"frame 0: prediction must be bool \[V\], got float64 \[4\]"):
        mean_iou([np.full(4, 0.3)], [voxels()], [voxels()])
    with pytest.raises(ValueError, match="frame 0: voxels of the truth are masked"):
        mean_iou([voxels()], [np.ma.array(voxels(0), mask=voxels(0))], [voxels()])
    with pytest.raises(ValueError, match="truths ended after 1 frames"):
        mean_iou([voxels(), voxels()], [voxels()], [voxels(), voxels()])
    with pytest.raises(ValueError, match="no frames"):
        mean_iou([], [], [])
    with pytest.raises(ValueError, match='both_empty must be "skip" or "one"'):
        mean_iou([], [], [], both_empty="zero")  # type: ignore[arg-type]


sequences = st.tuples(st.integers(1, 5), st.integers(1, 12)).flatmap(
    lambda shape: st.tuples(*[hnp.arrays(np.bool_, shape) for _ in range(3)])
)


@given(sequences, st.randoms(use_true_random=False))
def test_iou_is_a_symmetric_share_that_ignores_the_order_of_voxels(
    sequence: tuple[Flags, Flags, Flags], random: object
) -> None:
    predictions, truths, footprints = sequence
    result = mean_iou(predictions, truths, footprints)
    counted = result.per_frame[~np.isnan(result.per_frame)]
    assert ((counted >= 0.0) & (counted <= 1.0)).all()
    swapped = mean_iou(truths, predictions, footprints)
    np.testing.assert_array_equal(swapped.per_frame, result.per_frame)
    order = list(range(predictions.shape[1]))
    random.shuffle(order)  # type: ignore[attr-defined]
    permuted = mean_iou(predictions[:, order], truths[:, order], footprints[:, order])
    np.testing.assert_array_equal(permuted.per_frame, result.per_frame)


@given(sequences)
def test_against_sets(sequence: tuple[Flags, Flags, Flags]) -> None:
    seen: set[int] = set()
    expected = []
    for prediction, truth, footprint in zip(*sequence, strict=True):
        seen |= set(np.flatnonzero(footprint))
        called, crowd = set(np.flatnonzero(prediction)) & seen, set(np.flatnonzero(truth)) & seen
        expected.append(len(called & crowd) / len(called | crowd) if called | crowd else np.nan)
    np.testing.assert_allclose(mean_iou(*sequence).per_frame, expected)


def test_instants_that_are_in_no_mean_are_told() -> None:
    """A mean of few instants stood beside one of many, and nothing told them apart."""
    nan = np.nan
    some = MeanIou(0.5, 0.0, np.array([nan, nan, 0.5]))
    every = MeanIou(0.2, 0.2, np.array([0.0, 0.0, 0.6]))
    assert instants_left_out([("or", every), ("paper", every)]) == ""
    assert instants_left_out([("evidence", some), ("or", every)]) == (
        "Of 3 instants those without crowd in both map and truth are in no mean IoU: evidence 2, or 0."
    )
