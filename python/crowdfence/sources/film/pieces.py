"""A flight whose film the drone split into files, each with its subtitles -> one drone again.

Files on cards end at 4 GB, after some minutes. Each piece by itself would be a drone of its own, which took
off where it begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from crowdfence.sources.geographic_track import TAKE_OFF_UNKNOWN
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.recording import Recording

_LONGEST_PAUSE_S = 1.6
"""From the last subtitle of a piece to the first of the next, which come once a second at the least."""
_FASTEST_M_PER_S = 25.0
_JITTER_M = 5.0


def joined_pieces(recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings; films that go on where one other ends are one with that, under its name and from its
    take-off. Recordings of one local frame."""
    found = list(recordings)
    while (pair := _next_pair(found)) is not None:
        first, then = pair
        found[found.index(first)] = _continued(first, then)
        found.remove(then)
    return found


def _next_pair(recordings: Sequence[Recording]) -> tuple[Recording, Recording] | None:
    """A film and the one that goes on where it ends; where several could be meant, none is."""
    pairs = [(first, then) for first in recordings for then in recordings if _goes_on(first, then)]
    for first, then in pairs:
        if sum(first is one for one, _ in pairs) == sum(then is other for _, other in pairs) == 1:
            return first, then
    return None


def _goes_on(first: Recording, then: Recording) -> bool:
    """Whether a film begins when and where another one ends, with pictures of the same size."""
    if not _timed(first) or not _timed(then) or first.georeference != then.georeference:
        return False
    pause_s, apart_m = _between(first, then)
    return 0 < pause_s <= _LONGEST_PAUSE_S and apart_m <= _JITTER_M + _FASTEST_M_PER_S * pause_s


def _timed(recording: Recording) -> bool:
    """Of a film whose subtitles tell the time of day."""
    return "zone_s" in recording.manifest and bool(len(_track(recording)))


def _between(first: Recording, then: Recording) -> tuple[float, float]:
    """Seconds and metres from the last pose of a film to the first of another."""
    end, begin = _track(first), _track(then)
    pause_s = int(begin.stamps_ns[0] - end.stamps_ns[-1]) / 1e9
    return pause_s, float(np.linalg.norm(begin.positions[0] - end.positions[-1]))


def _track(recording: Recording) -> PoseTrack:
    return recording.tracks()[recording.drones[0]]


def _continued(first: Recording, then: Recording) -> Recording:
    (drone,), (piece,) = first.drones, then.drones
    pause_s, apart_m = _between(first, then)
    a, b = _track(first), _track(then)
    track = PoseTrack(
        np.concatenate([a.stamps_ns, b.stamps_ns]),
        np.concatenate([a.positions, b.positions]),
        np.concatenate([a.quaternions, b.quaternions]),
    )
    said = (
        f"{piece} begins {pause_s:.1f} s after {drone} ends, {apart_m:.1f} m from there: it is taken as the "
        f"same flight, of {drone}"
    )
    known = {one.removeprefix(f"{drone}: ") for one in first.warnings}
    more = (
        one
        for one in then.warnings
        if one.removeprefix(f"{piece}: ") not in known and not one.endswith(TAKE_OFF_UNKNOWN)
    )
    return replace(
        first,
        frames=(*first.frames, *(replace(frame, drone=drone) for frame in then.frames)),
        refused=(*first.refused, *(replace(one, drone=drone) for one in then.refused)),
        warnings=(*first.warnings, said, *more),
        manifest={**first.manifest, "pieces": [*first.manifest.get("pieces", []), then.manifest]},
        pose_tracks={drone: track},
        longest_gap_s=max(first.longest_gap_s, then.longest_gap_s),
    )
