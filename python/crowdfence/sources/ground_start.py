"""Drones that stood on the ground at their first pose: what that says of their heights."""

from __future__ import annotations

from dataclasses import replace

from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.recording import GroundContact, Recording

_STOOD_M = 5.0
"""So far above its own take-off, or below, a drone does not stand there: barometers drift by less."""


def from_the_ground(recording: Recording) -> Recording:
    """The recording with heights that wait for the map's ground at every drone's first pose.

    Not moved are those that count from the ground below, and those of a drone that by its own height above
    the take-off had begun in flight; a warning says so.
    """
    contacts = dict(recording.ground_contacts)
    left_alone: list[str] = []
    for drone, track in recording.tracks().items():
        if not len(track):
            continue
        found = _first_pose(track, contacts.get(drone))
        if isinstance(found, str):
            left_alone.append(f"{drone}: --ground-start moves nothing, {found}")
        else:
            contacts[drone] = found
    return replace(recording, ground_contacts=contacts, warnings=(*recording.warnings, *left_alone))


def _first_pose(track: PoseTrack, waiting: GroundContact | None) -> GroundContact | str:
    """The contact of a drone whose heights wait for another one, or for none; or why there is none."""
    x, y, z = (float(value) for value in track.positions[0])
    if waiting is None:
        return GroundContact((x, y, z), "its first pose", absolute=True)
    if waiting.place is None:
        return "its heights count from the ground below at every moment"
    above_m = z - waiting.place[2]
    if abs(above_m) > _STOOD_M:
        return f"it begins {above_m:+.0f} m from the height of its take-off"
    said = f"its first pose, {above_m:+.1f} m from there by its own height"
    return GroundContact((x, y, z), said, absolute=waiting.absolute)
