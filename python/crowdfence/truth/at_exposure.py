"""The world when a frame was exposed: where everybody and the ground of the crowds was, and the camera."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import FrameError
from crowdfence.sources.recorded_truth import RecordedPeople
from crowdfence.sources.recording import Frame, Instant, Recording
from crowdfence.truth.world import OffTerrain, truth_from_positions

if TYPE_CHECKING:
    from crowdfence._core import Terrain

MAX_PEOPLE_GAP_S = 0.25
"""Largest time between an exposure and the recorded instant of the world: people walk 0.4 m in it."""
DEFAULT_CROWD = {"radius_m": 2.0, "min_people": 3}


def crowd_definition(manifest: dict[str, Any]) -> dict[str, Any]:
    """`radius_m` and `min_people` that a simulated recording was labelled with; else three within 2 m.
    ValueError for values that define no crowd."""
    given: Any = manifest
    for key in ("simulation", "scenario", "crowd_definition"):
        given = given.get(key) if isinstance(given, dict) else None
    if not isinstance(given, dict):
        return dict(DEFAULT_CROWD)
    definition = {name: given.get(name, default) for name, default in DEFAULT_CROWD.items()}
    radius_m, min_people = definition["radius_m"], definition["min_people"]
    if type(radius_m) not in (int, float) or not 0.0 < radius_m < float("inf"):
        raise ValueError(f"the recorded crowd_definition.radius_m is {radius_m!r}; allowed: metres above 0")
    if type(min_people) is not int or min_people < 1:
        raise ValueError(
            f"the recorded crowd_definition.min_people is {min_people!r}; allowed: a whole number from 1 on"
        )
    return definition


def timed_frame(instant: Instant) -> Frame | None:
    """The last frame of an instant of which it is known when it was exposed; None where it is of none."""
    for frame in reversed(instant.frames):
        try:
            frame.exposure_ns()
        except FrameError:
            continue
        return frame
    return None


def are_people_recorded(frame: Frame, recording: Recording) -> bool:
    """Whether `people_at` knows anything when `frame` was exposed. FrameError when that time is damaged."""
    return recording.people.nearest_ns(frame.exposure_ns(), MAX_PEOPLE_GAP_S) is not None


def instants_with_people(recording: Recording, tolerance_ms: float) -> Iterator[bool | None]:
    """Of one instant after the other, whether anybody's position is recorded there; None where no frame says
    when that was."""
    for instant in recording.instants(tolerance_ms):
        frame = timed_frame(instant)
        yield None if frame is None else are_people_recorded(frame, recording)


def people_at(frame: Frame, recording: Recording) -> RecordedPeople:
    """Everybody when `frame` was exposed. FrameError when nobody's position is recorded then, or damaged."""
    exposure_ns = frame.exposure_ns()
    try:
        people = recording.people_truth(exposure_ns, max_gap_s=MAX_PEOPLE_GAP_S)
    except (OSError, ValueError) as error:
        reason = f"people of the world cannot be read: {error}"
        raise FrameError(frame.drone, frame.stamp_ns, reason) from error
    if people is None:
        raise FrameError(
            frame.drone,
            frame.stamp_ns,
            f"nobody's position is recorded within {MAX_PEOPLE_GAP_S} s of the exposure",
        )
    return people


def crowd_ground_at(
    frame: Frame, recording: Recording, terrain: Terrain, off_terrain: OffTerrain = "refuse"
) -> NDArray[np.bool_]:
    """Voxels [V] that crowds stand on when `frame` was exposed, seen or not (`truth_from_positions`).

    FrameError when nobody's position is recorded then; ValueError when people of a crowd stand on no voxel.
    """
    return crowd_ground_of(people_at(frame, recording), recording, terrain, off_terrain)


def crowd_ground_of(
    people: RecordedPeople, recording: Recording, terrain: Terrain, off_terrain: OffTerrain = "refuse"
) -> NDArray[np.bool_]:
    """Voxels [V] that the crowds among `people` stand on, by the definition of a crowd in `recording`."""
    definition = crowd_definition(recording.manifest)
    return truth_from_positions(people.position, terrain, **definition, off_terrain=off_terrain)


def true_camera_pose(frame: Frame) -> NDArray[np.float64]:
    """world_from_camera [4, 4] as it was, where recorded; else as the recording has it."""
    return frame.world_from_camera if frame.truth.pose is None else frame.true_pose().world_from_camera()
