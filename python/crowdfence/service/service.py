"""Everything that the routes ask, in one place."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from crowdfence._core import __version__
from crowdfence.service.access import Access, User
from crowdfence.service.alerts import Alerts
from crowdfence.service.base_map import BaseMap
from crowdfence.service.clock import Clock
from crowdfence.service.fleet import Fleet
from crowdfence.service.ground import GroundRaster
from crowdfence.service.left_out import DroneAction, DroneVerb
from crowdfence.service.media import Media
from crowdfence.service.mission import Mission
from crowdfence.service.operator_zones import Action, OperatorAction
from crowdfence.service.settings import ServiceSettings
from crowdfence.service.stamps import moment_json
from crowdfence.service.store import Store, Write
from crowdfence.service.stream import Hub
from crowdfence.service.timeline import Moment
from crowdfence.service.zone_set_json import ANY_VERSION, ZoneSetJson

if TYPE_CHECKING:
    from crowdfence.service.live import Live

_LOG = logging.getLogger(__name__)

_ASKED_WITHIN_NS = 1_000_000_000
"""From the moment at which somebody takes the time to the one at which the question arrives."""

Mode = Literal["live", "replay", "finished"]


@dataclass(slots=True, eq=False)
class Service:
    """One mission, live or replayed."""

    mission: Mission
    raster: GroundRaster
    fleet: Fleet
    media: Media
    alerts: Alerts
    access: Access
    store: Store
    clock: Clock
    settings: ServiceSettings
    live: Live | None = None
    """None for a replay."""
    mode: Mode = "live"
    base_map: BaseMap | None = None
    hub: Hub = field(default_factory=Hub)
    _zone_sets: ZoneSetJson = field(default_factory=ZoneSetJson)
    store_trouble: str | None = None
    """Why nothing can be written."""

    def __post_init__(self) -> None:
        self.mission.listeners.append(self.publish)
        self.alerts.on_change = lambda alert: self.hub.tell({"type": "alert", "alert": alert.to_json()})
        self.store.on_trouble = self._trouble

    def _trouble(self, trouble: str | None) -> None:
        if trouble is not None:
            self.mission.timeline.begin_whole()
        else:
            self.alerts.write_again()
        self.store_trouble = trouble

    @property
    def drones(self) -> tuple[str, ...]:
        """All that are expected or were heard. Of companions, which project themselves, the fleet knows no
        camera."""
        heard = {} if self.live is None else dict(self.live.heard.last_view_ns)
        return tuple(sorted({*self.fleet.drones, *self.mission.drones, *heard}))

    def decide(self, user: User, action: Action, zone: str, reason: str, **drawn: Any) -> str:
        """Do what an operator asks of a zone and write down who, what and why; the id of the zone.
        RefusedAction."""
        return self._do(
            user, OperatorAction(action, zone, self._acting_ns(), user.name, user.role, reason, **drawn)
        )

    def decide_drone(self, user: User, action: DroneVerb, drone: str, reason: str) -> None:
        """The same of a drone."""
        self._do(user, DroneAction(action, drone, self._acting_ns(), user.name, user.role, reason))

    def _do(self, user: User, wanted: OperatorAction | DroneAction) -> str:
        """The id of the zone or the name of the drone."""
        zone, drone = (None, wanted.drone) if isinstance(wanted, DroneAction) else (wanted.zone or None, None)
        if self.live is not None:
            entry = audit_entry(user, wanted.action, zone, wanted.reason, drone)
            return self.live.intake.decide(wanted, entry)
        with self.mission.lock:
            name = self.mission.do(wanted)
        self.audit(user, wanted.action, name if drone is None else None, wanted.reason, drone)
        return name

    def _acting_ns(self) -> int:
        """Now, also where the newest view is ahead of it: what an operator allows ends by the clock."""
        newest, now_ns = self.mission.newest, self.now_ns()
        if self.clock.kind == "system" or newest is None:
            return now_ns
        return max(now_ns, newest.stamp_ns)

    def audit(
        self, user: User, action: str, zone: str | None, reason: str | None, drone: str | None = None
    ) -> None:
        """Who did what."""
        self.store.submit(audit_entry(user, action, zone, reason, drone)).result()

    def audit_json(self) -> list[dict[str, Any]]:
        """The newest first. Of a row that is damaged what can still be read."""
        names = ("user", "role", "action", "zone", "drone", "reason")
        rows = self.store.rows(
            "SELECT CASE typeof(stamp_ns) WHEN 'integer' THEN stamp_ns END, "
            f"{', '.join(f'CAST({name} AS TEXT)' for name in names)} FROM audit ORDER BY id DESC LIMIT 1000"
        )
        return [{**moment_json("stamp", row[0]), **dict(zip(names, row[1:], strict=True))} for row in rows]

    @property
    def works(self) -> bool:
        """Whether views still go into the map."""
        return self.live is None or self.live.applying.works

    def set_mode(self, mode: Mode) -> None:
        self.mode = mode
        self.hub.tell({"type": "mode", "mode": mode})

    def now_ns(self) -> int:
        """The service's clock, in a replay the newest instant."""
        return self.clock.now_ns()

    def scene_json(self, user: User) -> dict[str, Any]:
        """What stays the same while the mission goes on."""
        mission, raster = self.mission, self.raster
        rows, columns = raster.heights_m.shape
        anchor = mission.georeference
        west, north, size_m = raster.west_m, raster.north_m, raster.cell_size_m
        span = mission.timeline.span_ns()
        return {
            "name": mission.name,
            "run": mission.run,
            "mode": self.mode,
            "method": mission.loop.crowd_map.method.name,
            "threshold": mission.threshold,
            "parameters": mission.parameters(),
            "zone_rules": mission.config.zone_parameters(mission.loop.crowd_map.default_threshold()),
            "voxel_size_m": mission.terrain.voxel_size_m,
            "drones": sorted(self.fleet.drones),
            "silent_after_s": self.settings.silent_after_s,
            "anchor": None
            if anchor is None
            else {
                "latitude_deg": anchor.latitude_deg,
                "longitude_deg": anchor.longitude_deg,
                "height_m": anchor.height_m,
            },
            "bounds": [west, north - rows * size_m, west + columns * size_m, north],
            "terrain": {
                "west": west,
                "north": north,
                "cell_size_m": size_m,
                "rows": rows,
                "columns": columns,
            },
            "base_map": None if anchor is None or self.base_map is None else self.base_map.kind,
            "role": user.role,
            "user": user.name,
            "version": __version__,
            **moment_json("first_stamp", None if span is None else span[0]),
            **moment_json("last_stamp", None if span is None else span[1]),
        }

    def zones_json(self, moment: Moment, without_static: str | None = None) -> dict[str, Any]:
        """The zones of a moment; without a stamp where the clock of the views has not begun. Those of others
        are left out where they are of the version `without_static`, or that is `ANY_VERSION`."""
        told = {"run": self.mission.run, **self._zone_sets.of(moment, without_static)}
        is_timeless = moment.number == 0 and moment.stamp_ns == 0
        return {**told, **moment_json("stamp", None)} if is_timeless else told

    def step_json(self, moment: Moment, *, with_static: bool = True) -> dict[str, Any]:
        """For the stream."""
        return {
            "type": "step",
            **moment_json("stamp", moment.stamp_ns),
            "belief_version": moment.number,
            **moment.figures,
            "zone_count": len(moment.zones.closed),
            "zones": self.zones_json(moment, None if with_static else ANY_VERSION),
            "drones": {"drones": self.drones_json(trails=False)},
            "lag_s": max(0.0, (self.now_ns() - moment.stamp_ns) / 1e9),
            "silent_s": None if self.live is None else self.live.silent_s,
        }

    def drones_json(self, at_ns: int | None = None, *, trails: bool = True) -> list[dict[str, Any]]:
        """Every drone as of `at_ns`, or now; who left it out now, or null, and how long after their stamps
        its views come now."""
        told = self.fleet.to_json(self.now_ns(), at_ns, trails=trails)
        for drone in told:
            drone["lag_s"] = None if self.live is None else self.live.heard.lag_s(drone["drone"])
            by = self.mission.left_out.by(drone["drone"])
            drone["left_out"] = (
                None
                if by is None
                else {"name": by.user, "reason": by.reason, **moment_json("since", by.stamp_ns)}
            )
        return told

    def moment(self, at_ns: int | None) -> Moment:
        """The newest, or the last one up to a stamp; before the first one what holds without any view."""
        newest = self.mission.newest
        if newest is not None and (at_ns is None or at_ns >= newest.stamp_ns):
            return newest
        then = None if at_ns is None else self.mission.timeline.at(at_ns)
        if newest is not None and at_ns is not None and self._is_about_now(at_ns, newest):
            return then if then is not None and then.stamp_ns == at_ns else newest
        return then or self.mission.opening(self.now_ns() if at_ns is None else at_ns)

    def has_zone(self, zone: str) -> bool:
        """Whether it is closed now."""
        return any(one.id == zone for one in self.moment(None).zones.closed)

    def _is_about_now(self, at_ns: int, newest: Moment) -> bool:
        """Whether somebody asks for now while the newest moment, of a drone whose clock is ahead, is of
        later: what it closes is closed now."""
        now_ns = self.now_ns()
        return newest.stamp_ns > now_ns and at_ns >= now_ns - _ASKED_WITHIN_NS

    def publish(self, moment: Moment, before: Moment | None = None) -> None:
        """A listener of the mission."""
        self.hub.step(lambda with_static: self.step_json(moment, with_static=with_static))


def audit_entry(
    user: User, action: str, zone: str | None, reason: str | None, drone: str | None = None
) -> Write:
    """Who did what, as a write."""
    row = (time.time_ns(), user.name, user.role, action, zone, drone, reason)
    told = {"user": user.name, "action": action, "zone": zone, "drone": drone, "reason": reason}
    _LOG.info("operator", extra=told)
    return lambda connection: connection.execute(
        "INSERT INTO audit (stamp_ns, user, role, action, zone, drone, reason) VALUES (?, ?, ?, ?, ?, ?, ?)",
        row,
    )
