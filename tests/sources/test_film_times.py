"""When films were taken: the drone's local time in subtitles, UTC in the film's creation_time."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest

from crowdfence import open_recording
from support.foreign_recordings import frames, write_film, write_subtitles
from support.small_videos import with_creation_time

HOUR_NS = 3600 * 10**9


def film(folder: Path, created_after_s: float | None) -> Path:
    """With subtitles whose time of day begins with the film; `created_after_s`: seconds of creation_time
    after that, as if both were UTC."""
    folder.mkdir()
    plain, start_ns = write_film(folder / "plain.mp4")
    if created_after_s is None:
        named = plain.rename(folder / "DJI_0001.MP4")
    else:
        created = datetime.fromtimestamp(start_ns // 10**9, timezone.utc) + timedelta(seconds=created_after_s)
        named = with_creation_time(plain, folder / "DJI_0001.MP4", f"{created:%Y-%m-%dT%H:%M:%S.000000Z}")
    write_subtitles(folder / "DJI_0001.SRT", start_ns)
    return named


@pytest.mark.parametrize(
    ("created_after_s", "hours", "told"),
    [
        (-2 * 3600, 2, "its time of day is that of UTC+02:00, by the film's creation_time"),
        (3.5 * 3600 + 2, -3.5, "its time of day is that of UTC-03:30, by the film's creation_time"),
        (-5.75 * 3600, 5.75, "its time of day is that of UTC+05:45, by the film's creation_time"),
        (1, 0, ""),
        (None, 0, "in a time zone that nothing tells"),
        # Of half an hour, told when it had ended, in London and in Rome: nobody lives in such zones.
        (1800, 0, "in a time zone that nothing tells"),
        (-1.5 * 3600, 0, "in a time zone that nothing tells"),
        # Saved again later that day, and the day after.
        (-1.3 * 3600, 0, "in a time zone that nothing tells"),
        (-1.25 * 3600, 0, "in a time zone that nothing tells"),
        (30 * 3600, 0, "in a time zone that nothing tells"),
    ],
)
def test_the_zone_of_subtitles_is_found_by_the_creation_time(
    tmp_path: Path, created_after_s: float | None, hours: float, told: str
) -> None:
    found = open_recording(film(tmp_path / "a", created_after_s))
    late_ns = found.frames[1].stamp_ns + round(hours * HOUR_NS) - frames()[0].stamp_ns
    assert abs(late_ns) < 5_000_000 * 100  # of two frames a second, the second is half a second in
    said = [one for one in found.warnings if "time of day" in one]
    assert len(said) == bool(told) and all(told in one for one in said)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
@pytest.mark.parametrize("second", [None, 0.0])
def test_films_of_a_fleet_are_in_one_zone(
    tmp_path: Path, order: tuple[int, int], second: float | None
) -> None:
    """One was saved again without its time, or its maker writes local time there too: they flew together."""
    films = [film(tmp_path / "a", -2 * 3600), film(tmp_path / "b", second)]
    fleet = open_recording([films[at] for at in order])
    assert all(len(instant.frames) == 2 for instant in fleet.instants())
    assert abs(fleet.frames[2].stamp_ns + 2 * HOUR_NS - frames()[0].stamp_ns) < 5e8
    (said,) = [one for one in fleet.warnings if one.startswith("b_DJI_0001") and "time of day" in one]
    assert "its time of day is that of UTC+02:00, as of the other films" in said
