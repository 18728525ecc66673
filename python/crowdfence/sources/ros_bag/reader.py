"""Reads bags of ROS 1 and 2, and MCAP files with topics of others: camera, intrinsics, pose of each drone.

The pose comes from the first of these that the bag has for a drone, and `Recording.warnings` say which:

    camera_pose   the camera's optical frame itself
    pose          the drone's body, with the camera on it from tf, or as the user says (`mount`)
    tf            the frames from the world down to the one that the pictures name
    fix, imu      satellite position and attitude of the body, with the camera on it as for `pose`

Worlds are east-north-up (REP 103), bodies forward-left-up, cameras as in REP 104. A frame that is named for
north-east-down (world_ned, odom_local_ned, as AirSim has them) is turned, and bodies in it are
forward-right-down. Messages are timed by the stamps of their headers. Pixels are fetched from the bag when
asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from heapq import merge
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera
from crowdfence.georeference import Georeference
from crowdfence.sources.axes import body_quaternions_ned, optical_quaternions_enu
from crowdfence.sources.camera_mount import CameraMount
from crowdfence.sources.mission.camera_info import is_rectified
from crowdfence.sources.moved_frame import FrameMove
from crowdfence.sources.place_camera import Limits, UnplacedFrame, place_cameras
from crowdfence.sources.pose_track import PoseTrack, track_from_rows
from crowdfence.sources.recording import PixelSources, Recording
from crowdfence.sources.ros_bag.bag_content import BagContent, PoseRows
from crowdfence.sources.ros_bag.bag_file import Bag, BagMessage, decode, open_bag
from crowdfence.sources.ros_bag.common_world import CommonWorld, heading_doubt
from crowdfence.sources.ros_bag.optical_frame import frame_doubt, optical_frame
from crowdfence.sources.ros_bag.own_frame import COUNTED_FROM
from crowdfence.sources.ros_bag.picture import encoded_picture, heatmap_pixels
from crowdfence.sources.ros_bag.told_place import heights_assumed
from crowdfence.sources.ros_bag.topic_choice import (
    COMPRESSED,
    FIX,
    DroneTopics,
    guessed_topics,
    left_out,
    shared_pose,
    stated_topics,
    topic_list,
)
from crowdfence.sources.ros_bag.transforms import (
    BODY_FRAME,
    NED_WORLD,
    Segment,
    as_forward_left_up,
    composed,
    is_ned,
)
from crowdfence.sources.ros_bag.two_clocks import (
    Arrivals,
    behind_s,
    clock_doubt,
    drone_clock_doubt,
    drones_apart,
)
from crowdfence.sources.rotation import multiply

_INVERSE = np.array([1.0, -1.0, -1.0, -1.0])
"""Times a unit quaternion."""
_BODY = ("base", "body", "fcu", "imu", "gimbal", "camera", "cam")
"""Frames whose names begin so are on the drone: a tree that ends there does not reach the world."""
_FEWEST_HEATMAPS = 3
"""Fewer may be of pictures that were not recorded."""


@dataclass(frozen=True, slots=True)
class BagOptions:
    """What a bag does not say about itself."""

    topics: Sequence[str] = ()
    """Per drone `camera=...,info=...,pose=...` (`topic_choice.ROLES`); empty: by types and names."""
    mount: CameraMount | None = None
    """How the camera hangs on the drone, where no tf says it."""
    calibration: Camera | None = None
    """Intrinsics for all cameras, instead of those in the bag."""


def read_bag(path: Path, limits: Limits, options: BagOptions, *, beside_others: bool = False) -> Recording:
    """Open a bag. `beside_others`: it is one of several recordings of a fleet; where it does not say where on
    Earth its poses are, what it tells to be over their frames counts.

    ValueError when it is damaged, names of `topics` are wrong, or no camera with a pose is in it; the message
    then lists the topics that are there.
    """
    bag = open_bag(path)
    topics = bag.topics()
    stated = stated_topics(options.topics, topics)
    chosen = stated or guessed_topics(topics)
    if not chosen:
        raise ValueError(
            f"{path} holds no camera with a pose that can be told by itself; name them with --topics "
            f"camera=...,info=...,pose=... from {topic_list(topics)}"
        )
    content = BagContent(bag, chosen)
    reader = _Reader(bag, chosen, content, limits, options, guessed=not stated, beside_others=beside_others)
    return reader.recording()


@dataclass(slots=True)
class _Reader:
    bag: Bag
    chosen: list[DroneTopics]
    content: BagContent
    limits: Limits
    options: BagOptions
    guessed: bool
    beside_others: bool
    anchor: Georeference | None = None
    warnings: list[str] = field(default_factory=list)
    poses_from: dict[str, str] = field(default_factory=dict)
    told_by: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Topics that tell the poses of a drone as they change."""
    world: CommonWorld = field(init=False)
    placed: list[str] = field(default_factory=list)
    """Drones of which the bag says where on Earth their poses count from."""

    def __post_init__(self) -> None:
        self.world = CommonWorld(self.content, self.chosen, self.warnings, self.beside_others)

    def recording(self) -> Recording:
        chosen = self.chosen
        self.warnings += [f"damaged bag: {sentence}" for sentence in self.bag.damage]
        for topic, faults in self.content.faulty.items():
            self.warnings.append(f"{topic}: {len(faults)} messages are left out, the first: {faults[0]}")
        for topic, counts in self.content.other_frames.items():
            told = ", ".join(f"{count} name {frame or '(none)'}" for frame, count in counts.items())
            self.warnings.append(
                f"{topic}: its messages are of several frames, {told}: all are taken as in "
                f"{self.content.frames[topic] or '(none)'}, so that what was seen may be put elsewhere; let "
                "one node publish on it, in one frame"
            )
        self._require_pictures()
        tracks = {one.drone: self._track(one) for one in chosen}
        fixes = dict.fromkeys(self._origin_topic(one) or "" for one in chosen if one.drone in self.placed)
        self.warnings += [heights_assumed(topic) for topic in fixes if self.content.types.get(topic) == FIX]
        self._unplace_those_of_one_origin()
        if doubt := self.world.doubt(self.placed):
            self.warnings.append(doubt)
        self._doubt_drones_apart([one for one in chosen if not self._doubt_clocks(one)])
        unplaced = {one.drone: self._unplaced(one) for one in chosen}
        for one in chosen:
            how = "taken by types and names" if self.guessed else "as stated"
            self.warnings.append(f"topics {how}: {one}; pose from {self.poses_from[one.drone]}")
        if self.guessed and (others := left_out(self.bag.topics(), chosen)):
            self.warnings.append(
                f"{', '.join(others)}: left out, what they saw is not used; name each camera of a drone with "
                "--topics drone=NAME,camera=... or heatmap=..., and a name of its own"
            )
        if self.guessed:
            self._doubt_shared_poses()
        self.warnings += self.content.tree_warnings[:4]
        frames, refused = place_cameras(unplaced, tracks, self.limits)
        return Recording(
            name=self.bag.path.resolve().stem,
            drones=tuple(sorted(tracks)),
            frames=frames,
            georeference=self.anchor,
            terrain=None,
            refused=tuple(refused),
            warnings=tuple(self.warnings),
            manifest={
                "kind": "ROS 1 bag" if self.bag.ros1 else "ROS 2 bag",
                "path": str(self.bag.path),
                "topics": [str(one) for one in chosen],
                COUNTED_FROM: self.world.local_frames(self.placed),
            },
            pose_tracks=tracks,
        )

    def _doubt_shared_poses(self) -> None:
        for drones, topic, other in shared_pose(self.bag.topics(), self.told_by):
            self.warnings.append(
                f"{' and '.join(drones)} are given one topic of poses by types and names, {topic}, and "
                f"nobody {other}: if they are cameras of several drones, what one sees is put where another "
                "one is; name what tells where each is with --topics drone=NAME,camera=...,info=...,pose=..."
            )

    def _doubt_clocks(self, one: DroneTopics) -> bool:
        """Whether its pictures and its poses are of two clocks."""
        is_doubted = False
        pictures_on = one.camera or one.heatmap or ""
        for poses_on in self.told_by.get(one.drone, ()):
            if (apart_s := behind_s(self._arrivals(pictures_on), self._arrivals(poses_on))) is not None:
                self.warnings.append(f"{one.drone}: {clock_doubt(pictures_on, poses_on, apart_s)}")
                is_doubted = True
        return is_doubted

    def _doubt_drones_apart(self, drones: Sequence[DroneTopics]) -> None:
        pictures = {one.drone: self._arrivals(one.camera or one.heatmap or "") for one in drones}
        poses = {one.drone: self._arrivals(self.told_by[one.drone][0]) for one in drones}
        self.warnings += [drone_clock_doubt(*apart) for apart in drones_apart(pictures, poses)]

    def _arrivals(self, topic: str) -> Arrivals:
        return self.content.arrivals.get(topic, Arrivals())

    def _require_pictures(self) -> None:
        pictures = self.content.pictures
        for one in self.chosen:
            if not any(pictures.get(name or "") for name in (one.camera, one.heatmap)):
                why = f"; {self.warnings[0]}" if self.warnings else ""
                raise ValueError(
                    f"{self.bag.path}: no picture of {one.drone!r} on {one.camera or one.heatmap}{why}"
                )

    # --- where the camera was ---

    def _track(self, one: DroneTopics) -> PoseTrack:
        tree = self.content.tree(one.drone)
        frame = optical_frame(self._named(one), tree)
        if one.camera_pose:
            self._doubt_mount(one, one.camera_pose)
            self.told_by[one.drone] = (one.camera_pose,)
            track = self._in_world(one.drone, one.camera_pose)
            return self._moved_to_anchor(one, track, f"{one.camera_pose}")
        tree_reaches = tree.moves(frame) and not _on_drone(tree.root(frame))
        if one.tf and tree_reaches and (self.guessed or not one.pose):
            self._doubt_mount(one, one.tf)
            self.told_by[one.drone] = (one.tf,)
            self._doubt_frame(one, frame)
            root, path = tree.in_world(frame)
            segments = [*self.world.over(one.drone, root), *tree.segments(path)]
            self.world.count_from(one.drone, root, one.tf)
            track = composed(segments, self.limits.max_pose_gap_s)
            return self._moved_to_anchor(one, track, f"{one.tf}, {root} to {frame}")
        if one.pose:
            self.told_by[one.drone] = (one.pose,)
            child = self.world.child(one.pose)
            body = self._in_world(one.drone, one.pose)
            north_east_down = any(part is NED_WORLD for part in self.world.over_topic(one.drone, one.pose))
            if self.options.mount is not None and north_east_down:
                body = as_forward_left_up(body)
            track = self._on_body(one, body, frame, child or BODY_FRAME)
            return self._moved_to_anchor(one, track, f"{one.pose}{self._how(frame, child or BODY_FRAME)}")
        if one.fix and one.imu:
            self.told_by[one.drone] = (one.fix, one.imu)
            body = self._satellite_track(one.drone, one.fix, one.imu)
            self.placed.append(one.drone)
            self.poses_from[one.drone] = f"{one.fix} and {one.imu}{self._how(frame, BODY_FRAME)}"
            return self._on_body(one, body, frame, BODY_FRAME)
        raise ValueError(
            f"{self.bag.path}: no pose of {one.drone!r}: name camera_pose=, pose=, tf= or fix= and imu= with "
            f"--topics; the bag has {topic_list(self.bag.topics())}"
        )

    def _named(self, one: DroneTopics) -> str:
        """The frame that the pictures of a drone name, or their intrinsics."""
        frames = self.content.frames
        return frames.get(one.camera or "") or frames.get(one.info or "") or ""

    def _doubt_mount(self, one: DroneTopics, topic: str) -> None:
        if self.options.mount is not None:
            self.warnings.append(
                f"{one.drone}: --mount is not used, {topic} tells where its camera looked; with pose= in "
                "--topics it is"
            )

    def _doubt_frame(self, one: DroneTopics, frame: str) -> None:
        if doubt := frame_doubt(self._named(one), frame):
            self.warnings.append(f"{one.drone}: {doubt}")

    def _rows(self, drone: str, topic: str) -> PoseTrack:
        track, remarks = self.content.rows.get(topic, PoseRows()).track()
        self.warnings += [f"{drone}: {topic}: {remark}" for remark in remarks]
        return track

    def _in_world(self, drone: str, topic: str) -> PoseTrack:
        """Poses of a topic in the world of all."""
        track = self._rows(drone, topic)
        self.world.count_from(drone, self.world.frame_over_topic(drone, topic), topic)
        above = self.world.over_topic(drone, topic)
        return composed([*above, track], self.limits.max_pose_gap_s) if above else track

    def _on_body(self, one: DroneTopics, body: PoseTrack, frame: str, body_frame: str) -> PoseTrack:
        """The camera on a body, forward-left-up in ENU: by the user's word, or by tf."""
        mount, tree = self.options.mount, self.content.tree(one.drone)
        if mount is not None:
            attitudes = mount.camera_quaternions_ned(body_quaternions_ned(body.quaternions))
            return PoseTrack(body.stamps_ns, body.positions, optical_quaternions_enu(attitudes))
        path = tree.path(frame, above=body_frame)
        if not path:
            raise ValueError(
                f"{self.bag.path}: nothing says how the camera of {one.drone!r} hangs on the drone: no tf "
                f"from {body_frame} to {frame or '(no frame)'}. Say it with --mount, such as level:-60, or "
                "name the pose of the camera itself as camera_pose= in --topics"
            )
        self._doubt_frame(one, frame)
        segments: list[Segment] = [body, *tree.segments(path)]
        return composed(segments, self.limits.max_pose_gap_s)

    def _how(self, frame: str, body_frame: str) -> str:
        mount = self.options.mount
        if mount is None:
            return f" with tf from {body_frame} to {frame}"
        return f" with the camera at {mount.kind}:{mount.pitch_deg:g},{mount.yaw_deg:g},{mount.roll_deg:g}"

    def _satellite_track(self, drone: str, fix: str, imu: str) -> PoseTrack:
        fixes = np.array(self.content.fixes.get(fix, []), np.float64).reshape(-1, 4)
        stamps = [stamp for stamp, *_ in self.content.fixes.get(fix, [])]
        if not stamps:
            raise ValueError(f"{self.bag.path}: {fix} never has a position")
        if self.anchor is None:
            self.anchor = Georeference(*fixes[0, 1:])
        positions = self.anchor.local_from_geodetic(*fixes[:, 1:].T)
        level = np.tile([1.0, 0.0, 0.0, 0.0], (len(stamps), 1))
        place, remarks = track_from_rows(stamps, positions, level)
        self.warnings += [f"{fix}: {remark}" for remark in remarks]
        turn, remarks = self.content.rows.get(imu, PoseRows()).track()
        self.warnings += [f"{imu}: {remark}" for remark in remarks]
        turn = self._of_body(drone, imu, turn)
        gap_s = max(self.limits.max_pose_gap_s, _longest_usual_gap_s(stamps))
        return composed([place, turn], gap_s)

    def _of_body(self, drone: str, imu: str, turn: PoseTrack) -> PoseTrack:
        """Attitudes of an IMU -> of the body that it is fixed to, forward-left-up in east-north-up."""
        frame = self.content.frames.get(imu, "")
        ned = is_ned(frame)
        if ned:
            self.warnings.append(f"{frame} of {imu} is north-east-down by its name: its attitudes are turned")
        tree = self.content.tree(drone)
        path = tree.path(frame, above=BODY_FRAME)
        mounted = tree.fixed_segments(path) if path else None
        if mounted is not None:
            imu_on_body = reduce(multiply, (part.quaternion for part in mounted))
            turn = replace(turn, quaternions=multiply(turn.quaternions, imu_on_body * _INVERSE))
        elif ned:
            turn = as_forward_left_up(turn)
        return composed([NED_WORLD, turn], np.inf) if ned else turn

    # --- where on Earth ---

    def _moved_to_anchor(self, one: DroneTopics, track: PoseTrack, poses_from: str) -> PoseTrack:
        """Local poses with the origin of their frame as far as the bag says it; the first one is the anchor
        of all."""
        self.poses_from[one.drone] = poses_from
        origin = self._origin(one, track)
        if origin is None:
            return track
        self.placed.append(one.drone)
        if self.anchor is None:
            self.anchor = origin
        if self.anchor == origin:
            return track
        return FrameMove.between(origin, self.anchor).track(track)

    def _unplace_those_of_one_origin(self) -> None:
        """One topic that says where the poses of several drones count from says it of one of their frames."""
        frames: dict[str | None, set[tuple[str, str]]] = {}
        told_by = {one.drone: self._origin_topic(one) for one in self.chosen}
        for drone, counted_from in self.world.counted_from.items():
            frames.setdefault(told_by[drone], set()).add(counted_from)
        self.placed = [drone for drone in self.placed if len(frames.get(told_by[drone], ())) < 2]

    def _origin_topic(self, one: DroneTopics) -> str | None:
        return one.origin if one.origin and self.content.fixes.get(one.origin) else one.fix

    def _origin(self, one: DroneTopics, track: PoseTrack) -> Georeference | None:
        if one.origin and self.content.fixes.get(one.origin):
            return Georeference(*self.content.fixes[one.origin][0][1:])
        fixes = self.content.fixes.get(one.fix or "", [])
        pairs = [(place, _near(track, stamp_ns)) for stamp_ns, *place in fixes]
        known = [(place, at) for place, at in pairs if at is not None]
        if not known:
            return None
        anchor = Georeference(*known[0][0])
        places, at = np.array([place for place, _ in known]), np.array([at for _, at in known])
        for _ in range(3):  # the plane of the first position leans against that of the origin
            apart = anchor.local_from_geodetic(*places.T) - at
            origin = np.median(apart, axis=0)
            anchor = Georeference(*(float(value[0]) for value in anchor.geodetic_from_local(origin[None])))
        spread_m = float(np.linalg.norm(np.median(np.abs(apart - origin), axis=0)))
        self.warnings.append(
            f"{one.drone}: (0, 0, 0) of its poses is placed on Earth by {len(known)} positions of {one.fix}, "
            f"which scatter by {spread_m:.1f} m; name an origin= topic or --origin if you know it better"
        )
        if doubt := heading_doubt(at, anchor.local_from_geodetic(*places.T)):
            self.warnings.append(f"{one.drone}: {doubt}")
        return anchor

    # --- what it saw ---

    def _unplaced(self, one: DroneTopics) -> list[UnplacedFrame]:
        pictures = self.content.pictures.get(one.camera or "", {})
        heatmaps = self.content.pictures.get(one.heatmap or "", {})
        rectified = is_rectified(one.camera or one.heatmap or "")
        calibration = self.options.calibration
        if rectified and calibration is not None and any(calibration.distortion):
            self.warnings.append(
                f"{one.drone}: by the name of {one.camera or one.heatmap} the lens is taken out of its "
                "pictures already, and --calibration has a distortion: if it is of the raw ones, everything "
                "off the middle is put elsewhere; name the raw pictures, or leave --calibration out"
            )
        cameras = {
            stamp_ns: infos.rectified if rectified else infos.raw
            for stamp_ns, infos in self.content.cameras.get(one.info or "", {}).items()
        }
        if len(heatmaps) >= _FEWEST_HEATMAPS and pictures and not pictures.keys() & heatmaps.keys():
            self.warnings.append(
                f"{one.drone}: none of the {len(heatmaps)} heatmaps of {one.heatmap} has the stamp of a "
                f"picture of {one.camera}: where they are stamped as they are made, each gets the pose of "
                "that moment, and what it shows is put beside; give them the stamps of their pictures"
            )
        only = next(iter(cameras.values())) if len(set(map(id, cameras.values()))) == 1 else None
        unplaced = []
        # Each topic in its own order, which tells of clocks; one behind the other they would look disordered.
        for stamp_ns in dict.fromkeys(merge(pictures, heatmaps)):
            camera = self.options.calibration or cameras.get(stamp_ns, only)
            fault = camera if isinstance(camera, str) else None
            pixels = self._pixels(pictures.get(stamp_ns), heatmaps.get(stamp_ns))
            usable = None if isinstance(camera, str) else camera
            unplaced.append(UnplacedFrame(stamp_ns, usable, pixels, fault))
        if unplaced and all(frame.camera is None and frame.fault is None for frame in unplaced):
            if cameras:  # they change, so that each is of the picture of its own stamp alone
                raise ValueError(
                    f"{self.bag.path}: the intrinsics of {one.drone!r} on {one.info} change, as of a zoom, "
                    "and none has the stamp of a picture: record them with those stamps, or give "
                    "--calibration"
                )
            raise ValueError(
                f"{self.bag.path}: no intrinsics of {one.drone!r}: name a CameraInfo topic as info= in "
                "--topics, or a file with --calibration"
            )
        unplaced.extend(
            UnplacedFrame(stamp_ns, None, fault=f"stamp {stamp_ns} repeats an earlier frame of this drone")
            for stamp_ns in self.content.repeated.get(one.camera or one.heatmap or "", [])
        )
        return unplaced

    def _pixels(self, picture: BagMessage | None, heatmap: BagMessage | None) -> PixelSources:
        bag, types = self.bag, self.content.types

        def message(stored: BagMessage) -> Any:
            return decode(bag.read(stored.place), types[stored.topic], ros1=bag.ros1)

        def encoded(stored: BagMessage) -> bytes:
            return encoded_picture(message(stored), packed=types[stored.topic] == COMPRESSED)

        return PixelSources(
            image=None if picture is None else lambda: encoded(picture),
            heatmap=None if heatmap is None else lambda: heatmap_pixels(message(heatmap)),
        )


def _on_drone(frame: str) -> bool:
    name = frame.rpartition("/")[2].lower()
    return name.startswith(_BODY)


def _near(track: PoseTrack, stamp_ns: int) -> NDArray[np.float64] | None:
    """Where the track is at a stamp, within 0.2 s."""
    if len(track) == 0:
        return None
    nearest = int(np.argmin(np.abs(track.stamps_ns - stamp_ns)))
    return track.positions[nearest] if abs(int(track.stamps_ns[nearest]) - stamp_ns) < 200_000_000 else None


def _longest_usual_gap_s(stamps_ns: Sequence[int]) -> float:
    """Receivers report once to ten times a second: half as much again as the usual pause."""
    return 1.5 * float(np.median(np.diff(stamps_ns))) / 1e9 if len(stamps_ns) > 1 else 0.0
