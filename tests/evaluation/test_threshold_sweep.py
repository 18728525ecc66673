"""Equation 4 at many thresholds at once."""

import numpy as np
import pytest

from crowdfence.evaluation.threshold_sweep import ThresholdSweep


def swept(*frames: tuple[list[float], list[bool]]) -> ThresholdSweep:
    sweep = ThresholdSweep([0.1, 0.5, 0.9])
    for probability, crowd in frames:
        sweep.update(np.array(probability), np.array(crowd))
    return sweep


def test_the_best_threshold_has_the_largest_mean() -> None:
    best, iou = swept(([0.2, 0.6, 0.0], [False, True, False])).result().best()
    assert best == 0.5 and iou.mean == 1.0


@pytest.mark.parametrize("probability", [[0.2, 0.6, 0.0], [0.0, 0.0, 0.0]])
@pytest.mark.parametrize("crowd", [[False, False, False], [False, False, True]])
def test_no_threshold_is_best_where_none_finds_any_crowd(probability: list[float], crowd: list[bool]) -> None:
    """The lowest one was named, which closes everything."""
    best, iou = swept((probability, crowd)).result().best()
    assert np.isnan(best)
    assert iou.mean == 0.0 or np.isnan(iou.mean)
