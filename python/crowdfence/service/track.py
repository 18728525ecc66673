"""Where a drone's camera was, for as long as a flight lasts, in little memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera

_ROW = np.dtype([("stamp_ns", "<i8"), ("pose", "<f8", (3, 4)), ("picture", "?"), ("heatmap", "?")])
_FIRST_ROOM = 64


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A camera at a stamp."""

    stamp_ns: int
    camera: Camera
    world_from_camera: NDArray[np.float64]
    picture: bool
    heatmap: bool


class Track:
    """Sightings of one drone in the order of their stamps; beyond `most` the older half goes. 114 bytes each
    while the camera stays the same."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._rows = np.zeros(min(_FIRST_ROOM, most), _ROW)
        self._cameras: list[Camera] = []
        self.has_forgotten = False
        """Whether there were sightings before those that it holds."""

    def __len__(self) -> int:
        return len(self._cameras)

    def add(self, sighting: Sighting) -> None:
        """One that is not newer than the newest is left out."""
        count = len(self)
        if count and sighting.stamp_ns <= self._rows["stamp_ns"][count - 1]:
            return
        if count == len(self._rows):
            count = self._make_room(count)
        pose = sighting.world_from_camera[:3]
        self._rows[count] = (sighting.stamp_ns, pose, sighting.picture, sighting.heatmap)
        same = bool(self._cameras) and self._cameras[-1] == sighting.camera
        self._cameras.append(self._cameras[-1] if same else sighting.camera)

    def _make_room(self, count: int) -> int:
        if count < self._most:
            larger = np.zeros(min(2 * count, self._most), _ROW)
            larger[:count] = self._rows
            self._rows = larger
            return count
        self.has_forgotten = True
        gone = (count + 1) // 2
        self._rows[: count - gone] = self._rows[gone:].copy()
        del self._cameras[:gone]
        return count - gone

    def at(self, stamp_ns: int | None = None) -> Sighting | None:
        """The newest of that stamp or before, or of all."""
        count = self.count_until(stamp_ns)
        if count == 0:
            return None
        row = self._rows[count - 1]
        world_from_camera = np.eye(4)
        world_from_camera[:3] = row["pose"]
        camera = self._cameras[count - 1]
        return Sighting(
            int(row["stamp_ns"]), camera, world_from_camera, bool(row["picture"]), bool(row["heatmap"])
        )

    def newest(self, count: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Stamps [<= count], rising, and positions [<= count, 3] of the newest."""
        rows = self._rows[max(0, len(self) - count) : len(self)]
        return rows["stamp_ns"].copy(), np.ascontiguousarray(rows["pose"][:, :, 3])

    def count_until(self, stamp_ns: int | None) -> int:
        if stamp_ns is None:
            return len(self)
        return int(np.searchsorted(self._rows["stamp_ns"][: len(self)], stamp_ns, side="right"))

    def trail(self, stamp_ns: int | None, points: int) -> NDArray[np.float64]:
        """Positions [<= points, 3] up to then, evenly thinned, the newest among them."""
        return np.ascontiguousarray(self._thinned(self.count_until(stamp_ns), points)[:, :, 3])

    def turns(self, points: int) -> NDArray[np.float64]:
        """Rotations [<= points, 3, 3] of all, from camera to world, thinned likewise."""
        return np.ascontiguousarray(self._thinned(len(self), points)[:, :, :3])

    def _thinned(self, count: int, points: int) -> NDArray[np.float64]:
        """Poses [<= points, 3, 4] among the first `count`."""
        stride = max(1, -(-count // points))
        poses: NDArray[np.float64] = self._rows["pose"][np.arange(count - 1, -1, -stride)[::-1]]
        return poses
