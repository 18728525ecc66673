"""What is counted of a layer, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from crowdfence import Contract, CrowdMap
from crowdfence.config import EvidenceConfig, LinearPoolConfig, PaperConfig, RunConfig, ZoneConfig
from crowdfence.config.comparison import LogPoolConfig, MovingAverageConfig
from crowdfence.config.layer import PRIORS, with_layer
from crowdfence.evaluation.layer_measures import LayerMeasures
from crowdfence.pipeline.frame_loop import FrameLoop
from support.onnx_models import contract as document
from support.small_crowd_maps import SURE, flat_crowd_map


def test_ground_that_is_called_and_people_on_it() -> None:
    crowd_map = flat_crowd_map(np.array([[0.9, 0.9, 0.2], [0.8, 0.1, np.nan]]))
    # Truth of the voxels in their order, (0, 0) (0, 1) (0, 2) (1, 0) ...: the last one was never seen.
    truth = np.zeros(6, np.bool_)
    ids = crowd_map.terrain.voxel_ids(np.array([(0, 0, 0), (0, 2, 0), (1, 0, 0), (1, 2, 0)]))
    truth[ids] = True
    people = np.array([(0.5, 1.5, 1.0), (0.5, 2.5, 1.0), (1.5, 2.5, 1.0), (9.0, 9.0, 0.0)])
    measures = LayerMeasures()
    assert np.isnan(measures.precision) and measures.to_json()["recall"] is None
    measures.add(crowd_map, 0, 0.5, truth, people)
    assert measures.precision == pytest.approx(2 / 3)  # of (0, 0), (0, 1), (1, 0) the second is not
    assert measures.recall == pytest.approx(2 / 3)  # (0, 2) was missed; nobody saw (1, 2)
    assert (measures.people, measures.people_on_called) == (2, 1)  # on (0, 1) and (0, 2)
    brier = (0.1**2 + 0.9**2 + 0.8**2 + 0.2**2 + 0.1**2) / 5
    assert measures.quality.brier == pytest.approx(brier)


def test_a_layer_fills_in_what_is_left_open_and_no_more() -> None:
    ours = with_layer(EvidenceConfig(), "landing-site")
    assert isinstance(ours, EvidenceConfig) and ours.prior == PRIORS["landing-site"] and ours.likelihood
    assert with_layer(EvidenceConfig(prior=0.2), "landing-site").prior == 0.2
    assert with_layer(EvidenceConfig(), "crowd") == EvidenceConfig()
    assert with_layer(PaperConfig(), "landing-site") == PaperConfig()
    # Of looks from below those count that speak for what is dangerous to overlook.
    assert ours.from_below == "against"
    kept = with_layer(EvidenceConfig(from_below="for"), "landing-site")
    assert isinstance(kept, EvidenceConfig) and kept.from_below == "for"
    smoke = with_layer(EvidenceConfig(), "smoke")
    assert isinstance(smoke, EvidenceConfig) and smoke.prior == 0.5 and smoke.from_below is None
    # A class that nobody calibrated is taken at its word: even odds for even odds, and symmetric.
    assert smoke.likelihood is not None
    ratios = smoke.likelihood.log_ratio.ravel()
    assert np.allclose(ratios, -ratios[::-1]) and (np.diff(ratios) > 0.0).all()


def test_ground_is_fit_for_paper_from_one_half_on_unless_somebody_says_otherwise() -> None:
    def threshold(method, layer="landing-site", given=None):
        return RunConfig(method, zones=ZoneConfig(threshold=given)).with_layer(layer).zones.threshold

    assert threshold(PaperConfig()) == threshold(LinearPoolConfig()) == 0.5
    assert threshold(PaperConfig(), given=0.2) == 0.2
    # The own one of the others is above that, and smoke is rounded towards smoke.
    assert threshold(EvidenceConfig()) is threshold(PaperConfig(), layer="smoke") is None


@pytest.mark.parametrize("config", [EvidenceConfig, LogPoolConfig, MovingAverageConfig])
def test_ground_that_is_rarely_fit_is_fit_from_one_half_on_all_the_same(config: type) -> None:
    """Of a street a fourteenth is: 1.2 log odds above that is P = e^1.2 / (13 + e^1.2) = 0.20 alone."""
    street = RunConfig(config(prior=1 / 14)).with_layer("landing-site")
    assert street.zones.threshold == 0.5
    given = RunConfig(config(prior=1 / 14), zones=ZoneConfig(threshold=0.2)).with_layer("landing-site")
    assert given.zones.threshold == 0.2
    assert RunConfig(config(prior=1 / 14)).with_layer("smoke").zones.threshold is None
    # 1.2 above 1/4 is 0.525.
    assert RunConfig(config(prior=0.25)).with_layer("landing-site").zones.threshold is None


def test_ground_is_fit_from_one_half_on_for_a_detector_that_finds_it_rarely() -> None:
    """By its contract, as of one in a hundred observations."""
    table = {
        "distance_m": [0.0, 1e9],
        "tilt_deg": [0.0, 90.0],
        "mean": [0.0, 0.5, 1.0],
        "log10_ratio": [[[-1.0, 1.0]]],
    }
    rates = {"likelihood_ratio": table, "crowd_observations": 1, "empty_observations": 99}
    found = replace(Contract.from_json(document()), rates=rates)
    rare = RunConfig().with_layer("landing-site", found).with_detector(found)
    assert rare.method.prior == 0.01 and rare.zones.threshold == 0.5
    assert rare.method.from_below == "against"


def test_a_layer_closes_nothing() -> None:
    terrain = flat_crowd_map(np.full((6, 6), 0.9)).terrain
    seen = flat_crowd_map(np.full((6, 6), 0.9))
    for closes, zones in ((True, 1), (False, 0)):
        loop = FrameLoop(CrowdMap(terrain, SURE), ZoneConfig(threshold=0.5), closes=closes)
        observation = _all_of(terrain)
        step = loop.step_observed([observation], 0)
        assert len(step.zones) == zones and len(step.crowd_ids) == seen.seen_count == 36
        assert len(loop.to_bytes()) > 0


def _all_of(terrain):
    from crowdfence import Observation

    count = terrain.voxel_count
    return Observation(
        terrain,
        "uav1",
        0,
        voxel_ids=np.arange(count),
        mean=np.full(count, 0.95),
        pixel_count=np.ones(count, int),
        range_m=np.full(count, 10.0),
        tilt_deg=np.full(count, 90.0),
        occluded_ids=[],
    )


def test_the_configuration_of_a_run_takes_the_layer() -> None:
    config = RunConfig().with_layer("landing-site").with_detector(None)
    assert isinstance(config.method, EvidenceConfig) and config.method.prior == PRIORS["landing-site"]
