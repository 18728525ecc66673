"""Pose offsets as a file: what `crowdfence align` found, for every command that opens the recording."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from crowdfence.atomic_file import write_bytes
from crowdfence.errors import one_line, quoted
from crowdfence.iso_time import iso_utc
from crowdfence.sources.pose_offset import PoseOffset, alignments_of
from crowdfence.sources.recording import Recording
from crowdfence.sources.stamps import LAST_STAMP_NS

KIND = "crowdfence alignment"
_NUMBERS = ("pitch_deg", "yaw_deg", "roll_deg", "time_s")
_MOST = {"pitch_deg": 180.0, "yaw_deg": 180.0, "roll_deg": 180.0, "time_s": 86_400.0, "position_m": 1000.0}
"""Beyond that nothing is an offset of poses that are roughly right, but another unit or a slip."""
_MOST_PICTURES = 50
_SAME_WAY_M = 5.0
"""Poses may be smoothed or read anew; another flight leaves the way of this one by more."""
_ELSEWHERE = "what is off in how a camera is mounted is off here too, places and clocks may not be"


def write_alignment(
    path: str | PathLike[str],
    offsets: Mapping[str, PoseOffset],
    found: Mapping[str, Any] | None = None,
    recording: Recording | None = None,
) -> None:
    """JSON with the offsets of each drone, and beside them what is to be told of how they were found, and on
    which flight.

    OSError when it cannot be written."""
    drones = {drone: asdict(offset) for drone, offset in offsets.items()}
    content: dict[str, Any] = {"kind": KIND, "drones": drones, "found": dict(found or {})}
    if recording is not None:
        content["recording"] = {
            "name": recording.name,
            "span_ns": recording.span_ns,
            "alignment": {drone: alignments_of(recording.manifest, drone) for drone in offsets},
            "pictures": {drone: _pictures(recording, drone) for drone in offsets},
        }
    write_bytes(path, (json.dumps(content, indent=2) + "\n").encode())


def read_alignment(path: str | PathLike[str]) -> dict[str, PoseOffset]:
    """The offsets of each drone. OSError when it cannot be read, ValueError that names what is wrong."""
    content = _content(path)
    drones = content.get("drones")
    if not isinstance(drones, dict):
        raise ValueError(f"{path}: drones must be names with their offsets")
    if not drones:
        raise ValueError(f"{path} names no drone: it would put nothing right; leave it out")
    return {str(drone): _offset(path, drone, values) for drone, values in drones.items()}


def require_same_poses(path: str | PathLike[str], recording: Recording) -> None:
    """ValueError where an alignment was found on poses that were put right by other alignments than those of
    this recording: what is left of one is not left of the other. A file that does not say passes. Other
    errors as for `read_alignment`."""
    found_on = _content(path).get("recording")
    before = found_on.get("alignment") if isinstance(found_on, dict) else None
    if not isinstance(before, dict):
        return
    for drone, righted in before.items():
        if righted == (now := alignments_of(recording.manifest, drone)):
            continue
        if not righted:
            raise ValueError(
                f"{path} was found on the poses of {drone} as they were recorded, and those in "
                f"{recording.name} were put right before: it would move them as far again; leave the "
                "alignment out"
            )
        raise ValueError(
            f"{path} was found on poses of {drone} that were put right before, and those in {recording.name} "
            f"were {'put right by another alignment' if now else 'not'}: it tells what the first left; use "
            "it with the recording that it was found on, or align this one"
        )


def doubt_of(path: str | PathLike[str], recording: Recording) -> str | None:
    """Why an alignment may not hold for a recording: it was found on a flight of another time, or on other
    pictures. None where it was found on this one, or a part of it, and for a file that does not say. Errors
    as for `read_alignment`."""
    found_on = _content(path).get("recording")
    here = recording.span_ns
    if not isinstance(found_on, dict) or here is None:
        return None
    match found_on.get("span_ns"):
        case [int(first_ns), int(last_ns)] if 0 <= first_ns <= last_ns <= LAST_STAMP_NS and (
            last_ns < here[0] or here[1] < first_ns
        ):
            return _of_another_flight(path, found_on.get("name"), first_ns)
    pictures = found_on.get("pictures")
    if isinstance(pictures, dict) and (others := _of_others(pictures, recording)):
        return (
            f"{path} was found on {found_on.get('name')}, and the pictures of {', '.join(others)} there are "
            f"none of {recording.name}, though it flew at the time: {_ELSEWHERE}"
        )
    return None


def doubt_of_live(path: str | PathLike[str]) -> str | None:
    """The same for live views, which are of another time than any recording. None where it puts right how
    cameras are mounted and nothing else. Errors as for `read_alignment`."""
    found_on = _content(path).get("recording")
    offsets = read_alignment(path).values()
    if not isinstance(found_on, dict) or not any(one.time_s or any(one.position_m) for one in offsets):
        return None
    match found_on.get("span_ns"):
        case [int(first_ns), int(_)] if 0 <= first_ns <= LAST_STAMP_NS:
            return _of_another_flight(path, found_on.get("name"), first_ns)
    return None


def _of_another_flight(path: str | PathLike[str], name: object, first_ns: int) -> str:
    return f"{path} was found on {name}, from {iso_utc(first_ns)} on, and not on this flight: {_ELSEWHERE}"


def _pictures(recording: Recording, drone: str) -> list[list[float]]:
    """Stamp and place of pictures of a drone, all along its flight, by which the flight is known again."""
    frames = [frame for frame in recording.frames if frame.drone == drone]
    some = frames[:: max(1, len(frames) // _MOST_PICTURES)]
    return [[frame.stamp_ns, *frame.world_from_camera[:3, 3].round(2).tolist()] for frame in some]


def _of_others(pictures: Mapping[str, Any], recording: Recording) -> list[str]:
    """Drones none of whose pictures, as `_pictures` gave them, is in a recording, or that flew another way
    from one to the next. Where the map puts them, all of them, does not matter."""
    places = {(frame.drone, frame.stamp_ns): frame.world_from_camera[:3, 3] for frame in recording.frames}
    spans = {drone: (track.stamps_ns[0], track.stamps_ns[-1]) for drone, track in recording.tracks().items()}
    others = []
    for drone, told in pictures.items():
        if not _are_pictures(told) or drone not in spans:
            continue
        first_ns, last_ns = spans[drone]
        of_time = [(stamp_ns, place) for stamp_ns, *place in told if first_ns <= stamp_ns <= last_ns]
        apart = np.array(
            [np.subtract(places[drone, one], place) for one, place in of_time if (drone, one) in places]
        )
        if of_time and (not len(apart) or np.abs(apart - np.median(apart, axis=0)).max() > _SAME_WAY_M):
            others.append(drone)
    return others


def _are_pictures(told: Any) -> bool:
    return isinstance(told, list) and all(
        isinstance(one, list) and len(one) == 4 and all(type(x) in (int, float) and isfinite(x) for x in one)
        for one in told
    )


def _content(path: str | PathLike[str]) -> dict[str, Any]:
    try:
        text = Path(path).read_text(encoding="utf-8")
        content = json.loads(text, object_pairs_hook=_each_once)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is no alignment: {one_line(error)}") from error
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise ValueError(f"{path} is no alignment; `crowdfence align` writes one")
    return content


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object. ValueError for a name that stands in it twice: only one of its values would count."""
    found: dict[str, Any] = {}
    for name, value in pairs:
        if name in found:
            raise ValueError(f"it has {quoted(name)} twice")
        found[name] = value
    return found


def _offset(path: str | PathLike[str], drone: str, values: Any) -> PoseOffset:
    known = {*_NUMBERS, "position_m"}
    if not isinstance(values, dict) or not set(values) <= known:
        raise ValueError(
            f"{path}: {drone} must have {', '.join(sorted(known))} and nothing else, got {quoted(values)}"
        )
    position = values.get("position_m", [0.0, 0.0, 0.0])
    numbers = [values.get(name, 0.0) for name in _NUMBERS]
    if not isinstance(position, list) or len(position) != 3:
        raise ValueError(
            f"{path}: position_m of {drone} must be east, north and up in metres, got {quoted(position)}"
        )
    for name, number in zip((*_NUMBERS, *["position_m"] * 3), (*numbers, *position), strict=True):
        if isinstance(number, bool) or not isinstance(number, (int, float)):
            raise ValueError(f"{path}: {drone} has {quoted(number)} where a number is needed")
        if isinstance(number, float) and not isfinite(number):
            raise ValueError(f"{path}: {name} of {drone} is {number}; it must be finite")
        if abs(number) > _MOST[name]:
            raise ValueError(f"{path}: {name} of {drone} is {quoted(number, 20)}, beyond {_MOST[name]:g}")
    pitch, yaw, roll, time_s = map(float, numbers)
    east, north, up = map(float, position)
    return PoseOffset(pitch, yaw, roll, time_s, (east, north, up))
