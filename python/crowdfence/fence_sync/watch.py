"""A vehicle's fence kept equal to zones that change, until somebody stops it.

Whatever goes wrong is said and tried again; the vehicle keeps the last fence that it took. Something that
lasts is said once when it begins, and again where what was said is wrong by now.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass

from crowdfence.errors import one_line
from crowdfence.fence_sync.conversation import Clock
from crowdfence.fence_sync.debounce import Debounce
from crowdfence.fence_sync.fence_error import FenceError
from crowdfence.fence_sync.fence_event import FenceEvent
from crowdfence.fence_sync.fence_item import FenceShape, key_of
from crowdfence.fence_sync.inside import is_closed
from crowdfence.fence_sync.messages import Position
from crowdfence.fence_sync.placed_zones import PlacedZones
from crowdfence.fence_sync.synchronise import FenceKeeper
from crowdfence.fence_sync.zone_source import ZonePlace
from crowdfence.iso_time import iso_utc
from crowdfence.zones import Zone

POLL_S = 0.5
LOST_S = 3.0
"""Without a word from a vehicle, which sends a heartbeat a second."""
ENDED_S = 10.0
"""A zone that had ended so long before it was read is one of another time, or a clock is wrong."""
REOPEN_S = (1.0, 30.0)
"""From a link that broke to the next try to open it, doubled every time, and the longest of them."""

_PLACES = ("vehicle_inside", "home_inside", "position_unknown", "home_unknown", "way_home_closed")
_LASTING = (
    *_PLACES,
    "not_enforced",
    "acts_inside",
    "autopilot_unknown",
    "refused_by_text",
    "zone_without_ground",
    "kept_others",
    "no_heights",
)

_EACH_BY_ITSELF = ("not_enforced", "refused_by_text", "zone_without_ground", "failed")
"""Of these there may be several, at once or in turn; texts that differ in numbers alone are one."""
_NUMBER = re.compile(r"\d+")

Tell = Callable[[FenceEvent], None]


@dataclass(frozen=True, slots=True)
class WatchPlan:
    """How often, in seconds."""

    opening_s: float = 5.0
    """Ground opens in the fence when it has been open for so long."""
    interval_s: float = 2.0
    """Between two fences."""
    check_s: float = 20.0
    """Between two readings of what the vehicle holds."""
    stale_s: float | None = None
    """Zones that are not written anew for so long are an alarm; None: they may stand for ever."""
    expires: bool = False
    """Zones end at their `valid_until` even if nobody looked again."""


class FenceWatch:
    """One vehicle and one place where zones are written."""

    def __init__(
        self,
        keeper: FenceKeeper,
        source: ZonePlace,
        plan: WatchPlan,
        tell: Tell,
        wall_ns: Callable[[], int] = time.time_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """`wall_ns` is what `valid_until` is compared with; everything else goes by the station's clock.
        `sleep` passes the time while the link is broken."""
        self._keeper, self._source, self._plan, self._tell = keeper, source, plan, tell
        self._wall_ns, self._sleep = wall_ns, sleep
        self._debounce = self._new_debounce()
        self._placed: PlacedZones | None = None
        self._alive: tuple[Zone, ...] | None = None
        self._shapes: tuple[FenceShape, ...] = ()
        self._read_s = self._checked_s = self._clock()
        self._standing: dict[tuple[str, str], FenceEvent] = {}
        self._told: dict[tuple[str, str], FenceEvent] = {}
        """As each of them was said last."""
        self._is_unsent = False
        """Whether the newest fence was refused."""
        self._reopen_at_s: float | None = None
        """While the link is broken."""
        self._reopen_after_s = REOPEN_S[0]

    @property
    def _clock(self) -> Clock:
        return self._keeper.station.clock

    @property
    def alarms(self) -> tuple[FenceEvent, ...]:
        """Those that stand."""
        return tuple(event for event in self._standing.values() if event.alarm)

    def _new_debounce(self) -> Debounce:
        return Debounce(self._plan.opening_s, self._plan.interval_s)

    def run(self, until_s: float = float("inf"), stopped: Callable[[], bool] = lambda: False) -> None:
        """Until the clock says so, or until somebody has `stopped` it, which is asked between two steps: no
        fence is left half written. The vehicle keeps the last one."""
        while self._clock() < until_s and not stopped():
            wait_s = min(POLL_S, max(0.0, until_s - self._clock()))
            try:
                if self._reopen_at_s is not None and not self._is_reopened():
                    self._read_zones()
                    self._sleep(wait_s)
                    continue
                self.step()
                self._keeper.station.listen(wait_s)
            except OSError as error:
                self._broke(error)

    def _broke(self, error: OSError) -> None:
        text = f"the link broke ({one_line(error, whole=True)}): it is opened again; the last fence stays"
        self._say_while(("link_lost",), [FenceEvent("link_lost", text, alarm=True)])
        self._reopen_at_s = self._clock() + self._reopen_after_s
        self._reopen_after_s = min(2.0 * self._reopen_after_s, REOPEN_S[1])

    def _is_reopened(self) -> bool:
        """Whether the link works again; tried when it is time. OSError."""
        if self._reopen_at_s is not None and self._clock() >= self._reopen_at_s:
            self._keeper.station.reconnect()
            self._reopen_at_s = None
        return self._reopen_at_s is None

    def step(self) -> None:
        """Everything once. OSError where the link broke."""
        self._read_zones()
        if not self._is_heard():
            return
        if (wanted := self._debounce.due(self._clock())) is not None:
            self._send(wanted)
        elif self._clock() - self._checked_s >= self._plan.check_s and self._placed is not None:
            self._check()
        elif self._shapes and self._placed is not None:
            self._say_while(
                _PLACES,
                self._keeper.whereabouts(self._shapes, self._placed.zones, self._placed.georeference),
            )

    def _read_zones(self) -> None:
        now_s = self._clock()
        if self._placed is None or self._source.has_changed():
            try:
                placed = self._source.read()
            except (OSError, ValueError) as error:
                reason = one_line(error, whole=True)
                unread = FenceEvent("zones_unreadable", f"{reason}; the last fence stays", alarm=True)
                self._say_while(("zones_unreadable",), [unread])
            else:
                if self._placed is not None:
                    if placed.georeference != self._placed.georeference:
                        self._debounce = self._new_debounce()  # another mission, in another local frame
                    for event in _of_another_mission(self._placed, placed):
                        self._tell(event)
                self._placed, self._read_s, self._alive = placed, now_s, None
                self._say_while(("zones_unreadable",), [])
                self._say_while(("zones_ended",), self._ended(placed) if self._plan.expires else [])
        stale_s = self._plan.stale_s
        if stale_s is not None and now_s - self._read_s > stale_s:
            old = FenceEvent(
                "zones_stale", f"no new zones for {stale_s:g} s; the last fence stays", alarm=True
            )
            self._say_while(("zones_stale",), [old])
        else:
            self._say_while(("zones_stale",), [])
        if self._placed is None:
            return
        alive = self._placed.at(self._wall_ns()) if self._plan.expires else self._placed.zones
        if alive != self._alive:
            self._alive = alive
            self._debounce.offer(alive, now_s)

    def _ended(self, placed: PlacedZones) -> Iterator[FenceEvent]:
        """Zones that are opened because they had ended when they were read: by the clock here."""
        now_ns = self._wall_ns()
        ended = len(placed.zones) - len(placed.at(now_ns - round(ENDED_S * 1e9)))
        if ended:
            text = (
                f"{ended} of {len(placed.zones)} zones had ended when they were read, by the clock of this "
                f"computer ({iso_utc(now_ns)}), and are open; set it, or see that somebody writes zones"
            )
            yield FenceEvent("zones_ended", text, alarm=True)

    def _is_heard(self) -> bool:
        silent_s = self._clock() - self._keeper.station.vehicle.heard_s
        lost = silent_s > LOST_S
        if lost:
            text = f"nothing was heard of the vehicle for {LOST_S:g} s; it keeps the fence that it has"
            self._say_while(("link_lost",), [FenceEvent("link_lost", text, alarm=True)])
        elif ("link_lost", "") in self._standing:
            self._say_while(("link_lost",), [])
            self._reopen_after_s = REOPEN_S[0]
            self._tell(FenceEvent("link_back", "the vehicle is heard again; its fence is read"))
            self._checked_s = float("-inf")
        return not lost

    def _send(self, zones: tuple[Zone, ...]) -> None:
        assert self._placed is not None
        try:
            report = self._keeper.put(zones, self._placed.georeference)
        except (FenceError, ValueError, OSError) as error:
            self._debounce.failed(self._clock())
            self._is_unsent = True
            self._say_while(("failed",), [FenceEvent("failed", one_line(error, whole=True), alarm=True)])
            return
        self._debounce.sent(zones, self._clock())
        self._is_unsent = False
        self._shapes, self._checked_s = report.shapes, self._clock()
        self._say_while(("failed",), [])
        self._say_while(_LASTING, [event for event in report.events if event.kind in _LASTING])
        for event in report.events:
            if event.kind not in _LASTING:
                self._tell(event)

    def _check(self) -> None:
        """Read the fence; where it is not what was written, it is written again, others' shapes kept. And
        whether it is still kept: somebody may have switched it off, or moved home into it."""
        self._checked_s = self._clock()
        if self._keeper.station.vehicle.uid:  # else it says no number, and would be waited for every time
            self._say_while(("several_vehicles",), self._keeper.strangers())
        try:
            shapes, _ = self._keeper.read()
            unkept = self._keeper.enforcement() if shapes else []
        except FenceError as error:
            self._say_while(("failed",), [FenceEvent("failed", str(error), alarm=True)])
            return
        if not self._is_unsent:
            self._say_while(("failed",), [])
        self._say_while(("not_enforced", "acts_inside", "autopilot_unknown"), unkept)
        self._keeper.find_home()
        if _keys(shapes) != _keys(self._shapes) and self._alive is not None:
            self._debounce.failed(float("-inf"))

    def _say_while(self, kinds: Collection[str], events: Iterable[FenceEvent]) -> None:
        """Say what begins, forget what has ended; what goes on was said, as long as that is not wrong now."""
        now = {_what(event): event for event in events}
        for what, event in now.items():
            if what[0] in kinds and (what not in self._standing or self._misleads(self._told[what], event)):
                self._told[what] = event
                self._tell(event)
        others = {what: event for what, event in self._standing.items() if what[0] not in kinds}
        self._standing = {**others, **{what: event for what, event in now.items() if what[0] in kinds}}

    def _misleads(self, told: FenceEvent, now: FenceEvent) -> bool:
        """Whether a vehicle that flies was told to stay down, or was sent to a place that is closed since."""
        if now.kind != "vehicle_inside" or self._placed is None:
            return False
        suggestion = now.details["suggestion"]
        place = Position(told.details["clear_latitude"], told.details["clear_longitude"])
        return suggestion != told.details["suggestion"] or (
            suggestion == "evacuate" and is_closed(place, self._shapes, self._placed.georeference)
        )


def _of_another_mission(before: PlacedZones, now: PlacedZones) -> Iterator[FenceEvent]:
    """Whether what was closed is told no more because nobody asks for it any more: a service that was started
    with another folder has seen nobody yet."""
    if before.zones and None not in (before.begun_ns, now.begun_ns) and before.begun_ns != now.begun_ns:
        yield FenceEvent(
            "another_mission",
            f"the zones are those of another mission, which began {_utc(now)}; of the one before, of "
            f"{_utc(before)}, nobody tells any more: what its {len(before.zones)} zones closed opens where "
            "none of the new ones is",
            alarm=True,
        )


def _utc(placed: PlacedZones) -> str:
    assert placed.begun_ns is not None
    return iso_utc(placed.begun_ns)


def _keys(shapes: Iterable[FenceShape]) -> list[object]:
    return [key_of(shape) for shape in shapes]


def _what(event: FenceEvent) -> tuple[str, str]:
    """What goes on as long as it is said again."""
    return event.kind, _NUMBER.sub("", event.text) if event.kind in _EACH_BY_ITSELF else ""
