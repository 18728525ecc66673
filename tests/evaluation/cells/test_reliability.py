"""Reliability table and its scores on four cells."""

import numpy as np
import pytest

from crowdfence.evaluation.cells.reliability import reliability

HEATMAP = np.array([[0.1, 0.2], [0.7, 1.0]])
MASK = np.array([[0, 1], [1, 1]])


def test_two_bins_by_hand() -> None:
    """Bin 0 holds .1 and .2 (half crowd), bin 1 .7 and 1 (all crowd): gaps .35 and .15, two cells each."""
    result = reliability([HEATMAP], [MASK], bins=2)
    np.testing.assert_array_equal(result.count, [2, 2])
    np.testing.assert_allclose(result.mean_probability, [0.15, 0.85])
    np.testing.assert_allclose(result.crowd_share, [0.5, 1.0])
    assert result.expected_calibration_error == pytest.approx(0.25)
    assert result.brier_score == pytest.approx((0.1**2 + 0.8**2 + 0.3**2) / 4)


def test_easy_cells_can_be_left_out() -> None:
    result = reliability([HEATMAP], [MASK], bins=2, above=0.5)
    np.testing.assert_array_equal(result.count, [0, 2])
    assert np.isnan(result.crowd_share[0])
    assert result.expected_calibration_error == pytest.approx(0.15)


def test_frames_weigh_by_their_cells() -> None:
    large = np.repeat(HEATMAP, 4, axis=1)
    together = reliability([HEATMAP, large], [MASK, np.repeat(MASK, 4, axis=1)])
    assert together.count.sum() == 20
    alone = reliability([HEATMAP], [MASK])
    assert together.expected_calibration_error == pytest.approx(alone.expected_calibration_error)


def test_bad_input() -> None:
    with pytest.raises(ValueError, match="bins must be at least 1, got 0"):
        reliability([HEATMAP], [MASK], bins=0)
    with pytest.raises(ValueError, match=r"above must lie in \[0, 1\)"):
        reliability([HEATMAP], [MASK], above=1.0)
    with pytest.raises(ValueError, match=r"no cell has a value of at least 0\.9"):
        reliability([np.zeros((2, 2))], [MASK], above=0.9)
