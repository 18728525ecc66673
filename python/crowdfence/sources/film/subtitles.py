"""Subtitles that DJI drones write beside their films (.SRT), in the dialects of their generations.

    Phantom 4 RTK        GPS (lon, lat, n) ... H 85.8m ... F.PRY (p, r, y), G.PRY (p, r, y); RTK (lon, lat, n)
                         where it has corrections
    Matrice              GPS(lat,lon,0.0M) BAROMETER:0.3M
    older Mavic          HOME(lon,lat) ... GPS(lon,lat,19) BAROMETER:20.1
    Mavic 2              [latitude : -20.2] [longtitude : 149.0], no arrows, no heights
    Mavic Air 2          [latitude: ..] [longitude: ..] [altitude: ..]
    newer                [latitude: ..] [longitude: ..] [rel_alt: .. abs_alt: ..] [gb_yaw: .. gb_pitch: ..]

H, BAROMETER, rel_alt and (by its look) altitude count from the take-off, abs_alt from the sea. F.PRY is the
drone, G.PRY and gb_ the camera: degrees, pitch down is negative, yaw clockwise from north.
The third number of `GPS` is the height only where it ends in M; otherwise it counts satellites.
Times of day are the drone's local time, whose zone they do not tell: they are read as if it were UTC.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crowdfence.georeference import on_earth
from crowdfence.sources.film.flight_log import FlightLog
from crowdfence.sources.geographic_track import HeightsAbove
from crowdfence.sources.rotation import are_degrees, from_yaw_pitch_roll_deg

_LARGEST_BYTES = 1 << 28
_SPEED_OFF = 0.2
_LONG_S = 10.0
"""Over so long a time of day in whole seconds tells how fast it runs."""
_METRES_PER_FOOT = 0.3048
_DAMAGED = 0.05
"""A share of the blocks; what more of them say is no damage."""
_NUMBER = r"([-+]?\d{1,9}(?:\.\d{1,12})?)"
_ARROW = re.compile(r"(\d{1,3}):(\d\d):(\d\d)[,.](\d{1,3})\s*-->")
_CLOCK = re.compile(r"(\d{4})[-.](\d\d)[-.](\d\d)\s+(\d\d):(\d\d):(\d\d)(?:[,.](\d{1,3}))?(?:[,.](\d{1,3}))?")
_GPS = re.compile(
    r"\b(?:GPS|RTK)\s*\(\s*" + _NUMBER + r"\s*,\s*" + _NUMBER + r"\s*(?:,\s*" + _NUMBER + r"?\s*([Mm]?))?"
)
_HOME = re.compile(r"HOME\s*\(\s*" + _NUMBER + r"\s*,\s*" + _NUMBER)
_FEET = r"(?:\s*([Ff][Tt]|[Ff]eet)\b)?"
_HEIGHT = re.compile(r"(?:\bH\s+|BAROMETER\s*:\s*)" + _NUMBER + _FEET)
_ANGLES = re.compile(r"\b([FG])\.PRY\s*\(\s*" + r"\D{0,3},\s*".join([_NUMBER] * 3) + r"\D{0,3}\)")
_FIELD = re.compile(r"\b([a-z]+(?:_[a-z]+)*)\s*:\s*" + _NUMBER + r"(?!\d|\.\d|,\d)" + _FEET, re.IGNORECASE)
"""None of a number with a decimal comma, whose digits behind it would be lost."""

_NAMES = {
    "latitude": "latitude",
    "longitude": "longitude",
    "longtitude": "longitude",
    "rel_alt": "rel_alt",
    "abs_alt": "abs_alt",
    "altitude": "altitude",
    "focal_len": "focal_len",
    "dzoom_ratio": "zoom",
    "dzoom": "zoom",
    **{f"{who}_{angle}": f"camera_{angle}" for who in ("gb", "gimbal") for angle in ("yaw", "pitch", "roll")},
    **{
        f"{who}_{angle}": f"body_{angle}" for who in ("drone", "flight") for angle in ("yaw", "pitch", "roll")
    },
}


@dataclass(slots=True)
class _Block:
    time_s: float | None = None
    clock_ns: int | None = None
    fields: dict[str, float] = field(default_factory=dict)
    decimals: int = 9
    """Digits behind the point of the latitude."""
    home: tuple[float, float] | None = None
    longitude_first: bool = False
    whole_seconds: bool = False


def read_subtitles(path: Path) -> FlightLog:
    """ValueError when the file holds no block with a time and a position. Blocks that are cut off or lack
    them are left out and counted."""
    if path.stat().st_size > _LARGEST_BYTES:
        raise ValueError(f"{path} has {path.stat().st_size} bytes, too many for subtitles")
    text = path.read_bytes().decode("utf-8-sig", errors="replace")
    found = [_block(one) for one in re.split(r"\n[ \t]*\r?\n", text) if one.strip()]
    blocks = [one for one in found if {"latitude", "longitude"} <= one.fields.keys()]
    _time_by_clock(blocks)
    blocks = [one for one in blocks if one.time_s is not None]
    if not blocks:
        raise ValueError(
            f"{path} holds no position: {len(found)} blocks, none with a time and GPS or latitude and "
            "longitude"
        )
    remarks, unusable = _remarks(path, blocks, len(found)), _unusable(blocks, "camera")
    return FlightLog(
        time_s=np.array([one.time_s for one in blocks], np.float64),
        start_ns=_start_ns(blocks),
        latitude_deg=_column(blocks, "latitude"),
        longitude_deg=_column(blocks, "longitude"),
        heights_m=_heights(blocks, remarks),
        camera_ned=_attitudes(blocks, "camera"),
        body_ned=_attitudes(blocks, "body"),
        timed_by_film=True,
        take_off=next((one.home for one in blocks if one.home is not None), None),
        focal_35mm=_focal_35mm(blocks),
        unusable_attitude=unusable,
        remarks=remarks,
    )


def _block(text: str) -> _Block:
    block = _Block()
    if arrow := _ARROW.search(text):
        hours, minutes, seconds = (int(value) for value in arrow.groups()[:3])
        block.time_s = hours * 3600 + minutes * 60 + seconds + int(arrow[4].ljust(3, "0")) / 1000
    if clock := _CLOCK.search(text):
        block.clock_ns = _clock_ns(clock)
        block.whole_seconds = clock[7] is None
    for name, value, feet in _FIELD.findall(text):
        if known := _NAMES.get(name.lower()):
            number = _millimetres(value) if known == "focal_len" else _metres(value, feet)
            block.fields.setdefault(known, number)
    if latitude := re.search(r"latitude\s*:\s*[-+]?\d+\.?(\d*)", text):
        block.decimals = len(latitude[1])
    if gps := _GPS.search(text):
        _take_gps(block, gps)
    for who, *angles in _ANGLES.findall(text):
        names = ("pitch", "roll", "yaw")
        values = dict(zip(names, map(float, angles), strict=True))
        block.fields |= {f"{'camera' if who == 'G' else 'body'}_{name}": values[name] for name in names}
    if (height := _HEIGHT.search(text)) and "rel_alt" not in block.fields:
        block.fields["rel_alt"] = _metres(height[1], height[2])
    if home := _HOME.search(text):
        first, second = float(home[1]), float(home[2])
        place = (second, first) if block.longitude_first else (first, second)
        block.home = place if _is_place(*place) else None
    _drop_impossible(block)
    return block


def _metres(written: str, feet: str | None) -> float:
    """Without a unit it is the metre; nothing but heights comes in feet."""
    return float(written) * (_METRES_PER_FOOT if feet else 1.0)


def _millimetres(written: str) -> float:
    """Older files write tenths as a whole number, 240 for 24 mm; with a point it is what it says: 166.00."""
    value = float(written)
    return value / 10 if "." not in written and value > 100 else value


def _take_gps(block: _Block, gps: re.Match[str]) -> None:
    first, second = float(gps[1]), float(gps[2])
    block.longitude_first = not gps[4] or abs(first) > 90
    latitude, longitude = (second, first) if block.longitude_first else (first, second)
    block.fields |= {"latitude": latitude, "longitude": longitude}
    block.decimals = len(gps[2 if block.longitude_first else 1].partition(".")[2])


def _is_place(latitude: float, longitude: float) -> bool:
    """No fix, and no home yet, is written as 0, 0; damage can be anything."""
    return (latitude, longitude) != (0.0, 0.0) and on_earth(latitude, longitude)


def _drop_impossible(block: _Block) -> None:
    latitude, longitude = block.fields.get("latitude"), block.fields.get("longitude")
    if latitude is None or longitude is None:
        return
    if not _is_place(latitude, longitude):
        del block.fields["latitude"], block.fields["longitude"]


def _clock_ns(clock: re.Match[str]) -> int | None:
    try:
        year, month, day, hour, minute, second = (int(clock[group]) for group in range(1, 7))
        at = datetime(year, month, day, hour, minute, second, tzinfo=timezone.utc)
    except ValueError:
        return None
    milliseconds = int((clock[7] or "0").ljust(3, "0"))
    microseconds = int((clock[8] or "0").ljust(3, "0"))
    return int(at.timestamp()) * 1_000_000_000 + milliseconds * 1_000_000 + microseconds * 1_000


def _time_by_clock(blocks: list[_Block]) -> None:
    """Files without arrows begin with their film: the time of day counts from the first block."""
    if any(one.time_s is not None for one in blocks):
        return
    first_ns = next((one.clock_ns for one in blocks if one.clock_ns is not None), None)
    for one in blocks:
        if one.clock_ns is not None and first_ns is not None:
            one.time_s = (one.clock_ns - first_ns) / 1e9


def _start_ns(blocks: list[_Block]) -> int | None:
    starts = [
        one.clock_ns - round(one.time_s * 1e9)
        for one in blocks
        if one.clock_ns is not None and one.time_s is not None
    ]
    return None if not starts else int(np.median(np.array(starts) - starts[0])) + starts[0]


def _heights(blocks: list[_Block], remarks: list[str]) -> dict[HeightsAbove, NDArray[np.float64]]:
    heights: dict[HeightsAbove, NDArray[np.float64]] = {}
    for name, above in (("rel_alt", "take-off"), ("abs_alt", "sea"), ("altitude", "take-off")):
        column = _column(blocks, name)
        if np.isfinite(column).any() and above not in heights:
            heights[above] = column  # type: ignore[index]
            if name == "altitude":
                remarks.append("`altitude` does not say from where it counts: taken as above the take-off")
    return heights


def _angles(blocks: list[_Block], who: str) -> NDArray[np.float64]:
    """Yaw, pitch, roll [N, 3]."""
    return np.stack([_column(blocks, f"{who}_{angle}") for angle in ("yaw", "pitch", "roll")], axis=1)


def _unusable(blocks: list[_Block], who: str) -> str:
    """Why angles are not used; a block that is damaged is left out by itself. In tenths of degrees, small
    ones look like degrees."""
    angles = _angles(blocks, who)
    beyond = ~are_degrees(*angles.T)
    if beyond.mean() <= _DAMAGED:
        return ""
    first = ", ".join(f"{angle:g}" for angle in angles[beyond][0])
    return f"logged in another unit than degrees (yaw, pitch, roll {first})"


def _attitudes(blocks: list[_Block], who: str) -> NDArray[np.float64] | None:
    if _unusable(blocks, who):
        return None
    angles = _angles(blocks, who)
    angles[~are_degrees(*angles.T)] = np.nan
    angles[:, 2] = np.where(np.isfinite(angles[:, 2]), angles[:, 2], 0.0)
    told = angles[np.isfinite(angles).all(axis=1)]
    if not told.any():  # nor where all are 0, as of a drone that does not know them
        return None
    return np.array([from_yaw_pitch_roll_deg(*row) for row in angles])


def _focal_35mm(blocks: list[_Block]) -> NDArray[np.float64] | None:
    """Lens times digital zoom [N], millimetres on 35 mm film; NaN where a block does not tell."""
    focal, zoom = _column(blocks, "focal_len"), _column(blocks, "zoom")
    if not np.isfinite(focal).any():
        return None
    if not np.isfinite(zoom).any():
        return focal
    return focal * np.where(zoom >= 1000, zoom / 10_000, np.maximum(zoom, 1.0))


def _remarks(path: Path, blocks: list[_Block], count: int) -> list[str]:
    remarks = []
    if len(blocks) < count:
        remarks.append(f"{path.name}: {count - len(blocks)} of {count} blocks have no time or no position")
    decimals = min(one.decimals for one in blocks)
    if decimals < 6:
        remarks.append(
            f"{path.name}: positions have {decimals} digits behind the point, steps of "
            f"{111_000 * 10.0**-decimals:.1f} m"
        )
    if any(one.longitude_first for one in blocks):
        remarks.append(f"{path.name}: GPS is read as longitude, latitude")
    if any(one.whole_seconds and one.clock_ns is not None for one in blocks):
        remarks.append(f"{path.name}: its time of day is in whole seconds; other drones may be off by one")
    if (speed := _clock_speed(blocks)) is not None and abs(speed - 1.0) > _SPEED_OFF:
        remarks.append(
            f"{path.name}: its time of day runs {speed:.2f} times as fast as the film, as of slow motion or "
            "of a time lapse: how old what it saw is counts by the film"
        )
    return remarks


def _clock_speed(blocks: list[_Block]) -> float | None:
    """How fast the time of day runs against the film; None where too little of both is told."""
    told = [one for one in blocks if one.clock_ns is not None and one.time_s is not None]
    if not told:
        return None
    (a_s, a_ns), (b_s, b_ns) = ((one.time_s or 0.0, one.clock_ns or 0) for one in (told[0], told[-1]))
    return (b_ns - a_ns) / 1e9 / (b_s - a_s) if b_s - a_s > _LONG_S else None


def _column(blocks: list[_Block], name: str) -> NDArray[np.float64]:
    return np.array([one.fields.get(name, np.nan) for one in blocks], np.float64)
