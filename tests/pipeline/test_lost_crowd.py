"""What is said about crowd that met no ground."""

from dataclasses import fields

from crowdfence import CrowdMass
from crowdfence.exports.frames_csv import FrameRow
from crowdfence.pipeline.lost_crowd import LOST, lost_crowd_warning, lost_crowd_warnings, shares


def test_every_fate_but_ground_has_advice_and_a_column() -> None:
    assert ["ground", *LOST] == list(CrowdMass().by_fate())
    columns = {field.name for field in fields(FrameRow)}
    assert {f"crowd_{fate}" for fate in LOST} <= columns


def test_shares_add_up_to_one_where_there_is_crowd() -> None:
    told = shares(CrowdMass(ground=3.0, hole=1.0))
    assert told == {**dict.fromkeys(LOST, 0.0), "ground": 0.75, "hole": 0.25}
    assert shares(CrowdMass()) == dict.fromkeys(["ground", *LOST])


def test_drones_that_lose_more_than_a_hundredth_are_named_largest_loss_first() -> None:
    masses = {
        "uav1": CrowdMass(ground=99.0, sky=1.0),
        "uav2": CrowdMass(ground=98.0, out_of_range=0.5, sky=1.46, hole=0.04),
        "uav3": CrowdMass(),
        "uav4": CrowdMass(unusable=7.0),
    }
    two, four = lost_crowd_warnings(masses)
    assert two == (
        "uav2: 2.0% of the crowd it shows is not on the map: 1.5% lies above the horizon (false alarms of "
        "the detector, or a wrong attitude), 0.5% meets ground beyond the range (raise --max-range-m)"
    )
    assert lost_crowd_warning("uav2", masses["uav2"]) == two
    assert lost_crowd_warning("uav1", masses["uav1"]) is None
    assert four.startswith("uav4: 100.0% of the crowd it shows is not on the map: 100.0% has no ray")
