"""Places the camera, a step that all sources share: images as found + the camera's track -> frames, each with
the pose at its stamp, or the reason why not."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from crowdfence._core import Camera
from crowdfence.sources.pose_track import PoseGapError, PoseTrack
from crowdfence.sources.recorded_truth import FrameTruth
from crowdfence.sources.recording import Frame, PixelSources, RefusedFrame
from crowdfence.sources.stamps import stamp_faults


@dataclass(frozen=True, slots=True)
class Limits:
    """What a frame has to keep to."""

    max_pose_gap_s: float = 0.25
    """Longest stretch between two telemetry rows that a pose is interpolated over. At 5 m/s2 a straight line
    over 0.25 s is at most 4 cm off, over 1 s already 0.6 m."""
    max_jump_s: float = 3600.0
    """Longest pause between two frames of a drone; beyond it the clock is not believed, unless several frames
    show within a day that the drone is back."""

    def __post_init__(self) -> None:
        for name in ("max_pose_gap_s", "max_jump_s"):
            value = getattr(self, name)
            if not value > 0:
                raise ValueError(f"{name} must be positive, got {value}")


def bridged_s(track: PoseTrack, most_s: float) -> float:
    """Longest pause of a live track that a pose is interpolated over: as in a recording, or half as much
    again as is usual in it, at most `most_s`. A drone turns by a right angle in half a second."""
    usual_s = float(np.median(np.diff(track.stamps_ns))) / 1e9 if len(track) > 1 else 0.0
    return min(max(Limits().max_pose_gap_s, 1.5 * usual_s), most_s)


@dataclass(frozen=True, slots=True)
class UnplacedFrame:
    """One image as a source found it, before its pose is known."""

    stamp_ns: int
    camera: Camera | None
    pixels: PixelSources = field(default_factory=PixelSources)
    fault: str | None = None
    """Why the source itself already refuses it."""
    truth: FrameTruth = field(default_factory=FrameTruth)


def place_cameras(
    unplaced: Mapping[str, Sequence[UnplacedFrame]],
    tracks: Mapping[str, PoseTrack],
    limits: Limits,
    pose_gaps_s: Mapping[str, float] | None = None,
) -> tuple[tuple[Frame, ...], list[RefusedFrame]]:
    """Images per drone, in the order of recording -> usable frames and refused ones, both by stamp.
    `pose_gaps_s`: for some drones, over which gaps poses are bridged at least."""
    frames: list[Frame] = []
    refused: list[RefusedFrame] = []
    for drone, images in unplaced.items():
        gap_s = max(limits.max_pose_gap_s, (pose_gaps_s or {}).get(drone, 0.0))
        for outcome in _placed(drone, images, tracks.get(drone), replace(limits, max_pose_gap_s=gap_s)):
            if isinstance(outcome, Frame):
                frames.append(outcome)
            else:
                refused.append(outcome)
    frames.sort(key=lambda frame: (frame.stamp_ns, frame.drone))
    refused.sort(key=lambda frame: (frame.stamp_ns or 0, frame.drone))
    return tuple(frames), refused


def _placed(
    drone: str, images: Sequence[UnplacedFrame], track: PoseTrack | None, limits: Limits
) -> Iterable[Frame | RefusedFrame]:
    # An image that is refused anyway must not make its twin look like a repetition.
    sound = [image for image in images if image.fault is None]
    for image in images:
        if image.fault is not None:
            yield RefusedFrame(drone, image.stamp_ns, image.fault)
    faults = stamp_faults([image.stamp_ns for image in sound], limits.max_jump_s)
    for image, fault in zip(sound, faults, strict=True):
        if fault is None and image.camera is None:
            fault = "no camera intrinsics were recorded for it"
        if fault is None and track is None:
            fault = "no telemetry of this drone was recorded, or none can be read"
        if fault is not None or image.camera is None or track is None:
            yield RefusedFrame(drone, image.stamp_ns, fault or "")
            continue
        try:
            pose = track.at(image.stamp_ns, limits.max_pose_gap_s)
        except PoseGapError as error:
            yield RefusedFrame(drone, image.stamp_ns, str(error))
            continue
        yield Frame(drone, image.stamp_ns, image.camera, pose, image.pixels, image.truth)
