"""What operators closed, locked and opened, and what the zones are with it.

An operator can close ground, and keep a zone closed when its crowd is gone (lock). Crowd that the map still
shows can be passed through for a while only (dismiss): it comes back by itself, at the latest when it is no
longer the crowd that was dismissed, and stays on the list meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from crowdfence._core import Terrain
from crowdfence.config import ZoneConfig
from crowdfence.service.stamps import moment_json
from crowdfence.service.zone_json import Marks
from crowdfence.zones import AltitudeBand, Zone, ZoneSet
from crowdfence.zones.ground_heights import GroundHeights
from crowdfence.zones.history import polygon_of, rings_of, zone_of_record, zone_record
from crowdfence.zones.rules import Restriction
from crowdfence.zones.tracker import ZoneEvent
from crowdfence.zones.zone_id import zone_id

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

Action = Literal["add", "lock", "unlock", "dismiss"]

MOST_CORNERS = 2000
FARTHEST_M = 1e6
LEAST_DRAWN_M2 = 1.0
"""Where degrees are given for metres, all of a city is less."""
FLICKERS_M = 2.0
"""How far crowd may reach beyond the ground that was dismissed. What was taken for crowd by mistake stands
still, and its outline flickers by a voxel and by what poses are off; who walks there is beyond in seconds."""
_ROUNDED = 1.0 - 1e-9
"""Areas far from the origin are sums of rounded numbers."""
_SECOND_NS = 1_000_000_000


class RefusedAction(ValueError):
    """An operator asked for something that cannot be done; the message says why."""


@dataclass(frozen=True, slots=True)
class OperatorAction:
    """What somebody did, when and why; it can be done again from the journal."""

    action: Action
    zone: str
    """Empty for "add"."""
    stamp_ns: int
    user: str
    role: str
    reason: str
    rings: Sequence[Any] | None = None
    """Parts of rings of corners, local metres. For "add" what is closed; for "dismiss" the crowd's ground as
    whoever dismisses it saw it, None for that of now."""
    restriction: Restriction = "prohibited"


@dataclass(frozen=True)
class _Lock:
    zone: Zone
    action: OperatorAction

    @cached_property
    def held(self) -> Zone:
        """What stays closed where the service opened the zone; one object, as it stays the same."""
        return replace(self.zone, kind="static", reason="given", crowd_outline=None, valid_until_ns=None)


@dataclass(frozen=True, slots=True)
class _Dismissal:
    until_ns: int
    zone: Zone
    """As the operator saw it: of that crowd the operator spoke, and of no other that gets its name in a
    merge."""
    action: OperatorAction


class OperatorZones:
    """Actions in order; the same actions on the same zones give the same result."""

    def __init__(self, rules: ZoneConfig, terrain: Terrain, dismissed_for_s: float) -> None:
        self._rules, self._terrain = rules, terrain
        self._dismissed_for_ns = round(dismissed_for_s * _SECOND_NS)
        self._count = 0
        self._added: dict[str, tuple[Zone, OperatorAction]] = {}
        self._locked: dict[str, _Lock] = {}
        self._dismissed: dict[str, _Dismissal] = {}

    @cached_property
    def _ground(self) -> GroundHeights:
        return GroundHeights(self._terrain)

    def check(self, action: OperatorAction, zones: ZoneSet) -> None:
        """RefusedAction for what `do` would not do with the published `zones`."""
        if action.action == "add":
            drawn_polygon(action.rings or [])
            return
        zone = next((one for one in zones.closed if one.id == action.zone), None)
        if zone is None:
            raise RefusedAction(f"there is no zone {action.zone}")
        if action.action == "unlock":
            if action.zone not in self._locked:
                raise RefusedAction(f"zone {action.zone} is not locked")
        elif action.action == "lock":
            if zone.kind != "crowd":
                raise RefusedAction(
                    f"zone {action.zone} does not end by itself; only zones of crowd are locked"
                )
        elif action.zone in self._locked:
            raise RefusedAction(f"zone {action.zone} is locked; unlock it first")
        elif zone.kind != "crowd" and action.zone not in self._added:
            raise RefusedAction(
                f"zone {action.zone} is not of crowd and was not drawn here: it cannot be dismissed"
            )
        elif self._reaches_beyond(_as_seen(zone, action), zone, zones.min_area_m2, has_merged=False):
            raise RefusedAction(
                f"the crowd of zone {action.zone} reaches beyond the ground that it had when it was looked "
                "at: look again, then dismiss it"
            )

    def do(self, action: OperatorAction, zones: ZoneSet) -> str:
        """Do what was checked; the id of the zone that it concerns."""
        self.check(action, zones)
        if action.action == "add":
            zone = self._drawn(action)
            self._added[zone.id] = (zone, action)
            return zone.id
        zone = next(one for one in zones.closed if one.id == action.zone)
        if action.action == "lock":
            self._locked[action.zone] = _Lock(zone, action)
            self._dismissed.pop(action.zone, None)
        elif action.action == "unlock":
            del self._locked[action.zone]
        elif action.zone in self._added:
            del self._added[action.zone]
        else:
            until_ns = action.stamp_ns + self._dismissed_for_ns
            self._dismissed[action.zone] = _Dismissal(until_ns, _as_seen(zone, action), action)
        return action.zone

    def end_those_after(self, now_ns: int) -> bool:
        """End the dismissals that were made after a stamp; whether there were any."""
        after = [name for name, one in self._dismissed.items() if one.action.stamp_ns > now_ns]
        for name in after:
            del self._dismissed[name]
        return bool(after)

    def applied_to(self, zones: ZoneSet, now_ns: int) -> tuple[ZoneSet, Marks]:
        """The zones as they are published at a moment, and what operators did to them."""
        marks: dict[str, dict[str, Any]] = {}
        alive = {zone.id: zone for zone in zones}
        self._follow_splits(zones)
        merged = {event.other for event in zones.events if event.kind == "merged" and self._is_other(event)}
        for name, dismissal in list(self._dismissed.items()):
            if (
                dismissal.until_ns <= now_ns
                or name not in alive
                or self._reaches_beyond(
                    dismissal.zone, alive[name], zones.min_area_m2, has_merged=name in merged
                )
            ):
                del self._dismissed[name]
                continue
            marks[name] = {
                "operator": _who(dismissal.action),
                "dismissed": moment_json("until", dismissal.until_ns),
            }
        crowd = [self._with_lock(zone) for zone in zones]
        given = list(zones.static)
        for name, lock in self._locked.items():
            marks[name] = {"locked": True, "operator": _who(lock.action)}
            if name not in alive:
                given.append(lock.held)
                marks[name]["kind"] = "operator"
        for name, (zone, action) in self._added.items():
            given.append(zone)
            marks[name] = {"kind": "operator", "operator": _who(action)}
        return replace(zones, zones=tuple(crowd), static=tuple(given)), marks

    def to_json(self) -> dict[str, Any]:
        """For a snapshot."""
        return {
            "count": self._count,
            "added": [_action_json(action) | {"id": name} for name, (_, action) in self._added.items()],
            "locked": [
                _action_json(lock.action) | {"held": zone_record(lock.zone)} for lock in self._locked.values()
            ],
            "dismissed": [
                _action_json(one.action) | {"until_ns": one.until_ns, "held": zone_record(one.zone)}
                for one in self._dismissed.values()
            ],
        }

    def restore(self, told: dict[str, Any]) -> None:
        """What `to_json` told."""
        self._count = told["count"]
        for entry in told["added"]:
            name = entry.pop("id")
            action = OperatorAction(**entry)
            self._added[name] = (self._zone_of(action, name), action)
        for entry in told["locked"]:
            held = zone_of_record(entry.pop("held"))
            self._locked[held.id] = _Lock(held, OperatorAction(**entry))
        for entry in told["dismissed"]:
            if "held" not in entry:  # as older builds kept it: of ground that nobody knows any more
                continue
            until_ns, zone = entry.pop("until_ns"), zone_of_record(entry.pop("held"))
            self._dismissed[zone.id] = _Dismissal(until_ns, zone, OperatorAction(**entry))

    def _follow_splits(self, zones: ZoneSet) -> None:
        """Where a dismissed zone falls apart, all that comes out of it is the crowd that was dismissed."""
        for event in zones.events:
            if event.kind == "split" and event.other in self._dismissed:
                whole = self._dismissed[event.other]
                self._dismissed[event.id] = replace(whole, zone=replace(whole.zone, id=event.id))

    def _is_other(self, event: ZoneEvent) -> bool:
        """Whether what went into a zone was not dismissed with it, as what had come out of it was."""
        before = self._dismissed.get(event.id)
        now = None if event.other is None else self._dismissed.get(event.other)
        return before is None or now is None or before.action != now.action

    def _reaches_beyond(self, dismissed: Zone, zone: Zone, least_m2: float, *, has_merged: bool) -> bool:
        """Whether it closes other crowd than what was dismissed. Ground that came in a merge is no flicker,
        however near it is, nor is a part that is new and large enough (`least_m2`) to be a zone by itself."""
        import shapely

        margin_m = 1e-6 if has_merged else max(FLICKERS_M, self._terrain.voxel_size_m)
        before, ground = _crowd_ground(dismissed), _crowd_ground(zone)
        if not before.buffer(margin_m, join_style="mitre").covers(ground):
            return True
        parts = shapely.get_parts(ground)
        new_m2 = shapely.area(parts[~shapely.intersects(parts, before)])
        return bool((new_m2 >= least_m2 * _ROUNDED).any())

    def _with_lock(self, zone: Zone) -> Zone:
        """A locked zone keeps all that it closed when it was locked, from its lowest to its highest ground,
        and has no end."""
        lock = self._locked.get(zone.id)
        if lock is None:
            return zone
        polygon, outline = zone.polygon, zone.crowd_outline
        if not polygon.covers(lock.zone.polygon):
            polygon, outline = polygon.union(lock.zone.polygon), outline or polygon
        return replace(
            zone,
            polygon=polygon,
            crowd_outline=outline,
            lower_m=min(zone.lower_m, lock.zone.lower_m),
            upper_m=max(zone.upper_m, lock.zone.upper_m),
            leaves_map=zone.leaves_map or lock.zone.leaves_map,
            valid_until_ns=None,
        )

    def _drawn(self, action: OperatorAction) -> Zone:
        self._count += 1
        return self._zone_of(action, zone_id(self._count, "O"))

    def _zone_of(self, action: OperatorAction, name: str) -> Zone:
        polygon = drawn_polygon(action.rings or [])
        low_m, high_m = self._terrain.bounds[:, 2].tolist()
        return Zone.of_no_look(
            name,
            polygon,
            "static",
            "given",
            ground_m=(low_m, high_m),
            leaves_map=not self._ground.hold(polygon),
            restriction=action.restriction,
            band=AltitudeBand(self._rules.lower_m, self._rules.upper_m, "AGL"),
            created_ns=action.stamp_ns,
        )


def passable(zones: ZoneSet, marks: Marks) -> ZoneSet:
    """The zones without those that an operator lets drones pass for a while: what fences and files hold."""
    kept = tuple(zone for zone in zones if not marks.get(zone.id, {}).get("dismissed"))
    return replace(zones, zones=kept)


def seen_ground(zone: Zone) -> list[Any]:
    """For a dismissal (`OperatorAction.rings`): the crowd's ground of a zone as somebody saw it."""
    return rings_of(_crowd_ground(zone))


def drawn_polygon(parts: Sequence[Any]) -> Polygon | MultiPolygon:
    """What an operator drew, parts of rings of corners. RefusedAction for what is no polygon."""
    corners = [corner for part in parts for ring in part for corner in ring]
    if not 3 <= len(corners) <= MOST_CORNERS:
        raise RefusedAction(f"the polygon has {len(corners)} corners; 3 to {MOST_CORNERS} are possible")
    if not all(len(corner) == 2 and all(abs(value) <= FARTHEST_M for value in corner) for corner in corners):
        raise RefusedAction(f"a corner is two numbers, at most {FARTHEST_M:g} metres east and north")
    try:
        polygon = polygon_of(parts)
    except ValueError as error:
        raise RefusedAction(f"that is no polygon: {error}") from error
    if not polygon.is_valid or not polygon.area > 0.0:
        raise RefusedAction("the polygon crosses itself or holds no ground")
    return polygon


def _as_seen(zone: Zone, action: OperatorAction) -> Zone:
    """With the ground that whoever dismisses it saw."""
    return replace(zone, polygon=polygon_of(action.rings), crowd_outline=None) if action.rings else zone


def _crowd_ground(zone: Zone) -> Polygon | MultiPolygon:
    return zone.crowd_outline or zone.polygon


def _who(action: OperatorAction) -> dict[str, Any]:
    return {"name": action.user, "reason": action.reason}


def _action_json(action: OperatorAction) -> dict[str, Any]:
    return {name: getattr(action, name) for name in OperatorAction.__slots__}
