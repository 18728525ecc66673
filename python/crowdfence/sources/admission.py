"""The step that all sources share: images as found + the camera's track -> frames, or the reason why not."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

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
    """Longest pause between two frames of a drone; beyond it the clock is not believed."""

    def __post_init__(self) -> None:
        for name in ("max_pose_gap_s", "max_jump_s"):
            value = getattr(self, name)
            if not value > 0:
                raise ValueError(f"{name} must be positive, got {value}")


@dataclass(frozen=True, slots=True)
class Capture:
    """One image as a source found it, before its pose is known."""

    stamp_ns: int
    camera: Camera | None
    pixels: PixelSources = field(default_factory=PixelSources)
    fault: str | None = None
    """Why the source itself already refuses it."""
    truth: FrameTruth = field(default_factory=FrameTruth)


def admit(
    captures: Mapping[str, Sequence[Capture]], tracks: Mapping[str, PoseTrack], limits: Limits
) -> tuple[tuple[Frame, ...], list[RefusedFrame]]:
    """Captures per drone, in the order of recording -> usable frames and refused ones, both by stamp."""
    frames: list[Frame] = []
    refused: list[RefusedFrame] = []
    for drone, found in captures.items():
        for outcome in _admit_drone(drone, found, tracks.get(drone), limits):
            if isinstance(outcome, Frame):
                frames.append(outcome)
            else:
                refused.append(outcome)
    frames.sort(key=lambda frame: (frame.stamp_ns, frame.drone))
    refused.sort(key=lambda frame: (frame.stamp_ns or 0, frame.drone))
    return tuple(frames), refused


def _admit_drone(
    drone: str, captures: Sequence[Capture], track: PoseTrack | None, limits: Limits
) -> Iterable[Frame | RefusedFrame]:
    # A capture that is refused anyway must not make its twin look like a repetition.
    sound = [capture for capture in captures if capture.fault is None]
    for capture in captures:
        if capture.fault is not None:
            yield RefusedFrame(drone, capture.stamp_ns, capture.fault)
    faults = stamp_faults([capture.stamp_ns for capture in sound], limits.max_jump_s)
    for capture, fault in zip(sound, faults, strict=True):
        if fault is None and capture.camera is None:
            fault = "no camera intrinsics were recorded for it"
        if fault is None and track is None:
            fault = "no telemetry was recorded for this drone"
        if fault is not None or capture.camera is None or track is None:
            yield RefusedFrame(drone, capture.stamp_ns, fault or "")
            continue
        try:
            pose = track.at(capture.stamp_ns, limits.max_pose_gap_s)
        except PoseGapError as error:
            yield RefusedFrame(drone, capture.stamp_ns, str(error))
            continue
        yield Frame(drone, capture.stamp_ns, capture.camera, pose, capture.pixels, capture.truth)
