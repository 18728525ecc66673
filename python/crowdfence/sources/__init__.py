"""Where views come from: recordings of one or more drones, one file per kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from numpy.typing import ArrayLike

from crowdfence.errors import FrameError
from crowdfence.georeference import Georeference
from crowdfence.sources.place_camera import Limits
from crowdfence.sources.pose_track import PoseGapError, PoseTrack
from crowdfence.sources.recording import (
    Frame,
    Instant,
    PixelSources,
    Recording,
    RefusedFrame,
)
from crowdfence.sources.without_drones import without_drones

__all__ = [
    "Frame",
    "FrameError",
    "Instant",
    "PixelSources",
    "PoseGapError",
    "PoseTrack",
    "Recording",
    "RefusedFrame",
    "is_flight",
    "is_recording",
    "open_recording",
]

KINDS = (
    "mission file or other MCAP, rosbag2 folder, ROS 1 .bag, film with its flight log (DJI .SRT, PX4 .ulg, "
    "MAVLink .tlog), folder of geotagged photographs, AirSim folder, folder of Wildtrack or MultiviewX, "
    "folder with poses.csv"
)
"""What can be opened, for messages."""

_MOST_NAMED = 5


def open_recording(
    path: str | PathLike[str] | Sequence[str | PathLike[str]],
    *,
    max_pose_gap_s: float = 0.25,
    max_jump_s: float = 3600.0,
    ground_start: bool = False,
    alignment: str | PathLike[str] | None = None,
    pose_noise: Literal["estimate"] | tuple[float, float] | None = None,
    without: Sequence[str] = (),
    camera_masks: Mapping[str, str | PathLike[str] | ArrayLike] | None = None,
    **options: Any,
) -> Recording:
    """Open a recording, whatever it is, or several as one fleet:

    * a mission file (MCAP with our topics, see `mission.layout`),
    * a rosbag2 folder, a ROS 1 bag, or an MCAP file with other topics (see `ros_bag.reader`),
    * a film with its flight log beside it (DJI subtitles, PX4 ULog, MAVLink telemetry; see `film.reader`),
    * a folder of geotagged photographs (see `photographs.reader`),
    * a folder with airsim_rec.txt, or the folder above it (AirSim, Cosys-AirSim; see `airsim.reader`),
    * the folder of Wildtrack or MultiviewX, fixed cameras on flat ground (see `multi_camera.reader`),
    * a folder with poses.csv (plain heatmaps and poses; see `folder`).

    A frame is refused, with its reason in `Recording.refused`, where the telemetry rows around it are more
    than `max_pose_gap_s` apart (films: what their subtitles need; files of `convert`: what was bridged
    before), or its stamp repeats, goes backwards, or
    lies more than `max_jump_s` away from the others; several frames in a row may, if the drone was away for
    less than a day. `ground_start`: every drone stood on the ground at its
    first pose, so heights are moved by what the map says there. `alignment`: a file of `crowdfence align`
    with what the poses are off. `pose_noise`: each telemetry row is off by itself by so many metres and
    degrees (standard deviation an axis), or by what the rows themselves show; such errors are smoothed away.
    `without`: drones that are left out, because they saw nothing. `camera_masks`: by drone, where its
    pictures show no ground but parts of itself, or writing: a picture file (black hides, white shows) or a
    bool array [h, w] of the proportions of its pictures, True where nothing can be seen.
    `options` are those of the kind:
    `airsim.reader.AirSimOptions`, `ros_bag.reader.BagOptions`, `film.reader.FilmOptions`,
    `photographs.reader.PhotographOptions`, `multi_camera.reader.MultiCameraOptions`.

    OSError when the path cannot be read, ValueError when it holds no recording or one that cannot be used;
    TypeError for an unknown option, ValueError for an option of another kind of recording.
    """
    limits = Limits(max_pose_gap_s, max_jump_s)
    if isinstance(path, (str, PathLike)):
        recording = _in_time(_open_one(Path(path), limits, options), limits)
    else:
        recording = _open_fleet([Path(one) for one in path], limits, options)
    recording = _with_readable_names(recording)
    recording = _told_once(_with_doubts(_steadied(recording, pose_noise)))
    if ground_start:
        from crowdfence.sources.ground_start import from_the_ground

        recording = from_the_ground(recording)
    if alignment is not None:
        recording = _aligned(recording, alignment)
    if camera_masks:
        recording = _masked(recording, camera_masks)
    return without_drones(recording, without) if without else recording


def is_recording(path: Path) -> bool:
    """Whether `open_recording` would take it for a recording, intact or not. OSError when it is not there.

    Films and photographs are not: they are also pictures, which `detect` takes without poses."""
    from crowdfence.sources.airsim.reader import find_airsim_folder
    from crowdfence.sources.folder import POSES_NAME
    from crowdfence.sources.mission.layout import MAGIC
    from crowdfence.sources.multi_camera.layout import layout_of
    from crowdfence.sources.ros_bag.bag_file import is_bag

    if path.is_dir():
        own = find_airsim_folder(path) is not None or (path / POSES_NAME).is_file()
        return own or layout_of(path) is not None or is_bag(path)
    with path.open("rb") as file:
        return path.suffix == ".mcap" or file.read(len(MAGIC)) == MAGIC or is_bag(path)


def is_flight(path: Path) -> bool:
    """Whether it is a film or photographs by name: pictures that may know where they were taken."""
    from crowdfence.sources.film.reader import is_film
    from crowdfence.sources.photographs.reader import photographs

    return bool(photographs(path)) or (path.is_file() and is_film(path))


def _open_fleet(paths: Sequence[Path], limits: Limits, options: Mapping[str, Any]) -> Recording:
    """The first says where the local frame of all lies, if the others can follow it."""
    from crowdfence.sources.film.pieces import joined_pieces
    from crowdfence.sources.film.reader import is_film, require_one_each, zone_of_fleet_s
    from crowdfence.sources.fleet import joined, names_of

    if not paths:
        raise ValueError("no recording is named")
    require_one_each(sum(map(is_film, paths)), options)
    names = names_of(paths)
    opened: list[Recording] = []
    for path, name in zip(paths, names, strict=True):
        anchor = opened[0].georeference if opened else None
        one = _open_one(path, limits, options, anchor, name, beside_others=len(paths) > 1)
        opened.append(_in_time(one, limits))
    if (zone_s := zone_of_fleet_s(opened)) is not None:
        anchor = opened[0].georeference
        opened = [
            one
            if one.manifest.get("zone_s", zone_s) == zone_s
            else _in_time(_open_film(path, limits, options, anchor, name, zone_s), limits)
            for path, name, one in zip(paths, names, opened, strict=True)
        ]
    opened = joined_pieces(opened)
    return joined(opened) if len(opened) > 1 else opened[0]


def _open_one(
    path: Path,
    limits: Limits,
    options: Mapping[str, Any],
    anchor: Georeference | None = None,
    name: str = "",
    *,
    beside_others: bool = False,
) -> Recording:
    from crowdfence.sources.film.reader import is_film
    from crowdfence.sources.mission.layout import MAGIC
    from crowdfence.sources.photographs.reader import photographs
    from crowdfence.sources.ros_bag.bag_file import is_bag

    if path.is_dir():
        return _open_folder(path, limits, options, anchor, beside_others)
    if path.is_fifo():
        raise ValueError(f"{path} is a pipe; save what it gives in a file, and name that")
    with path.open("rb") as file:
        is_mcap = file.read(len(MAGIC)) == MAGIC
    if is_mcap:
        return _open_mcap(path, limits, options, beside_others)
    if photographs(path):
        return _open_photographs(path, limits, options, anchor)
    if is_film(path):
        return _open_film(path, limits, options, anchor, name)
    if is_bag(path):
        return _open_bag(path, limits, options, beside_others)
    raise ValueError(f"{path} is not a recording: {KINDS}{_film_beside(path)}")


def _in_time(recording: Recording, limits: Limits) -> Recording:
    """With the longest gap that its clocks are believed to tell, and a warning where stamps may be in another
    unit than nanoseconds. ValueError where they must be."""
    from crowdfence.sources.stamp_unit import unit_warning
    from crowdfence.sources.stamps import longest_pause_s

    stamps: dict[str, list[int]] = {}
    told = [(frame.drone, frame.stamp_ns) for frame in recording.frames]
    for drone, stamp_ns in [*told, *((frame.drone, frame.stamp_ns) for frame in recording.refused)]:
        if stamp_ns is not None:
            stamps.setdefault(drone, []).append(stamp_ns)
    said = (unit_warning(drone, stamps[drone]) for drone in sorted(stamps))
    # A drone that was away is believed; two drones hours apart may as well have two clocks.
    gap_s = longest_pause_s((frame.drone, frame.stamp_ns) for frame in recording.frames)
    return replace(
        recording,
        warnings=(*recording.warnings, *(text for text in said if text is not None)),
        longest_gap_s=max(limits.max_jump_s, gap_s),
    )


def _with_readable_names(recording: Recording) -> Recording:
    """Names stand in zones, on pages and in files of other formats. ValueError for one of a drone that nobody
    can read: another may look the same."""
    from crowdfence.legible import legible, unreadable

    name = legible(recording.name)
    drones = {frame.drone for frame in recording.frames} | {one.drone for one in recording.refused}
    for drone in sorted(drones | set(recording.tracks())):
        if character := unreadable(drone):
            raise ValueError(
                f"{name}: the name of drone {drone!a} has the character {character}, which nobody can see: "
                "leave it out"
            )
    return recording if name == recording.name else replace(recording, name=name)


def _with_doubts(recording: Recording) -> Recording:
    """With a warning for each drone with a camera that no usual one is, whose attitudes may be written the
    other way round, or that flew as if its clock were that of another time zone."""
    from crowdfence.sources.fleet_clocks import zone_doubts
    from crowdfence.sources.lens.doubtful import lens_doubt
    from crowdfence.sources.reversed_attitude import reversal_doubt
    from crowdfence.sources.rotation import normalise, rotation_matrix

    cameras = dict.fromkeys((frame.drone, frame.camera) for frame in recording.frames)
    lenses = {drone: doubt for drone, camera in cameras if (doubt := lens_doubt(camera)) is not None}
    attitudes = {
        drone: reversal_doubt(rotation_matrix(normalise(track.quaternions)))
        for drone, track in recording.tracks().items()
    }
    doubts = [*sorted(lenses.items()), *sorted(attitudes.items())]
    said = [f"{drone}: {doubt}" for drone, doubt in doubts if doubt is not None]
    said += zone_doubts((frame.drone, frame.stamp_ns) for frame in recording.frames)
    return replace(recording, warnings=(*recording.warnings, *said))


def _told_once(recording: Recording) -> Recording:
    """Without what a file was converted with and shows itself."""
    from crowdfence.sources.mission.layout import OF_THE_SOURCE

    again = {f"{OF_THE_SOURCE}{one}" for one in recording.warnings}
    return replace(recording, warnings=tuple(one for one in recording.warnings if one not in again))


def _open_film(
    path: Path,
    limits: Limits,
    options: Mapping[str, Any],
    anchor: Georeference | None,
    name: str,
    zone_s: int | None = None,
) -> Recording:
    from crowdfence.sources.film.reader import FilmOptions, read_film
    from crowdfence.sources.reader_options import reader_options

    return read_film(path, limits, reader_options(FilmOptions, path, options), anchor, name, zone_s)


def _open_photographs(
    path: Path, limits: Limits, options: Mapping[str, Any], anchor: Georeference | None
) -> Recording:
    from crowdfence.sources.photographs.reader import PhotographOptions, read_photographs
    from crowdfence.sources.reader_options import reader_options

    return read_photographs(path, limits, reader_options(PhotographOptions, path, options), anchor)


def _film_beside(path: Path) -> str:
    from crowdfence.sources.film.reader import LOG_SUFFIXES, film_of

    if path.suffix.lower() not in LOG_SUFFIXES:
        return ""
    film = film_of(path)
    return f"; it is the log of a film, which is named instead{f': {film}' if film else ''}"


def _aligned(recording: Recording, alignment: str | PathLike[str]) -> Recording:
    from crowdfence.sources.alignment_file import doubt_of, read_alignment, require_same_poses
    from crowdfence.sources.pose_offset import without_offsets

    righted = without_offsets(recording, read_alignment(alignment))
    require_same_poses(alignment, recording)
    doubt = doubt_of(alignment, recording)
    return righted if doubt is None else replace(righted, warnings=(*righted.warnings, doubt))


def _masked(recording: Recording, given: Mapping[str, str | PathLike[str] | ArrayLike]) -> Recording:
    from crowdfence.sources.masked_drones import camera_masks, with_camera_masks

    return with_camera_masks(recording, camera_masks(given))


def _steadied(recording: Recording, noise: Literal["estimate"] | tuple[float, float] | None) -> Recording:
    from crowdfence.sources.pose_noise import with_doubts, without_noise

    return with_doubts(recording) if noise is None else without_noise(recording, noise)


def _open_folder(
    path: Path,
    limits: Limits,
    options: Mapping[str, Any],
    anchor: Georeference | None,
    beside_others: bool,
) -> Recording:
    from crowdfence.sources.airsim.reader import AirSimOptions, find_airsim_folder, read_airsim
    from crowdfence.sources.folder import POSES_NAME, read_folder
    from crowdfence.sources.multi_camera.layout import layout_of
    from crowdfence.sources.photographs.reader import photographs
    from crowdfence.sources.reader_options import reader_options, refuse_options
    from crowdfence.sources.ros_bag.bag_file import is_bag

    airsim = find_airsim_folder(path)
    if airsim is not None:
        return read_airsim(airsim, limits, reader_options(AirSimOptions, path, options))
    if (path / POSES_NAME).is_file():
        refuse_options(path, options)
        return read_folder(path, limits)
    if layout_of(path) is not None:
        from crowdfence.sources.multi_camera.reader import MultiCameraOptions, read_multi_camera

        return read_multi_camera(path, reader_options(MultiCameraOptions, path, options))
    if is_bag(path):
        return _open_bag(path, limits, options, beside_others)
    if photographs(path):
        return _open_photographs(path, limits, options, anchor)
    raise ValueError(
        f"{path} holds no recording: neither airsim_rec.txt (here or one folder below) nor poses.csv nor a "
        f"rosbag2 nor photographs (.jpg) nor the layout of Wildtrack or MultiviewX{_what_is_in(path)}"
    )


def _what_is_in(folder: Path) -> str:
    """Which of its files are recordings by themselves; or that a run wrote it, and what reads that."""
    from crowdfence.sources.film.reader import is_film

    if (folder / "zone_history.jsonl").is_file():
        return (
            "; it holds the results of a run: `crowdfence explain`, `export` and `route` take those, "
            "and `inspect` the .crowdmap in it"
        )
    files = [one for one in sorted(folder.iterdir()) if one.is_file()]
    named = [one.name for one in files if one.suffix in (".mcap", ".bag") or is_film(one)]
    return f"; name a recording in it: {', '.join(named[:_MOST_NAMED])}" if named else ""


def _open_mcap(path: Path, limits: Limits, options: Mapping[str, Any], beside_others: bool) -> Recording:
    from crowdfence.sources.mission.reader import NoMissionError, read_mission
    from crowdfence.sources.reader_options import refuse_options

    if "topics" in options:
        return _open_bag(path, limits, options, beside_others)
    try:
        mission = read_mission(path, limits)
    except NoMissionError as no_mission:
        try:
            return _open_bag(path, limits, options, beside_others)
        except ValueError as no_bag:
            raise ValueError(f"{no_mission}; {no_bag}") from no_bag
    if not any(len(track) for track in mission.tracks().values()) and "version" not in mission.manifest:
        # Topics of others that happen to be named like ours.
        try:
            return _open_bag(path, limits, options, beside_others)
        except ValueError:
            return mission
    refuse_options(path, options)
    return mission


def _open_bag(path: Path, limits: Limits, options: Mapping[str, Any], beside_others: bool) -> Recording:
    from crowdfence.sources.reader_options import reader_options
    from crowdfence.sources.ros_bag.reader import BagOptions, read_bag

    how = reader_options(BagOptions, path, options)
    return read_bag(path, limits, how, beside_others=beside_others)
