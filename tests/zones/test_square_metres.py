import pytest

from crowdfence.zones.square_metres import square_metres


@pytest.mark.parametrize(
    ("area_m2", "text"),
    [(0.0, "0 m2"), (0.04, "0.04 m2"), (0.253, "0.25 m2"), (1.0, "1 m2"), (9.6, "10 m2"), (564.4, "564 m2")],
)
def test_small_areas_are_not_told_as_none(area_m2: float, text: str) -> None:
    assert square_metres(area_m2) == text
