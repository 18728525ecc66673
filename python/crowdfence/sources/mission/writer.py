"""Writes the native mission file frame by frame. `layout` describes it."""

import json
import os
from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence._core import Camera
from crowdfence.georeference import Georeference
from crowdfence.sources.layers import LayerGround, checked_layer
from crowdfence.sources.mission import ros2_messages
from crowdfence.sources.mission.attached_map import attach_map
from crowdfence.sources.mission.layout import (
    FORMAT_VERSION,
    MAP_FRAME,
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
    camera_frame,
    layer_ground_topic,
    message_type,
    topic,
    topic_prefix,
)
from crowdfence.sources.mission.messages import (
    FrameContent,
    LayerContent,
    encode_frame,
    encode_layer_ground,
    encode_people,
    pose_fields,
)
from crowdfence.sources.mission.topic_writer import TopicWriter
from crowdfence.sources.recorded_truth import CameraPose, RecordedPeople
from crowdfence.sources.recording import RefusedFrame
from crowdfence.sources.stamps import LAST_STAMP_NS


class MissionWriter(TopicWriter):
    """Writes a mission file; a context manager.

    After an error inside the `with` block the partial file is removed; after a power cut it stays, and
    `open_recording` reads what is in it.

    Poses and frames may come in any order between drones, but the stamps of one drone's poses, and of its
    frames, must increase: ValueError otherwise, and for stamps outside [0, LAST_STAMP_NS]. Of frames that are
    given an arrival, the arrivals must not go back.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        *,
        georeference: Georeference | None = None,
        terrain: str | PathLike[str] | None = None,
        source: str = "",
        depth_images: bool = False,
        map_inside: bool = False,
        terrain_options: Mapping[str, Any] | None = None,
    ) -> None:
        """`terrain` is a map file to suggest to readers, kept as a path relative to the mission file, or with
        `map_inside` in it (ValueError for one that is too large), and `terrain_options` how it is to be read;
        `depth_images`: depth as images that viewers draw, where PNG would be a third of the bytes."""
        inside = map_inside and terrain is not None
        description = _description(Path(path), georeference, None if inside else terrain, source)
        if terrain is not None and terrain_options:
            # Of what is no plain value, a reference system of pyproj, the name says the same.
            description["terrain_options"] = json.dumps(dict(terrain_options), default=str)
        super().__init__(path)
        self._depth_images = depth_images
        self._prefixes: dict[str, str] = {}
        self._cameras: dict[str, Camera] = {}
        self._last_stamp_ns: dict[tuple[str, str], int] = {}
        self.add_metadata(METADATA, description)
        if map_inside and terrain is not None:
            try:
                attach_map(self._mcap, Path(terrain))
            except BaseException:
                self.discard()
                raise

    def add_camera(self, drone: str, camera: Camera) -> None:
        """Intrinsics of the drone's frames from now on."""
        self._cameras[drone] = camera

    def add_pose(self, drone: str, stamp_ns: int, position: ArrayLike, quaternion: ArrayLike) -> None:
        """Pose of the drone's camera: `position` [3] in local ENU metres, `quaternion` [4] w x y z turning
        camera axes (OpenCV) into ENU. Written bit for bit; also goes out on /tf."""
        self._advance(drone, "pose", stamp_ns)
        header, pose = ros2_messages.header(stamp_ns, MAP_FRAME), pose_fields(position, quaternion)
        message = ros2_messages.encode(ros2_messages.POSE_STAMPED, {"header": header, "pose": pose})
        self._write(topic(self._prefix(drone), "pose"), ros2_messages.POSE_STAMPED, message, stamp_ns)
        transform = {
            "header": header,
            "child_frame_id": camera_frame(self._prefix(drone)),
            "transform": {"translation": pose["position"], "rotation": pose["orientation"]},
        }
        message = ros2_messages.encode(ros2_messages.TF_MESSAGE, {"transforms": [transform]})
        self._write("/tf", ros2_messages.TF_MESSAGE, message, stamp_ns)

    def add_frame(
        self,
        drone: str,
        stamp_ns: int,
        *,
        image: bytes | None = None,
        heatmap: NDArray[Any] | None = None,
        regions: NDArray[Any] | None = None,
        silhouettes: NDArray[np.bool_] | None = None,
        depth_m: NDArray[np.float32] | None = None,
        segmentation: NDArray[Any] | None = None,
        instances: NDArray[Any] | None = None,
        true_pose: CameraPose | None = None,
        exposure_ns: int | None = None,
        people: RecordedPeople | None = None,
        layers: Mapping[str, LayerContent] | None = None,
    ) -> None:
        """One image of a drone whose camera was added, and what is known about it: see `FrameContent`."""
        if drone not in self._cameras:
            raise ValueError(f"no camera of {drone!r} was added before its frame at {stamp_ns}")
        content = FrameContent(
            image,
            heatmap,
            regions,
            silhouettes,
            depth_m,
            segmentation,
            instances,
            true_pose,
            exposure_ns,
            people,
            {checked_layer(name): layer for name, layer in (layers or {}).items()},
        )
        # Nothing may be written of a frame that cannot be, not even its drone.
        frame = self._next_camera_frame(drone)
        parts = encode_frame(content, self._cameras[drone], stamp_ns, frame, depth_images=self._depth_images)
        self.add_encoded_frame(drone, stamp_ns, parts)

    def add_encoded_frame(
        self, drone: str, stamp_ns: int, parts: Mapping[FramePart, bytes], *, arrival_ns: int | None = None
    ) -> None:
        """One image whose messages were made by `encode_frame` with its drone's `camera_frame`.

        `arrival_ns` is when it arrived, if that is not its stamp: a late frame stands behind younger ones.
        """
        if arrival_ns is None:
            self._advance(drone, "frame", stamp_ns)
        else:
            self._advance(drone, "arrival", arrival_ns, at_once=True)
        log_time_ns = stamp_ns if arrival_ns is None else arrival_ns
        prefix = self._prefix(drone)
        for part, message in parts.items():
            self._write(topic(prefix, part), message_type(part), message, log_time_ns, stamp_ns)

    def add_people(self, people: RecordedPeople) -> None:
        """Everybody in the world at an instant of the world's clock; instants must increase."""
        self._advance("", "people", people.stamp_ns)
        message = encode_people(people, people.stamp_ns)
        self._write(PEOPLE_TOPIC, ros2_messages.POINT_CLOUD2, message, people.stamp_ns)

    def add_layer_ground(self, layer: str, ground: LayerGround, stamp_ns: int) -> None:
        """Where in the world the class of a further layer is, for the whole mission; `stamp_ns` is when that
        was known. ValueError for a layer without a proper name."""
        topic_of_layer = layer_ground_topic(checked_layer(layer))
        self.add_metadata(METADATA_LAYER, {"layer": layer, "people_m": repr(float(ground.people_m))})
        message = encode_layer_ground(ground, stamp_ns)
        self._write(topic_of_layer, ros2_messages.OCCUPANCY_GRID, message, stamp_ns, latched=True)

    def add_simulation(self, manifest: Mapping[str, Any]) -> None:
        """What a simulation was made from, ready for JSON; goes before its first message."""
        self.add_metadata(METADATA_SIMULATION, {"manifest": json.dumps(manifest)})

    def add_statistics(self, statistics: Mapping[str, Any]) -> None:
        """What came out of a simulation, ready for JSON; goes behind its last message."""
        self.add_metadata(METADATA_STATISTICS, {"statistics": json.dumps(statistics)})

    def add_alignment(self, offsets: Mapping[str, Any]) -> None:
        """By what the poses of each drone were put right before they were written, ready for JSON."""
        self.add_metadata(METADATA_ALIGNMENT, {"offsets": json.dumps(offsets)})

    def add_detector(self, contract: Mapping[str, Any]) -> None:
        """What the model that made the heatmaps states about itself, ready for JSON."""
        self.add_metadata(METADATA_DETECTOR, {"contract": json.dumps(contract)})

    def add_pose_noise(self, noise: Mapping[str, Any]) -> None:
        """By what the poses of each drone were smoothed before they were written, ready for JSON."""
        self.add_metadata(METADATA_POSE_NOISE, {"noise": json.dumps(noise)})

    def add_refused(self, refused: Iterable[RefusedFrame]) -> None:
        """Frames that the source of this mission had but could not pass on; readers report them again."""
        rows = [
            {"drone": frame.drone, "stamp_ns": frame.stamp_ns, "reason": frame.reason} for frame in refused
        ]
        if rows:
            self.add_metadata(METADATA_REFUSED, {"frames": json.dumps(rows)})

    def add_warnings(self, warnings: Iterable[str]) -> None:
        """What was doubtful about the source of this mission, one sentence each; readers tell it again."""
        sentences = [one.removeprefix(OF_THE_SOURCE) for one in warnings]
        if sentences:
            self.add_metadata(METADATA_WARNINGS, {"warnings": json.dumps(sentences)})

    def add_drone(self, drone: str, *, pose_gap_s: float | None = None) -> None:
        """Announce a drone of the fleet. Its first pose or frame does the same, without `pose_gap_s`: how far
        apart the poses are that its frames lie between, where that is more than readers bridge by default."""
        self._prefix(drone, pose_gap_s)

    def _advance(self, drone: str, what: str, stamp_ns: int, *, at_once: bool = False) -> None:
        if not 0 <= stamp_ns <= LAST_STAMP_NS:
            raise ValueError(f"{what} of {drone!r}: stamp {stamp_ns} is outside [0, {LAST_STAMP_NS}] ns")
        last_ns = self._last_stamp_ns.get((drone, what), -1)
        if stamp_ns < last_ns or (stamp_ns == last_ns and not at_once):
            raise ValueError(
                f"{what} of {drone!r}: stamp {stamp_ns} does not come after the last one, {last_ns}"
            )
        self._last_stamp_ns[drone, what] = stamp_ns

    def _prefix(self, drone: str, pose_gap_s: float | None = None) -> str:
        if drone not in self._prefixes:
            prefix = topic_prefix(drone, set(self._prefixes.values()))
            self._prefixes[drone] = prefix
            gap = {} if pose_gap_s is None else {"pose_gap_s": repr(float(pose_gap_s))}
            self.add_metadata(METADATA_DRONE, {"drone": drone, "topic_prefix": prefix, **gap})
        return self._prefixes[drone]

    def _next_camera_frame(self, drone: str) -> str:
        prefix = self._prefixes.get(drone) or topic_prefix(drone, set(self._prefixes.values()))
        return camera_frame(prefix)


def _description(
    path: Path, georeference: Georeference | None, terrain: str | PathLike[str] | None, source: str
) -> dict[str, str]:
    description = {"format": "crowdfence mission", "version": str(FORMAT_VERSION), "source": source}
    if georeference is not None:
        # repr keeps every bit of a float64; 1e-15 degrees are 0.1 nm, but equal runs should be equal.
        description["latitude_deg"] = repr(float(georeference.latitude_deg))
        description["longitude_deg"] = repr(float(georeference.longitude_deg))
        description["height_m"] = repr(float(georeference.height_m))
    if terrain is not None:
        relative = os.path.relpath(Path(terrain).resolve(), path.parent.resolve())
        description["terrain"] = relative.replace(os.sep, "/")
    return description
