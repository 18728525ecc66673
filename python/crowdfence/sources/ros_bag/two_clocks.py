"""Whether the pictures of a drone and its poses, and those of several drones, are stamped by one clock.

A bag keeps when each message arrived, on the recorder's clock, beside the stamp that its sender gave it. A
camera that counts by satellites is 18 s ahead of poses in UTC, one that nobody set is off by anything: every
picture would get the pose of another moment. Where the clock of a whole drone is off, what it saw counts as
older or newer than what others saw: a look from before a crowd came would open its ground.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

_MOST_S = 1.0
"""By which ways of messages differ: packing and sending a picture takes a part of a second."""
_NEAR_NS = 1_000_000_000
_FASTEST = 2.0
"""Arrivals that run so much faster or slower than stamps tell nothing, such as those of a file that was
written at once."""
_FEWEST = 3


@dataclass(slots=True)
class Arrivals:
    """When the messages of a topic arrived, and their stamps, in the order of recording."""

    arrived_ns: list[int] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)

    def add(self, arrived_ns: int, stamp_ns: int) -> None:
        self.arrived_ns.append(arrived_ns)
        self.stamps_ns.append(stamp_ns)

    def as_it_happened(self) -> bool:
        """Whether arrivals and stamps took about as long."""
        if len(self.stamps_ns) < _FEWEST:
            return False
        arrived_ns, stamped_ns = (max(times) - min(times) for times in (self.arrived_ns, self.stamps_ns))
        return stamped_ns <= _FASTEST * arrived_ns and arrived_ns <= _FASTEST * stamped_ns


def behind_s(pictures: Arrivals, poses: Arrivals) -> float | None:
    """By how much the stamps of pictures are behind those of poses, by when both arrived; None where that is
    no more than ways of messages differ by, or cannot be told."""
    if not pictures.as_it_happened() or not poses.as_it_happened():
        return None
    order = np.argsort(np.array(poses.arrived_ns, np.int64), kind="stable")
    came_ns = np.array(poses.arrived_ns, np.int64)[order]
    late_ns = came_ns - np.array(poses.stamps_ns, np.int64)[order]
    at_ns = np.array(pictures.arrived_ns, np.int64)
    after = np.clip(np.searchsorted(came_ns, at_ns), 1, len(came_ns) - 1)
    nearest = np.where(at_ns - came_ns[after - 1] < came_ns[after] - at_ns, after - 1, after)
    near = np.abs(came_ns[nearest] - at_ns) <= _NEAR_NS
    if np.count_nonzero(near) < _FEWEST:
        return None
    apart_ns = (at_ns - np.array(pictures.stamps_ns, np.int64) - late_ns[nearest])[near]
    apart_s = float(np.median(apart_ns)) / 1e9
    return apart_s if abs(apart_s) > _MOST_S else None


def drones_apart(
    pictures: Mapping[str, Arrivals], poses: Mapping[str, Arrivals]
) -> Iterator[tuple[str, str, float]]:
    """Drones whose stamps are of another clock than those of a drone with which most others agree: the drone,
    that one, and how many seconds it is behind. By drone, when its pictures and its poses arrived."""

    def behind(drone: str, other: str) -> float | None:
        apart_s = behind_s(pictures[drone], pictures[other])
        told_alike = poses[drone] is poses[other]  # by one topic, such as /tf
        # Pictures of one of them may be longer on their way, which its poses are not then.
        return apart_s if told_alike or behind_s(poses[drone], poses[other]) is not None else None

    if not pictures:
        return
    usual = min(pictures, key=lambda one: sum(behind(other, one) is not None for other in pictures))
    for drone in pictures:
        if (apart_s := behind(drone, usual)) is not None:
            yield drone, usual, apart_s


def drone_clock_doubt(drone: str, other: str, apart_s: float) -> str:
    """What to tell of it."""
    where, age = ("behind", "older") if apart_s > 0 else ("ahead of", "newer")
    return (
        f"by when they were recorded, the stamps of {drone} are {abs(apart_s):.1f} s {where} those of "
        f"{other}: what {drone} saw counts as so much {age}, so that looks from before a crowd came may open "
        f"its ground; set the clocks of all drones by one, or leave one out (--without {drone})"
    )


def clock_doubt(pictures_on: str, poses_on: str, apart_s: float) -> str:
    """What to tell of it, as the end of a sentence that begins with whose they are."""
    where = "behind" if apart_s > 0 else "ahead of"
    return (
        f"by when they were recorded, the stamps of {pictures_on} are {abs(apart_s):.1f} s {where} those of "
        f"{poses_on}: unless the ones were on their way so much longer, they are of two clocks, and each "
        "picture gets the pose of another moment; stamp both by one clock, or put it right by an --alignment "
        f"whose time_s is {apart_s:.2f}"
    )
