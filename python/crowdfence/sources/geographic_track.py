"""Positions on Earth and attitudes against true north -> the local track of a camera.

Heights are said before they are used: above the ellipsoid (satellite receivers that know), above sea level
(what most files call altitude), above the take-off (barometers), above the ground below. Only the first is a
place in space; sea level needs a geoid, the last two the map (`ground_contact`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence.georeference import Georeference, geoid_height_m, on_earth
from crowdfence.sources.axes import optical_quaternions_enu
from crowdfence.sources.pose_track import PoseTrack, track_from_rows
from crowdfence.sources.recording import GroundContact

HeightsAbove = Literal["ellipsoid", "sea", "take-off", "ground"]
_GEOID_BOUNDS_M = (-110.0, 90.0)
"""EGM96 lies between -107 m south of India and 86 m in New Guinea."""
DJI_SEA_LEVEL = (
    "without RTK, DJI tells heights above the sea by air pressure as of a standard day, off by up to 200 m "
    "with the weather: use those above the take-off, or --ground-start"
)
"""What to tell whoever asks for these."""
TAKE_OFF_UNKNOWN = (
    "whose place is not recorded: the ground below the first position is taken for it; say it with "
    "--take-off LAT,LON"
)
"""How it is told that a height may be wrong by how the ground rises from the take-off."""
_SAME_PLACE_M = 50.0
_BESIDE_M = 15.0
_STARTED_M = 5.0
"""A first height above this says that the log begins in flight."""


@dataclass(frozen=True, slots=True)
class HeightOptions:
    """What the user says about heights. ValueError for a geoid or a place that is nowhere on Earth."""

    heights: HeightsAbove | None = None
    """Which of the heights in the file is used; None: the first that it has of `preferred_heights`."""
    geoid_m: float | None = None
    """Height of the geoid above the ellipsoid, instead of PROJ's grid."""
    take_off: tuple[float, float] | None = None
    """Latitude and longitude of the take-off, degrees."""

    def __post_init__(self) -> None:
        low_m, high_m = _GEOID_BOUNDS_M
        if self.geoid_m is not None and not low_m <= self.geoid_m <= high_m:
            raise ValueError(f"geoid_m is {self.geoid_m:g}; it must be in [{low_m:g}, {high_m:g}], metres")
        if self.take_off is not None:
            latitude_deg, longitude_deg = self.take_off
            if not on_earth(latitude_deg, longitude_deg):
                raise ValueError(
                    f"take_off is {latitude_deg:g}, {longitude_deg:g}; a latitude is in [-90, 90] and a "
                    "longitude in [-180, 180] degrees"
                )


@dataclass(frozen=True, slots=True)
class GeographicPoses:
    """A camera over time on Earth."""

    stamps_ns: list[int]
    latitude_deg: NDArray[np.float64]
    """[N]"""
    longitude_deg: NDArray[np.float64]
    heights_m: Mapping[HeightsAbove, NDArray[np.float64]]
    """[N] each: what the file has."""
    attitudes_ned: NDArray[np.float64]
    """Camera axes forward-right-down in north-east-down at the drone, [N, 4] (w, x, y, z)."""
    take_off: tuple[float, float] | None = None
    """Latitude and longitude, where the file knows it."""
    preferred_heights: tuple[HeightsAbove, ...] = ("ellipsoid", "take-off", "sea", "ground")


@dataclass(frozen=True, slots=True)
class LocalTrack:
    """The track in the frame of an anchor, and what had to be assumed."""

    anchor: Georeference
    track: PoseTrack
    contact: GroundContact | None
    remarks: list[str]
    heights: HeightsAbove
    """Which of the recorded ones are used."""
    take_off_doubts: list[str]
    """Those of the remarks that say why heights above the take-off may be wrong."""


def local_track(poses: GeographicPoses, options: HeightOptions, anchor: Georeference | None) -> LocalTrack:
    """`anchor` None: the first position. ValueError when the file has no such heights, or heights above the
    sea meet a PROJ without a geoid."""
    above = options.heights or next((one for one in poses.preferred_heights if one in poses.heights_m), None)
    if not poses.heights_m:
        raise ValueError(
            "positions are recorded and no heights, without which no camera can be placed: with heights of "
            "your own it can be opened as a folder with poses.csv (docs/own-recording.md)"
        )
    if above is None or above not in poses.heights_m:
        raise ValueError(
            f"no heights above {above or 'anything known'} are recorded: there are "
            f"{', '.join(poses.heights_m)} (--heights)"
        )
    height_m = poses.heights_m[above]
    columns = np.stack([poses.latitude_deg, poses.longitude_deg, height_m])
    usable = np.asarray(np.isfinite(columns).all(axis=0))
    if not usable.any():
        raise ValueError("no row has a position and a height")
    first = int(np.argmax(usable))
    remarks = [f"heights are those above the {_NAMES[above]}"]
    latitude, longitude = float(poses.latitude_deg[first]), float(poses.longitude_deg[first])
    if above == "sea":
        undulation_m = _undulation_m(latitude, longitude, options.geoid_m)
        height_m = height_m + undulation_m
        remarks[0] += f", with the geoid {undulation_m:+.1f} m above the ellipsoid"
    absolute = above in ("ellipsoid", "sea")
    if anchor is None:
        base_m = height_m[first] if absolute else _sea_level_of_start_m(poses)
        anchor = Georeference(latitude, longitude, math.floor(base_m))
    if not absolute:
        height_m = height_m + anchor.height_m
    safe = [np.where(usable, values, values[first]) for values in _columns(poses, height_m)]
    positions = np.where(usable[:, None], anchor.local_from_geodetic(*safe), np.nan)
    if above == "ground":  # that of the map falls away with distance already, as the Earth does
        positions[:, 2] = np.where(usable, poses.heights_m[above], np.nan)
    # Above the take-off, "up" is the height and not the tangent plane of a far anchor.
    quaternions = _turned_to(anchor, safe, optical_quaternions_enu(poses.attitudes_ned))
    track, left_out = track_from_rows(poses.stamps_ns, positions, quaternions)
    contact, doubts = None, list[str]()
    if not absolute:
        contact = _contact(poses, options, above, anchor, first, positions, doubts)
    return LocalTrack(anchor, track, contact, [*remarks, *doubts, *left_out], above, doubts)


def _sea_level_of_start_m(poses: GeographicPoses) -> float:
    """About how high the take-off lies, where both heights are told: for small numbers only, the map settles
    it."""
    if not {"sea", "take-off"} <= poses.heights_m.keys():
        return 0.0
    apart = np.asarray(poses.heights_m["sea"]) - np.asarray(poses.heights_m["take-off"])
    apart = apart[np.isfinite(apart) & (np.abs(apart) < 9000)]
    return float(np.median(apart)) if apart.size else 0.0


_NAMES: dict[HeightsAbove, str] = {
    "ellipsoid": "ellipsoid (WGS84)",
    "sea": "sea",
    "take-off": "take-off",
    "ground": "ground below",
}


def _columns(poses: GeographicPoses, height_m: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    return [np.asarray(values, np.float64) for values in (poses.latitude_deg, poses.longitude_deg, height_m)]


def _contact(
    poses: GeographicPoses,
    options: HeightOptions,
    above: HeightsAbove,
    anchor: Georeference,
    first: int,
    positions: NDArray[np.float64],
    remarks: list[str],
) -> GroundContact:
    if above == "ground":
        return GroundContact(None, "heights above the ground below")
    place, said = options.take_off, "as stated"
    if place is None:
        place, said = poses.take_off, "recorded home"
    if place is None:
        place = float(poses.latitude_deg[first]), float(poses.longitude_deg[first])
        said = "first position, no home is recorded"
        start_m = float(poses.heights_m[above][first])
        if abs(start_m) > _STARTED_M:
            remarks.append(f"it begins {start_m:.0f} m above its take-off, {TAKE_OFF_UNKNOWN}")
    x, y, z = (float(value) for value in anchor.local_from_geodetic(*place, anchor.height_m)[0])
    if options.take_off is not None and (known := _known_take_off(poses, above, first)) is not None:
        (latitude, longitude), what = known
        at = anchor.local_from_geodetic(latitude, longitude, anchor.height_m)[0]
        apart_m = float(np.hypot(at[0] - x, at[1] - y))
        if apart_m > _SAME_PLACE_M:
            remarks.append(
                f"the stated take-off lies {apart_m:.0f} m from {what}: of several drones it is that of all"
            )
    beside = np.hypot(positions[:, 0] - x, positions[:, 1] - y) < _BESIDE_M
    lower_m = -float(poses.heights_m[above][beside].min(initial=np.inf))
    if lower_m > _STARTED_M:
        remarks.append(
            f"it flew {lower_m:.0f} m below its take-off right at it: heights count from no ground, as after "
            "a home that was set in the air, and what it saw is taken for that much nearer; use those above "
            "the sea (--heights sea), or --ground-start where it begins on the ground"
        )
    return GroundContact((x, y, z), said)


def _known_take_off(
    poses: GeographicPoses, above: HeightsAbove, first: int
) -> tuple[tuple[float, float], str] | None:
    """Where by its own log a drone took off, and what that is."""
    if poses.take_off is not None:
        return poses.take_off, "the home that is recorded"
    start_m = float(poses.heights_m[above][first])
    if abs(start_m) > _STARTED_M:
        return None
    place = float(poses.latitude_deg[first]), float(poses.longitude_deg[first])
    return place, f"the first position, {start_m:.1f} m above the take-off"


def _undulation_m(latitude_deg: float, longitude_deg: float, given_m: float | None) -> float:
    if given_m is not None:
        return given_m
    try:
        return geoid_height_m(latitude_deg, longitude_deg)
    except ValueError as error:
        raise ValueError(
            "heights above sea level need the geoid (EGM96), whose grid PROJ has not installed: install it "
            "(pyproj sync --file us_nga_egm96_15), say how high the geoid lies there (--geoid-m), or count "
            "from the take-off (--heights take-off)"
        ) from error


def _turned_to(
    anchor: Georeference, places: list[NDArray[np.float64]], quaternions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """East-north-up at the drone -> at the anchor: the planes lean, and north turns, with distance."""
    from scipy.spatial.transform import Rotation

    here = _ecef_from_enu(np.radians(places[0]), np.radians(places[1]))
    there = _ecef_from_enu(np.radians(anchor.latitude_deg), np.radians(anchor.longitude_deg))
    finite = np.asarray(np.isfinite(quaternions).all(axis=1))
    xyzw = np.where(finite[:, None], quaternions, [1.0, 0.0, 0.0, 0.0])[:, [1, 2, 3, 0]]
    turned = Rotation.from_matrix(there.T @ here) * Rotation.from_quat(xyzw)
    return np.where(finite[:, None], turned.as_quat()[:, [3, 0, 1, 2]], np.nan)


def _ecef_from_enu(
    latitude: NDArray[np.float64] | float, longitude: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """[..., 3, 3] at places in radians; columns point east, north, up."""
    sin_lat, cos_lat, sin_lon, cos_lon = np.broadcast_arrays(
        np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    )
    zero = np.zeros_like(sin_lat)
    rows = [
        [-sin_lon, -sin_lat * cos_lon, cos_lat * cos_lon],
        [cos_lon, -sin_lat * sin_lon, cos_lat * sin_lon],
        [zero, cos_lat, sin_lat],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
