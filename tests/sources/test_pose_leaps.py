"""Rows of telemetry further apart than any drone flies."""

from pathlib import Path

import numpy as np
import pytest

from crowdfence import open_recording
from crowdfence.sources.pose_track import track_from_rows
from support.small_recordings import flight, write_folder

LEVEL = [1.0, 0.0, 0.0, 0.0]


def flown(count: int = 200) -> tuple[list[int], np.ndarray]:
    """10 m/s eastwards, 10 rows a second."""
    return [number * 100_000_000 for number in range(count)], np.arange(count)[:, None] * [1.0, 0.0, 0.0]


@pytest.mark.parametrize("rows", [slice(50, 51), slice(50, 53)])
def test_rows_that_are_elsewhere_for_a_moment_are_left_out(rows: slice) -> None:
    """Halfway there stood the drone for the pictures around it: 500 m off its way."""
    stamps, places = flown()
    places[rows, 1] += 1000.0
    track, said = track_from_rows(stamps, places, [LEVEL] * len(stamps))
    count = rows.stop - rows.start
    assert len(track) == len(stamps) - count and np.all(track.positions[:, 1] == 0)
    (told,) = said
    assert told.startswith(
        f"{count} of 200 pose rows are left out, the first at stamp 5000000000: 1000 m away"
    )
    if count == 1:  # 0.2 s between its neighbours, which is bridged
        assert track.at(5_000_000_000, 0.25)[:3, 3] == pytest.approx([50.0, 0.0, 0.0])


def test_a_leap_that_stays_is_told_and_left() -> None:
    stamps, places = flown()
    places[120:, 1] += 60.0
    track, said = track_from_rows(stamps, places, [LEVEL] * len(stamps))
    assert len(track) == len(stamps)
    assert len(said) == 1 and said[0].startswith("poses leap 1 times") and "12000000000: 60 m away" in said[0]


def test_of_two_drones_under_one_name_neither_is_left_out() -> None:
    stamps, places = flown()
    places[::2, 1] += 300.0
    track, said = track_from_rows(stamps, places, [LEVEL] * len(stamps))
    assert len(track) == len(stamps)
    assert len(said) == 1 and "leap 199 times" in said[0] and "two drones" in said[0]


def test_what_a_drone_flies_is_no_leap() -> None:
    stamps, places = flown()
    places[100:, 0] += 15.0  # a better fix
    later = [stamp + (3600 * 10**9 if row >= 150 else 0) for row, stamp in enumerate(stamps)]
    places[150:, 1] += 5000.0  # flown from elsewhere an hour later
    track, said = track_from_rows(later, places, [LEVEL] * len(stamps))
    assert len(track) == len(stamps) and not said
    assert track_from_rows([], [], [])[1] == []


def test_a_folder_says_which_drone_leaps(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "flight", flight())
    lines = (folder / "poses.csv").read_text().splitlines()
    first = [row for row, line in enumerate(lines) if line.startswith("uav1,")]
    at = first[len(first) // 2]
    cells = lines[at].split(",")
    lines[at] = ",".join([*cells[:3], str(float(cells[3]) + 1e5), *cells[4:]])
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    warnings = open_recording(folder).warnings
    assert any(one.startswith("uav1: 1 of ") and "100000 m away and back" in one for one in warnings)
