"""Method `evidence` as it is configured: what is given, what the detector states, what is left."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from crowdfence import Detector, Evidence, LikelihoodRatio, RunConfig, Terrain
from crowdfence.config import (
    EvidenceConfig,
    LinearPoolConfig,
    LogOddsConfig,
    LogPoolConfig,
    MovingAverageConfig,
)
from crowdfence.detector.contract.contract import Contract, FinerCameras, Validity

FLOOR = Terrain.from_occupancy(np.ones((4, 1, 1), bool), 1.0)
RATES = {
    "crowd_observations": 30,
    "empty_observations": 970,
    "likelihood_ratio": {
        "distance_m": [0.0, 50.0, 300.0],
        "tilt_deg": [0.0, 90.0],
        "mean": [0.0, 0.5, 1.0],
        "log10_ratio": [[[-1.0, 2.0]], [[-0.5, 1.0]]],
    },
}


def contract(
    rates: dict[str, Any] | None, validity: Validity | None = None, finer: FinerCameras | None = None
) -> Contract:
    """All that matters here of one."""
    return cast(Contract, SimpleNamespace(rates=rates, validity=validity, finer_cameras=finer))


def method(config: EvidenceConfig) -> Evidence:
    return config.fusion_method(FLOOR, 3)


def test_evidence_is_what_a_run_does_unless_told_otherwise() -> None:
    assert RunConfig().method == EvidenceConfig()
    assert RunConfig().crowd_map(FLOOR, 3).method.name == "evidence"


def test_a_contract_states_table_prior_and_cameras() -> None:
    # 40 m away at .1 m a pixel: 400 px of focal length.
    stated = contract(RATES, Validity(gsd_m=(0.1, 0.5), distance_m=(40.0, 200.0)))
    complete = EvidenceConfig().with_detector(stated)
    assert complete.prior == 0.03
    assert complete.focal_px == pytest.approx(400.0)
    assert complete.likelihood is not None
    np.testing.assert_allclose(complete.likelihood.gsd_m, [50.0 / 400.0])
    np.testing.assert_allclose(
        complete.likelihood.log_ratio, np.log(10.0) * np.array([[[-1.0, 2.0]], [[-0.5, 1.0]]]), rtol=1e-6
    )
    # What is given is not overruled.
    given = EvidenceConfig(likelihood=LikelihoodRatio([], [], [], [[[0.0]]]), prior=0.1, focal_px=100.0)
    assert given.with_detector(stated) == given


def test_a_contract_states_what_was_measured_of_finer_cameras() -> None:
    """400 px of focal length beside 1000."""
    table = {**RATES["likelihood_ratio"], "log10_ratio": [[[-1.5, 1.0]], [[-0.4, 0.5]]]}
    finer = FinerCameras(1000.0, table, Validity(gsd_m=(0.03, 0.3)))
    stated = contract(RATES, Validity(gsd_m=(0.1, 0.5), distance_m=(40.0, 200.0)), finer)
    complete = EvidenceConfig().with_detector(stated)
    assert complete.focal_px == pytest.approx(400.0)
    assert complete.likelihood is not None and complete.likelihood.finer is not None
    times, beside = complete.likelihood.finer
    assert times == pytest.approx(2.5) and beside.finer is None
    np.testing.assert_allclose(beside.gsd_m, [50.0 / 1000.0])
    np.testing.assert_allclose(beside.log_ratio[1, 0], np.log(10.0) * np.array([-0.4, 0.5]), rtol=1e-6)
    np.testing.assert_allclose(
        complete.likelihood.log_ratio[1, 0], np.log(10.0) * np.array([-0.5, 1.0]), rtol=1e-6
    )
    told = json.loads(json.dumps(RunConfig(complete).to_json()))["likelihood"]
    assert told["finer"][0] == pytest.approx(2.5) and np.shape(told["finer"][1]["log_ratio"]) == (2, 1, 2)
    coarser = contract(RATES, stated.validity, FinerCameras(300.0, table, Validity()))
    with pytest.raises(
        ValueError, match=r"likelihood_ratio cannot be used: times is 0.75; it must be above 1"
    ):
        EvidenceConfig().with_detector(coarser)


def test_what_it_is_compared_with_takes_the_same_calibration() -> None:
    stated = contract(
        {**RATES, "true_positive": {"rate": 0.7}, "false_positive": {"rate": 0.1}},
        Validity(gsd_m=(0.1, 0.5), distance_m=(40.0, 200.0)),
    )
    own = EvidenceConfig().with_detector(stated)
    for kind in (LogPoolConfig, MovingAverageConfig):
        filled = kind().with_detector(stated)
        assert (filled.likelihood, filled.prior, filled.focal_px) == (own.likelihood, 0.03, own.focal_px)
        made = kind(zone_log_odds=0.0).with_detector(stated).fusion_method(FLOOR, 3)
        assert made.default_threshold == pytest.approx(0.03)
    linear = LinearPoolConfig().with_detector(stated)
    assert (linear.true_positive_rate, linear.false_positive_rate, linear.prior) == (0.7, 0.1, 0.03)
    odds = LogOddsConfig().with_detector(stated).fusion_method(FLOOR, 3)
    # OctoMap's prior and clamps, whatever the detector states.
    assert {name: odds.parameters[name] for name in ("prior", "clamp_low", "clamp_high")} == {
        "prior": 0.5,
        "clamp_low": -2.0,
        "clamp_high": 3.5,
    }


def test_a_detector_that_states_nothing_is_taken_for_the_shipped_one() -> None:
    complete = EvidenceConfig().with_detector(contract(None))
    assert complete == EvidenceConfig().with_detector(None)
    shipped = Detector().contract
    assert shipped.rates is not None
    table = shipped.rates["likelihood_ratio"]
    assert complete.likelihood is not None
    # Most of what is in view, as the model states it, is far away, where nobody shown says less than near.
    overall = np.log(10.0) * np.array(table["all_log10_ratio"])
    ratio = complete.likelihood.log_ratio[0, 0]
    np.testing.assert_allclose(ratio[1:], overall[1:], atol=0.61)
    nearest = np.log(10.0) * np.min(table["log10_ratio"])
    assert nearest < ratio[0] < overall[0] < 0.0
    np.testing.assert_allclose(complete.likelihood.mean, table["mean"][1:-1])
    stated = EvidenceConfig().with_detector(shipped)
    assert stated.prior == pytest.approx(complete.prior, abs=5e-3)
    assert stated.focal_px == pytest.approx(complete.focal_px, abs=1.0)


def test_threshold_and_empty_lie_around_the_prior() -> None:
    evidence = method(EvidenceConfig(prior=0.5, zone_log_odds=np.log(3.0), clear_log_odds=np.log(9.0)))
    assert evidence.default_threshold == pytest.approx(0.75)
    assert evidence.cleared == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mean": [0.0, 1.0]}, r"log_ratio has shape \[2, 1, 2\]; it must be \[2, 1, 1\]"),
        ({"log10_ratio": None}, "cannot be used"),
        ({"distance_m": [0.0, -5.0, 300.0]}, "gsd_m is"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused(change: dict[str, Any], words: str) -> None:
    broken = contract(RATES | {"likelihood_ratio": RATES["likelihood_ratio"] | change})
    with pytest.raises(ValueError, match=f"likelihood_ratio cannot be used.*{words}|{words}"):
        EvidenceConfig().with_detector(broken)
    with pytest.raises(ValueError, match="likelihood_ratio cannot be used"):
        EvidenceConfig().with_detector(contract({"likelihood_ratio": {}}))


def test_what_makes_no_sense_is_refused_when_the_map_is_made() -> None:
    for change, words in (
        ({"prior": 2.0}, "prior is 2"),
        ({"memory_s": -1.0}, "memory_s is -1"),
        ({"clear_log_odds": -1.0}, "clear_log_odds is -1"),
    ):
        with pytest.raises(ValueError, match=words):
            method(replace(EvidenceConfig(), **cast(Any, change)))


def test_a_summary_holds_the_table() -> None:
    config = RunConfig().with_detector(None)
    told = json.loads(json.dumps(config.to_json()))
    assert told["method"] == "evidence"
    assert np.shape(told["likelihood"]["log_ratio"]) == (1, 1, 15)
