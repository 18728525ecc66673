"""When a photograph was taken, in UTC as far as it tells.

EXIF says the time of the camera's clock, in whatever zone that was set to. Newer cameras say the zone too; of
the others the receiver's date and time, which are UTC, tell it to a quarter of an hour. Cameras of DJI for
surveys say UTC itself in XMP, to the microsecond: 2026-01-01T12:00:00.123456, or with colons in the date.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from typing import Any

import numpy as np
from PIL import ExifTags

from crowdfence.sources.photographs.exif_text import exif_text
from crowdfence.sources.time_zone import quarter_zone_s

_CLOCK = "%Y:%m:%d %H:%M:%S"
_UTC_AT_EXPOSURE = re.compile(r"(\d{4}[-:]\d\d[-:]\d\d)[T ](\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?Z?", re.ASCII)
_STALE_S = 300
"""A receiver's time may be that of its last fix, and no clock is exact."""


@dataclass(frozen=True, slots=True)
class WhenTaken:
    """A time."""

    stamp_ns: int
    """UTC; the camera's clock as if it showed UTC where `zone_s` is None."""
    zone_s: int | None
    """How far the clock was ahead of UTC; None: not told."""
    whole_second: bool
    """Whether the time is told to the second only."""

    def in_zone(self, zone_s: int) -> WhenTaken:
        """The same where the zone is not told by itself."""
        if self.zone_s is not None:
            return self
        return WhenTaken(self.stamp_ns - zone_s * 1_000_000_000, zone_s, self.whole_second)


def when_taken(
    exif: Mapping[int, Any], more: Mapping[int, Any], gps: Mapping[int, Any], xmp: Mapping[str, str]
) -> WhenTaken | None:
    """From the tags of a picture: EXIF's own, those of its camera and of its receiver, and XMP. None where no
    date is told."""
    text = exif_text(more.get(ExifTags.Base.DateTimeOriginal)) or exif_text(exif.get(ExifTags.Base.DateTime))
    clock = _utc(text, _CLOCK)
    exposed = _UTC_AT_EXPOSURE.fullmatch(xmp.get("drone-dji:UTCAtExposure", "").strip())
    exact = None if exposed is None else _utc(f"{exposed[1].replace('-', ':')} {exposed[2]}", _CLOCK)
    if exposed is not None and exact is not None:
        zone_s = None if clock is None else _zone_s(clock, exact)
        return WhenTaken(_stamp_ns(exact, exposed[3] or ""), zone_s or 0, not exposed[3])
    if clock is None:
        return None
    fraction = exif_text(more.get(ExifTags.Base.SubsecTimeOriginal))
    digits = fraction if fraction.isascii() and fraction.isdecimal() else ""
    as_utc = WhenTaken(_stamp_ns(clock, digits), None, not fraction)
    zone_s = _stated_zone_s(clock, exif_text(more.get(ExifTags.Base.OffsetTimeOriginal)))
    if zone_s is None:
        told = received(gps)
        zone_s = None if told is None else _zone_s(clock, told)
    return as_utc if zone_s is None else as_utc.in_zone(zone_s)


def _utc(text: str, form: str) -> datetime | None:
    try:
        return datetime.strptime(text, form).replace(tzinfo=timezone.utc)
    except ValueError:
        return None


def _stamp_ns(second: datetime, fraction: str) -> int:
    """With the digits after the point."""
    return int(second.timestamp()) * 1_000_000_000 + int(fraction[:9].ljust(9, "0"))


def _stated_zone_s(clock: datetime, zone: str) -> int | None:
    """Of a text such as +02:00."""
    try:
        offset = datetime.fromisoformat(f"{clock:%Y-%m-%dT%H:%M:%S}{zone}").utcoffset()
    except ValueError:
        return None
    return None if offset is None else round(offset.total_seconds())


def clock_doubt(ahead_s: Sequence[float]) -> str | None:
    """What to tell of photographs whose stamps are so far ahead of what the receiver of each told, as the end
    of a sentence that begins with whose they are; None where most agree."""
    off_s = float(np.median(ahead_s)) if len(ahead_s) else 0.0
    if abs(off_s) <= _STALE_S:
        return None
    return (
        f"its photographs count by its camera's clock, and are {_length(abs(off_s))} "
        f"{'later' if off_s > 0 else 'earlier'} by it than by its receiver (GPSDateStamp, GPSTimeStamp): "
        "unless that keeps the time of a fix of long ago, so far off are the times of the zones, and "
        "what other drones saw counts as so much newer or older; set the dates of the photographs right "
        "(exiftool -AllDates+=...)"
    )


def _length(seconds: float) -> str:
    for unit_s, unit in ((86_400.0, "days"), (3600.0, "h")):
        if seconds >= 2 * unit_s:
            return f"{seconds / unit_s:.1f} {unit}"
    return f"{seconds / 60.0:.0f} min"


def received(gps: Mapping[int, Any]) -> datetime | None:
    """Date and time of the receiver, UTC."""
    day = _utc(exif_text(gps.get(ExifTags.GPS.GPSDateStamp)), "%Y:%m:%d")
    try:
        hours, minutes, seconds = (float(part) for part in gps[ExifTags.GPS.GPSTimeStamp])
        return None if day is None else day + timedelta(hours=hours, minutes=minutes, seconds=seconds)
    except (KeyError, TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None


def _zone_s(clock: datetime, utc: datetime) -> int | None:
    """Of a clock that shows so much when it is so late in UTC; None where that is no zone."""
    return quarter_zone_s((clock - utc).total_seconds(), _STALE_S)
