"""Clocks that are whole hours off."""

import pytest

from crowdfence.sources.fleet_clocks import zone_doubts

SECOND_NS = 10**9
START_NS = 1_767_225_600 * SECOND_NS


def flight(drone: str, begin_s: float, length_s: int) -> list[tuple[str, int]]:
    return [(drone, START_NS + round((begin_s + k) * SECOND_NS)) for k in range(length_s + 1)]


@pytest.mark.parametrize(
    ("begin_s", "length_s", "hours"),
    [
        (0.0, 600, None),  # together
        (3600.0, 600, 1),
        (3600.0 - 240.0, 600, 1),  # took off 4 min earlier: 6 of 10 min together
        (3600.0 + 240.0, 600, 1),
        (3600.0 + 360.0, 600, None),  # 4 of 10 min
        (7200.0, 600, 2),
        (1800.0, 600, None),  # its battery was changed
        (15 * 3600.0, 600, None),  # no zone is so far
        (3600.0, 3700, None),  # both in the air at once
    ],
)
def test_flights_that_hours_alone_keep_apart_are_doubted(
    begin_s: float, length_s: int, hours: int | None
) -> None:
    told = zone_doubts([*flight("uav2", begin_s, length_s), *flight("uav1", 0.0, length_s)])
    if hours is None:
        assert told == []
    else:
        (doubt,) = told
        minutes = round((begin_s - length_s) / 60)
        assert (
            doubt.startswith(f"uav2 begins {minutes} min after uav1 has ended; ")
            and f"{hours} h off" in doubt
        )


def test_one_drone_and_none_are_of_one_clock() -> None:
    assert zone_doubts([]) == [] == zone_doubts(flight("uav1", 0.0, 10))
