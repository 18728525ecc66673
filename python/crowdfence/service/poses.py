"""Where cameras are whose views come without a pose: from an autopilot's telemetry, or from ROS."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Mapping
from threading import Condition
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from crowdfence.iso_time import iso_utc
from crowdfence.service.gate import Refused
from crowdfence.service.view_lag import AHEAD_S
from crowdfence.sources.pose_offset import PoseOffset

_SETTLED_NS = 300_000_000
"""Poses that are this much newer than a view and do not tell its pose never will."""
_SECOND_NS = 1_000_000_000


class PoseTrouble(NamedTuple):
    """What is wrong with a drone's poses."""

    cause: str
    """The same while it is the same trouble, whatever the numbers in its text."""
    text: str


class PoseFeed(Protocol):
    """The poses of one drone's camera as they come."""

    changed: Condition
    """Notified after every pose; held by whoever reads or writes."""
    remedy: str
    """What to do where poses do not come, or have gaps."""

    @property
    def doubt(self) -> str | None:
        """Why its poses may be wrong, with what to do where that is known: those of another drone, say."""

    @property
    def lacks(self) -> str:
        """What has not come, while no pose is known."""

    @property
    def newest_ns(self) -> int | None:
        """Up to when poses are known."""

    @property
    def frame(self) -> str | None:
        """Name of the local frame that its poses count from; None for none so far, or a place on Earth."""

    def pose_at(self, stamp_ns: int) -> NDArray[np.float64]:
        """`world_from_camera` [4, 4]. ValueError where the poses do not say it."""


class Poses:
    """The feeds of a fleet by drone."""

    def __init__(
        self,
        feeds: Mapping[str, PoseFeed],
        *,
        wait_s: float,
        stale_s: float,
        started_ns: int,
        max_ahead_s: float = math.inf,
        offsets: Mapping[str, PoseOffset] | None = None,
    ) -> None:
        """A view waits `wait_s` for poses around its stamp; a feed that has told nothing for `stale_s` is
        stale, and one that is more than `max_ahead_s` ahead of the clock gives no pose (infinite: there is no
        clock to compare it with). `offsets`: what the poses of a drone are constantly off."""
        self.feeds, self._offsets = dict(feeds), dict(offsets or {})
        self._wait_s, self._stale_s, self._started_ns = wait_s, stale_s, started_ns
        self._max_ahead_s = max_ahead_s
        self._gaps: dict[str, tuple[int, str]] = {}
        """The last view of each drone that got no pose: when, and why."""

    @property
    def aligned(self) -> tuple[str, ...]:
        """Drones whose poses are to be put right."""
        return tuple(sorted(self._offsets))

    def aligns(self, drone: str) -> bool:
        """Whether poses of this drone need to be put right."""
        return drone in self._offsets

    def righted(self, drone: str, world_from_camera: NDArray[np.float64]) -> NDArray[np.float64]:
        """The pose that came with a view, put right. Refused (422) where it is one of the wrong time."""
        offset = self._offsets[drone]
        if offset.time_s != 0.0:
            raise Refused(
                422,
                f"pictures of {drone} are {offset.time_s:+.3f} s off its poses (--alignment), and one pose "
                "does not say where the camera was then: correct its stamps, or give telemetry",
            )
        return offset.pose(world_from_camera)

    def pose_at(self, drone: str, stamp_ns: int, now_ns: int) -> NDArray[np.float64]:
        """Wait for it; put right. Refused: 422 for a drone without a feed and a gap in the poses, 503 while
        they are late."""
        offset = self._offsets.get(drone)
        if offset is None:
            return self._recorded_at(drone, stamp_ns, now_ns)
        return offset.pose(self._recorded_at(drone, stamp_ns + round(offset.time_s * _SECOND_NS), now_ns))

    def _recorded_at(self, drone: str, stamp_ns: int, now_ns: int) -> NDArray[np.float64]:
        feed = self.feeds.get(drone)
        if feed is None:
            raise Refused(422, f"a view of {drone} needs world_from_camera: nobody else tells its pose")
        began_s = time.monotonic()
        give_up_s = began_s + self._wait_s
        with feed.changed:
            while True:
                newest_ns, reason = feed.newest_ns, ""
                waited_ns = round((time.monotonic() - began_s) * _SECOND_NS)
                ahead_s = self._ahead_s(drone, newest_ns, now_ns + waited_ns)
                if ahead_s > self._max_ahead_s:
                    raise self._gap(drone, 422, _ahead(ahead_s), now_ns)
                if newest_ns is not None and newest_ns >= stamp_ns:
                    try:
                        return feed.pose_at(stamp_ns)
                    except ValueError as error:
                        reason = str(error)
                    if newest_ns >= stamp_ns + _SETTLED_NS:
                        raise self._gap(drone, 422, reason, now_ns)
                elif newest_ns is not None:
                    reason = f"the newest pose is {(stamp_ns - newest_ns) / 1e9:.2f} s older than the view"
                else:
                    reason = f"no pose has come yet, {feed.lacks}"
                left_s = give_up_s - time.monotonic()
                if left_s <= 0.0:
                    raise self._gap(drone, 503, reason, now_ns)
                feed.changed.wait(left_s)

    def _ahead_s(self, drone: str, newest_ns: int | None, now_ns: int) -> float:
        """By how much the newest pose of a drone is later than now, as it is told and put right: the clock of
        poses is ahead where it is by both. By the second alone pictures are stamped late, as those are that
        get their stamps at the end of a slow video link."""
        if newest_ns is None:
            return -math.inf
        offset = self._offsets.get(drone)
        ahead_s = (newest_ns - now_ns) / _SECOND_NS
        return ahead_s if offset is None else min(ahead_s, ahead_s - offset.time_s)

    def _gap(self, drone: str, status: int, reason: str, now_ns: int) -> Refused:
        said = f"the pose of {drone} is not known at its view: {reason}"
        self._gaps[drone] = now_ns, said
        return Refused(status, said, 1.0 if status == 503 else 0.0)

    def frames(self) -> dict[str, str]:
        """Of the drones whose poses are local, what they count from, as far as it is known."""
        found = {drone: self.feeds[drone].frame for drone in sorted(self.feeds)}
        return {drone: frame for drone, frame in found.items() if frame is not None}

    def trouble(self, drone: str, now_ns: int) -> PoseTrouble | None:
        """What is wrong with a drone's poses now; None: nothing."""
        feed = self.feeds[drone]
        newest_ns = feed.newest_ns
        last_ns = self._started_ns if newest_ns is None else newest_ns
        if now_ns - last_ns > self._stale_s * _SECOND_NS:
            last = f"the last is of {iso_utc(newest_ns)}" if newest_ns is not None else f"none, {feed.lacks}"
            said = f"no pose of {drone} for more than {self._stale_s:g} s, {last}"
            return PoseTrouble("silent", f"{said}: its views are refused, zones stay; {feed.remedy}")
        ahead_s = self._ahead_s(drone, newest_ns, now_ns)
        if ahead_s > AHEAD_S and self._max_ahead_s < math.inf:
            then = "" if ahead_s <= self._max_ahead_s else "; its views are refused, zones stay"
            return PoseTrouble("ahead", f"poses of {drone}: {_ahead(ahead_s)}{then}")
        gap_ns, said = self._gaps.get(drone, (0, ""))
        if said and now_ns - gap_ns <= self._stale_s * _SECOND_NS:
            return PoseTrouble("gap", f"{said}; {feed.remedy}")
        doubt = feed.doubt
        return None if doubt is None else PoseTrouble(re.sub(r"\d+", "", doubt), doubt)


def _ahead(ahead_s: float) -> str:
    return (
        f"the newest is {ahead_s:.1f} s ahead of the clock of the service, and none comes before its time: "
        "each view would get the pose of an earlier moment; correct the clock that stamps them (SYSTEM_TIME "
        "of an autopilot that does not answer TIMESYNC), or that of this machine"
    )
