"""What a recording says of its crowds, which others may have written."""

from typing import Any

import pytest

from crowdfence.truth.at_exposure import crowd_definition


def of_scenario(given: object) -> dict[str, Any]:
    return {"kind": "mission", "simulation": {"scenario": {"crowd_definition": given}}}


def test_a_crowd_is_as_the_recording_says_else_three_within_two_metres() -> None:
    assert crowd_definition(of_scenario({"radius_m": 1.5, "min_people": 5, "more": 1})) == {
        "radius_m": 1.5,
        "min_people": 5,
    }
    assert crowd_definition(of_scenario({"min_people": 5})) == {"radius_m": 2.0, "min_people": 5}
    for said in ({}, {"simulation": "mine"}, {"simulation": {"scenario": [1]}}, of_scenario(None)):
        assert crowd_definition(said) == {"radius_m": 2.0, "min_people": 3}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"radius_m": "2"}, r"crowd_definition.radius_m is '2'; allowed: metres above 0"),
        ({"radius_m": float("nan")}, "crowd_definition.radius_m is nan"),
        ({"min_people": 2.5}, r"min_people is 2.5; allowed: a whole number from 1 on"),
        ({"min_people": 0}, "min_people is 0"),
    ],
)
def test_a_definition_of_no_crowd_is_one_line(given: object, message: str) -> None:
    """A mission file of somebody else's ended every measurement in a traceback."""
    with pytest.raises(ValueError, match=message):
        crowd_definition(of_scenario(given))
