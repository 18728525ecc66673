"""An autopilot's telemetry as poses of its camera: what a .tlog of the flight would say, as it comes."""

from __future__ import annotations

import logging
from bisect import bisect_right
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from threading import Condition
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.georeference import Georeference
from crowdfence.service.boot_clock import BootClock
from crowdfence.sources.camera_mount import CameraMount
from crowdfence.sources.film.boots import PLACE, Boot
from crowdfence.sources.film.component_clock import OF_GIMBALS, OWN_CLOCK_MS, at_autopilot_time
from crowdfence.sources.film.gimbal_turns import count_from_north, one_gimbal
from crowdfence.sources.film.merged_rows import UNSET_BODY
from crowdfence.sources.film.receivers import ADRIFT, RECEIVERS, Receivers
from crowdfence.sources.film.tlog import KINDS, gimbal_of, log_of_boots
from crowdfence.sources.geographic_track import HeightOptions, local_track
from crowdfence.sources.ground_contact import settled_track
from crowdfence.sources.place_camera import bridged_s
from crowdfence.sources.pose_noise import GivenNoise, steadied_as
from crowdfence.sources.rotation import are_unset

_LOG = logging.getLogger(__name__)
_KEPT_MS = 70_000
"""As long as a view may be late, and a little more."""
_AROUND_MS = 2500
"""Messages this far from a view say where it was taken."""
_MS_NS = 1_000_000
_OTHER_HOME_M = 5.0
"""A home so much higher or lower than the one that heights count from is another one."""
_BODY = ("ATTITUDE_QUATERNION", "ATTITUDE")
"""Kinds of messages that tell the drone's own attitude."""
_AUTOPILOTS = (0, 1)
"""Components taken for it while nobody has told a position: unsaid, and MAV_COMP_ID_AUTOPILOT1."""


@dataclass(frozen=True, slots=True)
class TelemetryOptions:
    """What telemetry does not say about itself."""

    mount: CameraMount | None = None
    """How the camera hangs, where no gimbal tells it."""
    heights: HeightOptions = field(default_factory=HeightOptions)
    max_gap_s: float = 1.0
    """Longest pause of positions that is bridged; of attitudes where they usually come so seldom."""
    noise: GivenNoise | None = None
    """What each row is off by itself; None: it is taken as it is."""


class Telemetry:
    """A pose feed (`poses.PoseFeed`). ValueError for a mission without a place on Earth."""

    frame = None
    remedy = (
        "see that its autopilot, or the router, sends to the address of --mavlink: GLOBAL_POSITION_INT and "
        "the attitudes of a gimbal, or of the drone where --mount says how the camera hangs; or send poses "
        "with the views"
    )

    def __init__(
        self, drone: str, terrain: Terrain, anchor: Georeference | None, options: TelemetryOptions
    ) -> None:
        if anchor is None:
            raise ValueError(
                f"the telemetry of {drone} says where on Earth it is, but the mission has no place there: "
                "give a map that has one, and --origin"
            )
        self._drone, self._terrain, self._anchor, self._options = drone, terrain, anchor, options
        self._messages: dict[str, deque[Any]] = {kind: deque() for kind in KINDS}
        self.changed = Condition()
        self.confused: str | None = None
        """Why what is heard may be of another drone, or of no autopilot."""
        self._receivers = Receivers()
        self._take_off_doubt: str | None = None
        """Why the heights of the last view may be wrong."""
        self._overruled = ""
        """What is said where a gimbal told another attitude of the last view than the mount."""
        self._unset = False
        """Whether nobody had set the drone's attitudes that the last view was given."""
        self.clock = BootClock()
        self._autopilot: int | None = None
        """The component that tells positions."""
        self._doubted_clock = False
        """Whether it was said that its time of day is none."""
        self._gimbals: dict[str, Counter[tuple[int, int]]] = {kind: Counter() for kind in OF_GIMBALS}
        """How often each gimbal was heard, by kind of message."""
        self._gimbal: dict[str, tuple[int, int]] = {}
        """The one of them that is taken."""
        self._several: dict[str, str] = {}
        """What is said where there are several."""
        self._others: dict[int, BootClock] = {}
        """Clocks of gimbals that are components of their own."""

    def heard(self, message: Any, now_ns: int) -> None:
        """A decoded message of the drone's autopilot or gimbal, at this moment of the service's clock."""
        with self.changed:
            kind, component = message.get_type(), message.get_srcComponent()
            if kind == PLACE and self._autopilot is None:
                self._autopilot = component
            if not self.is_autopilot(component):
                self._heard_of_another(message, kind, component, now_ns)
                self.changed.notify_all()
                return
            if kind in RECEIVERS:
                self._receivers.heard(message)
            if kind == "SYSTEM_TIME":
                self._told(message.time_unix_usec * 1000, message.time_boot_ms)
            if kind == "HOME_POSITION":
                self._messages[kind].append(message)
                while len(self._messages[kind]) > 1:
                    self._messages[kind].popleft()
            elif kind in self._messages:
                if self.clock.arrived(message.time_boot_ms, now_ns):
                    for others in self._messages.values():
                        others.clear()
                if kind not in OF_GIMBALS or self._is_of_the_gimbal(kind, message):
                    self._keep(self._messages[kind], message)
            self.changed.notify_all()

    def _is_of_the_gimbal(self, kind: str, message: Any) -> bool:
        """Whether a message is about the gimbal that counts, which is chosen as in a log: when that falls
        silent, where another one looks says nothing."""
        told, said = self._gimbals[kind], list[str]()
        told[gimbal_of(message)] += 1
        taken = one_gimbal(told, "component", said)
        if said:
            self._several[kind] = said[0]
        if taken != self._gimbal.setdefault(kind, taken):
            self._gimbal[kind] = taken
            self._messages[kind].clear()
        return gimbal_of(message) == taken

    def _told(self, unix_ns: int, boot_ms: int) -> None:
        if self.clock.told(unix_ns, boot_ms) or unix_ns == 0 or self._doubted_clock:
            return
        self._doubted_clock = True
        # Not in ISO 8601, which ends before the largest of 64 bits does.
        _LOG.warning(
            "the autopilot of %s does not know the time of day: its SYSTEM_TIME is %.0f s after 1970. Its "
            "poses are laid on the clock by TIMESYNC, or by when they arrive, which is late by their way",
            *(self._drone, unix_ns / 1e9),
        )

    def is_autopilot(self, component: int) -> bool:
        """Whether a component of the drone is taken for its autopilot."""
        return component in _AUTOPILOTS if self._autopilot is None else component == self._autopilot

    def _heard_of_another(self, message: Any, kind: str, component: int, now_ns: int) -> None:
        """Its clock is its own. Gimbals count, laid on the autopilot's by when both arrive."""
        if kind == PLACE and self.confused is None:
            self.confused = (
                f"components {self._autopilot} and {component} of {self._drone} tell positions: those of "
                f"{self._autopilot} are taken, because it was heard first; see that the autopilot alone does "
                "so, or acknowledge this where that is the autopilot"
            )
        if kind not in OF_GIMBALS or not self._is_of_the_gimbal(kind, message):
            return
        clock = self._others.setdefault(component, BootClock())
        if clock.arrived(message.time_boot_ms, now_ns):
            for one in OF_GIMBALS:
                self._messages[one].clear()
        theirs_ns, ours_ns = clock.by_arrival_ns, self.clock.by_arrival_ns
        if theirs_ns is None or ours_ns is None:
            return
        shift_ms = (theirs_ns - ours_ns) / _MS_NS
        laid = at_autopilot_time(message, shift_ms if abs(shift_ms) > OWN_CLOCK_MS else 0.0)
        self._keep(self._messages[kind], laid)

    def answered(self, sent_ns: int, boot_ns: int, now_ns: int, component: int) -> None:
        """An answer of a component to TIMESYNC."""
        with self.changed:
            if not self.is_autopilot(component):
                return
            self.clock.answered(sent_ns, boot_ns, now_ns)
            self.changed.notify_all()

    @property
    def doubt(self) -> str | None:
        if self.confused is not None:
            return self.confused
        if self._receivers.are_lost:
            return f"positions of {self._drone} {ADRIFT}"
        if self._unset:
            return f"attitudes of {self._drone} {UNSET_BODY}"
        if self._take_off_doubt is not None:
            return f"{self._drone}: {self._take_off_doubt}"
        if self._overruled:
            return f"{self._drone}: {self._overruled}"
        several = next((self._several[kind] for kind in self._telling() if kind in self._several), None)
        if several is None:
            return None
        return (
            f"{self._drone}: {several}; where that is not the one of its pictures, what they show is put "
            "elsewhere: send the other alone, or acknowledge this"
        )

    @property
    def knows_home(self) -> bool:
        """Whether the home that heights count from now was told."""
        places = self._messages[PLACE]
        return bool(self._messages["HOME_POSITION"]) and self._other_home(list(places)[-1:]) is None

    def _other_home(self, places: Sequence[Any]) -> str | None:
        """What is said where positions count their heights from another home than the one that was told: it
        was set anew, as where a drone takes off elsewhere, and one of the two is of before."""
        for home in self._messages["HOME_POSITION"]:
            for one in places if home.altitude else ():
                counted_m, told_m = (one.alt - one.relative_alt) / 1e3, home.altitude / 1e3
                if abs(counted_m - told_m) > _OTHER_HOME_M:
                    return (
                        f"its heights count from a home {counted_m:.0f} m above the sea, and the one that it "
                        f"told last (HOME_POSITION) lies at {told_m:.0f} m: home was set anew; it is asked "
                        "for, or say with --take-off where heights count from"
                    )
        return None

    def _keep(self, kept: deque[Any], message: Any) -> None:
        boot_ms = message.time_boot_ms
        if kept and boot_ms <= kept[-1].time_boot_ms:
            return  # repeated, or overtaken on its way
        kept.append(message)
        while kept[0].time_boot_ms < boot_ms - _KEPT_MS:
            kept.popleft()

    @property
    def newest_ns(self) -> int | None:
        offset_ns = self.clock.offset_ns
        newest = [self._messages[kind][-1].time_boot_ms for kind in self._telling() if self._messages[kind]]
        if offset_ns is None or len(newest) < len(self._telling()):
            return None
        return int(min(newest)) * _MS_NS + offset_ns

    @property
    def lacks(self) -> str:
        missing = [kind for kind in self._telling() if not self._messages[kind]]
        return f"no {' and no '.join(missing)}" if missing else "no time of its autopilot"

    def _telling(self) -> tuple[str, ...]:
        """The kinds of messages that a pose is made of."""
        camera = ("GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION")
        mount = self._options.mount
        if mount is not None and not mount.needs_body:
            return (PLACE,)
        told_camera, told_body = (
            next((kind for kind in kinds if self._messages[kind]), kinds[0]) for kinds in (camera, _BODY)
        )
        if mount is not None:
            return (PLACE, told_body)
        gimbal = self._messages["GIMBAL_DEVICE_ATTITUDE_STATUS"]
        if gimbal and not count_from_north(gimbal[-1].flags):
            return (PLACE, told_camera, told_body)
        return (PLACE, told_camera)

    @property
    def _needs_body(self) -> bool:
        """Whether poses follow from the drone's own attitude."""
        return any(kind in _BODY for kind in self._telling())

    def pose_at(self, stamp_ns: int) -> NDArray[np.float64]:
        offset_ns = self.clock.offset_ns
        if offset_ns is None:
            raise ValueError("no telemetry has come yet")
        at_ms = (stamp_ns - offset_ns) // _MS_NS
        self._check_gaps(at_ms)
        around = {kind: self._around(kind, at_ms) for kind in KINDS}
        first_ms = around["GLOBAL_POSITION_INT"][0].time_boot_ms
        log = log_of_boots([Boot(around, first_ms)], None, [])
        self._unset = log.body_ned is not None and self._needs_body and are_unset(log.body_ned)
        self._overruled = log.overruled(self._options.mount)
        heights = self._options.heights
        placed = local_track(log.poses(self._options.mount), heights, self._anchor)
        track = placed.track.shifted(first_ms * _MS_NS + offset_ns)
        if placed.contact is not None:
            if placed.contact.place is not None and heights.take_off is None and log.take_off is None:
                raise ValueError(
                    "its heights count from the take-off, which it has not told (HOME_POSITION): say it with "
                    "--take-off LAT,LON, or use those above the sea (--heights sea)"
                )
            other_home = self._other_home(around[PLACE]) if heights.take_off is None else None
            if placed.contact.place is not None and other_home is not None:
                raise ValueError(other_home)
            # Without a home the first of these few positions would stand for it.
            self._take_off_doubt = next(iter(placed.take_off_doubts if log.take_off else []), None)
            track = settled_track(self._drone, track, placed.contact, self._terrain)
        track = steadied_as(track, self._options.noise)
        gap_s = self._options.max_gap_s
        # Rows are as dense as attitudes, where any count; a mount against north is the same in a pause too.
        return track.at(stamp_ns, bridged_s(track, gap_s) if len(self._telling()) > 1 else gap_s)

    def _around(self, kind: str, at_ms: int) -> list[Any]:
        kept = self._messages[kind]
        if kind == "HOME_POSITION":
            return list(kept)
        return [one for one in kept if abs(one.time_boot_ms - at_ms) <= _AROUND_MS]

    def _check_gaps(self, at_ms: int) -> None:
        most_ms = self._options.max_gap_s * 1e3
        for kind in self._telling():
            times = [one.time_boot_ms for one in self._messages[kind]]
            after = bisect_right(times, at_ms)
            if after == 0:
                raise ValueError(f"{kind} does not reach back to it")
            if after < len(times) and times[after] - times[after - 1] > most_ms:
                pause_s = (times[after] - times[after - 1]) / 1e3
                raise ValueError(
                    f"{kind} has a gap of {pause_s:.2f} s there, at most {most_ms / 1e3:g} s are bridged"
                )
