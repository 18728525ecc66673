"""Reads the native mission file, and any MCAP with the same topics. `mission_layout` describes it.

The file is passed over once: poses and intrinsics are decoded, of everything else only the stamp and the
place in the file are kept. Pixels are fetched from their chunk when asked for, so memory does not grow with
the length of the flight. A damaged file is read as far as it is intact, and the recording's warnings say what
is missing.
"""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Metadata
from numpy.typing import NDArray

from crowdfence._core import Camera
from crowdfence.georeference import Georeference
from crowdfence.sources import ros2_messages
from crowdfence.sources.admission import Capture, Limits, admit
from crowdfence.sources.camera_info import camera_from_info
from crowdfence.sources.mcap_records import McapFile, MessageLocation, StoredMessage
from crowdfence.sources.mission_layout import (
    FORMAT_VERSION,
    METADATA,
    METADATA_DRONE,
    METADATA_REFUSED,
    TOPICS,
    Part,
    split_topic,
)
from crowdfence.sources.pose_track import PoseTrack, track_from_rows
from crowdfence.sources.recording import PixelSources, Recording, RefusedFrame


def read_mission(path: Path, limits: Limits) -> Recording:
    """Open a mission file.

    ValueError when it is not MCAP, was written by a newer version, or holds none of our topics.
    """
    mcap = McapFile(path)
    content = _Content(path)
    for record in mcap.scan():
        if isinstance(record, Metadata):
            content.take_metadata(record)
        else:
            content.take_message(record)
    return _recording(mcap, content, limits)


@dataclass(slots=True)
class _DroneContent:
    """What the pass found of one drone, in the order of recording."""

    pose_stamps_ns: list[int] = field(default_factory=list)
    positions: list[list[float]] = field(default_factory=list)
    quaternions: list[list[float]] = field(default_factory=list)
    cameras: dict[int, Camera | str] = field(default_factory=dict)
    """Camera, or what is wrong with it, by stamp."""
    parts: dict[int, dict[Part, MessageLocation]] = field(default_factory=dict)
    """Places of the pixels by stamp."""
    repeated: list[int] = field(default_factory=list)


class _Content:
    """Gathers what one pass over the file meets."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.description: dict[str, str] | None = None
        self.names: dict[str, str] = {}
        self.drones: dict[str, _DroneContent] = {}
        self.refused: list[RefusedFrame] = []
        self.warnings: list[str] = []
        self._cameras: dict[bytes, Camera | str] = {}
        self._ignored_topics: set[str] = set()

    def take_metadata(self, record: Metadata) -> None:
        if record.name == METADATA:
            version = record.metadata.get("version", "")
            if version != str(FORMAT_VERSION):
                raise ValueError(
                    f"{self.path} is a mission file of version {version!r}, expected {FORMAT_VERSION}"
                )
            self.description = record.metadata
        elif record.name == METADATA_DRONE and {"drone", "topic_prefix"} <= set(record.metadata):
            prefix = record.metadata["topic_prefix"]
            self.names[prefix] = record.metadata["drone"]
            self.drones.setdefault(prefix, _DroneContent())
        elif record.name == METADATA_REFUSED:
            self._take_refused(record.metadata.get("frames", ""))

    def take_message(self, message: StoredMessage) -> None:
        place = split_topic(message.topic)
        if place is None:
            return
        prefix, part = place
        expected = TOPICS[part][1]
        if message.schema_name != expected:
            self._ignore_topic(message, expected)
            return
        drone = self.drones.setdefault(prefix, _DroneContent())
        try:
            self._take_part(drone, part, message)
        except ValueError as error:
            self.warnings.append(
                f"a message on {message.topic} at log time {message.log_time_ns} is left out: {error}"
            )

    def _take_part(self, drone: _DroneContent, part: Part, message: StoredMessage) -> None:
        data = bytes(message.data) if part in ("pose", "camera_info") else bytes(message.data[:12])
        stamp_ns = ros2_messages.header_stamp_ns(data)
        if part == "pose":
            pose = ros2_messages.decode(ros2_messages.POSE_STAMPED, data).pose
            drone.pose_stamps_ns.append(stamp_ns)
            drone.positions.append([pose.position.x, pose.position.y, pose.position.z])
            turn = pose.orientation
            drone.quaternions.append([turn.w, turn.x, turn.y, turn.z])
        elif part == "camera_info":
            drone.cameras[stamp_ns] = self._camera(data)
        elif part in drone.parts.get(stamp_ns, {}):
            drone.repeated.append(stamp_ns)
        else:
            drone.parts.setdefault(stamp_ns, {})[part] = message.location

    def _camera(self, data: bytes) -> Camera | str:
        # Equal intrinsics are one camera: a flight repeats the same message, only its stamp differs.
        key = data[:4] + data[12:]
        if key not in self._cameras:
            try:
                self._cameras[key] = camera_from_info(ros2_messages.decode(ros2_messages.CAMERA_INFO, data))
            except ValueError as error:
                self._cameras[key] = f"its camera_info cannot be used: {error}"
        return self._cameras[key]

    def _take_refused(self, text: str) -> None:
        try:
            for row in json.loads(text):
                stamp_ns = None if row["stamp_ns"] is None else int(row["stamp_ns"])
                self.refused.append(RefusedFrame(str(row["drone"]), stamp_ns, str(row["reason"])))
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            self.warnings.append(f"the list of refused frames in the file is damaged: {error!r}")

    def _ignore_topic(self, message: StoredMessage, expected: str) -> None:
        if message.topic not in self._ignored_topics:
            self._ignored_topics.add(message.topic)
            self.warnings.append(
                f"{message.topic} holds {message.schema_name or 'no schema'}, expected {expected}: not read"
            )


def _recording(mcap: McapFile, content: _Content, limits: Limits) -> Recording:
    warnings = [f"damaged file: {sentence}" for sentence in mcap.damage] + content.warnings
    if not content.drones:
        lost = "".join(f"\n  {sentence}" for sentence in warnings)
        raise ValueError(
            f"{mcap.path} holds no mission: no topic like /<drone>/heatmap or /<drone>/camera/pose{lost}"
        )
    if content.description is None:
        warnings.append(
            "the file has no crowdfence metadata: georeference unknown, drones named after their topics"
        )
    names = {prefix: content.names.get(prefix, prefix[1:]) for prefix in content.drones}
    tracks: dict[str, PoseTrack] = {}
    captures: dict[str, list[Capture]] = {}
    for prefix, found in content.drones.items():
        drone = names[prefix]
        tracks[drone], remarks = track_from_rows(found.pose_stamps_ns, found.positions, found.quaternions)
        warnings.extend(f"{drone}: {remark}" for remark in remarks)
        captures[drone] = _captures(mcap, found)
    frames, refused = admit(captures, tracks, limits)
    description = content.description or {}
    return Recording(
        name=mcap.path.stem,
        drones=tuple(sorted(names.values())),
        frames=frames,
        georeference=_georeference(description, warnings),
        terrain=_terrain(mcap.path, description, warnings),
        refused=content.refused + refused,
        warnings=tuple(warnings),
        manifest={"kind": "mission", "path": str(mcap.path), **description},
        pose_tracks=tracks,
    )


def _captures(mcap: McapFile, found: _DroneContent) -> list[Capture]:
    # A bag of other tools may send the intrinsics once: they then hold for all frames.
    only = next(iter(found.cameras.values())) if len(set(map(id, found.cameras.values()))) == 1 else None
    captures = []
    for stamp_ns, parts in found.parts.items():
        camera = found.cameras.get(stamp_ns, only)
        fault = camera if isinstance(camera, str) else None
        usable = None if isinstance(camera, str) else camera
        captures.append(Capture(stamp_ns, usable, _pixel_sources(mcap, parts), fault))
    # A stamp that was sent twice is refused once; its first message stands.
    captures.extend(
        Capture(stamp_ns, None, fault=f"stamp {stamp_ns} repeats an earlier frame of this drone")
        for stamp_ns in dict.fromkeys(found.repeated)
    )
    return captures


def _pixel_sources(mcap: McapFile, parts: dict[Part, MessageLocation]) -> PixelSources:
    def raster(part: Part) -> Callable[[], NDArray[Any]] | None:
        location = parts.get(part)
        return None if location is None else lambda: _decode_raster(mcap.payload(location))

    def picture(location: MessageLocation) -> bytes:
        return bytes(ros2_messages.decode(ros2_messages.COMPRESSED_IMAGE, mcap.payload(location)).data)

    image, silhouettes = parts.get("image"), raster("silhouettes")
    return PixelSources(
        image=None if image is None else lambda: picture(image),
        heatmap=raster("heatmap"),
        regions=raster("regions"),
        silhouettes=None if silhouettes is None else lambda: silhouettes() > 0,
        depth_m=raster("depth"),
    )


_DTYPES = {"mono8": "u1", "8UC1": "u1", "mono16": "u2", "16UC1": "u2", "32FC1": "f4"}


def _decode_raster(data: bytes) -> NDArray[Any]:
    """sensor_msgs/Image with one channel -> [h, w]."""
    message = ros2_messages.decode(ros2_messages.IMAGE, data)
    if message.encoding not in _DTYPES:
        raise ValueError(f"image encoding {message.encoding!r} is not supported ({', '.join(_DTYPES)})")
    dtype = np.dtype(_DTYPES[message.encoding]).newbyteorder(">" if message.is_bigendian else "<")
    rows, columns, step = message.height, message.width, message.step
    if step < columns * dtype.itemsize or len(message.data) < rows * step:
        raise ValueError(
            f"{columns}x{rows} {message.encoding} with {step} bytes a row needs more than its "
            f"{len(message.data)} bytes of data"
        )
    bytes_2d = np.frombuffer(message.data, dtype=np.uint8, count=rows * step).reshape(rows, step)
    pixels = np.ascontiguousarray(bytes_2d[:, : columns * dtype.itemsize]).view(dtype)
    return pixels.astype(dtype.newbyteorder("="))


def _georeference(description: dict[str, str], warnings: list[str]) -> Georeference | None:
    keys = ("latitude_deg", "longitude_deg", "height_m")
    if not all(key in description for key in keys):
        return None
    try:
        return Georeference(*(float(description[key]) for key in keys))
    except ValueError as error:
        warnings.append(f"the georeference in the file cannot be used: {error}")
        return None


def _terrain(path: Path, description: dict[str, str], warnings: list[str]) -> Path | None:
    if "terrain" not in description:
        return None
    terrain = Path(os.path.normpath(path.parent.resolve() / description["terrain"]))
    if not terrain.is_file():
        warnings.append(f"the map that the file names, {description['terrain']}, is not there")
        return None
    return terrain
