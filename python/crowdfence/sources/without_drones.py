"""Recordings without the frames of drones that saw nothing: a covered lens, a detector that failed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from crowdfence.sources.recording import Recording


def without_drones(recording: Recording, drones: Sequence[str]) -> Recording:
    """As if these drones had not flown; the manifest and a warning for each say so.

    ValueError for a drone that the recording has not, and where none would be left.
    """
    unknown = [drone for drone in drones if drone not in recording.drones]
    if unknown:
        raise ValueError(
            f"{recording.name} has no drone {unknown[0]!r} to leave out; it holds "
            f"{', '.join(recording.drones) or 'none'}"
        )
    kept = tuple(drone for drone in recording.drones if drone not in drones)
    if not kept:
        raise ValueError(f"{recording.name} holds {', '.join(recording.drones)}; one of them must be left")
    left_out = [drone for drone in recording.drones if drone in drones]
    counts = {drone: sum(frame.drone == drone for frame in recording.frames) for drone in left_out}
    said = tuple(f"{drone} is left out, as asked: {count} frames" for drone, count in counts.items())
    return replace(
        recording,
        drones=kept,
        frames=tuple(frame for frame in recording.frames if frame.drone in kept),
        refused=tuple(one for one in recording.refused if one.drone not in left_out),
        pose_tracks={name: track for name, track in recording.pose_tracks.items() if name in kept},
        ground_contacts={name: one for name, one in recording.ground_contacts.items() if name in kept},
        warnings=(*recording.warnings, *said),
        manifest={**recording.manifest, "left_out": left_out},
    )
