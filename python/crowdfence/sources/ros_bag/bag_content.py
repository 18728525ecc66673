"""What one pass over the chosen topics of a bag meets: poses, places, intrinsics, where its pictures are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from crowdfence._core import Camera
from crowdfence.sources.mission.camera_info import camera_from_info, rectified_camera
from crowdfence.sources.mission.ros2_messages import time_ns
from crowdfence.sources.pose_track import PoseTrack, track_from_rows
from crowdfence.sources.ros_bag.bag_file import Bag, BagMessage, decode, header_of
from crowdfence.sources.ros_bag.told_place import told_place
from crowdfence.sources.ros_bag.topic_choice import (
    FIX,
    ODOMETRY,
    ORIGIN,
    POSE_WITH_COVARIANCE,
    TRANSFORM,
    DroneTopics,
    transform_topics,
)
from crowdfence.sources.ros_bag.transforms import TransformTree
from crowdfence.sources.ros_bag.two_clocks import Arrivals
from crowdfence.sources.rotation import UNSET_OF_ROS, are_unset

Intrinsics = Camera | str
"""A camera, or why there is none."""

_NO_ATTITUDE = -1.0
"""Instead of a variance (REP 145); the attitude beside it is what a message begins with, in ROS 2 level."""


@dataclass(slots=True)
class PoseRows:
    """Poses or attitudes of one topic in the order of recording."""

    stamps_ns: list[int] = field(default_factory=list)
    positions: list[list[float]] = field(default_factory=list)
    quaternions: list[list[float]] = field(default_factory=list)
    child_frame: str = ""

    def track(self) -> tuple[PoseTrack, list[str]]:
        track, remarks = track_from_rows(self.stamps_ns, self.positions, self.quaternions)
        if len(track) > 1 and are_unset(track.quaternions):
            remarks.append(
                f"all {len(track)} attitudes are {UNSET_OF_ROS}, such as camera_pose= or another imu= in "
                "--topics"
            )
        return track, remarks


@dataclass(frozen=True, slots=True)
class CameraInfos:
    """What one CameraInfo says of the pictures beside it."""

    raw: Intrinsics
    rectified: Intrinsics


class BagContent:
    """Everything but the pixels, which stay in the bag until they are asked for."""

    def __init__(self, bag: Bag, chosen: Sequence[DroneTopics]) -> None:
        self.bag = bag
        self.types = {name: topic.type for name, topic in bag.topics().items()}
        static = [name for name in self.types if name.endswith("/tf_static")]
        told_by = {one.drone: transform_topics(one, chosen, static) for one in chosen}
        self._trees = {topics: TransformTree() for topics in told_by.values()}
        self._tree_of = {drone: self._trees[topics] for drone, topics in told_by.items()}
        self.rows: dict[str, PoseRows] = {}
        self.fixes: dict[str, list[tuple[int, float, float, float]]] = {}
        """Stamp, latitude, longitude, ellipsoidal height by topic."""
        self.cameras: dict[str, dict[int, CameraInfos]] = {}
        self.pictures: dict[str, dict[int, BagMessage]] = {}
        """Messages without their data, by topic and stamp."""
        self.repeated: dict[str, list[int]] = {}
        self.arrivals: dict[str, Arrivals] = {}
        """Of pictures, poses and moving transforms by topic."""
        self.frames: dict[str, str] = {}
        """Frame that the messages of a topic name, the first where they name several."""
        self.other_frames: dict[str, dict[str, int]] = {}
        """How many messages of a topic name other frames than the first."""
        self.faulty: dict[str, list[str]] = {}
        self._known: dict[bytes, CameraInfos] = {}
        pixels = {name for one in chosen for name in (one.camera, one.heatmap) if name}
        wanted = {
            name
            for one in chosen
            for name in (one.info, one.camera_pose, one.pose, one.tf, one.fix, one.imu, one.origin)
            if name
        }
        wanted.update(name for topics in self._trees for name in topics)
        for message in bag.messages([*pixels, *wanted]):
            try:
                if message.topic in pixels:
                    self._take_picture(message)
                else:
                    self._take(message)
            except (ValueError, AttributeError) as error:
                self.faulty.setdefault(message.topic, []).append(str(error))

    def tree(self, drone: str) -> TransformTree:
        """The transforms that are told of a drone."""
        return self._tree_of[drone]

    @property
    def tree_warnings(self) -> list[str]:
        """What was met in the transforms of any drone, each once."""
        return list(dict.fromkeys(warning for tree in self._trees.values() for warning in tree.warnings))

    def _take_picture(self, message: BagMessage) -> None:
        header = header_of(message.data, ros1=self.bag.ros1)
        self._take_frame(message.topic, header.frame)
        self._take_arrival(message, header.stamp_ns)
        place = BagMessage(message.topic, message.log_ns, b"", message.place)
        taken = self.pictures.setdefault(message.topic, {})
        if taken.setdefault(header.stamp_ns, place) is not place:
            self.repeated.setdefault(message.topic, []).append(header.stamp_ns)

    def _take(self, message: BagMessage) -> None:
        kind = self.types[message.topic]
        if kind.endswith("CameraInfo"):
            self._take_info(message)
            return
        found = decode(message.data, kind, ros1=self.bag.ros1)
        if hasattr(found, "transforms"):
            trees = [tree for topics, tree in self._trees.items() if message.topic in topics]
            fixed = message.topic.endswith("_static")
            for tree in trees:
                for transform in found.transforms:
                    tree.add(transform, fixed=fixed)
            if found.transforms and not fixed:
                self._take_arrival(message, time_ns(found.transforms[0].header.stamp))
            return
        stamp_ns = time_ns(found.header.stamp)
        self._take_arrival(message, stamp_ns)
        self._take_frame(message.topic, found.header.frame_id.lstrip("/"))
        if kind in (FIX, ORIGIN):
            if (place := told_place(found)) is not None:
                self.fixes.setdefault(message.topic, []).append((stamp_ns, *place))
        else:
            self._take_pose(message.topic, kind, stamp_ns, found)

    def _take_frame(self, topic: str, frame: str) -> None:
        if self.frames.setdefault(topic, frame) != frame:
            others = self.other_frames.setdefault(topic, {})
            others[frame] = others.get(frame, 0) + 1

    def _take_arrival(self, message: BagMessage, stamp_ns: int) -> None:
        self.arrivals.setdefault(message.topic, Arrivals()).add(message.log_ns, stamp_ns)

    def _take_pose(self, topic: str, kind: str, stamp_ns: int, found: Any) -> None:
        rows = self.rows.setdefault(topic, PoseRows())
        rows.child_frame = getattr(found, "child_frame_id", "").lstrip("/") or rows.child_frame
        if kind.endswith("Imu"):
            if found.orientation_covariance[0] == _NO_ATTITUDE:
                raise ValueError("no attitude: its orientation_covariance begins with -1")
            position, turn = SimpleNamespace(x=0.0, y=0.0, z=0.0), found.orientation
        elif kind == TRANSFORM:
            position, turn = found.transform.translation, found.transform.rotation
        else:
            pose = found.pose.pose if kind in (ODOMETRY, POSE_WITH_COVARIANCE) else found.pose
            position, turn = pose.position, pose.orientation
        rows.stamps_ns.append(stamp_ns)
        rows.positions.append([position.x, position.y, position.z])
        rows.quaternions.append([turn.w, turn.x, turn.y, turn.z])

    def _take_info(self, message: BagMessage) -> None:
        header = header_of(message.data, ros1=self.bag.ros1)
        key = message.data[12:]
        if key not in self._known:
            self._known[key] = self._infos(message)
        self.cameras.setdefault(message.topic, {})[header.stamp_ns] = self._known[key]

    def _infos(self, message: BagMessage) -> CameraInfos:
        try:
            info = _as_ros2(decode(message.data, self.types[message.topic], ros1=self.bag.ros1))
        except ValueError as error:
            reason = _unusable(error)
            return CameraInfos(reason, reason)
        return CameraInfos(_camera(camera_from_info, info), _camera(rectified_camera, info))


def _camera(read: Callable[[Any], Camera], info: Any) -> Intrinsics:
    try:
        return read(info)
    except ValueError as error:
        return _unusable(error)


def _unusable(error: ValueError) -> str:
    return f"its camera_info cannot be used: {error}"


def _as_ros2(info: Any) -> Any:
    """A CameraInfo of ROS 1, whose matrices are in capitals, as one of ROS 2."""
    names = ("d", "k", "r", "p")
    matrices = {name: list(getattr(info, name, getattr(info, name.upper(), []))) for name in names}
    plain = ("width", "height", "distortion_model", "binning_x", "binning_y", "roi")
    return SimpleNamespace(**{name: getattr(info, name) for name in plain}, **matrices)
