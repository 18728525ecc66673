"""Recorded people beside the map, of whom no figure knows: few of a large world, or all in another frame."""

from __future__ import annotations

import numpy as np

from crowdfence._core import Terrain
from crowdfence.errors import FrameError
from crowdfence.sources.recording import Recording
from crowdfence.truth.at_exposure import are_people_recorded, crowd_definition, people_at, timed_frame
from crowdfence.truth.crowd_ground import crowds_of
from crowdfence.truth.world import stand_beside


def beside_map_warning(recording: Recording, terrain: Terrain, tolerance_ms: float) -> str | None:
    """One sentence where people of crowds stand beside the map, who are in no figure. ValueError where all do
    at all times: their positions are in another frame."""
    instants = crowded = most = people = beside = 0
    for instant in recording.instants(tolerance_ms):
        try:
            frame = timed_frame(instant)
            if frame is None or not are_people_recorded(frame, recording):
                continue
            feet = people_at(frame, recording).position
        except FrameError:
            continue
        feet = feet[crowds_of(feet, **crowd_definition(recording.manifest)) >= 0]
        out = int(np.count_nonzero(stand_beside(feet, terrain)))
        instants, crowded, most = instants + 1, crowded + (out > 0), max(most, out)
        people, beside = people + len(feet), beside + out
    if not people:
        return nobody_on_map_warning(recording, terrain)
    if not beside:
        return None
    if beside == people:
        raise ValueError(
            f"all people of crowds in {recording.name} stand beside the map at all times: check frame and "
            "offset, or take a map that has ground there"
        )
    return (
        f"at {crowded} of {instants} instants people of crowds stand beside the map, up to {most} at once "
        f"({beside / people:.1%} of all): no figure counts them"
    )


def nobody_on_map_warning(recording: Recording, terrain: Terrain) -> str | None:
    """One sentence where people are recorded, and none of them ever stands on the map. In centimetres they
    are too far apart for a crowd, so that none is missed."""
    somebody = False
    for stamp_ns in recording.people.stamps_ns:
        try:
            people = recording.people.nearest(stamp_ns, 0.0)
        except (OSError, ValueError):
            continue
        if people is None or not len(people.position):
            continue
        somebody = True
        if not stand_beside(people.position, terrain).all():
            return None
    if not somebody:
        return None
    return (
        f"everybody recorded in {recording.name} stands beside the map at all times, so that no crowd is "
        "known: check frame, unit and offset of the positions"
    )
