"""Several detectors on one picture, worked out by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowdfence import Contract, Detector
from crowdfence.detector.combination import (
    CombinationRule,
    CombinedModel,
    combination_warnings,
    combined_contract,
    rule_for,
)
from crowdfence.detector.contract.contract import read_contract
from crowdfence.detector.contract.lookup import KNOWN_CONTRACTS
from crowdfence.detector.inference.picture_parts import Enlarge
from crowdfence.detector.picture_statistics import PictureRange
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


def named(*names: str) -> list[Contract]:
    """Contracts of detectors that come with crowdfence, and of strangers."""
    known = {name: Detector(name).contract for name in names if name.startswith("crowdnet")}
    known["yolox-nano"] = read_contract(KNOWN_CONTRACTS / "yolox_nano.crowdfence.json")
    return [known.get(name) or Contract.from_json(document(name=name)) for name in names]


def test_a_combination_is_a_detector(tmp_path: Path) -> None:
    a, b = model(tmp_path, "a"), model(tmp_path, "b")
    both = Detector.combined([a, b])
    rule, calibrated = rule_for(named("a", "b"))
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


@pytest.mark.parametrize(("enlarge", "votes"), [("always", True), ("affordable", False), ("never", False)])
def test_a_detector_that_does_not_enlarge_has_no_vote_on_far_ground(
    tmp_path: Path, enlarge: Enlarge, votes: bool
) -> None:
    """b knows up to 0.03 m. Its silence at 0.05 m takes away the 0.8 of the other only where it is shown that
    ground enlarged: with an even prior, logit 0.8 - 2 is left."""
    of_b = document(name="b", sizes={"gsd_m": [0.01, 0.03]})
    silent = write_map_model(tmp_path / "b.onnx", of_b, scale=0.0)
    pair = model(tmp_path, "a", [0.01, 10.0]), Detector(silent, enlarge=enlarge)
    rule = CombinationRule(0.5, (-16.0, -2.0))
    expected = 1 / (1 + np.exp(2.0 - logit(0.8))) if votes else 0.8
    np.testing.assert_allclose(CombinedModel(pair, rule).heatmap(GREY, 0.05), expected, atol=1e-3)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_nobody_takes_away_crowd_without_calibration(p: float, q: float) -> None:
    """Each can add only: the pair is at least as sure as the surer of the two, and no surer where the other
    is silent, below the prior."""
    rule, calibrated = rule_for(named("a", "b"))
    assert not calibrated
    both = rule.combined([one(p), one(q)], [None, None]).item()
    # 1e-6: logits end at 16.
    assert both >= max(p, q) - 1e-6
    if min(p, q) <= rule.prior:
        assert both == pytest.approx(max(p, q), abs=1e-6)


def test_silence_beside_a_stranger_says_nothing(tmp_path: Path) -> None:
    """0.8 beside a detector that marks nothing stays 0.8, and ground that both call empty stays empty."""
    blind = Detector.from_callable(lambda image: np.zeros((16, 16), np.float32), stride=4, name="blind")
    for pair in ([model(tmp_path, "a"), blind], [blind, model(tmp_path, "a")]):
        both = Detector.combined(pair)
        np.testing.assert_allclose(both(GREY), 0.8, atol=1e-3)
        assert both(np.zeros_like(GREY)).max() < 1e-6


def test_a_crowd_in_one_coarse_cell_does_not_fade_on_finer_ones(tmp_path: Path) -> None:
    """Cells of 16 pixels beside cells of 4: 0.9 in one of them and 0 around it is 0.9 in its 4 x 4 cells, and
    0 elsewhere. Interpolated, its corners would keep (5 / 8)^2 of it, 0.35."""
    coarse = np.zeros((4, 4), np.float32)
    coarse[1, 2] = 0.9
    sees = Detector.from_callable(lambda image: coarse, stride=16, name="sees")
    expected = np.zeros((16, 16))
    expected[4:8, 8:12] = 0.9
    for pair in ([sees, model(tmp_path, "fine")], [model(tmp_path, "fine"), sees]):
        found = Detector.combined(pair)(np.zeros_like(GREY))
        np.testing.assert_allclose(found, expected, atol=1e-3)


def test_strangers_say_that_they_were_not_calibrated_together(tmp_path: Path) -> None:
    a, b = model(tmp_path, "a"), model(tmp_path, "b")
    (warning,) = combination_warnings(Detector.combined([a, b]).contract)
    assert warning.startswith("the detectors a + b were not calibrated together")
    assert combination_warnings(a.contract) == []
    assert combination_warnings(combined_contract([a.contract, b.contract], calibrated=True)) == []


def test_pictures_are_compared_with_those_of_the_first_that_says_which(tmp_path: Path) -> None:
    tested = PictureRange((0.5,) * 10, tuple(map(tuple, np.eye(10).tolist())), 3.0)
    a, b = model(tmp_path, "a"), model(tmp_path, "b")
    knows = replace(b.contract, pictures=tested)
    assert combined_contract([a.contract, knows], calibrated=False).pictures == tested
    assert combined_contract([a.contract, a.contract], calibrated=False).pictures is None


@pytest.mark.parametrize("lowest", [None, (-16.0, -8.0)])
def test_crowd_stays_where_nobody_has_a_vote(lowest: tuple[float, ...] | None) -> None:
    """On ground too coarse for all of them the surest stands, and nobody calls it empty."""
    rule, no = CombinationRule(0.015, lowest), np.array([[False]])
    assert rule.combined([one(0.7), one(0.2)], [no, no]).item() == pytest.approx(0.7, abs=1e-6)
    assert rule.combined([one(0.0), one(0.001)], [no, no]).item() == pytest.approx(0.015, abs=1e-6)


def test_a_stranger_with_a_vote_takes_nothing_from_one_without() -> None:
    found = rule_for(named("a", "b"))[0].combined([one(0.7), one(0.001)], [np.array([[False]]), None])
    assert found.item() == pytest.approx(0.7, abs=1e-6)


def test_one_detector_is_no_combination(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="1 detectors; a combination has two and more"):
        Detector.combined([model(tmp_path, "a")])


def test_the_pair_that_was_calibrated_has_numbers_of_its_own() -> None:
    rule, calibrated = rule_for(named("crowdnet-s", "yolox-nano"))
    assert calibrated and len(rule.lowest) == 2 and 0.0 < rule.prior < 1.0


@pytest.mark.parametrize(("network", "lowest"), [("crowdnet-s", -8.0), ("crowdnet-s-wide", -5.0)])
def test_the_order_in_which_detectors_are_named_changes_nothing(network: str, lowest: float) -> None:
    """Each keeps its own number: the silence of YOLOX-nano counts that at most."""
    there, calibrated = rule_for(named(network, "yolox-nano"))
    back, again = rule_for(named("yolox-nano", network))
    assert calibrated and again and back.prior == there.prior
    assert there.lowest == (-16.0, lowest) and back.lowest == (lowest, -16.0)
    p, q = one(0.9), one(0.0)
    assert there.combined([p, q], [None, None]) == back.combined([q, p], [None, None])


def test_the_name_of_a_calibrated_detector_makes_no_other_one_calibrated(tmp_path: Path) -> None:
    """Models trained by somebody else under its name, and it itself calibrated anew: the silence of one must
    not take away the 0.8 that the other sees. With the numbers of the pair, ln 4 + ln(.985 / .015) - 16 would
    be left of it."""
    net, people = named("crowdnet-s", "yolox-nano")
    assert not rule_for([*named("yolox-nano"), Contract.from_json(document(name="crowdnet-s"))])[1]
    again = {**(net.calibration or {}), "method": "curve", "earlier": net.calibration}
    assert not rule_for([replace(net, calibration=again), people])[1]
    assert not rule_for([net, replace(people, sizes=None)])[1]
    silent = Detector.from_callable(lambda image: np.zeros((16, 16)), stride=4, name="crowdnet-s")
    both = Detector.combined([silent, model(tmp_path, "yolox-nano")])
    np.testing.assert_allclose(both(GREY), 0.8, atol=1e-3)
    assert len(combination_warnings(both.contract)) == 1


def test_one_name_and_one_calibration_in_eight_bits_and_as_it_was_trained() -> None:
    assert rule_for(named("crowdnet-s-float32", "yolox-nano"))[1]


def test_a_detector_more_is_another_combination() -> None:
    assert not rule_for(named("crowdnet-s", "yolox-nano", "mine"))[1]
    assert not rule_for(named("crowdnet-s", "crowdnet-s-wide"))[1]
