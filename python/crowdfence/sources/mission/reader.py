"""Reads the native mission file, and any MCAP with the same topics. `layout` describes it.

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
from crowdfence.errors import quoted
from crowdfence.georeference import Georeference
from crowdfence.sources.interrupted_simulation import interrupted_line
from crowdfence.sources.layers import LayerGround, LayerPixels
from crowdfence.sources.mission import ros2_messages
from crowdfence.sources.mission.attached_map import attached_map
from crowdfence.sources.mission.camera_info import camera_from_info
from crowdfence.sources.mission.layout import (
    CROWD_CLASS,
    FORMAT_VERSION,
    METADATA,
    METADATA_ALIGNMENT,
    METADATA_DETECTOR,
    METADATA_DRONE,
    METADATA_LAYER,
    METADATA_POSE_NOISE,
    METADATA_REFUSED,
    METADATA_SIMULATION,
    METADATA_STATISTICS,
    METADATA_WARNINGS,
    OF_THE_SOURCE,
    PEOPLE_TOPIC,
    FramePart,
    LayerPart,
    layer_of_ground_topic,
    message_type,
    split_topic,
)
from crowdfence.sources.mission.mcap_records import McapFile, MessageLocation, StoredMessage
from crowdfence.sources.mission.messages import (
    decode_exposure_ns,
    decode_layer_ground,
    decode_people,
    decode_picture,
    decode_pose,
    decode_raster,
)
from crowdfence.sources.pictures.decoding import decode_depth_cm
from crowdfence.sources.place_camera import Limits, UnplacedFrame, place_cameras
from crowdfence.sources.pose_track import PoseTrack, track_from_rows
from crowdfence.sources.recorded_truth import FrameTruth, PeopleLog
from crowdfence.sources.recording import PixelSources, Recording, RefusedFrame
from crowdfence.sources.ros_bag.transforms import is_ned


class NoMissionError(ValueError):
    """An MCAP file without any of our topics, or whose poses are not in a world of ours."""


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
    parts: dict[int, dict[FramePart, MessageLocation]] = field(default_factory=dict)
    """Places of the pixels by stamp."""
    repeated: list[int] = field(default_factory=list)


class _Content:
    """Gathers what one pass over the file meets."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.description: dict[str, str] | None = None
        self.names: dict[str, str] = {}
        self.drones: dict[str, _DroneContent] = {}
        self.pose_gaps_s: dict[str, float] = {}
        """By topic prefix, where frames lie between poses further apart than usual."""
        self.refused: list[RefusedFrame] = []
        self.warnings: list[str] = []
        self.told: dict[str, Any] = {}
        """What the mission says about itself, by "simulation", "statistics", "alignment", "detector"
        and "pose_noise"."""
        self.people: dict[int, MessageLocation] = {}
        """Everybody in the world, by stamp."""
        self.layer_people_m: dict[str, float] = {}
        self.layer_grounds: dict[str, bytes] = {}
        """Where in the world further classes are, as encoded, by layer."""
        self.pose_frames: dict[str, None] = {}
        """Frames that poses count from."""
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
            self._take_pose_gap(prefix, record.metadata.get("pose_gap_s"))
        elif record.name == METADATA_LAYER:
            self._take_layer(record.metadata)
        elif record.name == METADATA_REFUSED:
            self._take_refused(record.metadata.get("frames", ""))
        elif record.name == METADATA_WARNINGS:
            self._take_warnings(record.metadata.get("warnings", ""))
        elif record.name == METADATA_SIMULATION:
            self._take_told("simulation", record.metadata.get("manifest", ""))
        elif record.name == METADATA_STATISTICS:
            self._take_told("statistics", record.metadata.get("statistics", ""))
        elif record.name == METADATA_ALIGNMENT:
            self._take_told("alignment", record.metadata.get("offsets", ""))
        elif record.name == METADATA_DETECTOR:
            self._take_told("detector", record.metadata.get("contract", ""))
        elif record.name == METADATA_POSE_NOISE:
            self._take_told("pose_noise", record.metadata.get("noise", ""))

    def take_message(self, message: StoredMessage) -> None:
        if message.topic == PEOPLE_TOPIC:
            self._take_people(message)
            return
        if (layer := layer_of_ground_topic(message.topic)) is not None:
            self._take_layer_ground(layer, message)
            return
        place = split_topic(message.topic)
        if place is None:
            return
        prefix, part = place
        expected = message_type(part)
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

    def _take_part(self, drone: _DroneContent, part: FramePart, message: StoredMessage) -> None:
        data = bytes(message.data) if part in ("pose", "camera_info") else bytes(message.data[:12])
        stamp_ns = ros2_messages.header_stamp_ns(data)
        if part == "pose":
            told = ros2_messages.decode(ros2_messages.POSE_STAMPED, data)
            pose = told.pose
            self.pose_frames.setdefault(told.header.frame_id)
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

    def _take_pose_gap(self, prefix: str, text: str | None) -> None:
        if text is None:
            return
        try:
            self.pose_gaps_s[prefix] = Limits(float(text)).max_pose_gap_s
        except ValueError as error:
            self.warnings.append(f"what the file says about the poses of {prefix[1:]} is damaged: {error}")

    def _take_refused(self, text: str) -> None:
        try:
            for row in json.loads(text):
                stamp_ns = None if row["stamp_ns"] is None else int(row["stamp_ns"])
                self.refused.append(RefusedFrame(str(row["drone"]), stamp_ns, str(row["reason"])))
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            self.warnings.append(f"the list of refused frames in the file is damaged: {error!r}")

    def _take_warnings(self, text: str) -> None:
        try:
            self.warnings.extend(f"{OF_THE_SOURCE}{one}" for one in json.loads(text))
        except (ValueError, TypeError, RecursionError) as error:
            self.warnings.append(f"the list of warnings in the file is damaged: {error!r}")

    def _take_told(self, what: str, text: str) -> None:
        try:
            self.told[what] = json.loads(text)
        except (ValueError, RecursionError) as error:
            self.warnings.append(f"the {what} record in the file is damaged: {error!r}")

    def _take_people(self, message: StoredMessage) -> None:
        if message.schema_name != ros2_messages.POINT_CLOUD2:
            self._ignore_topic(message, ros2_messages.POINT_CLOUD2)
            return
        try:
            stamp_ns = ros2_messages.header_stamp_ns(bytes(message.data[:12]))
        except ValueError as error:
            self.warnings.append(f"people at log time {message.log_time_ns} are left out: {error}")
            return
        self.people.setdefault(stamp_ns, message.location)

    def _take_layer(self, values: dict[str, str]) -> None:
        try:
            self.layer_people_m[values["layer"]] = float(values["people_m"])
        except (KeyError, ValueError) as error:
            self.warnings.append(f"what the file says about a layer is damaged: {error!r}")

    def _take_layer_ground(self, layer: str, message: StoredMessage) -> None:
        if message.schema_name != ros2_messages.OCCUPANCY_GRID:
            self._ignore_topic(message, ros2_messages.OCCUPANCY_GRID)
            return
        self.layer_grounds[layer] = bytes(message.data)

    def _ignore_topic(self, message: StoredMessage, expected: str) -> None:
        if message.topic not in self._ignored_topics:
            self._ignored_topics.add(message.topic)
            self.warnings.append(
                f"{message.topic} holds {message.schema_name or 'no schema'}, expected {expected}: not read"
            )


def _recording(mcap: McapFile, content: _Content, limits: Limits) -> Recording:
    warnings = [f"damaged file: {sentence}" for sentence in mcap.damage] + content.warnings
    if not mcap.messages and mcap.damage:
        raise ValueError(f"{mcap.path} is damaged: {mcap.damage[0]}. Copy it again, or record it again")
    if not content.drones:
        lost = "".join(f"\n  {sentence}" for sentence in warnings)
        raise NoMissionError(
            f"{mcap.path} holds no mission: no topic like /<drone>/heatmap or /<drone>/camera/pose{lost}"
        )
    if content.description is None and (turned := [frame for frame in content.pose_frames if is_ned(frame)]):
        raise NoMissionError(f"{mcap.path} is a bag of others: its poses count from {turned[0]}")
    if content.description is None:
        warnings.append(
            "the file has no crowdfence metadata: georeference unknown, drones named after their topics"
        )
    if (interrupted := interrupted_line(content.told.get("statistics"))) is not None:
        warnings.append(interrupted)
    grounds = _layer_grounds(content, warnings)
    names = {prefix: content.names.get(prefix, prefix[1:]) for prefix in content.drones}
    tracks: dict[str, PoseTrack] = {}
    unplaced: dict[str, list[UnplacedFrame]] = {}
    for prefix, found in content.drones.items():
        drone = names[prefix]
        tracks[drone], remarks = track_from_rows(found.pose_stamps_ns, found.positions, found.quaternions)
        warnings.extend(f"{drone}: {remark}" for remark in remarks)
        unplaced[drone] = _unplaced_frames(mcap, found)
    gaps_s = {names[prefix]: gap_s for prefix, gap_s in content.pose_gaps_s.items() if prefix in names}
    frames, refused = place_cameras(unplaced, tracks, limits, gaps_s)
    description = content.description or {}
    return Recording(
        name=mcap.path.stem,
        drones=tuple(sorted(names.values())),
        frames=frames,
        georeference=_georeference(description, warnings),
        terrain=_terrain(mcap.path, description, warnings),
        refused=(*content.refused, *refused),
        warnings=tuple(warnings),
        manifest={"kind": "mission", "path": str(mcap.path), **description, **content.told},
        pose_tracks=tracks,
        people=_people_log(mcap, content.people),
        layer_grounds=grounds,
        terrain_options=_terrain_options(description, warnings),
    )


def _unplaced_frames(mcap: McapFile, found: _DroneContent) -> list[UnplacedFrame]:
    # A bag of other tools may send the intrinsics once: they then hold for all frames.
    only = next(iter(found.cameras.values())) if len(set(map(id, found.cameras.values()))) == 1 else None
    unplaced = []
    for stamp_ns, parts in found.parts.items():
        camera = found.cameras.get(stamp_ns, only)
        fault = camera if isinstance(camera, str) else None
        usable = None if isinstance(camera, str) else camera
        unplaced.append(
            UnplacedFrame(stamp_ns, usable, _pixel_sources(mcap, parts), fault, _truth(mcap, parts))
        )
    # A stamp that was sent twice is refused once; its first message stands.
    unplaced.extend(
        UnplacedFrame(stamp_ns, None, fault=f"stamp {stamp_ns} repeats an earlier frame of this drone")
        for stamp_ns in dict.fromkeys(found.repeated)
    )
    return unplaced


def _pixel_sources(mcap: McapFile, parts: dict[FramePart, MessageLocation]) -> PixelSources:
    def raster(part: FramePart) -> Callable[[], NDArray[Any]] | None:
        location = parts.get(part)
        return None if location is None else lambda: decode_raster(mcap.payload(location))

    image, depth_cm = parts.get("image"), parts.get("depth_cm")
    segmentation = raster("segmentation")
    in_cm = None if depth_cm is None else lambda: decode_depth_cm(decode_picture(mcap.payload(depth_cm)))
    return PixelSources(
        image=None if image is None else lambda: decode_picture(mcap.payload(image)),
        heatmap=raster("heatmap"),
        regions=raster("regions"),
        silhouettes=_silhouettes(raster("silhouettes"), segmentation),
        depth_m=raster("depth") or in_cm,
        segmentation=segmentation,
        instances=raster("instances"),
        layers={
            name: LayerPixels(raster(LayerPart(name, "heatmap")), raster(LayerPart(name, "labels")))
            for name in dict.fromkeys(part.layer for part in parts if isinstance(part, LayerPart))
        },
    )


def _silhouettes(
    recorded: Callable[[], NDArray[Any]] | None, segmentation: Callable[[], NDArray[Any]] | None
) -> Callable[[], NDArray[np.bool_]] | None:
    if recorded is not None:
        return lambda: recorded() > 0
    return None if segmentation is None else lambda: segmentation() == CROWD_CLASS


def _truth(mcap: McapFile, parts: dict[FramePart, MessageLocation]) -> FrameTruth:
    pose, exposure, people = parts.get("true_pose"), parts.get("exposure"), parts.get("people")
    return FrameTruth(
        pose=None if pose is None else lambda: decode_pose(mcap.payload(pose)),
        exposure_ns=None if exposure is None else lambda: decode_exposure_ns(mcap.payload(exposure)),
        people=None if people is None else lambda: decode_people(mcap.payload(people)),
    )


def _people_log(mcap: McapFile, found: dict[int, MessageLocation]) -> PeopleLog:
    return PeopleLog(tuple(sorted(found)), lambda stamp_ns: decode_people(mcap.payload(found[stamp_ns])))


def _layer_grounds(content: _Content, warnings: list[str]) -> dict[str, LayerGround]:
    grounds = {}
    for layer, data in content.layer_grounds.items():
        try:
            grounds[layer] = decode_layer_ground(data, content.layer_people_m.get(layer, 0.0))
        except ValueError as error:
            warnings.append(f"where the layer {layer} is in the world cannot be read: {error}")
    return grounds


def _georeference(description: dict[str, str], warnings: list[str]) -> Georeference | None:
    keys = ("latitude_deg", "longitude_deg", "height_m")
    if not all(key in description for key in keys):
        return None
    try:
        return Georeference(*(float(description[key]) for key in keys))
    except ValueError as error:
        warnings.append(f"the georeference in the file cannot be used: {error}")
        return None


def _terrain_options(description: dict[str, str], warnings: list[str]) -> dict[str, Any]:
    try:
        options = json.loads(description.get("terrain_options", "{}"))
        if not isinstance(options, dict):
            raise ValueError(f"it must be an object, got {quoted(options)}")
    except (ValueError, RecursionError) as error:
        warnings.append(f"how the map of the file is to be read is damaged: {error}")
        return {}
    return options


def _terrain(path: Path, description: dict[str, str], warnings: list[str]) -> Path | None:
    try:
        if (inside := attached_map(path)) is not None:
            return inside
    except (ValueError, OSError) as error:
        warnings.append(f"{error}; give a map with --terrain")
    if "terrain" not in description:
        return None
    terrain = Path(os.path.normpath(path.parent.resolve() / description["terrain"]))
    if not terrain.is_file():
        warnings.append(f"the map that the file names, {description['terrain']}, is not there")
        return None
    return terrain
