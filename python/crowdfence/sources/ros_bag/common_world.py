"""The world that the poses of all drones of a bag are brought into: level, against north, east-north-up.

Frames may be north-east-down by their names, or each drone may count from one of its own. What the bag does
not say is told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.ros_bag.bag_content import BagContent
from crowdfence.sources.ros_bag.own_frame import whose_frame
from crowdfence.sources.ros_bag.topic_choice import DroneTopics
from crowdfence.sources.ros_bag.transforms import EARTH, NED_WORLD, FixedTransform, is_ned, is_ned_pose

_SCATTER_M = 1.0
"""Receivers scatter by so much where nothing is turned."""


@dataclass(slots=True)
class CommonWorld:
    """What brings poses there."""

    content: BagContent
    chosen: Sequence[DroneTopics]
    warnings: list[str]
    beside_others: bool = False
    """Whether drones of other recordings fly beside those of the bag."""
    counted_from: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Frame that the poses of a drone count from, and whose it is (`own_frame`); by drone, as far as it is
    known yet."""

    def over_topic(self, drone: str, topic: str) -> list[FixedTransform]:
        """What brings the poses of a topic into the world; empty where they are in it."""
        frame = self._frame(topic)
        above = self.over(drone, frame)
        return above or ([NED_WORLD] if is_ned_pose(frame, self.child(topic)) else [])

    def over(self, drone: str, frame: str) -> list[FixedTransform]:
        """The same for poses of a drone in a frame: by its own name, or by that of the one that it is fixed
        to."""
        root, above = self._fixed_to(drone, frame)
        if above and is_ned(root):
            found = [NED_WORLD, *above]
        elif is_ned(frame):
            root, found = frame, [NED_WORLD]
        else:
            return above if self._several() else []
        told = f"{root} is north-east-down by its name: its poses are turned"
        if told not in self.warnings:
            self.warnings.append(told)
        return found

    def frame_over_topic(self, drone: str, topic: str) -> str:
        """The frame that the poses of a topic count from, once they are brought into the world."""
        frame = self._frame(topic)
        return self._fixed_to(drone, frame)[0] if self._several() else frame

    def count_from(self, drone: str, frame: str, topic: str) -> None:
        """That the poses of a drone, told by a topic, count from a frame."""
        self.counted_from[drone] = frame, whose_frame(frame, topic)

    def child(self, topic: str) -> str:
        """The frame that a topic tells the pose of, where it names one."""
        rows = self.content.rows.get(topic)
        return "" if rows is None else rows.child_frame

    def doubt(self, placed: Sequence[str]) -> str | None:
        """Where poses of different frames are taken as being in one; of the drones in `placed` the bag says
        where on Earth they are."""
        lost = self.local_frames(placed)
        if not lost or (not placed and len(set(self.counted_from.values())) < 2):
            return None
        frames = ", ".join(f"{drone} in {self._told(drone)}" for drone in lost)
        others = f" as those of {placed[0]}" if placed else ""
        return (
            f"nothing in the bag says how the frames of the poses lie to each other ({frames}): all are "
            f"taken to count from the same place{others}, and what one drone sees may be put far from what "
            "another sees there; name origin= or fix= of each in --topics, or record /tf_static"
        )

    def local_frames(self, placed: Sequence[str]) -> dict[str, tuple[str, str]]:
        """What the poses of the drones count from of which the bag does not say where on Earth they are."""
        return {drone: counted for drone, counted in self.counted_from.items() if drone not in placed}

    def _told(self, drone: str) -> str:
        frame, whose = self.counted_from[drone]
        alike = [other for other, _ in self.counted_from.values()].count(frame) > 1
        return f"{frame or '(no frame)'}{f' of {whose}' if alike and whose else ''}"

    def _frame(self, topic: str) -> str:
        return self.content.frames.get(topic, "")

    def _several(self) -> bool:
        """Whether the poses of the drones are in frames of their own: of names of their own, or fixed to a
        common one each otherwise; those of other recordings may be, where nothing lays these on Earth."""
        if self.beside_others and not self._on_earth():
            return True
        frames = [(one.drone, self._frame(one.camera_pose or one.pose or "")) for one in self.chosen]
        if len({frame for _, frame in frames}) > 1:
            return True
        first, *others = (self._fixed_to(drone, frame)[1] for drone, frame in frames)
        return any(not _same(first, other) for other in others)

    def _on_earth(self) -> bool:
        topics = (topic for one in self.chosen for topic in (one.origin, one.fix))
        return any(self.content.fixes.get(topic or "") for topic in topics)

    def _fixed_to(self, drone: str, frame: str) -> tuple[str, list[FixedTransform]]:
        """The uppermost frame that a frame is fixed to, and by what; itself where something moves."""
        tree = self.content.tree(drone)
        path, root = tree.path(frame), tree.root(frame)
        if path and root in EARTH:  # its axes are not those of a level world
            path, root = path[1:], path[0]
        above = tree.fixed_segments(path)
        return (frame, []) if above is None else (root, above)


def _same(some: list[FixedTransform], others: list[FixedTransform]) -> bool:
    return len(some) == len(others) and all(
        np.array_equal(one.position, other.position) and np.array_equal(one.quaternion, other.quaternion)
        for one, other in zip(some, others, strict=True)
    )


def heading_doubt(at: NDArray[np.float64], places: NDArray[np.float64]) -> str | None:
    """Whether local positions [N, 3] lie on those against north [N, 3] only when they are turned, as the end
    of a sentence that begins with whose they are."""
    a, b = (one[:, 0] + 1j * one[:, 1] for one in (at - at.mean(axis=0), places - places.mean(axis=0)))
    turn = np.sum(np.conj(a) * b)
    turn /= max(abs(turn), 1e-12)
    scatter_m, left_m = (
        float(np.hypot(np.median(np.abs(apart.real)), np.median(np.abs(apart.imag))))
        for apart in (b - a, b - turn * a)
    )
    if scatter_m < _SCATTER_M or left_m > scatter_m / 2:
        return None
    return (
        f"turned by {np.degrees(np.angle(turn)):.0f} degrees about the vertical its poses would lie within "
        f"{left_m:.1f} m of them, not {scatter_m:.1f} m: its world is not against north, as that of visual "
        "odometry, and what it sees is put elsewhere; record its poses against north, or tf from such a world"
    )
