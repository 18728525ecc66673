"""Poses of a camera from what a fleet of ROS publishes: PoseStamped, Odometry, tf.

Worlds are the mission's local east-north-up frame (`map`), bodies forward-left-up, cameras as in REP 104. A
frame that is named for north-east-down is turned, and bodies in it are forward-right-down, as in bags.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterable, Sequence
from threading import Condition
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from crowdfence.service.ros.own_origin import OwnOrigin
from crowdfence.sources.axes import body_quaternions_ned, optical_quaternions_enu
from crowdfence.sources.camera_mount import CameraMount
from crowdfence.sources.mission.ros2_messages import time_ns
from crowdfence.sources.place_camera import bridged_s
from crowdfence.sources.pose_noise import GivenNoise, steadied_as
from crowdfence.sources.pose_track import PoseTrack, track_from_rows
from crowdfence.sources.ros_bag.optical_frame import frame_doubt, optical_frame
from crowdfence.sources.ros_bag.own_frame import whose_frame
from crowdfence.sources.ros_bag.transforms import (
    BODY_FRAME,
    NED_WORLD,
    Segment,
    TransformTree,
    as_forward_left_up,
    composed,
    is_ned,
    is_ned_pose,
    told_alike,
)
from crowdfence.sources.rotation import UNSET_OF_ROS, are_unset
from crowdfence.sources.told_by_two import told_by_two

_LOG = logging.getLogger(__name__)
PoseRole = Literal["camera_pose", "pose", "tf"]
POSE_ROLES: tuple[PoseRole, ...] = get_args(PoseRole)
"""Of several that are named the first counts."""

_KEPT_NS = 70_000_000_000
"""As long as a view may be late, and a little more."""
_AROUND_NS = 2_500_000_000
_OVERTAKEN_NS = 1_000_000_000
"""Messages of one topic overtake each other by less."""


class RosPoses:
    """A pose feed (`service.poses.PoseFeed`)."""

    remedy = (
        "see that its pose topic, or every tf from the map to the frame of its pictures, is published at "
        "least once a second under the names in --topics, with the stamps of the same clock as its pictures"
    )

    def __init__(
        self,
        role: PoseRole,
        mount: CameraMount | None,
        *,
        noise: GivenNoise | None = None,
        max_gap_s: float = 1.0,
        topic: str = "",
        origin: OwnOrigin | None = None,
    ) -> None:
        """`role` says whose the poses are: the camera's, or the body's, with the camera on it by the mount or
        by tf; or that tf says it all. `noise`: what each row is off by itself. `topic`: where they are
        told. `origin`: where on Earth they count from; None: from where the mission does."""
        self._role, self._mount, self._noise, self._max_gap_s = role, mount, noise, max_gap_s
        self._topic, self._origin = topic, origin
        self._confused: str | None = None
        """Why poses of two origins may be mixed."""
        self._unset = False
        """Whether nobody had set the attitudes that the last view was given."""
        self._rows: deque[tuple[int, list[float], list[float]]] = deque()
        self._moving: dict[str, deque[Any]] = {}
        self._parents: dict[str, dict[str, tuple[int, int]]] = {}
        """What a frame that moves hung on, by name: from the first to the last stamp."""
        self._fixed: dict[str, Any] = {}
        self._fixed_anew: set[str] = set()
        """Frames that were told to be fixed in other ways than before."""
        self.camera_frame = ""
        """The optical frame, as the pictures name it."""
        self._body_frame = BODY_FRAME
        self._frame: str | None = None
        self._in_ned = False
        """Whether `_rows` are north-east-down, with bodies forward-right-down."""
        self._told_ned: set[str] = set()
        self._told_of_frames: set[str] = set()
        self.changed = Condition()

    def posed(self, message: Any) -> None:
        """A decoded PoseStamped, PoseWithCovarianceStamped or Odometry."""
        pose = getattr(message.pose, "pose", message.pose)
        at, turn = pose.position, pose.orientation
        stamp_ns = time_ns(message.header.stamp)
        frame = message.header.frame_id.lstrip("/")
        child = getattr(message, "child_frame_id", "").lstrip("/")
        with self.changed:
            self._body_frame = child or self._body_frame
            in_ned = is_ned_pose(frame, child)
            if (frame, in_ned) != (self._frame, self._in_ned):  # somebody else publishes now: no row fits
                self._rows.clear()
            if self._frame is not None and frame != self._frame:
                frames = " and ".join(sorted((frame or "(none)", self._frame or "(none)")))
                self._confused = (
                    f"its poses come in the frames {frames}: all are taken to count from --origin, so what "
                    "it sees may lie elsewhere; see that one node publishes on its pose topic, in one "
                    "frame, or acknowledge this where both are the same"
                )
            self._frame, self._in_ned = frame, in_ned
            if in_ned:
                self._tell_ned(frame if is_ned(frame) else child)
            if self._rows and stamp_ns <= self._rows[-1][0]:
                if not _of_another_clock(stamp_ns, self._rows[-1][0]):
                    return
                self._rows.clear()
            self._rows.append((stamp_ns, [at.x, at.y, at.z], [turn.w, turn.x, turn.y, turn.z]))
            while self._rows[0][0] < stamp_ns - _KEPT_NS:
                self._rows.popleft()
            self.changed.notify_all()

    def placed(self, message: Any) -> None:
        """A decoded GeoPointStamped or NavSatFix of the origin of the poses. ValueError for no place."""
        assert self._origin is not None
        with self.changed:
            if self._origin.heard(message):  # which of the poses before count from it, nobody knows
                self._rows.clear()
                self._moving.clear()
                self._parents.clear()
                self._confused = (
                    f"{self._origin.topic} told another origin of its poses than before: the new one is "
                    "taken, and what it saw around then may lie elsewhere; acknowledge this where it was "
                    "started anew"
                )
            self.changed.notify_all()

    def transformed(self, message: Any, *, fixed: bool) -> None:
        """A decoded TFMessage; `fixed`: of /tf_static."""
        with self.changed:
            for transform in message.transforms:
                child = transform.child_frame_id.lstrip("/")
                if fixed:
                    if not told_alike(self._fixed.get(child, transform), transform):
                        self._fixed_anew.add(child)
                    self._fixed[child] = transform
                    continue
                kept = self._moving.setdefault(child, deque())
                stamp_ns = time_ns(transform.header.stamp)
                if kept and _of_another_clock(stamp_ns, time_ns(kept[-1].header.stamp)):
                    kept.clear()
                    self._parents[child].clear()
                parents, parent = self._parents.setdefault(child, {}), transform.header.frame_id.lstrip("/")
                first_ns, last_ns = parents.get(parent, (stamp_ns, stamp_ns))
                parents[parent] = min(first_ns, stamp_ns), max(last_ns, stamp_ns)
                if kept and stamp_ns <= time_ns(kept[-1].header.stamp):
                    continue
                kept.append(transform)
                while time_ns(kept[0].header.stamp) < stamp_ns - _KEPT_NS:
                    kept.popleft()
            self.changed.notify_all()

    @property
    def doubt(self) -> str | None:
        if self._confused is not None or not self._unset:
            return self._confused
        return f"its attitudes are {UNSET_OF_ROS}, such as camera_pose= or tf= in --topics"

    @property
    def frame(self) -> str | None:
        with self.changed:
            frame = self._frame
            if self._role == "tf":
                newest_ns = self.newest_ns
                frame = None if newest_ns is None else self._tree(newest_ns).in_world(self.camera_frame)[0]
            if frame is None or (self._origin is not None and not self._origin.shared):
                return None
            whose = whose_frame(frame, self._topic)
            return f"{frame} of {whose}" if whose else frame

    def _tell_ned(self, frame: str) -> None:
        if frame not in self._told_ned:
            self._told_ned.add(frame)
            _LOG.warning("%s is north-east-down by its name: its poses are turned", frame)

    @property
    def newest_ns(self) -> int | None:
        if self._lacks_origin:
            return None
        if self._role == "tf":
            newest = [time_ns(self._moving[frame][-1].header.stamp) for frame in self._moving_chain()]
            return min(newest, default=None)
        return self._rows[-1][0] if self._rows else None

    @property
    def lacks(self) -> str:
        if self._origin is not None and self._lacks_origin:
            return f"nothing on {self._origin.topic}, which says where its poses count from"
        if self._role != "tf":
            return "nothing on its pose topic"
        if not self.camera_frame:
            return "no picture to say which frame of tf its camera is"
        return f"no tf of something that moves leads to {self.camera_frame}"

    @property
    def _lacks_origin(self) -> bool:
        return self._origin is not None and not self._origin.is_known

    def _moving_chain(self) -> list[str]:
        """Frames that move between the camera and the world."""
        chain: list[str] = []
        frame, seen = self.camera_frame, set[str]()
        while frame not in seen and (frame in self._moving or frame in self._fixed):
            seen.add(frame)
            if frame in self._moving:
                chain.append(frame)
                frame = self._moving[frame][-1].header.frame_id.lstrip("/")
            else:
                frame = self._fixed[frame].header.frame_id.lstrip("/")
        return chain

    def pose_at(self, stamp_ns: int) -> NDArray[np.float64]:
        track = self._track(stamp_ns)
        track = track if self._origin is None else self._origin.moved(track)
        return steadied_as(track, self._noise).at(stamp_ns, self._max_gap_s)

    def _require_told(self, segments: Iterable[Segment], stamp_ns: int) -> None:
        """ValueError where one of them pauses for longer than it does usually, because nobody knows how it
        turned meanwhile, and where two nodes tell one by turns."""
        for segment in segments:
            if not isinstance(segment, PoseTrack):
                continue
            segment.at(stamp_ns, bridged_s(segment, self._max_gap_s))
            apart = told_by_two(segment.stamps_ns, segment.positions, segment.quaternions)
            if apart is not None:
                raise ValueError(
                    f"what tells it jumps {apart} away and back, again and again: stop all but one of the "
                    "nodes that do so"
                )

    def _track(self, stamp_ns: int) -> PoseTrack:
        if self._role == "tf":
            tree = self._tree(stamp_ns)
            root, path = tree.in_world(self._optical(tree))
            if not path:
                raise ValueError(f"no tf leads to {self.camera_frame or '(no frame)'}")
            self._require_one_parent(path, stamp_ns)
            segments = tree.segments(path)
            if is_ned(root):
                self._tell_ned(root)
                segments = [NED_WORLD, *segments]
            self._require_told(segments, stamp_ns)
            return composed(segments, self._max_gap_s)
        rows = [row for row in self._rows if abs(row[0] - stamp_ns) <= _AROUND_NS]
        stamps, positions, quaternions = zip(*rows, strict=True) if rows else ((), (), ())
        given, _ = track_from_rows(stamps, np.array(positions), np.array(quaternions))
        is_used = self._role == "camera_pose" or self._mount is None or self._mount.needs_body
        self._unset = is_used and len(given) > 1 and are_unset(given.quaternions)
        if is_used:
            self._require_told([given], stamp_ns)
        if self._in_ned:
            given = composed([NED_WORLD, given], self._max_gap_s)
        return given if self._role == "camera_pose" else self._on_body(given, stamp_ns)

    def _on_body(self, body: PoseTrack, stamp_ns: int) -> PoseTrack:
        if self._mount is not None:
            body = as_forward_left_up(body) if self._in_ned else body
            attitudes = self._mount.camera_quaternions_ned(body_quaternions_ned(body.quaternions))
            return PoseTrack(body.stamps_ns, body.positions, optical_quaternions_enu(attitudes))
        tree = self._tree(stamp_ns)
        path = tree.path(self._optical(tree), above=self._body_frame)
        if not path:
            raise ValueError(
                f"no tf leads from {self._body_frame} to {self.camera_frame or '(no frame)'}: say how the "
                "camera hangs with --mount, such as level:-60"
            )
        self._require_one_parent(path, stamp_ns)
        segments = tree.segments(path)
        self._require_told(segments, stamp_ns)
        return composed([body, *segments], self._max_gap_s)

    def _optical(self, tree: TransformTree) -> str:
        """The frame of the pictures, as in bags."""
        named = self.camera_frame
        frame = optical_frame(named, tree)
        if (doubt := frame_doubt(named, frame)) and doubt not in self._told_of_frames:
            self._told_of_frames.add(doubt)
            _LOG.warning("%s%s", f"{self._topic}: " if self._topic else "", doubt)
        return frame

    def _require_one_parent(self, path: Sequence[str], stamp_ns: int) -> None:
        """ValueError where two nodes say that a frame hangs on different ones, as MAVROS may of map and odom:
        the camera would stand in either by turns."""
        for child in path:
            if child in self._fixed_anew:
                self._confused = (
                    f"/tf_static told {child} in different places or attitudes: the last is taken, and what "
                    "its camera sees may lie elsewhere; let one node tell it, or acknowledge this where it "
                    "was measured anew"
                )
            parents = [
                parent
                for parent, (first_ns, last_ns) in self._parents.get(child, {}).items()
                if first_ns - _AROUND_NS <= stamp_ns <= last_ns + _AROUND_NS
            ]
            if len(parents) > 1:
                raise ValueError(
                    f"tf says that {child} hangs on {' and on '.join(sorted(parents))}: stop all but one of "
                    "the nodes that say so"
                )

    def _tree(self, stamp_ns: int) -> TransformTree:
        tree = TransformTree()
        for transform in self._fixed.values():
            tree.add(transform, fixed=True)
        for kept in self._moving.values():
            for transform in kept:
                if abs(time_ns(transform.header.stamp) - stamp_ns) <= _AROUND_NS:
                    tree.add(transform, fixed=False)
        return tree


def _of_another_clock(stamp_ns: int, newest_ns: int) -> bool:
    """Whether a pose is so much older than the newest that it was not overtaken on its way: the newest was
    stamped ahead of its time, or the clock was set back. All begins anew then: one wrong stamp would end all
    poses, and views of now would get those that were told at their stamps before."""
    return stamp_ns < newest_ns - _OVERTAKEN_NS
