"""When photographs were taken: zones, the receiver's time, DJI's UTC."""

from __future__ import annotations

import re
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import ExifTags, Image

from crowdfence import open_recording
from crowdfence.sources.photographs.when_taken import WhenTaken, when_taken
from support.foreign_recordings import dji, write_photograph

NOON = "2026:06:01 12:00:00"
NOON_UTC_NS = int(datetime(2026, 6, 1, 12, tzinfo=timezone.utc).timestamp()) * 10**9
HOUR_S = 3600


def taken(
    clock: str | None = NOON,
    *,
    fraction: str | None = None,
    zone: str | None = None,
    day: str | None = None,
    time: Any = None,
    exposed: str | None = None,
) -> WhenTaken | None:
    more = {
        ExifTags.Base.DateTimeOriginal: clock,
        ExifTags.Base.SubsecTimeOriginal: fraction,
        ExifTags.Base.OffsetTimeOriginal: zone,
    }
    gps = {ExifTags.GPS.GPSDateStamp: day, ExifTags.GPS.GPSTimeStamp: time}
    xmp = {} if exposed is None else {"drone-dji:UTCAtExposure": exposed}
    return when_taken({}, more, gps, xmp)


def after(seconds: float, zone_s: int | None, *, whole: bool = True) -> WhenTaken:
    """So long after noon, UTC."""
    return WhenTaken(NOON_UTC_NS + round(seconds * 1e9), zone_s, whole)


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({}, after(0, None)),
        ({"fraction": "25"}, after(0.25, None, whole=False)),
        ({"zone": "+02:00"}, after(-2 * HOUR_S, 2 * HOUR_S)),
        ({"zone": "-03:30", "fraction": "5"}, after(3.5 * HOUR_S + 0.5, -12600, whole=False)),
        ({"zone": "CEST"}, after(0, None)),
        # 09:59:57 received, the clock is 3 s ahead of it: two hours.
        ({"day": "2026:06:01", "time": (9.0, 59.0, 57.0)}, after(-2 * HOUR_S, 2 * HOUR_S)),
        # The evening before, west of the date line's other side: 12:00 is 23:00 of the day before in UTC.
        ({"day": "2026:05:31", "time": (23, 0, 0)}, after(-13 * HOUR_S, 13 * HOUR_S)),
        ({"day": "2026:06:01", "time": (17, 45, 1)}, after(5.75 * HOUR_S, -20700)),
        # Seven minutes beside any zone: a clock that is wrong, or a fix of long ago.
        ({"day": "2026:06:01", "time": (10, 7, 0)}, after(0, None)),
        ({"day": "2026:05:29", "time": (12, 0, 0)}, after(0, None)),
        ({"zone": "+02:00", "day": "2026:06:01", "time": (11, 0, 0)}, after(-2 * HOUR_S, 2 * HOUR_S)),
        ({"day": "2026:06:01", "time": (float("nan"), 0, 0)}, after(0, None)),
        ({"day": "2026:06:01", "time": (10, 0)}, after(0, None)),
        ({"exposed": "2026-06-01T10:00:03.123456"}, after(-2 * HOUR_S + 3.123456, 2 * HOUR_S, whole=False)),
        ({"exposed": "2026:06:01 10:00:03.5", "zone": "+05:00"}, after(-7196.5, 2 * HOUR_S, whole=False)),
        ({"exposed": "2026-06-01T10:00:03"}, after(-7197, 2 * HOUR_S)),
        ({"exposed": "2026-06-01T10:00:03.5", "clock": None}, after(-7196.5, 0, whole=False)),
        ({"exposed": "2026-13-01T10:00:03.5"}, after(0, None)),
        ({"clock": None}, None),
        ({"clock": "0000:00:00 00:00:00"}, None),
    ],
)
def test_the_time_is_in_utc_as_far_as_the_tags_tell(tags: dict[str, Any], expected: WhenTaken | None) -> None:
    assert taken(**tags) == expected


def photograph(folder: Path, number: int, received: tuple[int, int, int] | None) -> None:
    """At 12:00:0`number` of a clock two hours ahead; with the receiver's time, or before its first fix."""
    path = folder / f"{number}.JPG"
    image = np.full((48, 64, 3), 40 * number, np.uint8)
    xmp = dji((0.0, -60.0, 0.0), 'drone-dji:RelativeAltitude="+50.00"')
    write_photograph(path, image, NOON_UTC_NS + number * 10**9, (46.5, 8.0, 1100.0), xmp, focal_mm35=24)
    with Image.open(path) as picture:
        exif, packet = picture.getexif(), picture.info["xmp"]
        if received is not None:
            exif.get_ifd(ExifTags.IFD.GPSInfo).update({7: received, 29: "2026:06:01"})
        picture.save(path, "JPEG", exif=exif, xmp=packet)


def test_photographs_without_a_zone_are_in_that_of_the_others_of_their_camera(tmp_path: Path) -> None:
    """The first ones have no fix yet, and would lie two hours behind those that follow."""
    for number in range(1, 5):
        photograph(tmp_path, number, None if number < 3 else (10, 0, number))
    recording = open_recording(tmp_path)
    stamps_s = [(frame.stamp_ns - NOON_UTC_NS) / 1e9 + 2 * HOUR_S for frame in recording.frames]
    assert stamps_s == [1.0, 2.0, 3.0, 4.0]
    assert not any("time zone" in warning for warning in recording.warnings)


def test_photographs_that_tell_no_zone_are_said_to_be_taken_as_utc(tmp_path: Path) -> None:
    photograph(tmp_path, 1, None)
    recording = open_recording(tmp_path)
    assert [frame.stamp_ns for frame in recording.frames] == [NOON_UTC_NS + 10**9]
    (warning,) = [one for one in recording.warnings if "time zone" in one]
    assert warning == (
        "X1: its photographs do not say their time zone: their times, and with them those of the zones, are "
        "taken as UTC"
    )


@pytest.mark.parametrize(
    ("clock", "zone", "told"),
    [
        (NOON, "+02:00", None),  # ten o'clock by both
        ("2026:06:01 12:04:00", "+02:00", None),  # no clock is exact
        (NOON, "+01:00", "are 60 min later by it than by its receiver"),  # summer time was forgotten
        ("2026:06:01 10:20:00", "+02:00", "are 100 min earlier by it than by its receiver"),
        # 46 years and 151 days, 16 953, and ten hours.
        ("1980:01:01 00:00:00", None, r"are 16953\.4 days earlier by it than by its receiver"),
    ],
)
def test_a_clock_that_is_not_the_receiver_s_is_told(
    tmp_path: Path, clock: str, zone: str | None, told: str | None
) -> None:
    """The stamps of a clock that had forgotten its date were in 1980, and the zones with them."""
    for number in range(3):
        photograph(tmp_path, number, (10, 0, number))
        path = tmp_path / f"{number}.JPG"
        with Image.open(path) as picture:
            exif, packet = picture.getexif(), picture.info["xmp"]
            more = exif.get_ifd(ExifTags.IFD.Exif)
            more[ExifTags.Base.DateTimeOriginal] = clock[:-1] + str(number)
            if zone is not None:
                more[ExifTags.Base.OffsetTimeOriginal] = zone
            picture.save(path, "JPEG", exif=exif, xmp=packet)
    said = [one for one in open_recording(tmp_path).warnings if "by its receiver" in one]
    assert len(said) == (told is not None)
    assert told is None or re.search(told, said[0])
