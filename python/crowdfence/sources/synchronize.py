"""Frames of several drones, each on its own shutter, grouped into instants."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import count
from typing import Generic, Protocol, TypeVar


class Stamped(Protocol):
    """Anything that a drone recorded at a stamp."""

    @property
    def drone(self) -> str: ...
    @property
    def stamp_ns(self) -> int: ...


StampedT = TypeVar("StampedT", bound=Stamped)


@dataclass(frozen=True)
class Grouped(Generic[StampedT]):
    """What became of the frames so far."""

    instants: list[list[StampedT]]
    """Groups that no later frame can join any more, in order of time."""
    late: list[StampedT]
    """Frames that came when their time was already over; they are in no group."""


class InstantGrouper(Generic[StampedT]):
    """Groups frames as they arrive.

    A group holds consecutive frames no further apart than `tolerance_ns` (first to last), at most one per
    drone. A frame that comes too long after the first, or a second one of the same drone, opens the next
    group. Frames with equal stamps are never split over two groups unless one drone repeats, so the newest
    stamps of the groups strictly increase as long as each drone's own stamps do: a map that takes one update
    per instant never sees the same time twice.

    Frames may arrive in any order, up to `max_delay_ns` after frames that are newer. Within that bound the
    groups are those of the whole recording, whatever the order of arrival; beyond it a frame is late. An
    instant is known `max_delay_ns + tolerance_ns` after its first frame at the latest, on the clock of the
    stamps.
    """

    def __init__(self, tolerance_ns: int, max_delay_ns: int) -> None:
        for name, value in (("tolerance_ns", tolerance_ns), ("max_delay_ns", max_delay_ns)):
            if value < 0:
                raise ValueError(f"{name} is {value}; it must not be negative")
        self._tolerance_ns, self._max_delay_ns = tolerance_ns, max_delay_ns
        self._arrivals = count()
        self._waiting: list[tuple[int, str, int, StampedT]] = []
        """Heap by stamp and drone; the number of arrival keeps frames themselves from being compared."""
        self._group: list[StampedT] = []
        self._newest_ns: int | None = None

    def push(self, frame: StampedT) -> Grouped[StampedT]:
        """Take in a frame; the groups that are complete now."""
        if self._newest_ns is not None and frame.stamp_ns < self._newest_ns - self._max_delay_ns:
            return Grouped([], [frame])
        heapq.heappush(self._waiting, (frame.stamp_ns, frame.drone, next(self._arrivals), frame))
        return self.advance(frame.stamp_ns)

    def advance(self, stamp_ns: int) -> Grouped[StampedT]:
        """The clock has come to `stamp_ns`, with or without a frame: the groups that are complete now."""
        if self._newest_ns is None or stamp_ns > self._newest_ns:
            self._newest_ns = stamp_ns
        over_ns = self._newest_ns - self._max_delay_ns
        instants = [group for batch in self._batches(over_ns) for group in self._join(batch)]
        # What comes from now on is stamped `over_ns` or later.
        if self._group and over_ns - self._group[0].stamp_ns > self._tolerance_ns:
            instants.append(self._take_group())
        return Grouped(instants, [])

    def flush(self) -> Grouped[StampedT]:
        """No frame follows: the groups that are left."""
        instants = [group for batch in self._batches(None) for group in self._join(batch)]
        if self._group:
            instants.append(self._take_group())
        return Grouped(instants, [])

    def _batches(self, before_ns: int | None) -> Iterator[list[StampedT]]:
        """Waiting frames stamped before `before_ns` (None: all), those with equal stamps together."""
        while self._waiting and (before_ns is None or self._waiting[0][0] < before_ns):
            stamp_ns = self._waiting[0][0]
            batch = []
            while self._waiting and self._waiting[0][0] == stamp_ns:
                batch.append(heapq.heappop(self._waiting)[-1])
            yield batch

    def _join(self, batch: list[StampedT]) -> Iterator[list[StampedT]]:
        """Adds frames of one stamp to the group; yields the groups that this completes."""
        drones = {frame.drone for frame in self._group}
        too_late = bool(self._group) and batch[0].stamp_ns - self._group[0].stamp_ns > self._tolerance_ns
        if too_late or any(frame.drone in drones for frame in batch):
            yield self._take_group()
        for frame in batch:
            if any(frame.drone == other.drone for other in self._group):
                yield self._take_group()
            self._group.append(frame)

    def _take_group(self) -> list[StampedT]:
        group, self._group = self._group, []
        return group


def group_instants(frames: Iterable[StampedT], tolerance_ns: int) -> Iterator[list[StampedT]]:
    """The groups of a whole recording, in any order given: see `InstantGrouper`."""
    grouper = InstantGrouper[StampedT](tolerance_ns, max_delay_ns=0)
    for frame in sorted(frames, key=lambda frame: (frame.stamp_ns, frame.drone)):
        yield from grouper.push(frame).instants
    yield from grouper.flush().instants
