"""Of the ground in a drone's newest looks, the part that its detector was not tested on."""

import numpy as np
import pytest

from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.ground_sampling import GroundSampling
from crowdfence.pipeline.untested_ground import UntestedGround
from support.onnx_models import contract

TESTED = {"gsd_m": [0.1, 0.5], "distance_m": [30.0, 300.0]}


def ground(validity: dict[str, list[float]] | None = None) -> UntestedGround:
    document = contract() if validity is None else {**contract(), "validity": validity}
    return UntestedGround(Contract.from_json(document))


def look(*gsd_m: float) -> GroundSampling:
    """Straight down, with a focal length of 400 pixels."""
    gsd = np.array([gsd_m])
    return GroundSampling(gsd, 400.0 * gsd, np.full(gsd.shape, 90.0))


def test_more_than_half_of_the_ground_is_told_of_each_drone() -> None:
    """Of uav1 5 of 9 rays are finer than 0.1 m, of uav2 exactly half; sky counts nowhere."""
    seen = ground(TESTED)
    for gsd_m in ([0.05, 0.05, np.nan], [0.05, 0.2, 0.2], [0.05, 0.05, 0.2, 0.2]):
        seen.look("uav1", look(*gsd_m))
        seen.look("uav2", look(0.05, 0.2))
    seen.look("uav3", look(0.05))
    told = seen.mostly_untested(3)
    assert told.keys() == {"uav1", "uav2"} and told["uav2"] is None
    assert told["uav1"] == (
        "uav1, metres per pixel: 56% of the ground seen lies below 0.1 m, where the detector test model was "
        "not tested (the middle 90 % of its newest looks: 0.05 to 0.2 m, median 0.05)"
    )


def test_what_holds_is_what_the_newest_fifty_looks_see() -> None:
    """26 of 50 beyond, then 25 of 50."""
    seen = ground(TESTED)
    for number in range(50):
        seen.look("uav1", look(0.2 if number < 24 else 0.6))
    (text,) = seen.mostly_untested(10).values()
    assert text is not None and text.startswith(
        "uav1, metres per pixel: 52% of the ground seen lies above 0.5 m"
    )
    for _ in range(25):
        seen.look("uav1", look(0.2))
    assert seen.mostly_untested(10) == {"uav1": None}


@pytest.mark.parametrize("validity", [None, TESTED])
def test_nothing_is_told_of_looks_at_the_sky_or_by_a_detector_that_states_nothing(
    validity: dict[str, list[float]] | None,
) -> None:
    seen = ground(validity)
    for _ in range(20):
        seen.look("uav1", look(np.nan if validity else 9.0))
    assert seen.is_known == (validity is not None) and seen.mostly_untested(1) == {}
