"""The map that a recording is projected onto, and whether the two belong together."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.errors import quoted
from crowdfence.georeference import Georeference, geoid_height_m
from crowdfence.maps import MapError, MapReading, leaves_geoid_open, stated_place, told
from crowdfence.maps import read_map as read_map_file
from crowdfence.sources.recording import Recording

_SAME_PLACE_M = 0.1
"""Anchors may be rounded on their way through files; no pose is as good as that."""


def open_terrain(
    recording: Recording,
    path: str | PathLike[str] | None = None,
    *,
    georeference: Georeference | None = None,
    assume_local: bool = False,
    **options: Any,
) -> Terrain:
    """The terrain to project onto: of the map `path`, or else of the one that came with the recording.

    Georeferenced maps are brought into the recording's local frame. Where nothing says how the two relate,
    the caller does:

    - `georeference`: where on Earth the (0, 0, 0) of a recording lies that does not say so itself; its axes
      point east, north and up there.
    - `assume_local=True`: the recording's coordinates are the map's local ones. With a map that has a place
      on Earth, the recording's (0, 0, 0) is the anchor that the map has by itself: the middle of its extent
      at its lowest height, rounded down to whole metres (an OctoMap of ours names its own). A height model or
      point cloud without reference system holds the recording's coordinates as they are.

    `options` are those of the map's kind:

    - any: `voxel_size_m`, None lets the file decide; an OctoMap has its own and no other
    - height models and lidar points: `crs` ("EPSG:32632") before the file's own, `height_unit` ("m", "ft",
      "us-ft"; "auto"), `height_offset_m` added to heights, which count from the ellipsoid
    - height models (.tif .tiff): `band` (1 = first), `nodata`, `max_hole_m2`: smaller holes are bridged
    - lidar points (.las .laz): `surface` ("ground", "all"), `max_hole_m`: wider gaps stay holes
    - meshes (.ply .obj): `up` ("z", "y"), `unit_m`; these and OctoMaps (.bt .ot): `origin` (east, north, up),
      metres added to coordinates; without it, that their (0, 0, 0) is that of a recording with a place on
      Earth is doubtful

    ValueError when there is no map, a georeferenced map meets a recording without georeference and neither of
    the two is given, one contradicts what the files say, or an option does not belong to the map's kind. What
    is doubtful about the map is a Python warning, one for each doubt. TypeError for what is no recording.
    """
    require_recording(recording)
    return told(read_map(recording, path, georeference=georeference, assume_local=assume_local, **options))


def require_recording(given: object) -> None:
    """TypeError for what is no recording, as the path of one or of a map."""
    if not isinstance(given, Recording):
        raise TypeError(
            f"{quoted(given)} is no recording; `open_recording` makes one of a file or folder, "
            "`Terrain.open` a terrain of a map alone"
        )


def read_map(
    recording: Recording,
    path: str | PathLike[str] | None = None,
    *,
    georeference: Georeference | None = None,
    assume_local: bool = False,
    **options: Any,
) -> MapReading:
    """The terrain of `open_terrain`, which has the arguments and errors, and what was found on the way."""
    chosen = path or recording.terrain
    if chosen is None:
        raise ValueError(f"{recording.name} comes without a map; give one with --terrain")
    if came_along(Path(chosen), recording):
        # Its heights may have been settled on the map as it was read then.
        options = {**recording.terrain_options, **options}
    anchor = _anchor(recording, georeference)
    reading = _related(Path(chosen), f"the recording {recording.name}", anchor, assume_local, options)
    doubts = relation_doubts(Path(chosen), recording, anchor, options)
    return replace(reading, doubts=(*reading.doubts, *doubts))


def read_map_for_live_views(
    path: str | PathLike[str],
    *,
    georeference: Georeference | None = None,
    assume_local: bool = False,
    **options: Any,
) -> MapReading:
    """The map for views that come one by one, with poses in local metres and no more. Arguments and errors
    are those of `read_map`, with live views for the recording."""
    return _related(Path(path), "a live view", georeference, assume_local, options)


def _related(
    path: Path, who: str, anchor: Georeference | None, assume_local: bool, options: dict[str, Any]
) -> MapReading:
    place = stated_place(path, crs=options.get("crs"))
    if place == "earth":
        _require_relation(who, path, anchor, assume_local)
    elif place == "unstated":
        options["assume_local"] = assume_local
    try:
        reading = read_map_file(path, georeference=anchor, **options)
    except TypeError as error:
        raise ValueError(str(error)) from error
    if reading.terrain.georeference is not None:
        # By now somebody has said that it is where the poses count from.
        reading.terrain.georeference = replace(reading.terrain.georeference, of_map=False)
    return reading


def _anchor(recording: Recording, given: Georeference | None) -> Georeference | None:
    if given is None or recording.georeference is None or given == recording.georeference:
        return recording.georeference or given
    raise ValueError(
        f"{recording.name} says itself where its local frame lies, at {recording.georeference}; leave out "
        "--origin (georeference)"
    )


def _require_relation(who: str, path: Path, anchor: Georeference | None, assume_local: bool) -> None:
    """A map with a place on Earth and what is put on it must be related in one way: neither none nor two."""
    if anchor is None and not assume_local:
        raise MapError(
            path,
            f"has a place on Earth, but {who} does not say where its local frame lies: give the frame's "
            "origin (--origin LAT,LON,HEIGHT, georeference=), or --assume-local (assume_local=True) if its "
            "(0, 0, 0) is the middle of the map at the lowest height",
        )
    if anchor is not None and assume_local:
        raise MapError(
            path,
            f"has a place on Earth, and so has {who}: assume_local contradicts that; leave it out",
        )


def came_along(path: Path, recording: Recording) -> bool:
    """Whether the map is the one that came with the recording."""
    return recording.terrain is not None and path.resolve() == recording.terrain.resolve()


def relation_doubts(
    path: Path, recording: Recording, anchor: Georeference | None, options: dict[str, Any]
) -> tuple[str, ...]:
    """What nobody said of how a map lies to a recording on Earth, one sentence each; nothing of the map that
    came with it. `anchor` is that of the recording, also where the caller gives it."""
    if anchor is None or came_along(path, recording):
        return ()
    on_its_ground = set(recording.drones) <= recording.ground_contacts.keys()
    doubts = (
        _place_doubt(path, recording, options),
        level_doubt(path, anchor, options, of_poses=not on_its_ground),
    )
    return tuple(doubt for doubt in doubts if doubt is not None)


def _place_doubt(path: Path, recording: Recording, options: dict[str, Any]) -> str | None:
    """For a map in a frame that nobody placed. The anchor of most recordings is their first position, which
    no map of others counts from."""
    at = recording.georeference
    if at is None or "origin" in options or stated_place(path) != "local":
        return None
    return (
        f"{path.name} does not say where on Earth it lies: its (0, 0, 0) is taken to be that of the "
        f"recording, {at.latitude_deg:.7f}, {at.longitude_deg:.7f}, {at.height_m:g} m above the ellipsoid. "
        "If it is elsewhere, all zones are in the wrong place: say where it is from there, in metres, with "
        "--terrain-option origin=[EAST,NORTH,UP]"
    )


def level_doubt(path: Path, anchor: Georeference, options: dict[str, Any], *, of_poses: bool) -> str | None:
    """What to tell of a map around `anchor`, read by `options`, whose heights count from nothing that it
    names. `of_poses`: those of poses count from the ellipsoid or the sea; where they count from its ground
    they are the same above any map, and those of zones are not."""
    if options.get("height_offset_m") is not None:
        return None
    if not leaves_geoid_open(path, crs=options.get("crs")):
        return None
    try:
        sea_m = geoid_height_m(anchor.latitude_deg, anchor.longitude_deg)
        apart, offset = f"{abs(sea_m):.0f} m {'above' if sea_m > 0 else 'below'}", f"{sea_m:.1f}"
    except ValueError:
        apart, offset = "up to 100 m off", "METRES, how high the sea lies above the ellipsoid there"
    off = (
        "cameras are too high or too low above them by that"
        if of_poses
        else "though poses count from its ground, zones are too high or too low by that in files that say "
        "how high above the ellipsoid or the sea they reach"
    )
    return (
        f"{path.name} names no geoid that its heights count from: they are taken as above the ellipsoid. "
        f"Most height models count from the sea, {apart} there, and {off}: say height_offset_m={offset}, or "
        "0 where they do count from the ellipsoid"
    )


def check_overlap(recording: Recording, terrain: Terrain, max_range_m: float) -> None:
    """ValueError when both have a place on Earth and their local frames are two, when the recording has none
    and nobody said that its poses count from the middle of the map, and when no camera of the recording comes
    within range of the terrain's bounding box."""
    _require_one_frame(recording, terrain)
    if not recording.frames:
        return
    cameras = np.array([frame.world_from_camera[:3, 3] for frame in recording.frames])
    low, high = terrain.bounds
    distance_m = np.linalg.norm(cameras - np.clip(cameras, low, high), axis=1)
    if distance_m.min() > max_range_m:
        raise ValueError(
            f"terrain and poses do not overlap: the nearest camera is {distance_m.min():.0f} m away from the "
            f"terrain, max_range_m is {max_range_m:g}. The terrain spans {_box(low, high)}, the cameras "
            f"{_box(cameras.min(axis=0), cameras.max(axis=0))} (local metres)"
        )


def _require_one_frame(recording: Recording, terrain: Terrain) -> None:
    """A map that was opened by itself counts its metres from its own middle."""
    own, of_map = recording.georeference, terrain.georeference
    if own is None and of_map is not None and of_map.of_map:
        raise ValueError(
            f"the terrain counts its metres from its own middle, at {of_map}, and {recording.name} does not "
            "say where on Earth its (0, 0, 0) lies: open the map for the recording, with "
            "open_terrain(recording, path, georeference=Georeference(LAT, LON, HEIGHT)), or "
            "assume_local=True if it is that middle"
        )
    if own is None or of_map is None or own == of_map:
        return
    place = own.local_from_geodetic(of_map.latitude_deg, of_map.longitude_deg, of_map.height_m)
    apart_m = float(np.linalg.norm(place))
    if apart_m > _SAME_PLACE_M:
        raise ValueError(
            f"terrain and recording have two local frames, {apart_m:.1f} m apart: that of the terrain lies "
            f"at {of_map}, that of {recording.name} at {own}; open the map for the recording, with "
            "open_terrain(recording, path)"
        )


def _box(low: NDArray[np.float64], high: NDArray[np.float64]) -> str:
    spans = (f"{axis} {a:.0f} to {b:.0f}" for axis, a, b in zip("xyz", low, high, strict=True))
    return ", ".join(spans)
