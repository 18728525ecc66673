"""Frames of several drones, each on its own shutter, grouped into instants."""

from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import Protocol, TypeVar


class Stamped(Protocol):
    """Anything that a drone recorded at a stamp."""

    @property
    def drone(self) -> str: ...
    @property
    def stamp_ns(self) -> int: ...


StampedT = TypeVar("StampedT", bound=Stamped)


def group_instants(frames: Iterable[StampedT], tolerance_ns: int) -> Iterator[list[StampedT]]:
    """Consecutive frames no further apart than `tolerance_ns` (first to last), at most one per drone.

    A frame that comes too late, or a second one of the same drone, opens the next group. Every frame lands in
    exactly one group. Frames with equal stamps are never split over two groups unless one drone repeats, so
    the newest stamps of the groups strictly increase as long as each drone's own stamps do: a map that takes
    one update per instant never sees the same time twice.
    """
    group: list[StampedT] = []
    in_order = sorted(frames, key=lambda frame: (frame.stamp_ns, frame.drone))
    for stamp_ns, together in groupby(in_order, key=lambda frame: frame.stamp_ns):
        batch = list(together)
        drones = {frame.drone for frame in group}
        too_late = bool(group) and stamp_ns - group[0].stamp_ns > tolerance_ns
        if too_late or any(frame.drone in drones for frame in batch):
            yield group
            group = []
        for frame in batch:
            if any(frame.drone == other.drone for other in group):
                yield group
                group = []
            group.append(frame)
    if group:
        yield group
