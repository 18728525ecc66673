"""Which pictures are compared: few enough to be quick, and seen from as many sides as the flight has."""

from __future__ import annotations

from collections.abc import Sequence

from crowdfence.alignment.ground_matches import SeenGround, shared_ground
from crowdfence.sources.recording import Frame, Recording

MOST_FRAMES = 24
"""Per drone."""
_NEXT, _ELSEWHERE, _ACROSS = 2, 3, 3
"""Pairs that every frame begins: with those that follow it, with others from all over the flight that share
ground, and with those of other drones that share most of it."""
_LEAST_SHARED = 0.25
_LEAST_SHARED_OTHERS = 0.15


def chosen_frames(recording: Recording, most: int = MOST_FRAMES) -> list[Frame]:
    """Frames with pictures, at most `most` of each drone and spread over its flight."""
    chosen: list[Frame] = []
    for drone in recording.drones:
        frames = [frame for frame in recording.frames_of(drone) if frame.pixels.image is not None]
        step = max(1.0, (len(frames) - 1) / max(1, most - 1))
        chosen += [frames[round(k * step)] for k in range(min(most, len(frames)))]
    return chosen


def frame_pairs(seen: Sequence[SeenGround]) -> list[tuple[int, int]]:
    """Numbers of frames to compare: the next ones of the same drone, others from all over the flight, and
    those of other drones, without which nothing says where the drones are against each other."""
    pairs: dict[tuple[int, int], None] = {}
    for first, ground in enumerate(seen):
        shared = {n: shared_ground(ground, other) for n, other in enumerate(seen) if n != first}
        mine = [n for n in shared if seen[n].frame.drone == ground.frame.drone]
        following = [n for n in mine if n > first][:_NEXT]
        close = [n for n in following if shared[n] > _LEAST_SHARED]
        others = [n for n in shared if n not in following and shared[n] > _LEAST_SHARED_OTHERS]
        across = sorted((n for n in others if n not in mine), key=lambda n: -shared[n])[:_ACROSS]
        pairs |= dict.fromkeys((first, n) for n in (*close, *_spread(others, _ELSEWHERE), *across))
    return list(pairs)


def _spread(numbers: Sequence[int], most: int) -> list[int]:
    if len(numbers) <= most:
        return list(numbers)
    step = len(numbers) / most
    return [numbers[int((k + 0.5) * step)] for k in range(most)]
