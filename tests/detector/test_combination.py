"""Several detectors on one picture, worked out by hand."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowdfence import Detector
from crowdfence.detector.combination import CombinationRule, rule_for
from support.onnx_models import contract as document
from support.onnx_models import write_map_model

GREY = np.full((64, 64, 3), 204, np.uint8)
"""0.8 in every cell of the models below."""


def logit(p: float) -> float:
    return float(np.log(p) - np.log1p(-p))


def one(p: float) -> np.ndarray:
    return np.full((1, 1), p, np.float32)


def test_odds_multiply_and_the_prior_counts_once() -> None:
    """Two opinions of 0.8, prior 0.5: odds 4 * 4 = 16. With a prior of 0.2, odds 1/4: 4 * 4 / (1/4) = 64."""
    even = CombinationRule(0.5, (-16.0, -16.0)).combined([one(0.8), one(0.8)], [None, None])
    rare = CombinationRule(0.2, (-16.0, -16.0)).combined([one(0.8), one(0.8)], [None, None])
    assert even.item() == pytest.approx(16 / 17, abs=1e-6) and rare.item() == pytest.approx(64 / 65, abs=1e-6)


@given(st.floats(0.001, 0.999), st.floats(0.001, 0.999), st.floats(0.01, 0.99))
def test_an_opinion_that_is_the_prior_changes_nothing(p: float, q: float, prior: float) -> None:
    rule = CombinationRule(prior, (-16.0, -16.0))
    alone = rule.combined([one(p), one(prior)], [None, None]).item()
    assert alone == pytest.approx(p, abs=1e-4)
    no_vote = rule.combined([one(p), one(q)], [None, np.array([[False]])]).item()
    assert no_vote == pytest.approx(p, abs=1e-4)
    assert rule.combined([one(p), one(q)], [None, None]).item() == pytest.approx(
        rule.combined([one(q), one(p)], [None, None]).item(), abs=1e-6
    )


def test_silence_counts_no_more_than_it_was_calibrated_to() -> None:
    """0 would be minus infinity; with lowest -2 and an even prior: logit 3 - 2 = 1."""
    found = CombinationRule(0.5, (-16.0, -2.0)).combined(
        [one(1 / (1 + np.exp(-3.0))), one(0.0)], [None, None]
    )
    assert logit(found.item()) == pytest.approx(1.0, abs=1e-4)


def test_certainty_on_both_sides_is_no_nan() -> None:
    found = CombinationRule(0.015, (-16.0, -8.0)).combined([one(1.0), one(0.0)], [None, None])
    assert np.isfinite(found).all()


def model(folder: Path, name: str, stride_gsd: list[float] | None = None) -> Detector:
    sizes = None if stride_gsd is None else {"gsd_m": stride_gsd}
    return Detector(write_map_model(folder / f"{name}.onnx", document(name=name, sizes=sizes)))


def test_a_combination_is_a_detector(tmp_path: Path) -> None:
    a, b = model(tmp_path, "a"), model(tmp_path, "b")
    both = Detector.combined([a, b])
    rule, calibrated = rule_for(["a", "b"])
    assert not calibrated and both.contract.name == "a + b" and both.members == (a, b)
    assert both.contract.about == {"combination of": ["a", "b"], "calibrated together": False}
    z = 2 * logit(0.8) - logit(rule.prior)
    np.testing.assert_allclose(both(GREY), 1 / (1 + np.exp(-z)), atol=1e-5)


def test_a_detector_has_no_vote_on_ground_that_is_too_coarse_for_it(tmp_path: Path) -> None:
    """b knows 0.01 to 0.03 m, enlarged 0.06: on the upper half, 0.1 m, a decides alone."""
    a, b = model(tmp_path, "a", [0.01, 10.0]), model(tmp_path, "b", [0.01, 0.03])
    gsd_m = np.array([[0.1], [0.02]])
    found = Detector.combined([a, b])(GREY, gsd_m)
    np.testing.assert_allclose(found[:8], 0.8, atol=1e-3)
    assert (found[8:] > 0.99).all()


def test_one_detector_is_no_combination(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="1 detectors; a combination has two and more"):
        Detector.combined([model(tmp_path, "a")])


def test_the_pair_that_was_calibrated_has_numbers_of_its_own() -> None:
    rule, calibrated = rule_for(["crowdnet-s", "yolox-nano"])
    assert calibrated and len(rule.lowest) == 2 and 0.0 < rule.prior < 1.0
