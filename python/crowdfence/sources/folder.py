"""A plain folder of heatmaps and a table of camera poses: the form to produce from your own logs.

    poses.csv                          drone, stamp_ns, x, y, z, qw, qx, qy, qz
    recording.json                     cameras, and optionally georeference and terrain
    heatmaps/<drone>_<stamp_ns>.png    or .npy; one file is one frame
    images/<drone>_<stamp_ns>.jpg      or .png; optional
    truth/regions/<drone>_<stamp_ns>.png   optional, crowd number per pixel
    layers/<layer>/<drone>_<stamp_ns>.png  optional: heatmaps of other classes, such as landing-site; or .npy
    truth/layers/<layer>/<drone>_<stamp_ns>.png   optional, 0 = the pixel does not show the class

A row of poses.csv is the pose of a drone's camera: position in local east-north-up metres, unit quaternion
that turns camera axes (OpenCV: right, down, forward) into east-north-up. Rows need not fall on frames; they
are interpolated. recording.json:

    {"cameras": {"uav1": {"width": 640, "height": 480, "fx": 381.4, "fy": 381.4, "cx": 320, "cy": 240,
                          "model": "brown_conrady", "distortion": [k1, k2, p1, p2, k3]},
                 "*": {... for all other drones ...}},
     "georeference": {"latitude_deg": 46.5, "longitude_deg": 8.0, "height_m": 1200.0},
     "terrain": "terrain/dem.tif"}

`model` is pinhole (default), brown_conrady or kannala_brandt; cx and cy count from the outer corner of the
first pixel, whose centre is at (0.5, 0.5). Other keys of a camera are refused.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from crowdfence._core import Camera
from crowdfence.georeference import Georeference
from crowdfence.sources.csv_rows import integer, numbers, read_rows
from crowdfence.sources.folder_description import (
    camera_of,
    cameras_of_nobody,
    georeference_of,
    read_description,
)
from crowdfence.sources.layers import LayerPixels, layer_names
from crowdfence.sources.pictures.decoding import read_only_heatmap, read_regions
from crowdfence.sources.pictures.left_out import labels_without_frame
from crowdfence.sources.place_camera import Limits, UnplacedFrame, place_cameras
from crowdfence.sources.pose_track import PoseTrack, track_from_rows
from crowdfence.sources.recording import PixelSources, Recording
from crowdfence.sources.terrain_hint import find_terrain

POSES_NAME = "poses.csv"
DESCRIPTION_NAME = "recording.json"

_FLOWN_DEG = 0.1
"""11 km of latitude; as metres nobody flies within it but a drone that hovers at this very point."""
_NEAR_NULL_DEG = 1.0
"""Degrees are no longer told from metres near the origin there."""
_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
_FILE_NAME = re.compile(r"(?P<drone>.+)_(?P<stamp>[0-9]{1,20})\.(?P<suffix>png|npy|jpe?g)", re.ASCII)


def read_folder(folder: Path, limits: Limits) -> Recording:
    """Open the folder that holds poses.csv. ValueError when the table or recording.json cannot be used."""
    tracks, warnings = _read_tracks(folder / POSES_NAME)
    description = read_description(folder / DESCRIPTION_NAME, warnings)
    georeference = georeference_of(description, folder / DESCRIPTION_NAME)
    if georeference is not None:
        _require_metres(folder / POSES_NAME, tracks, georeference)
    heatmaps = _files_by_frame(folder / "heatmaps", ("png", "npy"), warnings)
    images = _files_by_frame(folder / "images", ("jpg", "jpeg", "png"), warnings)
    regions = _files_by_frame(folder / "truth" / "regions", ("png",), warnings)
    layers = {name: _layer_files(folder, name, warnings) for name in layer_names(folder, warnings)}
    unplaced: dict[str, list[UnplacedFrame]] = {drone: [] for drone in sorted(tracks)}
    stamps = heatmaps.keys() | images.keys()
    for drone, stamp_ns in sorted(stamps.union(*(one.heatmaps for one in layers.values()))):
        key = drone, stamp_ns
        camera = camera_of(description, drone, folder / DESCRIPTION_NAME)
        pixels = replace(
            _pixels(heatmaps.get(key, []), images.get(key, []), regions.get(key, []), camera),
            layers={name: one.pixels(key, camera) for name, one in layers.items() if one.holds(key)},
        )
        fault = _ambiguous({"heatmaps": heatmaps.get(key, []), "pictures": images.get(key, [])})
        unplaced.setdefault(drone, []).append(UnplacedFrame(stamp_ns, camera, pixels, fault))
    framed = {(drone, frame.stamp_ns) for drone, frames in unplaced.items() for frame in frames}
    labels = {"truth/regions": regions, **{f"truth/layers/{name}": layers[name].labels for name in layers}}
    warnings.extend(_labels_of_no_frame(labels, framed))
    if not unplaced:
        raise ValueError(f"{folder} holds no frames: {POSES_NAME} has no row and heatmaps/ no file")
    warnings.extend(cameras_of_nobody(description, unplaced, DESCRIPTION_NAME))
    frames, refused = place_cameras(unplaced, tracks, limits)
    return Recording(
        name=folder.resolve().name,
        drones=tuple(sorted(unplaced)),
        frames=frames,
        georeference=georeference,
        terrain=_terrain(folder, description, warnings),
        refused=tuple(refused),
        warnings=tuple(warnings),
        manifest={"kind": "folder", "path": str(folder)},
        pose_tracks=tracks,
    )


def _read_tracks(path: Path) -> tuple[dict[str, PoseTrack], list[str]]:
    stamps: dict[str, list[int]] = {}
    poses: dict[str, list[list[float]]] = {}
    faulty: list[str] = []
    for line, row in read_rows(path, ["drone", "stamp_ns", *_POSE]):
        if isinstance(row, str):
            faulty.append(row)
            continue
        try:
            stamp_ns, pose = integer(row, "stamp_ns"), numbers(row, _POSE)
        except ValueError as error:
            faulty.append(f"line {line}: {error}")
            continue
        stamps.setdefault(row["drone"], []).append(stamp_ns)
        poses.setdefault(row["drone"], []).append(pose)
    warnings = [f"{path.name}: {len(faulty)} rows cannot be read, first: {faulty[0]}"] if faulty else []
    tracks = {}
    for drone, values in poses.items():
        positions, quaternions = [pose[:3] for pose in values], [pose[3:] for pose in values]
        tracks[drone], remarks = track_from_rows(stamps[drone], positions, quaternions)
        warnings.extend(f"{drone}: {remark}" for remark in remarks)
    return tracks, warnings


def _require_metres(path: Path, tracks: Mapping[str, PoseTrack], at: Georeference) -> None:
    """ValueError for a drone whose x and y are longitude and latitude, in either order: as metres they are
    one point, some metres from the origin, from which all of its pictures would be taken."""
    place = np.array([at.longitude_deg, at.latitude_deg])
    if np.abs(place).max() < _NEAR_NULL_DEG:
        return
    for drone, track in tracks.items():
        xy = track.positions[:, :2]
        if len(track) and any((np.abs(xy - order) < _FLOWN_DEG).all() for order in (place, place[::-1])):
            x, y = xy[0]
            raise ValueError(
                f"{path}: x {x:.6f} and y {y:.6f} of {drone!r} are degrees, as all of its positions; x, y "
                "and z are metres to the east, to the north and up from the georeference "
                "(crowdfence.Georeference.local_from_geodetic makes them)"
            )


def _files_by_frame(
    folder: Path, suffixes: tuple[str, ...], warnings: list[str]
) -> dict[tuple[str, int], list[Path]]:
    """Files `<drone>_<stamp_ns>.<suffix>` by (drone, stamp); anything else is reported."""
    files: dict[tuple[str, int], list[Path]] = {}
    strange = []
    for path in sorted(folder.glob("*")):
        match = _FILE_NAME.fullmatch(path.name)
        if match is None or match["suffix"] not in suffixes:
            strange.append(path.name)
        else:
            files.setdefault((match["drone"], int(match["stamp"])), []).append(path)
    if strange:
        warnings.append(
            f"{len(strange)} files in {folder.name}/ are not named <drone>_<stamp_ns>.{'|'.join(suffixes)}, "
            f"first: {strange[0]}"
        )
    return files


def _labels_of_no_frame(
    labels: dict[str, dict[tuple[str, int], list[Path]]], framed: set[tuple[str, int]]
) -> list[str]:
    """What is told of label files by folder, each by (drone, stamp), that none of the frames has."""
    said = []
    for folder, files in labels.items():
        names = {key: path.name for key, paths in files.items() for path in paths}
        unused = [name for key, name in names.items() if key not in framed]
        said.extend(labels_without_frame(folder, names.values(), unused))
    return said


@dataclass(frozen=True, slots=True)
class _LayerFiles:
    """The files of one layer by (drone, stamp)."""

    heatmaps: dict[tuple[str, int], list[Path]]
    labels: dict[tuple[str, int], list[Path]]

    def holds(self, key: tuple[str, int]) -> bool:
        return key in self.heatmaps or key in self.labels

    def pixels(self, key: tuple[str, int], camera: Camera) -> LayerPixels:
        found = _pixels(self.heatmaps.get(key, []), [], self.labels.get(key, []), camera)
        return LayerPixels(found.heatmap, found.regions)


def _layer_files(folder: Path, name: str, warnings: list[str]) -> _LayerFiles:
    return _LayerFiles(
        _files_by_frame(folder / "layers" / name, ("png", "npy"), warnings),
        _files_by_frame(folder / "truth" / "layers" / name, ("png",), warnings),
    )


def _ambiguous(files: Mapping[str, list[Path]]) -> str | None:
    """What there are several of for one frame, by their noun."""
    for what, paths in files.items():
        if len(paths) > 1:
            return f"{len(paths)} {what} for one frame: {', '.join(path.name for path in paths)}"
    return None


def _pixels(heatmaps: list[Path], images: list[Path], regions: list[Path], camera: Camera) -> PixelSources:
    size = (camera.width, camera.height)
    return PixelSources(
        image=images[0].read_bytes if images else None,
        heatmap=(lambda: read_only_heatmap(heatmaps, size)) if heatmaps else None,
        regions=(lambda: read_regions(regions[0], size)) if regions else None,
    )


def _terrain(folder: Path, description: dict[str, Any], warnings: list[str]) -> Path | None:
    if "terrain" not in description:
        return find_terrain(folder)
    terrain = folder / str(description["terrain"])
    if not terrain.is_file():
        warnings.append(f"the map that {DESCRIPTION_NAME} names, {description['terrain']}, is not there")
        return None
    return terrain
