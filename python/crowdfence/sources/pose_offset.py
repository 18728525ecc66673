"""Constant errors of a drone's poses, and recordings without them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.placed_again import placed_again
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.recording import Recording
from crowdfence.sources.rotation import multiply, rotation_matrix


@dataclass(frozen=True, slots=True)
class PoseOffset:
    """What one drone's recorded camera poses need to be right, all the time the same.

    The camera was where the telemetry says `time_s` later, moved by `position_m`, and turned about its own
    axes there: up, to the right, and clockwise as seen from behind it. ValueError for values that are not
    finite.
    """

    pitch_deg: float = 0.0
    """About the camera's x axis: looks higher."""
    yaw_deg: float = 0.0
    """About the camera's y axis: looks further to the right."""
    roll_deg: float = 0.0
    """About the camera's z axis: its right side sinks."""
    time_s: float = 0.0
    """The picture belongs to telemetry so much later than its stamp."""
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """East, north, up."""

    def __post_init__(self) -> None:
        values = (self.pitch_deg, self.yaw_deg, self.roll_deg, self.time_s, *self.position_m)
        if len(values) != 7 or not np.isfinite(values).all():
            raise ValueError(f"a pose offset needs finite angles, time and three metres, got {values}")

    @property
    def turn(self) -> NDArray[np.float64]:
        """Quaternion [4] (w, x, y, z), recorded from true camera axes: to be multiplied from the right."""
        vector = np.radians([self.pitch_deg, self.yaw_deg, self.roll_deg])
        angle = float(np.linalg.norm(vector))
        return np.array([np.cos(angle / 2), *(np.sinc(angle / 2 / np.pi) / 2 * vector)])

    def pose(self, world_from_camera: NDArray[np.float64]) -> NDArray[np.float64]:
        """One pose [4, 4] of the right time as it was."""
        righted = np.array(world_from_camera, np.float64)
        righted[:3, :3] = righted[:3, :3] @ rotation_matrix(self.turn)
        righted[:3, 3] += self.position_m
        return righted

    def track(self, track: PoseTrack) -> PoseTrack:
        """The poses as they were, on the clock of the pictures."""
        if len(track) == 0:
            return track
        return PoseTrack(
            track.stamps_ns - np.int64(round(self.time_s * 1e9)),
            track.positions + np.array(self.position_m),
            multiply(track.quaternions, self.turn),
        )


def without_offsets(recording: Recording, offsets: Mapping[str, PoseOffset]) -> Recording:
    """The recording with every drone's poses put right; drones that are not named stay as they are.

    A frame that its time offset moves out of the telemetry is refused. ValueError for a drone that the
    recording has not, and for one whose poses were put right by the same offset before (`convert` keeps it in
    the file). The manifest tells what was put right.
    """
    unknown = sorted(set(offsets) - set(recording.drones))
    if unknown:
        raise ValueError(
            f"the alignment is of another recording: {recording.name} has no drone {unknown[0]!r}, it holds "
            f"{', '.join(recording.drones) or 'none'}; if it is the same flight, mend the name in the "
            "alignment or take that drone out of it"
        )
    righted_before = {drone: alignments_of(recording.manifest, drone) for drone in offsets}
    if twice := [drone for drone, offset in offsets.items() if _told(offset) in righted_before[drone]]:
        raise ValueError(
            f"the poses of {twice[0]} in {recording.name} were put right by this alignment before: it would "
            "move them once more; leave the alignment out"
        )
    tracks = recording.tracks()
    righted = {drone: offset.track(tracks[drone]) for drone, offset in offsets.items() if drone in tracks}
    told = {drone: [*righted_before[drone], _told(offset)] for drone, offset in offsets.items()}
    others = recording.manifest.get("alignment")
    alignment = {**(others if isinstance(others, Mapping) else {}), **told}
    manifest = {**recording.manifest, "alignment": alignment}
    return replace(placed_again(recording, righted, "its time offset"), manifest=manifest)


def alignments_of(manifest: Mapping[str, Any], drone: str) -> list[Any]:
    """By what the poses of a drone were put right already, one after the other."""
    told = manifest.get("alignment")
    found = told.get(drone) if isinstance(told, Mapping) else None
    return found if isinstance(found, list) else []


def _told(offset: PoseOffset) -> dict[str, Any]:
    """As JSON gives it back."""
    return {**asdict(offset), "position_m": list(offset.position_m)}
