"""What somebody should look at: raised once, cleared when it is over, acknowledged by a person."""

from __future__ import annotations

import json
import logging
import sqlite3
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import asdict, dataclass, replace
from threading import Lock
from typing import Any, Literal

from crowdfence.errors import one_line
from crowdfence.service.stamps import moment_json
from crowdfence.service.store import Store

AlertKind = Literal[
    "drone_silent",
    "drone_doubled",
    "drone_in_zone",
    "drone_near_zone",
    "new_zone",
    "detector_stale",
    "map_behind",
    "pose_gap",
    "pose_frames",
    "reversed_attitudes",
    "doubtful_lens",
    "alignment_unused",
    "mask_unused",
    "lost_crowd",
    "unheeded_crowd",
    "denied_crowd",
    "crowds_apart",
    "left_out",
    "no_ground",
    "heatmap_units",
    "same_answer",
    "unlike_pictures",
    "untested_ground",
    "shrunk_pictures",
    "clock",
    "stamps_off",
    "disk",
    "records_damaged",
    "refused_views",
    "watch_failed",
]
Level = Literal["info", "warning", "alarm"]

_REMEMBERED = 1000
_WORSE = 2.0
"""Times what was told, from which on it is told anew."""
CALM_S = 10.0
"""Of what every view decides anew, such as a clock at the bound: it is over once it did not happen for so
long."""
_LOG = logging.getLogger(__name__)
_LOG_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "alarm": logging.ERROR}


@dataclass(frozen=True, slots=True)
class Alert:
    """Active until it is cleared."""

    id: str
    kind: AlertKind
    level: Level
    text: str
    drone: str | None
    zone: str | None
    raised_ns: int
    cleared_ns: int | None = None
    acknowledged_by: str | None = None
    acknowledged_ns: int | None = None
    measure: float | None = None
    """How bad it was when its text was written, for what can become worse; None says something else."""

    def is_less_than(self, measure: float | None) -> bool:
        """Whether what it says is no longer the half of it."""
        return measure is not None and measure >= _WORSE * (self.measure or 0.0)

    @property
    def is_open(self) -> bool:
        """Whether somebody has to look at it: an alarm until somebody did, a warning while it holds."""
        if self.acknowledged_by is not None or self.level == "info":
            return False
        return self.level == "alarm" or self.cleared_ns is None

    def to_json(self) -> dict[str, Any]:
        told = {name: getattr(self, name) for name in ("id", "kind", "level", "text", "drone", "zone")}
        return {
            **told,
            **moment_json("raised", self.raised_ns),
            **moment_json("cleared", self.cleared_ns),
            "acknowledged_by": self.acknowledged_by,
            **moment_json("acknowledged", self.acknowledged_ns),
        }


def forget_before(connection: sqlite3.Connection, stamp_ns: int) -> None:
    """Retention: alerts that were raised before a stamp and are over; the newest stays for its number."""
    connection.execute(
        "DELETE FROM alerts WHERE raised_ns < ? AND json_extract(body, '$.cleared_ns') IS NOT NULL "
        "AND rowid < (SELECT MAX(rowid) FROM alerts)",
        (stamp_ns,),
    )


class Alerts:
    """A thousand of them: the newest, and those that somebody has to look at. An alert of the same kind,
    drone and zone is not raised twice while it is active."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._lock = Lock()
        self._alerts: dict[str, Alert] = {}
        self._unwritten: set[str] = set()
        """Ids of those whose last change is not on disk, because there was no room."""
        self._uncleared: dict[tuple[AlertKind, str | None], dict[str, Alert]] = {}
        """Those of them that are active by kind and drone, in the same order: every view asks for some."""
        self._happened_ns: dict[str, int] = {}
        """By the ids of those that are active: when it happened last since the start."""
        self._count = self.unread = 0
        """The number of the newest, and how many of before are damaged."""
        for name, body in store.rows(
            "SELECT id, body FROM (SELECT id, body, rowid AS place FROM alerts ORDER BY rowid DESC LIMIT ?) "
            "ORDER BY place",
            (_REMEMBERED,),
        ):
            self._recall(name, body)
        self.on_change: Callable[[Alert], None] = lambda alert: None

    def all(self) -> list[Alert]:
        """The newest first."""
        with self._lock:
            return list(self._alerts.values())[::-1]

    def named(self, name: str) -> Alert | None:
        """The one of an id, where it is remembered."""
        with self._lock:
            return self._alerts.get(name)

    def active(self, kind: AlertKind, drone: str | None = None, zone: str | None = None) -> Alert | None:
        with self._lock:
            return self._active(kind, drone, zone)

    def all_active(self, kind: AlertKind, drone: str) -> list[Alert]:
        """Of a drone, whatever their zones, the newest first."""
        with self._lock:
            return list(self._uncleared.get((kind, drone), {}).values())[::-1]

    def _active(self, kind: AlertKind, drone: str | None, zone: str | None) -> Alert | None:
        alike = self._uncleared.get((kind, drone), {}).values()
        return next((alert for alert in alike if alert.zone == zone), None)

    def _least_needed(self) -> str:
        """The oldest that asks nobody for anything, so that many small ones cover up no alarm."""
        return next(
            (name for name, alert in self._alerts.items() if not alert.is_open), next(iter(self._alerts))
        )

    def raise_(
        self,
        kind: AlertKind,
        level: Level,
        text: str,
        now_ns: int,
        *,
        drone: str | None = None,
        zone: str | None = None,
        is_new: bool = False,
        measure: float | None = None,
        is_other: bool = False,
    ) -> Alert:
        """Raise it, or return the one that is active. `is_new`: it happened again, rather than still holds;
        an active one that somebody acknowledged is over then, and a new one is raised. So it is where
        `measure`, how bad it is, has doubled since it was told; whoever has not acknowledged it is told by
        the same one. `is_other`: new, and for another cause, which the same one tells too."""
        over = None
        with self._lock:  # held until it is there: two threads that meet the same must not both raise it
            known = self._active(kind, drone, zone)
            if known is not None:
                self._happened_ns[known.id] = now_ns
                is_worse, is_acknowledged = known.is_less_than(measure), known.acknowledged_by is not None
                if not (is_worse or is_other or (is_new and is_acknowledged)):
                    return known
                if is_acknowledged or (known.measure is None and not is_other):
                    over = self._keep(replace(known, cleared_ns=now_ns))
            if known is not None and over is None:
                alert = self._keep(replace(known, text=text, measure=measure))
            else:
                self._count += 1
                while len(self._alerts) >= _REMEMBERED:
                    self._is_over(self._alerts.pop(self._least_needed()))
                named = f"A{self._count}"
                alert = self._keep(Alert(named, kind, level, text, drone, zone, now_ns, measure=measure))
        _LOG.log(
            _LOG_LEVELS[level], text, extra={"alert": alert.id, "kind": kind, "drone": drone, "zone": zone}
        )
        if over is not None:
            self.on_change(over)
        self.on_change(alert)
        return alert

    def clear(
        self,
        kind: AlertKind,
        now_ns: int,
        *,
        drone: str | None = None,
        zone: str | None = None,
        calm_s: float = 0.0,
    ) -> None:
        """It is over; nothing happens where there is none, or where it happened within `calm_s`: what comes
        and goes with every other view would be an alert each time, and push others out."""
        with self._lock:
            known = self._active(kind, drone, zone)
            if known is None:
                return
            happened_ns = self._happened_ns.get(known.id, known.raised_ns)
            if calm_s > 0.0 and now_ns - happened_ns < calm_s * 1e9:
                return
            over = self._keep(replace(known, cleared_ns=now_ns))
        self.on_change(over)

    def acknowledge(self, name: str, user: str, now_ns: int) -> Alert | None:
        """Somebody saw it; None where there is none of this id. The first to acknowledge counts."""
        with self._lock:
            known = self._alerts.get(name)
            if known is None or known.acknowledged_by is not None:
                return known
            seen = self._keep(replace(known, acknowledged_by=user, acknowledged_ns=now_ns))
        self.on_change(seen)
        return seen

    def _recall(self, name: Any, body: Any) -> None:
        """One that was written; one that is damaged stops nothing."""
        try:
            alert = Alert(**json.loads(body))
            number = int(alert.id[1:])
            if alert.level not in _LOG_LEVELS or not isinstance(alert.raised_ns, int):
                raise ValueError(f"level {alert.level!r}, raised {alert.raised_ns!r}")
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            _LOG.error("alert %r cannot be read: %s", name, one_line(error))
            self.unread += 1
            return
        self._count = max(self._count, number)
        self._remember(alert)

    def _remember(self, alert: Alert) -> None:
        self._alerts[alert.id] = alert
        if alert.cleared_ns is None:
            self._uncleared.setdefault((alert.kind, alert.drone), {})[alert.id] = alert
        else:
            self._is_over(alert)

    def _is_over(self, alert: Alert) -> None:
        """It is active no more, or not remembered."""
        self._happened_ns.pop(alert.id, None)
        alike = self._uncleared.get((alert.kind, alert.drone), {})
        alike.pop(alert.id, None)
        if not alike:
            self._uncleared.pop((alert.kind, alert.drone), None)

    def _keep(self, alert: Alert) -> Alert:
        """Under the lock, so that memory and disk get changes in the same order."""
        self._remember(alert)
        self._write(alert)
        return alert

    def _write(self, alert: Alert) -> None:
        row = (alert.id, alert.raised_ns, json.dumps(asdict(alert)))

        def written(done: Future[None]) -> None:
            if done.exception() is not None:
                self._unwritten.add(alert.id)

        self._store.submit(
            lambda connection: connection.execute(
                "INSERT INTO alerts VALUES (?, ?, ?) ON CONFLICT (id) DO UPDATE SET body = excluded.body", row
            ),
            written,
        )

    def write_again(self) -> None:
        """There is room again: what the disk did not take would be missing after a restart."""
        with self._lock:
            names, self._unwritten = self._unwritten, set()
            for name in names & self._alerts.keys():
                self._write(self._alerts[name])
