"""Quality of a detector: six cells by hand, agreement with the per-frame scores, groups and intervals."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowdfence.evaluation.cells.quality import DetectorQuality, LabelledHeatmap, detector_quality
from crowdfence.evaluation.cells.rates import confusion
from crowdfence.evaluation.cells.reliability import reliability
from crowdfence.evaluation.quality_table import quality_text
from crowdfence.evaluation.statistics.unit_bootstrap import bootstrap_interval

SIX = np.array([[0.9, 0.8, 0.7], [0.4, 0.3, 0.1]])
SIX_CROWD = np.array([[1, 0, 1], [1, 0, 0]])


def frames(heatmaps: np.ndarray, masks: np.ndarray, **where: object) -> list[LabelledHeatmap]:
    return [
        LabelledHeatmap(heatmap, mask, f"mission {number}", **where)
        for number, (heatmap, mask) in enumerate(zip(heatmaps, masks, strict=True))
    ]


def test_six_cells_by_hand() -> None:
    """Sorted by value: crowd, empty, crowd, crowd, empty, empty. Precision where a crowd cell is met: 1, 2/3,
    3/4. Above 0.5: 2 right, 1 wrong, 1 missed. Above 0.3 all three crowd cells and one other: IoU 3/4."""
    overall = detector_quality(frames(SIX[None], SIX_CROWD[None])).overall
    assert (overall.cells, overall.crowd_cells, overall.units) == (6, 3, 1)
    assert overall.pr_auc.value == pytest.approx((1 + 2 / 3 + 3 / 4) / 3)
    assert overall.iou.value == pytest.approx(2 / 4)
    assert overall.true_positive_rate.value == pytest.approx(2 / 3)
    assert overall.false_positive_rate.value == pytest.approx(1 / 3)
    assert overall.false_crowd_share.value == pytest.approx(1 / 6)
    assert 0.3 <= overall.best_threshold < 0.4
    assert overall.iou_at_best.value == pytest.approx(3 / 4)
    assert overall.true_positive_rate_at_best.value == pytest.approx(1.0)
    assert overall.false_positive_rate_at_best.value == pytest.approx(1 / 3)
    gaps = [0.1, 0.8, 0.3, 0.6, 0.3, 0.1]  # every cell in a bin of its own
    assert overall.calibration_error.value == pytest.approx(sum(gaps) / 6)
    assert overall.brier.value == pytest.approx(sum(gap**2 for gap in gaps) / 6)
    assert np.isnan(overall.iou.low), "one mission says nothing about how missions differ"


def test_the_curve_runs_from_every_cell_to_the_surest() -> None:
    """All cells: precision 1/2. Above 0.5: 2 of 3 are crowd, 2 of the 3 crowd cells are found."""
    curve = detector_quality(frames(SIX[None], SIX_CROWD[None])).curve
    assert (curve.threshold[0], curve.precision[0], curve.recall[0]) == (0.0, 0.5, 1.0)
    half = np.searchsorted(curve.threshold, 0.5)
    assert (curve.precision[half], curve.recall[half]) == pytest.approx((2 / 3, 2 / 3))
    assert np.isnan(curve.precision[-1]) and curve.recall[-1] == 0.0


def test_a_value_at_the_threshold_is_not_above_it() -> None:
    overall = detector_quality(frames(np.full((1, 1, 2), 0.5), np.array([[[1, 0]]]))).overall
    assert overall.true_positive_rate.value == 0.0
    assert overall.false_positive_rate.value == 0.0


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_agrees_with_the_scores_that_look_at_every_cell(seed: int, as_bytes: bool) -> None:
    rng = np.random.default_rng(seed)
    heatmaps = rng.random((3, 4, 5)) ** 2
    masks = rng.random((3, 8, 10)) < 0.5
    if as_bytes:
        heatmaps = np.rint(heatmaps * 255.0).astype(np.uint8)
    overall = detector_quality(frames(heatmaps, masks), resamples=2).overall
    counts = confusion(heatmaps, masks)
    assert overall.crowd_cells == counts.positives
    if counts.positives and counts.negatives:
        assert overall.true_positive_rate.value == pytest.approx(counts.true_positive_rate().rate)
        assert overall.false_positive_rate.value == pytest.approx(counts.false_positive_rate().rate)
    table = reliability(heatmaps, masks)
    assert overall.brier.value == pytest.approx(table.brier_score)
    if not as_bytes:  # bytes lie exactly on edges of bins, which are open at different ends
        assert overall.calibration_error.value == pytest.approx(table.expected_calibration_error)
        above = reliability(heatmaps, masks, above=0.05)
        assert overall.calibration_error_above.value == pytest.approx(above.expected_calibration_error)


def test_what_is_found_when_one_empty_cell_in_a_hundred_may_be_called() -> None:
    """200 empty cells, 5 of them at 0.5, 0.6, 0.7, 0.8 and 0.9: two may be called, so the threshold is 0.7.
    Of the crowd cells at 0.65, 0.72, 0.75 and 0.95 three lie above it."""
    values = np.concatenate([[0.5, 0.6, 0.7, 0.8, 0.9], np.full(195, 0.01), [0.65, 0.72, 0.75, 0.95]])
    crowd = np.arange(204) >= 200
    overall = detector_quality(frames(values[None, None], crowd[None, None])).overall
    assert overall.true_positive_rate_at_one_percent.value == pytest.approx(3 / 4)


def test_nothing_is_found_at_a_price_that_no_threshold_meets() -> None:
    overall = detector_quality(frames(np.ones((1, 1, 2)), np.array([[[1, 0]]]))).overall
    assert overall.true_positive_rate_at_one_percent.value == 0.0


def test_without_an_empty_cell_nothing_is_found_for_nothing() -> None:
    """A detector that says 0 everywhere, on a picture full of crowd: a threshold of 0 would find it all."""
    overall = detector_quality(frames(np.zeros((2, 1, 2)), np.ones((2, 1, 2), int))).overall
    assert overall.true_positive_rate.value == 0.0
    assert np.isnan(overall.true_positive_rate_at_one_percent.value)
    assert np.isnan(overall.pr_auc.value)


def test_cells_are_grouped_by_distance_tilt_and_name() -> None:
    gsd_m = np.array([[0.03, 0.03, 0.3], [np.nan, 0.3, 9.0]])
    collected = DetectorQuality(gsd_edges_m=(0.0, 0.1, 1.0))
    for name, season in (("a", "summer"), ("b", "winter")):
        groups = {"season": season}
        collected.add(LabelledHeatmap(SIX, SIX_CROWD, name, gsd_m=gsd_m, tilt_deg=25.0, groups=groups))
    by = collected.report(resamples=10).by
    assert {name: one.cells for name, one in by["gsd_m"].items()} == {"0 to 0.1": 4, "0.1 to 1": 4}
    assert by["gsd_m"]["0 to 0.1"].true_positive_rate.value == 1.0
    assert by["gsd_m"]["0.1 to 1"].false_positive_rate.value == 0.0
    assert list(by["tilt_deg"]) == ["20 to 30"]
    assert set(by["mission"]) == {"a", "b"} and set(by["season"]) == {"summer", "winter"}
    assert by["season"]["summer"].cells == 6


def test_ignored_cells_are_not_counted() -> None:
    ignore = np.array([[0, 1, 0], [0, 0, 0]], np.bool_)
    overall = detector_quality([LabelledHeatmap(SIX, SIX_CROWD, "a", ignore=ignore)]).overall
    assert overall.cells == 5
    assert overall.false_positive_rate.value == 0.0


def test_frames_without_crowd_have_no_iou_and_are_valid_json() -> None:
    """As the scenario `empty`: everything called crowd is false, everything about crowds is unknown."""
    report = detector_quality(frames(np.stack([SIX] * 3), np.zeros((3, 2, 3), np.bool_)), resamples=10)
    overall = report.overall
    for unknown in (overall.iou, overall.pr_auc, overall.true_positive_rate, overall.iou_at_best):
        assert np.isnan([unknown.value, unknown.low, unknown.high]).all()
    assert tuple(overall.false_crowd_share) == (0.5, 0.5, 0.5)
    document = json.loads(json.dumps(report.to_json(), allow_nan=False))
    assert document["overall"]["iou"] == {"value": None, "low": None, "high": None}
    assert document["by"]["mission"]["mission 0"]["best_threshold"] is None
    assert "-" in quality_text(report)


def test_nothing_called_crowd_everything_missed() -> None:
    overall = detector_quality(frames(np.zeros((2, 1, 1)), np.ones((2, 1, 1), np.bool_))).overall
    assert overall.iou.value == 0.0 and overall.true_positive_rate.value == 0.0
    assert np.isnan(overall.false_positive_rate.value)
    assert np.isnan(overall.calibration_error_above.value)


def test_the_interval_is_that_of_missions_not_of_cells() -> None:
    """Two missions of 10 000 crowd cells, one found and one missed: a resample draws none, one or both of
    each, so the rate is 0, 1/2 or 1 in at least a tenth of the resamples. Cells taken one by one would say
    0.5 +- 0.007."""
    heatmaps = np.stack([np.ones((100, 100)), np.zeros((100, 100))])
    rate = detector_quality(frames(heatmaps, np.ones((2, 100, 100), np.bool_))).overall.true_positive_rate
    assert tuple(rate) == (0.5, 0.0, 1.0)


def test_blocks_of_one_mission_can_be_resampled() -> None:
    collected = DetectorQuality()
    for number in range(4):
        collected.add(LabelledHeatmap(SIX, SIX_CROWD, "a", unit=f"a, block {number // 2}"))
    report = collected.report(resamples=10)
    assert report.overall.units == 2
    assert report.by["mission"]["a"].cells == 24
    assert tuple(report.overall.iou) == (0.5, 0.5, 0.5), "equal blocks differ by nothing"


def test_bootstrap_of_the_mean_is_as_wide_as_theory_says() -> None:
    """Mean of 50 units with standard deviation 1: 95 % interval of about 2 * 1.96 / sqrt(50) = 0.554."""
    values = np.random.default_rng(3).normal(size=50)
    values = (values - values.mean()) / values.std()
    totals = np.column_stack([values, np.ones(50)])
    low, high = bootstrap_interval(totals, lambda sums: sums[:, 0] / sums[:, 1])
    assert high - low == pytest.approx(0.554, rel=0.1)
    assert low < 0.0 < high


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (LabelledHeatmap(SIX * 2.0, SIX_CROWD, "race-1"), "race-1, frame 0: .*1.8 .* not in"),
        (LabelledHeatmap(SIX, SIX_CROWD[:, :1], "race-1"), "differ in proportion"),
        (
            LabelledHeatmap(SIX, SIX_CROWD, "race-1", gsd_m=np.ones(3)),
            r"gsd_m must be one number or \[2, 3\]",
        ),
        (LabelledHeatmap(SIX, SIX_CROWD, "race-1", groups={"mission": "x"}), "'mission' cannot name a group"),
    ],
)
def test_unusable_frames_are_named(frame: LabelledHeatmap, message: str) -> None:
    collected = DetectorQuality()
    with pytest.raises(ValueError, match=message):
        collected.add(frame)
    with pytest.raises(ValueError, match="no frames"):
        collected.report()
