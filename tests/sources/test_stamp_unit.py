"""Stamps in another unit than nanoseconds are refused or doubted; clocks of simulations pass."""

from pathlib import Path

import pytest

from crowdfence.sources import open_recording
from support.small_recordings import write_hovering

NOW_S = 1_760_000_000
"""9 October 2025."""
SECOND = 1_000_000_000


@pytest.mark.parametrize(
    ("per_second", "unit", "factor", "period_s", "apart"),
    [
        (10**6, "microseconds", 1000, 0.1, "0.1"),
        (10**6, "microseconds", 1000, 0.2, "0.2"),
        (10**6, "microseconds", 1000, 1, "1"),
        (10**6, "microseconds", 1000, 3, "3"),
        (10**3, "milliseconds", 10**6, 20, "0.02"),
        (1, "seconds", 10**9, 20, "2e-05"),
    ],
)
def test_frames_of_today_in_another_unit_are_refused_at_any_rate(
    tmp_path: Path, per_second: int, unit: str, factor: int, period_s: float, apart: str
) -> None:
    first = NOW_S * per_second
    stamps = [first + round(k * period_s * per_second) for k in range(5)]
    said = (
        f"the stamps of uav1 look like {unit}, not nanoseconds: {first} ns is in 1970, and its frames would "
        f"be {apart} ms apart, closer than any camera takes them; multiply them by {factor}"
    )
    with pytest.raises(ValueError, match=said):
        open_recording(write_hovering(tmp_path / "rec", {"uav1": stamps}))


@pytest.mark.parametrize(
    ("per_second", "begins_s", "period_s", "apart"),
    [
        (10**6, 0, 0.1, "0.1"),
        (10**6, 50, 3, "3"),
        (10**3, 7200, 0.1, "0.0001"),
        (1, 0, 1, "1e-06"),
        (1, 86_400, 60, "6e-05"),
    ],
)
def test_a_clock_since_the_start_in_another_unit_is_refused(
    tmp_path: Path, per_second: int, begins_s: int, period_s: float, apart: str
) -> None:
    """A flight of an hour took nanoseconds: no ground that was seen empty was ever stale."""
    stamps = [round((begins_s + k * period_s) * per_second) for k in range(5)]
    said = (
        f"the stamps of uav1 are no nanoseconds: its frames would be {apart} ms apart, closer than any camera"
    )
    with pytest.raises(ValueError, match=said):
        open_recording(write_hovering(tmp_path / "rec", {"uav1": stamps}))


def test_two_looks_of_one_shot_are_no_unit(tmp_path: Path) -> None:
    """Through a wide lens and a long one, by a camera whose clock was never set."""
    shots = [5 * SECOND, 5 * SECOND + 1000]
    for name, stamps in (("one", shots), ("two", [*shots, 7 * SECOND, 7 * SECOND + 1000])):
        assert open_recording(write_hovering(tmp_path / name, {"uav1": stamps})).warnings == ()


def test_one_drone_of_a_fleet_is_enough(tmp_path: Path) -> None:
    right = [NOW_S * SECOND + k * SECOND for k in range(5)]
    fleet = {"uav1": right, "uav2": [stamp // 1000 for stamp in right]}
    with pytest.raises(ValueError, match="the stamps of uav2 look like microseconds"):
        open_recording(write_hovering(tmp_path / "rec", fleet))


@pytest.mark.parametrize("period_s", [10, 60])
def test_rare_photographs_in_microseconds_could_be_a_clock_since_the_start_and_are_doubted(
    tmp_path: Path, period_s: int
) -> None:
    stamps = [(NOW_S + k * period_s) * 10**6 for k in range(3)]
    recording = open_recording(write_hovering(tmp_path / "rec", {"uav1": stamps}))
    assert len(recording.frames) == 3
    # 1.76e15 ns are 20.4 days.
    assert recording.warnings == (
        "the stamps of uav1 begin at 1760000000000000 ns, 20 days into 1970; if they are microseconds, "
        "multiply them by 1000: every age is wrong until then",
    )


@pytest.mark.parametrize(
    ("begins_s", "period_ns"),
    [
        (0, SECOND // 10),
        (1.5, SECOND // 240),  # slow motion at the numbers of seconds
        (2000, SECOND // 30),  # half an hour after the start, the numbers of milliseconds
        (900_000, SECOND // 5),  # ten days
        (NOW_S, SECOND // 30),
        (NOW_S, SECOND),
    ],
)
def test_clocks_of_simulations_machines_and_today_pass_without_a_word(
    tmp_path: Path, begins_s: float, period_ns: int
) -> None:
    stamps = [int(begins_s * SECOND) + k * period_ns for k in range(5)]
    recording = open_recording(write_hovering(tmp_path / "rec", {"uav1": stamps}))
    assert [frame.stamp_ns for frame in recording.frames] == stamps
    assert recording.warnings == ()
