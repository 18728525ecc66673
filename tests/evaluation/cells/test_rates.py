"""Rates of a detector, counted by hand on masks of a few pixels."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from crowdfence.evaluation.cells.rates import (
    Confusion,
    confusion,
    crowd_cells,
    detector_rates,
    wilson_estimate,
)

MASK = np.array([[1, 1], [0, 0]], np.uint8)


def test_two_by_two() -> None:
    heatmap = np.array([[0.9, 0.2], [0.8, 0.1]])
    assert confusion([heatmap], [MASK]) == Confusion(1, 1, 1, 1)
    with pytest.raises(ValueError, match="must call crowd more often where there is one"):
        detector_rates([heatmap], [MASK], 0.5)  # half of either kind: it tells nothing


def test_frames_add_up_and_the_threshold_itself_is_not_crowd() -> None:
    heatmaps = [
        np.array([[0.5, 0.6], [0.5, 0.0]], np.float32),
        np.array([[0.9, 0.9], [0.6, 0.4]], np.float32),
    ]
    counts = confusion(heatmaps, [MASK, MASK], 0.5)
    assert counts == Confusion(true_positives=3, false_positives=1, true_negatives=3, false_negatives=1)
    rates = detector_rates(heatmaps, [MASK, MASK], 0.5)
    assert (rates.true_positive, rates.false_positive) == (0.75, 0.25)
    assert counts.true_positive_rate().rate == 0.75
    assert counts.false_positive_rate().rate == 0.25


def test_bytes_are_read_as_shares_of_255() -> None:
    heatmap = np.array([[128, 127], [255, 0]], np.uint8)
    assert confusion([heatmap], [MASK], 0.5) == Confusion(1, 1, 1, 1)


def test_a_cell_is_crowd_when_more_than_half_of_it_is() -> None:
    mask = np.zeros((4, 12), np.bool_)
    mask[:2, :8] = True  # cell 0: 8 of 16 pixels, exactly half
    mask[2, 4] = True  # cell 1: 9 of 16
    mask[:, 8:] = True  # cell 2: all
    np.testing.assert_array_equal(crowd_cells(mask, (1, 3)), [[False, True, True]])


def test_stride_need_not_be_whole() -> None:
    """Three pixels on two cells: the middle pixel belongs half to each, 1.0 of 1.5 against 0.5 of 1.5."""
    np.testing.assert_array_equal(crowd_cells(np.array([[1, 0, 0]] * 3), (2, 2)), [[True, False]] * 2)
    np.testing.assert_array_equal(crowd_cells(np.array([[0, 1, 0]] * 3), (2, 2)), [[False, False]] * 2)


@given(
    hnp.arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9))),
    st.integers(1, 9),
    st.integers(1, 9),
)
def test_cells_against_exact_areas(mask: NDArray[np.bool_], rows: int, columns: int) -> None:
    height, width = mask.shape
    try:
        cells = crowd_cells(mask, (rows, columns))
    except ValueError as error:
        assert "proportion" in str(error)
        return
    size_y, size_x = Fraction(height, rows), Fraction(width, columns)
    if abs(height / size_x - rows) >= 1 or abs(width / size_y - columns) >= 1:
        # Cells of a whole stride reach beyond the image: 1 x 9 pixels are 1 x 5 cells of 2 x 2.
        size_y = size_x = Fraction(
            next(n for n in range(1, 10) if -(-height // n) == rows and -(-width // n) == columns)
        )

    def overlap(cell: int, size: Fraction, low: int, high: int) -> Fraction:
        return max(Fraction(0), min((cell + 1) * size, Fraction(high)) - max(cell * size, Fraction(low)))

    for row in range(rows):
        for column in range(columns):
            area = overlap(row, size_y, 0, height) * overlap(column, size_x, 0, width)
            covered = sum(
                overlap(row, size_y, y, y + 1) * overlap(column, size_x, x, x + 1)
                for y, x in np.argwhere(mask)
            )
            assert cells[row, column] == (2 * covered > area)


@given(st.lists(st.floats(0, 1), min_size=4, max_size=4), st.floats(0, 0.99), st.floats(0, 0.99))
def test_a_higher_threshold_never_calls_more(values: list[float], one: float, other: float) -> None:
    heatmap = np.array(values).reshape(2, 2)
    low = confusion([heatmap], [MASK], min(one, other))
    high = confusion([heatmap], [MASK], max(one, other))
    assert high.true_positives <= low.true_positives
    assert high.false_positives <= low.false_positives
    assert (high.positives, high.negatives) == (low.positives, low.negatives) == (2, 2)


def test_wilson_interval() -> None:
    """8 of 10 at 95 %: the textbook's 0.490 to 0.943. 0 of n ends at z^2 / (n + z^2). Of nothing: unknown."""
    assert wilson_estimate(8, 10) == pytest.approx((0.8, 0.4902, 0.9433), abs=5e-5)
    assert wilson_estimate(0, 10) == pytest.approx((0.0, 0.0, 3.8415 / 13.8415), abs=1e-5)
    assert wilson_estimate(0, 0)[1:] == (0.0, 1.0)


def test_voxels_count_like_pixels() -> None:
    called = np.array([True, True, False, False, False])
    crowd = np.array([True, False, True, False, False])
    assert Confusion.of(called, crowd) == Confusion(1, 1, 2, 1)


def test_a_perfect_detector_is_refused_unless_smoothed() -> None:
    perfect = np.array([[1.0, 1.0], [0.0, 0.0]])
    with pytest.raises(ValueError, match=r"true-positive rate is 2 of 2 cells = 1.*smoothing=0\.5"):
        detector_rates([perfect], [MASK])
    rates = detector_rates([perfect], [MASK], smoothing=0.5)
    assert rates.true_positive == pytest.approx(2.5 / 3)
    assert rates.false_positive == pytest.approx(0.5 / 3)


@pytest.mark.parametrize(("value", "missing"), [(0, "no crowd cells"), (1, "no crowd-free cells")])
def test_rates_need_both_kinds_of_cells(value: int, missing: str) -> None:
    with pytest.raises(ValueError, match=missing):
        detector_rates([np.full((2, 2), 0.4)], [np.full((2, 2), value)], smoothing=0.5)


GOOD = np.zeros((2, 2))


@pytest.mark.parametrize(
    ("heatmap", "mask", "message"),
    [
        (np.array([[0.1, np.nan], [0, 0]]), MASK, "frame 1: heatmap value nan at row 0, column 1"),
        (np.array([[0.1, 0.2], [1.5, 0]]), MASK, "frame 1: heatmap value 1.5 at row 1, column 0"),
        (np.array([[0, 1], [0, 0]]), MASK, "frame 1: heatmap must be floating point or uint8, got int64"),
        (np.ma.masked_less(GOOD, 0.5), MASK, "frame 1: cells of the heatmap are masked"),
        (GOOD, np.ma.masked_less(MASK, 1), "frame 1: cells of the mask are masked"),
        (np.zeros((0, 2)), MASK, "frame 1: heatmap must be .h, w. with at least one cell"),
        (np.zeros((2, 2, 1)), MASK, "frame 1: heatmap must be .h, w. "),
        (GOOD, np.zeros((2, 2)), "frame 1: mask must be bool or integer"),
        (GOOD, np.zeros((2, 2, 3), np.uint8), "frame 1: mask must be bool or integer"),
        (np.zeros((120, 160)), np.zeros((640, 480), np.uint8), "frame 1: mask .* differ in proportion"),
    ],
)
def test_bad_frames(heatmap: NDArray[np.generic], mask: NDArray[np.generic], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        detector_rates([GOOD, heatmap], [MASK, mask])


def test_bad_sequences_and_parameters() -> None:
    with pytest.raises(ValueError, match="masks ended after 1 frames"):
        confusion([GOOD, GOOD], [MASK])
    with pytest.raises(ValueError, match="no frames"):
        confusion([], [])
    with pytest.raises(ValueError, match=r"threshold must lie in \[0, 1\), got 1.0"):
        confusion([GOOD], [MASK], 1.0)
    with pytest.raises(ValueError, match="smoothing must be a finite number"):
        Confusion(1, 1, 1, 1).rates(smoothing=-1.0)
    with pytest.raises(ValueError, match="confidence must lie inside"):
        wilson_estimate(1, 2, 1.0)
    with pytest.raises(ValueError, match="bool arrays of one shape"):
        Confusion.of(np.zeros(3, np.bool_), np.zeros(4, np.bool_))


def test_cells_that_reach_beyond_the_picture_count_by_what_lies_inside() -> None:
    """765 x 1360 pixels in cells of 4: 192 rows, of which the last shows one row of pixels. Crowd from pixel
    row 762 on fills half of cell row 190 (760 to 763), no more, and all that is seen of row 191."""
    mask = np.zeros((765, 1360), np.bool_)
    mask[762:] = True
    found = crowd_cells(mask, (192, 340))
    assert found.shape == (192, 340) and found[191].all() and not found[:191].any()
    mask[761] = True
    assert crowd_cells(mask, (192, 340))[190].all()
