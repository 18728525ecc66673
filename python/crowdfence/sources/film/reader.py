"""A film and the flight log beside it -> a recording of one drone.

    DJI_0001.MP4 + DJI_0001.SRT    DJI's subtitles, see `subtitles`
    film.mp4 + film.ulg            PX4, see `ulog`
    film.mp4 + film.tlog           MAVLink telemetry, see `tlog`

The log is found by the film's name, or named (`telemetry`). Subtitles run on the film's own clock; the other
logs do not know when the film began, so that has to be said (`clock_offset_s`).

A film has 25 to 60 frames a second, which show the same: `frames_per_s` of them are taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera
from crowdfence.georeference import Georeference
from crowdfence.sources.camera_mount import CameraMount
from crowdfence.sources.film.flight_log import FlightLog
from crowdfence.sources.film.picture_reader import FilmPictures
from crowdfence.sources.film.zoom import film_cameras
from crowdfence.sources.geographic_track import (
    DJI_SEA_LEVEL,
    HeightOptions,
    HeightsAbove,
    LocalTrack,
    local_track,
)
from crowdfence.sources.pictures.thermal import THERMAL, is_named_thermal
from crowdfence.sources.pictures.video import left_aside, squeezed
from crowdfence.sources.place_camera import Limits, UnplacedFrame, place_cameras
from crowdfence.sources.recording import PixelSources, Recording
from crowdfence.sources.time_zone import real_zone_s, zone_name

SUFFIXES = (".mp4", ".mov", ".mkv", ".m4v", ".avi", ".webm", ".ts")
LOG_SUFFIXES = (".srt", ".ulg", ".tlog")
_NO_DAY_NS = 86_400 * 1_000_000_000
"""When a film begins of which nobody knows: its log has begun before, and no stamp is below 0."""
_CREATED_OFF_S = 60.0
"""Between the first subtitle and creation_time, which are of one clock; what was saved again later is no zone
by chance, mostly."""
_LONGEST_STEP_S = 2.1
"""Subtitles come once a second at the least."""
_ENDS_APART_S = 0.5
"""Beside a step of the subtitles, so far a film and they may end apart."""


@dataclass(frozen=True, slots=True)
class FilmOptions:
    """What a film and its log do not say about themselves."""

    telemetry: Path | None = None
    """The log; None: by the film's name."""
    clock_offset_s: float | None = None
    """When the film begins, in seconds on the log's clock; added to the times of subtitles."""
    mount: CameraMount | None = None
    calibration: Camera | None = None
    heights: HeightsAbove | None = None
    geoid_m: float | None = None
    take_off: tuple[float, float] | None = None
    frames_per_s: float = 2.0
    """At most so many frames; inf: all."""

    def __post_init__(self) -> None:
        if not self.frames_per_s > 0:
            raise ValueError(f"frames_per_s is {self.frames_per_s}, must be positive")
        if self.clock_offset_s is not None and not abs(self.clock_offset_s) < 1e9:
            raise ValueError(f"clock_offset_s is {self.clock_offset_s}, must be finite and below 1e9")


def is_film(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES


def film_of(log: Path) -> Path | None:
    """The film beside a log, by name."""
    return _beside(log, SUFFIXES)


def read_film(
    path: Path,
    limits: Limits,
    options: FilmOptions,
    anchor: Georeference | None = None,
    drone: str = "",
    zone_s: int | None = None,
) -> Recording:
    """Open a film with its log, in the local frame of `anchor` if given. `zone_s`: how far the time of day in
    its subtitles is ahead of UTC, where other films tell it.

    ValueError when there is no log, it has no positions or no attitude of the camera, or nothing says how
    wide the camera sees; the message says what to give.
    """
    drone = drone or path.stem
    log_path = options.telemetry or _beside(path, LOG_SUFFIXES)
    if log_path is None:
        raise ValueError(
            f"{path} has no flight log beside it ({path.stem}.SRT, .ulg or .tlog): a film without poses "
            "cannot be put on a map. Name the log with --telemetry; `detect` takes films without"
        )
    try:
        log = _read_log(log_path)
        placed = _local_track(log, options, anchor)
    except ValueError as error:
        raise ValueError(f"{error}" if str(log_path) in str(error) else f"{log_path}: {error}") from error
    film = FilmPictures(path)
    squeeze = _squeeze(film, options.calibration)
    cameras = film_cameras(path, film.size, log, options.calibration)
    offset_s, how = _clock_offset(log, film, cameras.usual, placed, log_path, options)
    start_ns, clock, told_zone = _start(log, film, offset_s, zone_s)
    track = placed.track.shifted(start_ns)
    step_s = _usual_step_s(track.stamps_ns)
    gap_s = max(limits.max_pose_gap_s, min(1.5 * step_s, _LONGEST_STEP_S))
    unplaced = []
    for number in _taken(film.times_s, options.frames_per_s):
        time_s = offset_s + film.times_s[number]
        camera, fault = cameras.at(time_s)
        pixels = PixelSources(image=partial(film.ppm, number))
        unplaced.append(UnplacedFrame(start_ns + round(time_s * 1e9), camera, pixels, fault))
    lens = cameras.said(unplaced)
    frames, refused = place_cameras({drone: unplaced}, {drone: track}, Limits(gap_s, limits.max_jump_s))
    sea = DJI_SEA_LEVEL if placed.heights == "sea" and log.timed_by_film else ""
    is_explained = options.clock_offset_s is not None or film.missing_end
    other_length = "" if is_explained else _other_length(log, film, step_s)
    missing = f"{film.missing_end}: what was filmed later is lost" if film.missing_end else ""
    thermal = (
        f"by its name the film is {THERMAL}: they call the ground empty; give the film of colours of the "
        "same shot, or --detector one that was trained on thermal pictures"
        if is_named_thermal(path.stem)
        else ""
    )
    overruled_by = log.overruled(options.mount)
    remarks = [
        *log.remarks,
        *placed.remarks,
        overruled_by,
        how,
        *clock,
        sea,
        other_length,
        missing,
        squeeze,
        left_aside(film.further_films),
        lens,
        _spacing(step_s),
        thermal,
    ]
    return Recording(
        name=path.stem,
        drones=(drone,),
        frames=frames,
        georeference=placed.anchor,
        terrain=None,
        refused=tuple(refused),
        warnings=tuple(f"{drone}: {remark}" for remark in remarks if remark),
        manifest={"kind": "film", "path": str(path), "log": str(log_path), **told_zone},
        pose_tracks={drone: track},
        ground_contacts={} if placed.contact is None else {drone: placed.contact},
    )


def _read_log(path: Path) -> FlightLog:
    suffix = path.suffix.lower()
    if suffix == ".srt":
        from crowdfence.sources.film.subtitles import read_subtitles

        return read_subtitles(path)
    if suffix == ".ulg":
        from crowdfence.sources.film.ulog import read_ulog

        return read_ulog(path)
    if suffix == ".tlog":
        from crowdfence.sources.film.tlog import read_tlog

        return read_tlog(path)
    raise ValueError(f"{path} is no flight log: {' '.join(LOG_SUFFIXES)}")


def _local_track(log: FlightLog, options: FilmOptions, anchor: Georeference | None) -> LocalTrack:
    poses = log.poses(options.mount)
    return local_track(poses, HeightOptions(options.heights, options.geoid_m, options.take_off), anchor)


def _clock_offset(
    log: FlightLog,
    film: FilmPictures,
    camera: Camera,
    placed: LocalTrack,
    log_path: Path,
    options: FilmOptions,
) -> tuple[float, str]:
    """When the film begins on the log's clock, and where that is known from."""
    if options.clock_offset_s is not None or log.timed_by_film:
        return options.clock_offset_s or 0.0, ""
    from crowdfence.sources.film.clock_estimate import estimate_clock_offset

    try:
        found = estimate_clock_offset(film, camera, placed.track)
    except ValueError as error:
        raise ValueError(
            f"{log_path} does not know when the film began, and {error}: say it with --clock-offset, in "
            "seconds after the beginning of the log"
        ) from error
    return found.offset_s, (
        f"the film begins {found.offset_s:.2f} s after the log, give or take {found.error_s:.2f} s, by how "
        f"both turn (agreement {found.agreement:.2f}); --clock-offset says it better"
    )


def _squeeze(film: FilmPictures, calibration: Camera | None) -> str:
    """A doubt about a film whose pixels are not square; ValueError without a calibration of them, as one
    focal length does not hold along both sides."""
    squeeze = squeezed(film.pixel_aspect)
    if not squeeze:
        return ""
    if calibration is None:
        raise ValueError(f"{film.path} {squeeze}, or give --calibration of the pixels as they are stored")
    said = f"the film {squeeze}"
    found = calibration.fy / calibration.fx
    if squeezed(film.pixel_aspect / found):
        said += f"; of its calibration, fy / fx is {found:.3f}: is it of the pixels as they are stored?"
    return said


def _other_length(log: FlightLog, film: FilmPictures, step_s: float) -> str:
    """A doubt about subtitles, which drones write as long as their films."""
    longer_s = float(log.time_s[-1]) - film.times_s[-1]
    if not log.timed_by_film or abs(longer_s) <= min(_LONGEST_STEP_S, _ENDS_APART_S + 1.5 * step_s):
        return ""
    if longer_s < 0:
        return (
            f"its subtitles end {-longer_s:.1f} s before the film: if that was slowed down, or begins with "
            "something else, every pose is of another moment; give the film as the drone wrote it. If they "
            "broke off, poses are right as far as there are any"
        )
    return (
        f"its subtitles go on for {longer_s:.1f} s after the film has ended: if its beginning was cut off, "
        "or it was made faster, every pose is of another moment; say by --clock-offset how many seconds were "
        "cut"
    )


def require_one_each(films: int, options: Mapping[str, Any]) -> None:
    """ValueError for options of one film that several were given."""
    log = options.get("telemetry")
    if films < 2 or log is None:
        return
    if Path(log).suffix.lower() == ".srt":
        raise ValueError(
            f"{log} is of one film, and {films} are named: each takes the subtitles of its own name, without "
            "--telemetry"
        )
    if options.get("clock_offset_s") is not None:
        raise ValueError(
            f"of {films} films in one log, --clock-offset says when one began, and all would be of that "
            "moment: leave it out where each film can be found by how it turns, join films that follow "
            "on each other (ffmpeg -f concat -i LIST.txt -c copy FLIGHT.MP4), or run them one by one"
        )


def zone_of_fleet_s(recordings: Sequence[Recording]) -> int | None:
    """The zone of the drones' clocks that some films tell and others do not; None where there is nothing to
    put right. A film that tells UTC itself may be of a maker who writes local time there too."""
    told = [one.manifest["zone_s"] for one in recordings if "zone_s" in one.manifest]
    zones = {zone_s for zone_s in told if zone_s}
    return zones.pop() if len(zones) == 1 and not all(told) else None


def _start(
    log: FlightLog, film: FilmPictures, offset_s: float, zone_s: int | None
) -> tuple[int, list[str], dict[str, int | None]]:
    """Stamp of the log's time 0, what had to be assumed, and for the manifest the zone of a log in local
    time, None where nothing tells it."""
    created_s = _created_s(film)
    if log.start_ns is not None:
        if not log.timed_by_film:
            return log.start_ns, [], {}
        return _in_utc(log.start_ns, created_s, zone_s)
    # What is known, or assumed, is when the film began; a log of its own began before.
    before_ns = 0 if log.timed_by_film else round(offset_s * 1e9)
    if created_s is not None:
        said = "the time of day is the film's creation_time, in whole seconds"
        return created_s * 1_000_000_000 - before_ns, [said], {}
    said = "no time of day is recorded: it begins in 1970; films of a fleet are taken as begun together"
    return _NO_DAY_NS - before_ns, [said], {}


def _created_s(film: FilmPictures) -> int | None:
    """UTC; None where the film does not tell it."""
    try:
        created = datetime.fromisoformat((film.created or "").replace("Z", "+00:00"))
        seconds = int(created.replace(tzinfo=created.tzinfo or timezone.utc).timestamp())
    except ValueError:
        return None
    return seconds if seconds > 0 else None


def _in_utc(
    local_ns: int, created_s: int | None, zone_s: int | None
) -> tuple[int, list[str], dict[str, int | None]]:
    """`_start` of a log that tells local time."""
    source = "as of the other films"
    if zone_s is None:
        source = "by the film's creation_time"
        zone_s = None if created_s is None else real_zone_s(local_ns / 1e9 - created_s, _CREATED_OFF_S)
    if zone_s is None:
        said = (
            "its time of day is the drone's local time, in a time zone that nothing tells: that, and with it "
            "the times of the zones, is taken as UTC"
        )
        return local_ns, [said], {"zone_s": None}
    said = f"its time of day is that of {zone_name(zone_s)}, {source}"
    return local_ns - zone_s * 1_000_000_000, [said] if zone_s else [], {"zone_s": zone_s}


def _taken(times_s: list[float], frames_per_s: float) -> list[int]:
    """Numbers of the frames that are used, never faster than `frames_per_s`."""
    taken: list[int] = []
    next_s = -np.inf
    for number, time_s in enumerate(times_s):
        if time_s >= next_s - 1e-6:
            taken.append(number)
            next_s = time_s + 1 / frames_per_s
    return taken


def _usual_step_s(stamps_ns: NDArray[np.int64]) -> float:
    return float(np.median(np.diff(stamps_ns))) / 1e9 if len(stamps_ns) > 1 else 0.0


def _spacing(step_s: float) -> str:
    if step_s <= 0.25:
        return ""
    # A straight line over a step t is a t^2 / 8 off at an acceleration a.
    return (
        f"poses come every {step_s:.1f} s: between them they may be {5 * step_s**2 / 8:.1f} m off at 5 m/s2"
    )


def _beside(path: Path, suffixes: tuple[str, ...]) -> Path | None:
    """The file of the same name with one of the suffixes, whatever the case of its letters."""
    if not path.parent.is_dir():
        return None
    found = {
        other.suffix.lower(): other
        for other in sorted(path.parent.iterdir())
        if other.stem == path.stem and other.suffix.lower() in suffixes
    }
    return next((found[suffix] for suffix in suffixes if suffix in found), None)
