"""What a photograph says of itself: EXIF, and the XMP that drones add.

Angles, by maker (degrees; ours: yaw clockwise from north, pitch -90 straight down, roll right side down):

    DJI        drone-dji:GimbalYawDegree, GimbalPitchDegree, GimbalRollDegree   ours
    Autel      drone:GimbalYawDegree, ..., DJI's tags by a shorter prefix       ours
    Parrot     drone-parrot:CameraYawDegree, ...                                ours
    Skydio     drone-skydio:CameraOrientationNED with Yaw, Pitch, Roll          ours
    senseFly,  Camera:Yaw, Pitch, Roll (pix4d)                                  pitch 0 is straight down; the
    others                                                                      roll of senseFly is mirrored;
                                                                                some of Autel's say ours

Up to version 2.32, EXIF says "above sea level" of every height. Some are above the ellipsoid, tens of metres
away, and XMP tells: Camera:VertCS "ellipsoidal" (pix4d's tags: senseFly, Autel, ...), and drone-dji:RtkFlag,
with which DJI's absolute altitude is the "geodetic" one of its manuals. Of some cameras only documentation
says it. Since version 3.0 the same marks (GPSAltitudeRef 0 and 1) mean the ellipsoid, and new ones (2 and 3)
the sea.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image

from crowdfence.georeference import on_earth
from crowdfence.great_circle import great_circle_m
from crowdfence.sources.geographic_track import HeightsAbove
from crowdfence.sources.photographs.exif_text import exif_text
from crowdfence.sources.photographs.when_taken import WhenTaken, received, when_taken
from crowdfence.sources.pictures.decoding import orientation
from crowdfence.sources.pictures.thermal import is_named_thermal, is_thermal
from crowdfence.sources.rotation import are_degrees, from_yaw_pitch_roll_deg, multiply

_HEAD_BYTES = 1 << 19
"""EXIF and XMP stand before the picture; previews between them may be large."""
_XMP_VALUE = re.compile(
    rb'\b([A-Za-z][\w-]{0,40}:[A-Za-z]\w{0,60})(?:\s{0,9}=\s{0,9}"([^"]{0,200})"|>\s{0,80}([^<]{1,200})<)'
)
"""Every part is bounded: a picture may hold anything, and unbounded ones take time with its square."""
_SKYDIO = re.compile(rb"drone-skydio:CameraOrientationNED(.{0,400})", re.DOTALL)
_SKYDIO_END = re.compile(rb"/>|</drone-skydio:CameraOrientationNED")
"""What follows may be the drone's own attitude, whose angles have the same names."""
_NUMBER = re.compile(
    r"\s*([-+]?\d{1,9}(?:\.\d{0,30})?(?:[eE][-+]?\d{1,2})?)(?:/(\d{1,9}))?(?![.,]?\d|[eE][-+]?\d)"
)
"""None with a decimal comma, whose digits behind it would be lost. Programs write small angles as 9.5e-05."""
_ANGLES = ("Yaw", "Pitch", "Roll")
_BELOW = (1, 3)
"""GPSAltitudeRef of heights that are to be taken negative."""
_OF_SEA = (2, 3)
"""GPSAltitudeRef, since EXIF 3.0, of heights above or below the sea; the others are of the ellipsoid."""
_NEW_MARKS = b"0300"
"""ExifVersion since which that holds."""
_ELLIPSOIDAL = ("ANAFIAI", "FC6310R", "S.O.D.A.", "AERIAX")
"""Cameras whose photographs say nothing of it: Parrot's by its "Embedded Photo Metadata", the Phantom 4 RTK
and senseFly's as PIX4Dmatic takes them."""
_SHAKES_DEG = 5.0
"""A gimbal that points straight down points no further back than this."""
_BACK_DEG = 30.0
"""Nor does a camera that is fixed to a drone, whatever its nose does."""
_WGS84 = {"WGS84", "WGS1984", "CGCS2000", "ETRS89", "NAD83", "JGD2000", "JGD2011", "GDA94", "GDA2020"}
"""GPSMapDatum without signs and spaces: WGS84, and what lies within a metre or two of it."""
_EARTH_M = 6_371_000.0
_RTK_POSITION = 16
"""drone-dji:RtkFlag: 0 none, 16 a single receiver's, 32 to 49 float, 50 fixed."""


@dataclass(frozen=True, slots=True)
class PhotographTags:
    """One photograph; None = not told."""

    width: int
    height: int
    size_taken: tuple[int, int] | None
    """Width and height as the camera wrote them: another program may have cut or shrunk the picture since."""
    taken: WhenTaken | None
    received: datetime | None
    """The receiver's time, UTC."""
    make: str
    model: str
    serial: str
    place: tuple[float, float] | None
    place_apart_m: float
    """How far from there EXIF tells it, where XMP and EXIF both do."""
    place_error_m: float | None
    """A standard deviation, as the receiver estimated it."""
    without_fix: str
    """The tag that says so; empty where none does."""
    other_datum: str
    """That of the place, where it is told and none that lies as WGS84; empty otherwise."""
    heights_m: Mapping[HeightsAbove, float]
    attitude_ned: NDArray[np.float64] | None
    """Of the camera, forward-right-down in north-east-down, [4]."""
    unusable_attitude: str
    """Why what is told of the camera's attitude cannot be used; empty where nothing is, or it can."""
    body_ned: NDArray[np.float64] | None
    focal_mm: float | None
    focal_35mm: float | None
    digital_zoom: float
    """1 = none; EXIF does not say whether makers count it into the focal lengths."""
    fisheye: bool
    """Whether it calls its lens one."""
    dewarp: str | None
    """DJI's own calibration: date;fx,fy,cx,cy,k1,k2,p1,p2,k3, cx and cy from the middle."""
    dewarped: bool
    """Whether the drone has taken the distortion of that calibration out of the picture."""
    orientation: int
    """EXIF Orientation, 1 = as stored."""
    panorama: str
    """Its projection, of pictures that were put together; empty of those of one lens."""
    by_dji: bool
    thermal: bool


def read_tags(path: Path) -> PhotographTags:
    """ValueError for a file that is no picture or damaged before its pixels."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is damaged is missing, which is said
            with Image.open(path) as picture:
                width, height = picture.size
                exif = picture.getexif()
                turned = orientation(picture)
                more, gps = exif.get_ifd(ExifTags.IFD.Exif), exif.get_ifd(ExifTags.IFD.GPSInfo)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        if isinstance(error, FileNotFoundError | PermissionError):
            raise
        raise ValueError(f"{path.name} is no picture, or damaged: {error}") from error
    except Exception as error:  # whatever the library meets in damaged tags
        raise ValueError(f"{path.name} has damaged EXIF: {error}") from error
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    xmp = _xmp(head)
    make, model = exif_text(exif.get(ExifTags.Base.Make)), exif_text(exif.get(ExifTags.Base.Model))
    return PhotographTags(
        width=width,
        height=height,
        size_taken=_size(more),
        taken=when_taken(exif, more, gps, xmp),
        received=received(gps),
        make=make,
        model=model,
        serial=exif_text(more.get(ExifTags.Base.BodySerialNumber))
        or xmp.get("drone-dji:DroneSerialNumber", ""),
        place=_place(gps, xmp),
        place_apart_m=_apart_m(gps, xmp),
        place_error_m=_place_error_m(gps, xmp),
        without_fix=_without_fix(gps),
        other_datum="" if _place({}, xmp) else _other_datum(exif_text(gps.get(ExifTags.GPS.GPSMapDatum))),
        heights_m=_heights(gps, xmp, model, more.get(ExifTags.Base.ExifVersion)),
        attitude_ned=_attitude(xmp, head, make),
        unusable_attitude=_unusable(xmp, make),
        body_ned=_turn([xmp.get(f"drone-dji:Flight{name}Degree") for name in _ANGLES]),
        focal_mm=_number(more.get(ExifTags.Base.FocalLength)),
        focal_35mm=_number(more.get(ExifTags.Base.FocalLengthIn35mmFilm)),
        digital_zoom=max(_number(more.get(ExifTags.Base.DigitalZoomRatio)) or 1.0, 1.0),
        fisheye=xmp.get("Camera:ModelType", "").lower() == "fisheye",
        dewarp=xmp.get("drone-dji:DewarpData"),
        dewarped=xmp.get("drone-dji:DewarpFlag") == "1",
        orientation=turned,
        panorama=xmp.get("GPano:ProjectionType", ""),
        by_dji=make.upper() in ("DJI", "HASSELBLAD"),
        thermal=is_thermal(path.stem, xmp, head),
    )


def is_thermal_picture(path: Path) -> bool:
    """By what a picture file says of itself; by its name, where it can say nothing."""
    try:
        return read_tags(path).thermal
    except (OSError, ValueError):
        return is_named_thermal(path.stem)


def _size(more: Mapping[int, Any]) -> tuple[int, int] | None:
    width, height = (
        _number(more.get(side)) for side in (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight)
    )
    return (int(width), int(height)) if width and height and min(width, height) >= 1 else None


def _xmp(head: bytes) -> dict[str, str]:
    begin, end = head.find(b"<x:xmpmeta"), head.find(b"</x:xmpmeta")
    if begin < 0:
        return {}
    found = _XMP_VALUE.findall(head[begin : end if end > begin else len(head)])
    values = {name.decode(): (a or b).decode(errors="replace").strip() for name, a, b in reversed(found)}
    by_autel = {f"drone-dji:{name[6:]}": value for name, value in values.items() if name.startswith("drone:")}
    return {**by_autel, **values}


def _attitude(xmp: Mapping[str, str], head: bytes, make: str) -> NDArray[np.float64] | None:
    names = [
        [f"drone-dji:Gimbal{angle}Degree" for angle in _ANGLES],
        [f"drone-parrot:Camera{angle}Degree" for angle in _ANGLES],
    ]
    for three in names:
        turn = _turn([xmp.get(name) for name in three])
        if turn is not None:
            return turn
    if skydio := _SKYDIO.search(head):
        values = _XMP_VALUE.findall(_SKYDIO_END.split(skydio[1], maxsplit=1)[0])
        found = {name.decode().rpartition(":")[2]: a or b for name, a, b in values}
        turn = _turn([found.get(angle, b"").decode(errors="replace") for angle in _ANGLES])
        if turn is not None:
            return turn
    yaw, pitch, roll = (_number(xmp.get(f"Camera:{angle}")) for angle in _ANGLES)
    if yaw is None or pitch is None or (yaw, pitch, roll or 0.0) == (0.0, 0.0, 0.0):
        return None
    if not are_degrees(yaw, pitch, roll or 0.0) or _unusable(xmp, make):
        return None
    if pitch < -_SHAKES_DEG and _is_autel(make, xmp):  # its EVO Lite tells pitch from the horizon there too
        return from_yaw_pitch_roll_deg(yaw, pitch, roll or 0.0)
    mirrored = -1 if "sensefly" in make.lower() else 1
    body = from_yaw_pitch_roll_deg(yaw, pitch, mirrored * (roll or 0.0))
    return multiply(body, from_yaw_pitch_roll_deg(0.0, -90.0, 0.0))


def _unusable(xmp: Mapping[str, str], make: str) -> str:
    """Pix4d's pitch of 0 is straight down, as cameras tell it that are fixed to a drone; that of a gimbal may
    count from the horizon under the same name, where -90 is straight down."""
    pitch = _number(xmp.get("Camera:Pitch"))
    if pitch is None or pitch >= -_BACK_DEG or _is_autel(make, xmp):
        return ""
    return (
        f"says Camera:Pitch {pitch:g}, which counts from straight down (pix4d) or from the horizon: by the "
        "first it looked far back, by the second ahead and down, and a guess would put crowds anywhere"
    )


def _is_autel(make: str, xmp: Mapping[str, str]) -> bool:
    """The EVO Lite is a "Camera" in EXIF."""
    return make.lower() == "camera" or "autel" in f"{make} {xmp.get('tiff:Make', '')}".lower()


def _turn(angles: list[str | None]) -> NDArray[np.float64] | None:
    """None where they are not told, in another unit, or all 0, as a drone writes them that does not know
    them: to its last digit level and north (of pix4d's: straight down) none ever hangs."""
    yaw, pitch, roll = (_number(angle) for angle in angles)
    if yaw is None or pitch is None or (yaw, pitch, roll or 0.0) == (0.0, 0.0, 0.0):
        return None
    if not are_degrees(yaw, pitch, roll or 0.0):
        return None
    return from_yaw_pitch_roll_deg(yaw, pitch, roll or 0.0)


def _place(gps: Mapping[int, Any], xmp: Mapping[str, str]) -> tuple[float, float] | None:
    """XMP has more digits than EXIF where both are there; DJI misspelled one for years. None also where the
    drone calls what it writes invalid (GpsStatus, of Normal, RTK and Invalid)."""
    if xmp.get("drone-dji:GpsStatus", "").lower() == "invalid":
        return None
    for maker in ("drone-dji", "drone-skydio"):
        latitude = _number(xmp.get(f"{maker}:GpsLatitude") or xmp.get(f"{maker}:Latitude"))
        names = ("GpsLongitude", "GpsLongtitude", "Longitude")
        longitude = next((_number(xmp[f"{maker}:{n}"]) for n in names if f"{maker}:{n}" in xmp), None)
        if _is_place(latitude, longitude):
            return latitude, longitude  # type: ignore[return-value]
    latitude = _degrees(gps.get(ExifTags.GPS.GPSLatitude), gps.get(ExifTags.GPS.GPSLatitudeRef), "NS")
    longitude = _degrees(gps.get(ExifTags.GPS.GPSLongitude), gps.get(ExifTags.GPS.GPSLongitudeRef), "EW")
    return (latitude, longitude) if _is_place(latitude, longitude) else None  # type: ignore[return-value]


def _apart_m(gps: Mapping[int, Any], xmp: Mapping[str, str]) -> float:
    by_xmp, by_exif = _place({}, xmp), _place(gps, {})
    if by_xmp is None or by_exif is None or _other_datum(exif_text(gps.get(ExifTags.GPS.GPSMapDatum))):
        return 0.0
    (latitude, longitude), middle = by_exif, (by_xmp[1], by_xmp[0])
    return float(great_circle_m(middle, np.array([longitude]), np.array([latitude]), _EARTH_M)[0])


def _place_error_m(gps: Mapping[int, Any], xmp: Mapping[str, str]) -> float | None:
    told = [_number(xmp.get(f"drone-dji:RtkStd{side}")) for side in ("Lat", "Lon")]
    told.append(_number(gps.get(ExifTags.GPS.GPSHPositioningError)))
    return max((value for value in told if value is not None), default=None)


def _without_fix(gps: Mapping[int, Any]) -> str:
    if exif_text(gps.get(ExifTags.GPS.GPSStatus)).upper() == "V":
        return "GPSStatus V"
    # By three satellites a receiver knows its place as far as it knows its height.
    return "GPSMeasureMode 2" if exif_text(gps.get(ExifTags.GPS.GPSMeasureMode)) == "2" else ""


def _other_datum(name: str) -> str:
    plain = "".join(letter for letter in name.upper() if letter.isalnum())
    return "" if not plain or plain in _WGS84 or plain.startswith("ITRF") else name


def _is_place(latitude: float | None, longitude: float | None) -> bool:
    if latitude is None or longitude is None or (latitude == 0 and longitude == 0):
        return False
    return on_earth(latitude, longitude)


def _heights(
    gps: Mapping[int, Any], xmp: Mapping[str, str], model: str, exif_version: Any
) -> dict[HeightsAbove, float]:
    heights: dict[HeightsAbove, float | None] = {}
    heights["take-off"] = _number(xmp.get("drone-dji:RelativeAltitude"))
    heights["ground"] = _number(xmp.get("Camera:AboveGroundAltitude"))  # of pix4d
    absolute = _number(gps.get(ExifTags.GPS.GPSAltitude))
    marked = gps.get(ExifTags.GPS.GPSAltitudeRef)
    mark = marked[0] if isinstance(marked, bytes) and marked else marked
    is_new = isinstance(exif_version, bytes) and exif_version >= _NEW_MARKS
    of_ellipsoid = is_new and absolute is not None and mark is not None and mark not in _OF_SEA
    if absolute is None:
        absolute = _number(xmp.get("drone-dji:AbsoluteAltitude") or xmp.get("drone-skydio:AbsoluteAltitude"))
    elif mark in _BELOW:
        absolute = -absolute
    heights["ellipsoid" if _above_ellipsoid(xmp, model, of_ellipsoid) else "sea"] = absolute
    return {above: value for above, value in heights.items() if value is not None}


def _above_ellipsoid(xmp: Mapping[str, str], model: str, by_exif: bool) -> bool:
    """Whether the absolute height counts from the ellipsoid, whatever EXIF calls it where XMP says so."""
    if said := xmp.get("Camera:VertCS"):
        return said.lower().startswith("ellips")
    by_rtk = (_number(xmp.get("drone-dji:RtkFlag")) or 0) >= _RTK_POSITION
    return by_exif or by_rtk or model.replace(" ", "").upper().startswith(_ELLIPSOIDAL)


def _degrees(value: Any, side: Any, sides: str) -> float | None:
    """Signed by `side`, the first or the second of two letters; None where it is neither, or the numbers are
    signed too, as the place could be on the other side of the Earth."""
    letter = exif_text(side)[:1].upper()
    try:
        degrees, minutes, seconds = (float(part) for part in value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    total = degrees + minutes / 60 + seconds / 3600
    if not math.isfinite(total) or min(degrees, minutes, seconds) < 0 or not letter or letter not in sides:
        return None
    return -total if letter == sides[1] else total


def _number(value: Any) -> float | None:
    """A number of EXIF, or the text of one, also a fraction."""
    if isinstance(value, str):
        match = _NUMBER.match(value)
        if match is None:
            return None
        return float(match[1]) / (float(match[2]) or math.nan) if match[2] else float(match[1])
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) else None
