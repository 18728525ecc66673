"""Which pictures are compared: few enough to be quick, and seen from as many sides as the flight has."""

from __future__ import annotations

from collections.abc import Sequence

from crowdfence.alignment.ground_matches import SeenGround, shared_ground
from crowdfence.sources.recording import Frame, Recording

MOST_FRAMES = 24
"""Per drone."""
_NEXT, _OTHERS = 2, 3
"""Pairs that every frame begins: with those that follow it, and with others that share ground."""
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
    """Numbers of frames to compare: the next ones of the same drone, and others from all over the flight."""
    pairs: list[tuple[int, int]] = []
    for first, ground in enumerate(seen):
        same = [n for n in range(first + 1, len(seen)) if seen[n].frame.drone == ground.frame.drone][:_NEXT]
        close = [n for n in same if shared_ground(ground, seen[n]) > _LEAST_SHARED]
        others = [
            n
            for n in range(len(seen))
            if n != first and n not in same and shared_ground(ground, seen[n]) > _LEAST_SHARED_OTHERS
        ]
        pairs += [(first, n) for n in (*close, *_spread(others, _OTHERS))]
    return pairs


def _spread(numbers: Sequence[int], most: int) -> list[int]:
    if len(numbers) <= most:
        return list(numbers)
    step = len(numbers) / most
    return [numbers[int((k + 0.5) * step)] for k in range(most)]
