"""Heights that wait for the map: above the take-off, or above the ground below.

Most drones know their height above the place where they took off far better than above anything else. Where
that place is on the map, the map's ground there says how high all of it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence._core import Terrain
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.recording import Frame, GroundContact, Recording

_AROUND_M = 2.0
"""The ground this far around the take-off says how sure its height is."""


def on_ground(recording: Recording, terrain: Terrain) -> Recording:
    """The recording with the heights of its drones settled on the map; itself where none waits for it.

    `Recording.warnings` say what was found. ValueError when the map has no ground where it is needed.
    """
    if not recording.ground_contacts:
        return recording
    lifts = {drone: _Lift.of(drone, contact, terrain) for drone, contact in recording.ground_contacts.items()}
    tracks = {
        drone: lifts[drone].track(track) if drone in lifts else track
        for drone, track in recording.tracks().items()
    }
    frames = tuple(
        lifts[frame.drone].frame(frame) if frame.drone in lifts else frame for frame in recording.frames
    )
    return replace(
        recording,
        frames=frames,
        pose_tracks=tracks,
        warnings=(*recording.warnings, *(lift.said for lift in lifts.values())),
        ground_contacts={},
    )


def settled_track(drone: str, track: PoseTrack, contact: GroundContact, terrain: Terrain) -> PoseTrack:
    """One drone's track with its heights settled on the map. ValueError as for `on_ground`."""
    return _Lift.of(drone, contact, terrain).track(track)


def ground_heights(terrain: Terrain, places: ArrayLike) -> NDArray[np.float64]:
    """Height of the uppermost surface at places [N, 2] (x, y); NaN where the map has none."""
    xy = np.asarray(places, np.float64).reshape(-1, 2)
    low, high = terrain.bounds
    top = float(high[2]) + 1.0
    origins = np.column_stack([xy, np.full(len(xy), top)])
    down = np.tile([0.0, 0.0, -1.0], (len(xy), 1))
    _, metres = terrain.raycast(origins, down, top - float(low[2]) + 1.0)
    return np.where(np.isfinite(metres), top - metres, np.nan)


@dataclass(frozen=True, slots=True)
class _Lift:
    drone: str
    terrain: Terrain
    height_m: float | None
    """None: every pose by the ground below it."""
    said: str

    @classmethod
    def of(cls, drone: str, contact: GroundContact, terrain: Terrain) -> _Lift:
        if contact.place is None:
            return cls(drone, terrain, None, f"{drone}: heights above the ground below, which the map gives")
        x, y, z = contact.place
        around = np.array([(x + dx, y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
        around = np.array([x, y]) + (around - np.array([x, y])) * _AROUND_M
        heights = ground_heights(terrain, around)
        ground = float(heights[4])
        if not np.isfinite(ground):
            raise ValueError(
                f"the map has no ground at x {x:.1f}, y {y:.1f} m, where {drone} took off ({contact.said}): "
                "give the place (--take-off LAT,LON) or other heights (--heights)"
            )
        spread = float(np.nanmax(np.abs(heights - ground)))
        sure = f"which lies within {spread:.1f} m for {_AROUND_M:g} m around"
        said = f"{drone}: its take-off ({contact.said}) is put on the map's ground, {sure}"
        if contact.absolute:
            said = (
                f"{drone}: heights moved by {ground - z:+.1f} m: {contact.said} is put on the map's ground, "
                f"{sure}"
            )
        return cls(drone, terrain, ground - z, said)

    def track(self, track: PoseTrack) -> PoseTrack:
        return PoseTrack(track.stamps_ns, self._lifted(track.positions), track.quaternions)

    def frame(self, frame: Frame) -> Frame:
        pose = frame.world_from_camera.copy()
        pose[:3, 3] = self._lifted(pose[None, :3, 3])[0]
        return replace(frame, world_from_camera=pose)

    def _lifted(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        lifted = positions.copy()
        if self.height_m is not None:
            lifted[:, 2] += self.height_m
            return lifted
        ground = ground_heights(self.terrain, positions[:, :2])
        if not np.isfinite(ground).all():
            x, y = positions[int(np.argmin(np.isfinite(ground))), :2]
            raise ValueError(
                f"the map has no ground at x {x:.1f}, y {y:.1f} m below {self.drone}, whose heights count "
                "from there"
            )
        lifted[:, 2] += ground
        return lifted
