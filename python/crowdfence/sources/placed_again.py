"""Frames whose drone was elsewhere than the recording says: the same pictures on other pose tracks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from crowdfence.sources.place_camera import Limits
from crowdfence.sources.pose_track import PoseGapError, PoseTrack
from crowdfence.sources.recording import Frame, Recording, RefusedFrame


def placed_again(recording: Recording, tracks: Mapping[str, PoseTrack], moved_by: str) -> Recording:
    """The recording with every frame of the drones in `tracks` where these say; the others stay as they are.

    A frame that lies outside of its new track is refused, with `moved_by` as the reason.
    """
    limits = {drone: widest_gap_s(recording, drone) for drone in tracks}
    frames: list[Frame] = []
    refused = list(recording.refused)
    for frame in recording.frames:
        if frame.drone not in tracks:
            frames.append(frame)
            continue
        try:
            pose = tracks[frame.drone].at(frame.stamp_ns, limits[frame.drone])
        except PoseGapError as error:
            refused.append(RefusedFrame(frame.drone, frame.stamp_ns, f"moved by {moved_by}: {error}"))
            continue
        frames.append(replace(frame, world_from_camera=pose))
    pose_tracks = {**recording.tracks(), **tracks}
    return replace(recording, frames=tuple(frames), refused=tuple(refused), pose_tracks=pose_tracks)


def widest_gap_s(recording: Recording, drone: str) -> float:
    """What the reader bridged for a drone: the widest gap around any frame that it took."""
    stamps = recording.tracks()[drone].stamps_ns if drone in recording.tracks() else np.zeros(0, np.int64)
    widest = Limits().max_pose_gap_s
    if len(stamps) < 2:
        return widest
    at = np.array([frame.stamp_ns for frame in recording.frames if frame.drone == drone], np.int64)
    after = np.clip(np.searchsorted(stamps, at), 1, len(stamps) - 1)
    between = (stamps[after] != at) & (stamps[after - 1] != at)
    gaps = (stamps[after] - stamps[after - 1])[between] / 1e9
    return max(widest, float(gaps.max(initial=0.0)))
