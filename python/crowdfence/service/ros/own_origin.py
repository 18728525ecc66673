"""The origin of a robot's own local frame, as it tells it on a topic: its poses are brought into the frame of
the mission."""

from __future__ import annotations

from typing import Any

import numpy as np

from crowdfence.georeference import Georeference
from crowdfence.sources.moved_frame import FrameMove
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.ros_bag.told_place import told_place

_THE_SAME_M = 0.1
"""Origins that are told again, rounded otherwise, are so near to each other."""


class OwnOrigin:
    """Where on Earth the poses of a topic count from, in words of a mission at `anchor`."""

    def __init__(self, anchor: Georeference, topic: str, *, shared: bool = False) -> None:
        """`shared`: the topic says it of others' poses too."""
        self._anchor = anchor
        self.topic, self.shared = topic, shared
        self._move: FrameMove | None = None

    @property
    def is_known(self) -> bool:
        return self._move is not None

    def heard(self, message: Any) -> bool:
        """A decoded GeoPointStamped or NavSatFix; whether the origin is another one than before. ValueError
        for what is no place on Earth."""
        place = told_place(message)
        if place is None:
            return False
        move, before = FrameMove.between(Georeference(*place), self._anchor), self._move
        if before is not None and np.linalg.norm(move.shift - before.shift) < _THE_SAME_M:
            return False
        self._move = move
        return before is not None

    def moved(self, track: PoseTrack) -> PoseTrack:
        """The poses in the frame of the mission. ValueError while the origin is not known."""
        if self._move is None:
            raise ValueError(f"nothing on {self.topic} has said yet where its poses count from")
        return self._move.track(track)
