"""A recording and its map -> what its poses are off, and how sure that is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from crowdfence._core import Terrain
from crowdfence.alignment.frame_pairs import MOST_FRAMES, chosen_frames, frame_pairs
from crowdfence.alignment.ground_matches import GroundMatches, SeenGround, match_ground, working_picture
from crowdfence.alignment.offset_fit import PRIOR, QUANTITIES, UNITS, Disagreement, Fit, fit_offsets
from crowdfence.alignment.pose_jump import PoseJump, find_jump
from crowdfence.errors import FrameError
from crowdfence.sources.ground_contact import on_ground
from crowdfence.sources.pose_offset import PoseOffset, without_offsets
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.recording import Frame, Recording

SURE_ENOUGH = {"pitch": 0.35, "yaw": 0.35, "roll": 0.35, "time": 0.05, "east": 0.5, "north": 0.5, "up": 0.5}
"""An offset counts as told up to this standard deviation, in degrees, seconds and metres."""
FEWEST_SHARED = 50
"""Matches with other drones from which a drone's east and north are told: against theirs, on the mean of all
that see the same ground."""
FEWEST_MATCHES = 100
"""Per drone."""
FEWEST_FRAMES = 6

_REACH_PX = 40.0
_FEWEST_OF_A_PAIR, _MOST_OF_A_PAIR = 5, 15
_LONGEST_ROW_S = 0.3
"""Telemetry with rows further apart does not say where a camera was a tenth of a second later."""
_WORSE, _NOISE_PX = 1.05, 0.5
"""Left-out stretches may disagree so much more than before, where little or nothing was wrong."""
_MUCH_PX, _LEAST_BETTER = 3.0, 0.75
"""Beyond so much, offsets that leave more than this part of the disagreement are not what is wrong: it is
something that changes, or ground that moves, as water does."""
_ALIKE = 0.8
_FAR_PX, _ROUNDS, _WITHIN = 6.0, 3, 2.0
"""Pictures that put the same place further apart are compared again by what was found, so often at most:
beyond `_REACH_PX` only those places were found that fit by chance. What they still tell then is nothing up to
so many standard deviations."""

Progress = Callable[[int], None]
"""Called with the number of steps done since the last call; there are `step_count` of them."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """One quantity of one drone."""

    quantity: str
    """pitch, yaw, roll, time, east, north or up: see `PoseOffset`."""
    unit: str
    value: float
    error: float
    """Standard deviation."""
    told: bool
    """Whether it is sure enough to be used."""
    why_not: str = ""


@dataclass(frozen=True, slots=True)
class DroneAlignment:
    """What was found of one drone."""

    drone: str
    pictures: int
    """How many of it were compared."""
    pictures_matched: int
    """In how many of these places of others were found again. Of the rest nothing is known: their poses may
    be so far off that nothing fits."""
    matches: int
    before_px: float
    """Median disagreement of its pictures with others, in pixels of a picture 640 wide."""
    after_px: float
    """The same by what is told, estimated from other stretches of time."""
    estimates: tuple[Estimate, ...]
    why_not: str = ""
    """Why nothing can be told of it at all."""

    @property
    def offset(self) -> PoseOffset:
        """What was told; everything else is 0."""
        told = {one.quantity: one.value for one in self.estimates if one.told}
        pitch, yaw, roll, time_s, *position = (told.get(quantity, 0.0) for quantity in QUANTITIES)
        return PoseOffset(pitch, yaw, roll, time_s, (position[0], position[1], position[2]))

    @property
    def told(self) -> bool:
        return any(one.told for one in self.estimates)


@dataclass(frozen=True, slots=True)
class Alignment:
    """What was found of a recording."""

    drones: tuple[DroneAlignment, ...]
    pictures: int
    pairs: int

    @property
    def told(self) -> bool:
        """Whether anything can be told of any drone."""
        return any(drone.told for drone in self.drones)

    def offsets(self) -> dict[str, PoseOffset]:
        """Per drone, for `sources.pose_offset.without_offsets`."""
        return {drone.drone: drone.offset for drone in self.drones if drone.told}


def align(
    recording: Recording,
    terrain: Terrain,
    *,
    most_frames: int = MOST_FRAMES,
    progress: Progress | None = None,
) -> Alignment:
    """Estimate a constant offset of attitude, time and place for every drone.

    Pictures that share ground, of one drone from different places or of several drones, are put on the map by
    their poses; constant offsets are looked for that make them agree. East and north are those of the drones
    against each other: what they all are off, no picture shows. `most_frames` pictures of each drone are
    used. Nothing is guessed: `Estimate.told` says what the pictures say, and `Alignment.told` is False where
    they say nothing at all.

    ValueError for a recording without pictures.
    """
    settled = on_ground(recording, terrain)
    found = _aligned(settled, terrain, most_frames, progress)
    for _ in range(_ROUNDS):
        if not any(one.told and one.before_px > _FAR_PX for one in found.drones):
            return found
        again = _aligned(without_offsets(settled, found.offsets()), terrain, most_frames, None)
        if not any(map(_left, found.drones, again.drones)):
            return found
        found = replace(again, drones=tuple(map(_added, found.drones, again.drones)))
    again = _aligned(without_offsets(settled, found.offsets()), terrain, most_frames, None)
    return replace(found, drones=tuple(map(_held, found.drones, again.drones)))


def _left(found: DroneAlignment, again: DroneAlignment) -> str:
    """What pictures still tell of poses that were put right by what was found; empty where that holds."""
    if again.why_not:
        return again.why_not if found.told else ""
    before = {one.quantity: one for one in found.estimates if one.told}
    for one in again.estimates:
        error = before[one.quantity].error if one.quantity in before else 0.0
        if one.told and abs(one.value) > _WITHIN * max(error, one.error):
            return (
                f"with its poses put right by what its pictures tell, these tell {one.value:+.2f} {one.unit} "
                f"of {one.quantity} more: it is too far off to be told"
            )
    return ""


def _added(found: DroneAlignment, again: DroneAlignment) -> DroneAlignment:
    """What was found, with what the pictures told beyond it."""
    before_px = found.before_px if np.isfinite(found.before_px) else again.before_px
    told = {one.quantity: one for one in found.estimates if one.told}
    estimates = []
    for one in again.estimates:
        first = told.get(one.quantity)
        if first is None:
            estimates.append(one)
        elif one.told:
            estimates.append(replace(one, value=first.value + one.value))
        else:
            estimates.append(first)
    return replace(again, before_px=before_px, estimates=tuple(estimates))


def _held(found: DroneAlignment, again: DroneAlignment) -> DroneAlignment:
    """Nothing, where the pictures never came to an end."""
    why_not = _left(found, again)
    return replace(found, estimates=(), why_not=why_not) if why_not else found


def _aligned(settled: Recording, terrain: Terrain, most_frames: int, progress: Progress | None) -> Alignment:
    """What one comparison of the pictures tells of a recording whose heights are settled."""
    frames, greys = _pictures(chosen_frames(settled, most_frames), progress or (lambda done: None))
    if not frames:
        raise ValueError(f"{settled.name} has no pictures that can be read; alignment compares pictures")
    names = sorted({frame.drone for frame in frames})
    seen = [
        SeenGround(frame, terrain, frame.world_from_camera, grey)
        for frame, grey in zip(frames, greys, strict=True)
    ]
    matches = _matches(seen)
    tracks = settled.tracks()
    found: dict[str, DroneAlignment] = {}
    while left := [name for name in names if name not in found]:
        found |= _told_or_left_out(*_of_drones(left, frames, matches), tracks, terrain, sorted(found))
    return Alignment(tuple(found[name] for name in names), len(frames), len(matches))


def step_count(recording: Recording, most_frames: int = MOST_FRAMES) -> int:
    """How many steps `align` tells its `progress` of."""
    return len(chosen_frames(recording, most_frames))


def _pictures(frames: Sequence[Frame], progress: Progress) -> tuple[list[Frame], list[NDArray[np.uint8]]]:
    read = []
    for frame in frames:
        progress(1)
        try:
            read.append((frame, working_picture(frame)))
        except FrameError:
            continue  # a damaged picture; `run` and `inspect` say which
    return [frame for frame, _ in read], [grey for _, grey in read]


def _matches(seen: Sequence[SeenGround]) -> list[GroundMatches]:
    found = [match_ground(seen[a], seen[b], (a, b), _REACH_PX) for a, b in frame_pairs(seen)]
    return [pair.thinned(_MOST_OF_A_PAIR) for pair in found if len(pair) >= _FEWEST_OF_A_PAIR]


def _counts(
    names: Sequence[str], frames: Sequence[Frame], matches: Sequence[GroundMatches]
) -> dict[str, tuple[int, int, int]]:
    """Pictures of each drone, those of them with matches, and its matches."""
    counts = dict.fromkeys(names, 0)
    matched: set[int] = set()
    for pair in matches:
        matched |= {pair.first, pair.second}
        for name in {frames[pair.first].drone, frames[pair.second].drone}:
            counts[name] += len(pair)
    pictures = Counter(frame.drone for frame in frames)
    pictures_matched = Counter(frames[number].drone for number in matched)
    return {name: (pictures[name], pictures_matched[name], counts[name]) for name in names}


def _of_drones(
    names: Sequence[str], frames: Sequence[Frame], matches: Sequence[GroundMatches]
) -> tuple[list[Frame], list[GroundMatches]]:
    """The frames of some drones, and the matches between those, numbered anew."""
    kept = [number for number, frame in enumerate(frames) if frame.drone in names]
    place = {number: k for k, number in enumerate(kept)}
    among = [
        replace(pair, first=place[pair.first], second=place[pair.second])
        for pair in matches
        if pair.first in place and pair.second in place
    ]
    return [frames[number] for number in kept], among


def _told_or_left_out(
    frames: Sequence[Frame],
    matches: Sequence[GroundMatches],
    tracks: Mapping[str, PoseTrack],
    terrain: Terrain,
    left_out: Sequence[str],
) -> dict[str, DroneAlignment]:
    """What is found of drones that are compared with one another; only those of which nothing can be told, if
    there are any: the others would be laid on their poses as if these were right. Of those whose poses jump
    the surest alone, and of those that do not hold the worst: what is wrong with one shows in others.
    `left_out` are those of which that was found before."""
    names = sorted({frame.drone for frame in frames})
    counts = _counts(names, frames, matches)
    reasons = {name: _too_little(counts[name][0], counts[name][2], left_out) for name in names}
    nothing = {
        name: DroneAlignment(name, *counts[name], np.nan, np.nan, (), why)
        for name, why in reasons.items()
        if why
    }
    if nothing:
        return nothing
    free = np.ones((len(names), 7), bool)
    for number, name in enumerate(names):
        rows_s = np.diff(tracks[name].stamps_ns) / 1e9
        free[number, 3] = len(rows_s) > 0 and float(np.median(rows_s)) <= _LONGEST_ROW_S
    disagreement = Disagreement(frames, [tracks[name] for name in names], matches, terrain)
    sure = np.array([SURE_ENOUGH[quantity] for quantity in QUANTITIES])
    fit = fit_offsets(disagreement, free, _groups(names, frames, matches), sure)
    if jumps := _jumps(names, disagreement, fit):
        name = max(jumps, key=lambda one: jumps[one].sigmas)
        before, after = _median_px(names.index(name), fit)
        return {name: DroneAlignment(name, *counts[name], before, after, (), str(jumps[name]))}
    found = {name: _drone(name, number, counts[name], fit) for number, name in enumerate(names)}
    worst = max(
        found.values(), key=lambda one: one.after_px / _allowed_px(one.before_px) if one.why_not else 0
    )
    return {worst.drone: worst} if worst.why_not else found


def _jumps(names: Sequence[str], disagreement: Disagreement, fit: Fit) -> dict[str, PoseJump]:
    found = {}
    for number, name in enumerate(names):
        mine = disagreement.drone == number
        if jump := find_jump(disagreement.stamps_ns[mine], fit.jitter[mine]):
            found[name] = jump
    return found


def _groups(
    names: Sequence[str], frames: Sequence[Frame], matches: Sequence[GroundMatches]
) -> NDArray[np.int64]:
    """Which drones are told against each other, because they see the same ground: a number for each [D]. One
    that shares too little with others is alone."""
    shared = np.zeros((len(names), len(names)), np.int64)
    for pair in matches:
        first, second = (names.index(frames[end].drone) for end in (pair.first, pair.second))
        if first != second:
            shared[first, second] += len(pair)
            shared[second, first] += len(pair)
    enough = shared.sum(axis=1) >= FEWEST_SHARED
    _, groups = connected_components(shared * enough * enough[:, None], directed=False)
    return np.asarray(groups, np.int64)


def _too_little(pictures: int, matches: int, left_out: Sequence[str]) -> str:
    if pictures < FEWEST_FRAMES:
        return f"{pictures} pictures, {FEWEST_FRAMES} are needed"
    if matches < FEWEST_MATCHES:
        without = f" without those of {', '.join(left_out)}, which are refused" if left_out else ""
        return (
            f"{matches} places could be found again in another picture{without}, {FEWEST_MATCHES} are "
            "needed: the ground has too little to recognise, or the pictures share too little of it"
        )
    return ""


def _drone(name: str, number: int, counts: tuple[int, int, int], fit: Fit) -> DroneAlignment:
    before, after = _median_px(number, fit)
    if not after <= _allowed_px(before):
        why_not = (
            f"what one part of the flight says does not hold for the rest ({before:.2f} px off before, "
            f"{after:.2f} after)"
        )
        return DroneAlignment(name, *counts, before, after, (), why_not)
    estimates = []
    for q, (quantity, unit) in enumerate(zip(QUANTITIES, UNITS, strict=True)):
        shown, told = bool(fit.shown[number, q]), bool(fit.told[number, q])
        value, error = (fit.values[number, q], fit.error[number, q]) if shown else (0.0, PRIOR[q])
        reason = "" if told else _untold(quantity, number, q, shown, fit)
        estimates.append(Estimate(quantity, unit, float(value), float(error), told, reason))
    return DroneAlignment(name, *counts, before, after, tuple(estimates))


def _allowed_px(before_px: float) -> float:
    """Up to which disagreement of left-out stretches offsets hold."""
    return min(_WORSE * before_px + _NOISE_PX, max(_MUCH_PX, _LEAST_BETTER * before_px))


def _median_px(number: int, fit: Fit) -> tuple[float, float]:
    """Disagreement of a drone's matches, before and after."""
    mine = (fit.drones == number).any(axis=1)
    before, after = (
        float(np.nanmedian(px[mine])) if np.isfinite(px[mine]).any() else np.nan
        for px in (fit.before_px, fit.after_px)
    )
    return before, after


def _untold(quantity: str, number: int, q: int, shown: bool, fit: Fit) -> str:
    if not shown and quantity == "time":
        return f"the telemetry's rows are more than {_LONGEST_ROW_S:g} s apart"
    if not shown:
        return "only other drones' pictures of the same ground can tell"
    sigma = np.sqrt(np.diag(fit.covariance))
    alike = fit.covariance[7 * number + q] / sigma / sigma[7 * number + q]
    others = [other for k, other in enumerate(QUANTITIES) if k != q and abs(alike[7 * number + k]) > _ALIKE]
    if others:
        return f"this flight cannot tell it from {' and '.join(others)}"
    return "this flight does not show it well enough"


def told_in_json(alignment: Alignment) -> dict[str, Any]:
    """All that was found, ready for JSON."""
    return {
        "pictures": alignment.pictures,
        "pairs": alignment.pairs,
        "drones": {
            one.drone: {
                "pictures": one.pictures,
                "pictures_matched": one.pictures_matched,
                "matches": one.matches,
                "before_px": _number(one.before_px),
                "after_px": _number(one.after_px),
                "why_not": one.why_not,
                "estimates": {
                    e.quantity: {
                        "value": e.value,
                        "error": e.error,
                        "unit": e.unit,
                        "told": e.told,
                        "why_not": e.why_not,
                    }
                    for e in one.estimates
                },
            }
            for one in alignment.drones
        },
    }


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None
