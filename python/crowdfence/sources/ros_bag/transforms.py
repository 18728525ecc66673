"""Trees of frames (tf): from the world to a camera's optical frame over time.

A chain of transforms, some fixed and some moving, each with stamps of its own, becomes one pose track.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.axes import ENU_FROM_NED, FORWARD_LEFT_UP_FROM_FORWARD_RIGHT_DOWN
from crowdfence.sources.mission.ros2_messages import time_ns
from crowdfence.sources.pose_track import PoseTrack, track_from_rows
from crowdfence.sources.rotation import multiply, normalise, rotation_matrix

BODY_FRAME = "base_link"


@dataclass(frozen=True, slots=True)
class FixedTransform:
    """`parent_from_child`, the same at all times."""

    position: NDArray[np.float64]
    quaternion: NDArray[np.float64]
    """w, x, y, z"""


Segment = FixedTransform | PoseTrack

NED_WORLD = FixedTransform(np.zeros(3), ENU_FROM_NED)
"""A world that is north-east-down, in one that is east-north-up."""
_ENU = ("map", "odom", "world", "enu")
"""Frames whose names end so are east-north-up."""
EARTH = ("earth", "utm")
"""Frames over a level world: Earth-centred (REP 105), and a grid that north is not quite up in."""
_NED = re.compile(r"(?:^|[/_])ned$", re.IGNORECASE)


def is_ned(frame: str) -> bool:
    """Whether a frame is north-east-down by its name, as REP 103 has it: world_ned, odom_local_ned."""
    return _NED.search(frame) is not None


def is_ned_pose(frame: str, child: str) -> bool:
    """Whether the pose of `child` in a frame is north-east-down by their names: AirSim's odometry names the
    axes in its child frame alone."""
    return is_ned(frame) or (is_ned(child) and not frame.endswith(_ENU))


def as_forward_left_up(body: PoseTrack) -> PoseTrack:
    """A body forward-right-down with its axes as ROS has them."""
    turned = multiply(body.quaternions, FORWARD_LEFT_UP_FROM_FORWARD_RIGHT_DOWN)
    return PoseTrack(body.stamps_ns, body.positions, turned)


_Row = tuple[list[float], list[float]]
"""Position and quaternion (w, x, y, z)."""


@dataclass(slots=True)
class _Edge:
    parent: str
    stamps_ns: list[int] = field(default_factory=list)
    positions: list[list[float]] = field(default_factory=list)
    quaternions: list[list[float]] = field(default_factory=list)
    told_fixed: _Row | None = None

    def segment(self) -> tuple[Segment, list[str]]:
        """And what is to be told of its rows."""
        if self.fixed:
            return self.as_fixed(), []
        return track_from_rows(self.stamps_ns, self.positions, self.quaternions)

    @property
    def fixed(self) -> bool:
        """Told to be. A gimbal that the description of a robot tells as fixed too moves by what its driver
        tells."""
        return self.told_fixed is not None and all(row == self.told_fixed for row in self._rows())

    def as_fixed(self) -> FixedTransform:
        position, quaternion = self.told_fixed or (self.positions[-1], self.quaternions[-1])
        return FixedTransform(np.array(position), normalise(np.array(quaternion)))

    def still(self) -> bool:
        rows = self._rows()
        return self.fixed or (bool(rows) and all(row == rows[0] for row in rows))

    def _rows(self) -> list[_Row]:
        return list(zip(self.positions, self.quaternions, strict=True))


def _row(transform: Any) -> _Row:
    """Of a geometry_msgs/TransformStamped as decoded."""
    at, turn = transform.transform.translation, transform.transform.rotation
    return [at.x, at.y, at.z], [turn.w, turn.x, turn.y, turn.z]


def _alike(one: _Row, other: _Row) -> bool:
    return all(np.allclose(a, b, rtol=0.0, atol=1e-6) for a, b in zip(one, other, strict=True))


def told_alike(one: Any, other: Any) -> bool:
    """Whether two decoded TransformStamped put their frame on the same parent in the same way."""
    parents = {transform.header.frame_id.lstrip("/") for transform in (one, other)}
    return len(parents) == 1 and _alike(_row(one), _row(other))


class TransformTree:
    """All transforms of a bag. `warnings` says where frames changed their parents, and which rows of the
    segments that were asked for were left out."""

    def __init__(self) -> None:
        self.warnings: list[str] = []
        self._edges: dict[str, _Edge] = {}

    def add(self, transform: Any, *, fixed: bool) -> None:
        """A geometry_msgs/TransformStamped as decoded."""
        parent = transform.header.frame_id.lstrip("/")
        child = transform.child_frame_id.lstrip("/")
        edge = self._edges.setdefault(child, _Edge(parent))
        if edge.parent != parent:
            self.warnings.append(f"tf: {child} hangs on {edge.parent} and on {parent}; the first is taken")
            return
        position, quaternion = _row(transform)
        if fixed:
            if edge.told_fixed is not None and not _alike(edge.told_fixed, (position, quaternion)):
                self.warnings.append(
                    f"tf: {child} is told to be fixed to {parent} in different places or attitudes: the last "
                    "is taken for the whole flight, and what was seen may be put elsewhere; let one node "
                    "tell it"
                )
            edge.told_fixed = position, quaternion
            return
        edge.stamps_ns.append(time_ns(transform.header.stamp))
        edge.positions.append(position)
        edge.quaternions.append(quaternion)

    def path(self, frame: str, above: str | None = None) -> list[str]:
        """Frames from the root (or the one below `above`) down to `frame`; empty when `frame` is not in the
        tree or `above` is not over it."""
        path: list[str] = []
        while frame in self._edges and frame != above and frame not in path:
            path.append(frame)
            frame = self._edges[frame].parent
        return path[::-1] if above is None or frame == above else []

    def fixed_below(self, frame: str) -> list[str]:
        """Frames that are fixed right below `frame`."""
        return [name for name, edge in self._edges.items() if edge.parent == frame and edge.still()]

    def root(self, frame: str) -> str:
        """The frame that everything over `frame` hangs on."""
        path = self.path(frame)
        return self._edges[path[0]].parent if path else frame

    def in_world(self, frame: str) -> tuple[str, list[str]]:
        """The level world that `frame` hangs in, and the path from there: what such a world is fixed to on
        Earth is left out."""
        path, root = self.path(frame), self.root(frame)
        if len(path) > 1 and root in EARTH and self._edges[path[0]].still():
            return path[0], path[1:]
        return root, path

    def moves(self, frame: str) -> bool:
        """Whether anything over `frame` moves."""
        return any(not self._edges[name].fixed for name in self.path(frame))

    def segments(self, path: Iterable[str]) -> list[Segment]:
        """The transforms into the parents of the frames of a `path`."""
        found = []
        for name in path:
            segment, remarks = self._edges[name].segment()
            found.append(segment)
            self.warnings += [f"tf: {name}: {remark}" for remark in remarks]
        return found

    def fixed_segments(self, path: Sequence[str]) -> list[FixedTransform] | None:
        """The same; None where one of them moves. One that is told again and again, as by ROS 1, is fixed."""
        edges = [self._edges[name] for name in path]
        return [edge.as_fixed() for edge in edges] if all(edge.still() for edge in edges) else None


def composed(segments: Sequence[Segment], max_gap_s: float) -> PoseTrack:
    """The product of a chain, from the world down, at every stamp of every moving part where all are known:
    linear between samples, attitudes by slerp, no bridge over more than `max_gap_s`."""
    moving = [segment for segment in segments if isinstance(segment, PoseTrack)]
    empty = np.empty(0, np.int64)
    stamps = np.unique(np.concatenate([empty, *(track.stamps_ns for track in moving)]))
    position = np.zeros((len(stamps), 3))
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (len(stamps), 1))
    known = np.ones(len(stamps), np.bool_)
    for segment in segments:
        if isinstance(segment, FixedTransform):
            step_position: NDArray[np.float64] = segment.position
            step_quaternion: NDArray[np.float64] = segment.quaternion
        else:
            step_position, step_quaternion, sampled = _sampled(segment, stamps, max_gap_s)
            known &= sampled
        turn = rotation_matrix(quaternion)
        position = position + np.einsum("nij,nj->ni", turn, np.broadcast_to(step_position, position.shape))
        quaternion = multiply(quaternion, step_quaternion)
    return PoseTrack(stamps[known], position[known], quaternion[known])


def _sampled(
    track: PoseTrack, stamps_ns: NDArray[np.int64], max_gap_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Positions [N, 3] and quaternions [N, 4] of a track at stamps [N], and where it says them."""
    count = len(track)
    if count == 0:
        return np.zeros((len(stamps_ns), 3)), np.zeros((len(stamps_ns), 4)), np.zeros(len(stamps_ns), bool)
    after = np.clip(np.searchsorted(track.stamps_ns, stamps_ns, side="left"), 0, count - 1)
    exact = track.stamps_ns[after] == stamps_ns
    before = np.where(exact, after, np.maximum(after - 1, 0))
    gap_ns = track.stamps_ns[after] - track.stamps_ns[before]
    inside = (stamps_ns >= track.stamps_ns[0]) & (stamps_ns <= track.stamps_ns[-1])
    fraction = ((stamps_ns - track.stamps_ns[before]) / np.maximum(gap_ns, 1))[:, None]
    first, second = normalise(track.quaternions[before]), normalise(track.quaternions[after])
    second = np.where(np.sum(first * second, axis=1, keepdims=True) < 0, -second, second)
    # Slerp; the angle from chord and sum, as in `rotation.slerp`.
    chord, total = np.linalg.norm(second - first, axis=1), np.linalg.norm(second + first, axis=1)
    angle = 2 * np.arctan2(chord, total)[:, None]
    sine = np.sin(np.maximum(angle, 1e-12))
    near = angle < 1e-9
    weights = [
        np.where(near, 1 - fraction, np.sin((1 - fraction) * angle) / sine),
        np.where(near, fraction, np.sin(fraction * angle) / sine),
    ]
    position = track.positions[before] + fraction * (track.positions[after] - track.positions[before])
    usable = inside & (exact | (gap_ns <= max_gap_s * 1e9))
    return position, normalise(weights[0] * first + weights[1] * second), usable
