"""Which live views are taken: whose clock is right, whose fleet it is, and how many at once.

Each drone has its own room, so that one that floods only stops itself."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from threading import Lock

from crowdfence.errors import beyond
from crowdfence.legible import unreadable
from crowdfence.service.alerts import CALM_S, Alerts
from crowdfence.service.clock import Clock, steady_s
from crowdfence.service.guard import Rate
from crowdfence.service.heard import UNKNOWN
from crowdfence.service.settings import ServiceSettings
from crowdfence.sources.stamp_unit import THIS_CENTURY_S, unit_hint, unit_warning

_SECOND_NS = 1_000_000_000
_FUTURE_OF_VIEWS_S = 3600.0
"""With the clock of the views a stamp may be this far ahead: the crowd map takes more for a wrong clock."""
_STAMPS_OF_A_DRONE = 8
_MORE_ROOM_EVERY_S = 5.0
"""One view of each drone more, after there was room for one alone: all at once would be too many again."""
_LATEST_NS = THIS_CENTURY_S.stop * _SECOND_NS
"""A first stamp beyond the year 2096 is a wrong clock: nobody else could give a view behind it."""


class Refused(ValueError):
    """A view that is not taken; nothing of it was kept."""

    def __init__(self, status: int, reason: str, again_s: float = 0.0) -> None:
        super().__init__(reason)
        self.status, self.reason, self.again_s = status, reason, again_s


class Gate:
    """`enter` before a view is journaled, `leave` once it is in the map or was not kept."""

    def __init__(
        self,
        clock: Clock,
        alerts: Alerts,
        settings: ServiceSettings,
        *,
        fleet: Callable[[], Iterable[str]],
        last_view_ns: Mapping[str, int],
        most_drones: int,
    ) -> None:
        """`fleet`: the drones that have a view on disk or are expected; not those of views on the way.
        `last_view_ns`: the newest stamp of each that was accepted."""
        self._clock, self._alerts, self._settings = clock, alerts, settings
        self._fleet, self._last_view_ns, self._most_drones = fleet, last_view_ns, most_drones
        self._rate = Rate(settings.views_per_s)
        self._on_the_way: Counter[str] = Counter()
        self._stamps_ns: dict[str, deque[int]] = {}
        """Newest of each drone, taken or not, where their clock is all that tells time."""
        self.behind_s: Callable[[], float] = lambda: 0.0
        """How long views wait for their turn."""
        self._room, self._since_s = settings.waiting_per_drone, 0.0
        """For views of each drone that wait, and since when."""
        self._counting = Lock()

    def enter(self, drone: str, stamp_ns: int) -> None:
        """Refused."""
        if wrong := _wrong_name(drone):
            self._tell(UNKNOWN, stamp_ns, wrong)
            raise Refused(422, wrong)
        self._check_stamp(drone, stamp_ns)
        # Together: two newcomers must not both find the last place of the fleet free.
        with self._counting:
            self._check_fleet(drone, stamp_ns)
            self._check_unit(drone, stamp_ns)
            self._reserve(drone, stamp_ns)

    def leave(self, drone: str) -> None:
        with self._counting:
            self._on_the_way[drone] -= 1
            if self._on_the_way[drone] <= 0:
                del self._on_the_way[drone]

    def _check_stamp(self, drone: str, stamp_ns: int) -> None:
        now_ns = self._clock.now_ns()
        by_views = self._clock.kind == "views"
        if by_views and now_ns == 0:
            if stamp_ns > _LATEST_NS:
                raise Refused(422, f"{drone} stamps {stamp_ns} ns, beyond the year 2096: its clock is wrong")
            return
        ahead_s = _FUTURE_OF_VIEWS_S if by_views else self._settings.max_ahead_s
        off_s = (stamp_ns - now_ns) / _SECOND_NS
        if -self._settings.max_age_s <= off_s <= ahead_s:
            if not by_views:
                self._alerts.clear("clock", now_ns, drone=drone, calm_s=CALM_S)
            return
        last_ns = dict(self._last_view_ns) if by_views and off_s < 0.0 else {}
        leader = max(last_ns, key=last_ns.__getitem__, default=None)
        led = ""
        if leader is not None:
            led = f", which is the newest stamp, {'its own' if leader == drone else f'of {leader}'}"
        side, most_s = ("ahead of", ahead_s) if off_s > 0.0 else ("behind", self._settings.max_age_s)
        reason = (
            f"{drone} is {beyond(abs(off_s), most_s)} s {side} the clock of the service{led}; at most "
            f"{most_s:g} s are taken" + unit_hint(stamp_ns)
        )
        if leader is not None and self._raised_of_leader(leader, last_ns, drone, stamp_ns):
            raise Refused(422, reason)
        self._alerts.raise_("clock", "alarm", reason, now_ns, drone=drone, measure=abs(off_s))
        raise Refused(422, reason)

    def _raised_of_leader(self, leader: str, last_ns: Mapping[str, int], drone: str, stamp_ns: int) -> bool:
        """Whether a view would be taken but for the stamps of one drone, which is ahead of all others: the
        alarm is of that one, not of those that it leaves behind."""
        others_ns = max((last for name, last in last_ns.items() if name != leader), default=None)
        most_s = self._settings.max_age_s
        if others_ns is None or (stamp_ns - others_ns) / _SECOND_NS < -most_s:
            return False
        apart_s = (last_ns[leader] - others_ns) / _SECOND_NS
        if apart_s <= most_s:
            return False
        text = (
            f"{leader} stamps {apart_s:.1f} s later than any other drone, and the newest stamp is the clock "
            f"of the service (--clock views): {drone}, and whoever else is more than {most_s:g} s behind, is "
            f"refused until its stamps come near; correct the clock of {leader}, and begin anew in another "
            "folder, because this one keeps its stamp"
        )
        self._alerts.raise_("clock", "alarm", text, self._clock.now_ns(), drone=leader, measure=apart_s)
        return True

    def _check_unit(self, drone: str, stamp_ns: int) -> None:
        """On the clock of the views nothing else shows that it runs a thousand times too slowly, so that
        nothing ever gets old. Held against what was heard, not what was taken: a pause of those that are
        refused would look like one of a slow camera."""
        if self._clock.kind != "views":
            return
        heard = self._stamps_ns.setdefault(drone, deque(maxlen=_STAMPS_OF_A_DRONE))
        if stamp_ns not in heard:
            heard.append(stamp_ns)
        now_ns = self._clock.now_ns() or stamp_ns
        try:
            doubt = unit_warning(drone, heard)
        except ValueError as error:
            self._alerts.raise_("clock", "alarm", str(error), now_ns, drone=drone)
            raise Refused(422, str(error)) from error
        if doubt is None:
            self._alerts.clear("clock", now_ns, drone=drone, calm_s=CALM_S)
        else:
            self._alerts.raise_("clock", "alarm", doubt, now_ns, drone=drone)

    def _check_fleet(self, drone: str, stamp_ns: int) -> None:
        known = {*self._fleet(), *self._on_the_way}
        if drone not in known and len(known) >= self._most_drones:
            reason = f"{drone} would be drone {len(known) + 1}; this fleet has {self._most_drones} at most"
            self._tell(UNKNOWN, stamp_ns, reason)
            raise Refused(422, reason)

    def _reserve(self, drone: str, stamp_ns: int) -> None:
        wait_s = self._rate.wait_s(drone)
        if wait_s > 0.0:
            most = f"more than {self._settings.views_per_s:g} views a second"
            self._tell(drone, stamp_ns, f"it sends {most}")
            raise Refused(429, f"{drone} sends {most}", wait_s)
        waiting = self._on_the_way.get(drone, 0)
        if waiting and waiting >= self._room_of_each():
            self._tell(
                drone, stamp_ns, f"{waiting} of them wait to be taken in, by a detector or map that is slower"
            )
            raise Refused(429, f"{waiting} views of {drone} wait to be taken in", 1.0)
        self._on_the_way[drone] = waiting + 1

    def _room_of_each(self) -> int:
        """For views of a drone of which some wait. With all that it may have the map would stay behind for
        good: 16 pictures of each of 6 drones before a slow detector are 24 s. On the clock of the views time
        waits with them."""
        behind_s, now_s = self.behind_s() if self._clock.kind == "system" else 0.0, steady_s()
        if behind_s > self._settings.turn_within_s:
            self._room, self._since_s = 1, now_s
        elif behind_s < self._settings.turn_within_s / 2.0 and now_s - self._since_s > _MORE_ROOM_EVERY_S:
            self._room, self._since_s = min(self._room + 1, self._settings.waiting_per_drone), now_s
        return self._room

    def _tell(self, drone: str, stamp_ns: int, why: str) -> None:
        """Whoever gives a view need not give it again, and what it shows is lost then."""
        of = "" if drone == UNKNOWN else f" of {drone}"
        text = f"views{of} are refused: {why}; those that are not given again are lost"
        now_ns = self._clock.now_ns() or stamp_ns
        self._alerts.raise_("refused_views", "warning", text, now_ns, drone=drone)


def _wrong_name(drone: str) -> str | None:
    """Names stand in alarms, on the page and in files of other formats: none turns the text behind it round,
    no two look alike for what nobody sees, and none has a step that browsers and proxies take out of the
    addresses of its picture and of what operators do with it."""
    if character := unreadable(drone):
        return f"the drone's name has the character {character}, which shows as no text: leave it out"
    if drone != drone.strip():
        return f"the drone's name {drone!r} begins or ends with a space: leave it out"
    if step := next((part for part in drone.split("/") if part in (".", "..")), None):
        return (
            f"the drone's name {drone!r} has the part {step!r}, which addresses lose, so that nobody could "
            "see its pictures or leave it out: give it another name"
        )
    return None
