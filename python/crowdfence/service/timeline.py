"""What was closed and what was believed at every stamp, on disk."""

from __future__ import annotations

import json
import sqlite3
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

from crowdfence.service.stamps import moment_json
from crowdfence.service.store import LASTING, Store
from crowdfence.service.zone_json import Marks
from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.history import history_line, zone_set_of_line

_Happened = tuple[int, dict[str, Any]]
"""The number of a moment, and what became of a zone then."""
_LAST = (1 << 63) - 1
WHOLE_EVERY = 50
"""Moments from one whose outlines are all written to the next one."""
MOST_POINTS = 2000
_BEHIND_NS = 120_000_000_000
"""What an operator does is published at once, with the time of it, and views up to a minute old follow, which
may have waited for the detector."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What is published after a step, or after an operator did something."""

    number: int
    """Counts from 1; the version of everything that follows from it. 0 before the first step."""
    stamp_ns: int
    zones: ZoneSet
    marks: Marks
    """What operators did to zones."""
    figures: dict[str, Any]
    """seen_m2, crowd_m2, closed_m2, zones."""

    @property
    def of_others(self) -> tuple[Zone, ...]:
        """The zones of others, which may be thousands and stay as they are; without what operators drew and
        hold closed."""
        return tuple(zone for zone in self.zones.static if zone.id not in self.marks)

    @property
    def own(self) -> ZoneSet:
        """All other zones."""
        drawn = tuple(zone for zone in self.zones.static if zone.id in self.marks)
        return replace(self.zones, static=drawn)


class LostMomentError(LookupError):
    """What was closed then is not all kept, because nothing could be written for a while."""


class Timeline:
    """Moments by stamp. Outlines, and zones of others, which may be thousands, are written when they changed,
    all of them every `WHOLE_EVERY` moments."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._before: ZoneSet | None = None
        self._newest_number = 0
        self._static_number = 0
        """Of the moment that tells the zones of others."""
        self._since_whole = WHOLE_EVERY
        self._belief_ns: int | None = None

    def add(self, moment: Moment) -> None:
        """Of a number that is there already (after a restart), the newer one counts."""
        whole = self._since_whole >= WHOLE_EVERY
        self._since_whole = 1 if whole else self._since_whole + 1
        zones = moment.zones
        line = history_line(moment.stamp_ns, zones, None if whole else self._before)
        same = "static" not in line
        told = replace(zones, static=()) if same else zones
        figures = {
            **moment.figures,
            "of": {zone.id: [_plain(zone.probability_max), zone.polygon.area] for zone in told.closed},
            "events": line["events"],
        }
        if same:
            figures["static"] = self._static_number
        else:
            self._static_number = moment.number
        self._before, self._newest_number = zones, moment.number
        body = zlib.compress(_json(line).encode(), 1)
        row = (moment.number, moment.stamp_ns, whole, body, _json(moment.marks), _json(figures))
        self._store.note(
            lambda connection: connection.execute(
                "INSERT OR REPLACE INTO moments VALUES (?, ?, ?, ?, ?, ?)", row
            ),
            size=len(body),
        )

    def begin_whole(self) -> None:
        """The next moment has all its outlines: what was written before is not in memory."""
        self._since_whole = WHOLE_EVERY

    def at(self, stamp_ns: int) -> Moment | None:
        """The last moment up to a stamp; None before the first. Steps that came behind what an operator did,
        with stamps of before, are in it: they are what was known of that stamp last. LostMomentError where it
        may be one that is missing, or rests on one: what has not changed since is told there alone; and where
        it was before all that are kept."""
        self._wait_for_newest()
        last = self._last_of("moments", stamp_ns)
        if last is None:
            first = self._next_after(0)
            if first not in (None, 1):  # they count from 1: nobody saw anything before that one alone
                raise LostMomentError(_FORGOTTEN if self._is_on_disk(first) else _LOST.format(1))
            return None
        number, then_ns = last
        rows = self._store.rows(
            "SELECT number, stamp_ns, line, marks, figures FROM moments WHERE number <= ? AND number >= "
            "(SELECT MAX(number) FROM moments WHERE whole AND number <= ?) ORDER BY number",
            (number, number),
        )
        zones: ZoneSet | None = None
        for place, (at_number, _, line, _, _) in enumerate(rows, start=rows[0][0] if rows else 0):
            # Outlines of before are not taken for those that it would have told.
            if at_number != place:
                raise LostMomentError(_LOST.format(place))
            with _readable(at_number):
                zones = zone_set_of_line(json.loads(zlib.decompress(line)), zones)
        if zones is None:
            return None
        _, _, _, marks, figures = rows[-1]
        if stamp_ns > then_ns and self._next_after(number) not in (None, number + 1):
            raise LostMomentError(_LOST.format(number + 1))
        with _readable(number):
            told = {k: value for k, value in dict(json.loads(figures)).items() if k not in _OWN}
            return Moment(number, then_ns, zones, dict(json.loads(marks)), told)

    def newest_of_others(self) -> tuple[Zone, ...] | None:
        """The zones of others that were published last; None where nothing was, or that is not kept."""
        with suppress(LostMomentError):
            newest = self.at(_LAST)
            return None if newest is None else newest.of_others
        return None

    def _wait_for_newest(self) -> None:
        """What was published is on its way to the disk, which may be slow, or full."""
        if self._newest_number and not self._is_on_disk(self._newest_number):
            with suppress(sqlite3.Error):  # told elsewhere
                self._store.flush()

    def _is_on_disk(self, number: int) -> bool:
        return bool(self._store.rows("SELECT 1 FROM moments WHERE number = ?", (number,)))

    def _next_after(self, number: int) -> int | None:
        """The number of the next moment that is kept: at the end the newest, in memory where nothing can be
        written. None where none follows."""
        ((following,),) = self._store.rows("SELECT MIN(number) FROM moments WHERE number > ?", (number,))
        if following is None and self._newest_number > number:
            return self._newest_number
        return None if following is None else int(following)

    def points(self) -> list[dict[str, Any]]:
        """Figures over time, in the order of their stamps, at most `MOST_POINTS`, the newest among them."""
        return [
            {**moment_json("stamp", stamp_ns), **figures}
            for stamp_ns, figures in self._figures(told=_WITHOUT_OWN)
        ]

    def zone_history(self, zone: str, until_ns: int | None = None) -> dict[str, Any]:
        """How a zone's probability and area went, and what became of it: of its changes the newest
        `MOST_POINTS`, and all else that happened to it."""
        points = []
        static: dict[int, dict[str, Any]] = {}
        for stamp_ns, figures in self._figures(until_ns):
            of = figures.get("of", {})
            if zone not in of and (number := figures.get("static")) is not None:
                if number not in static:
                    static = {number: self._told_of(number)}  # of many moments in a row
                of = static[number]
            if zone in of:
                probability, closed_m2 = of[zone]
                points.append(
                    {**moment_json("stamp", stamp_ns), "probability_max": probability, "closed_m2": closed_m2}
                )
        # Not the moments of one question: a zone in view changes at nearly every one, for hours.
        lasting = list(self._events(zone, until_ns, lambda kind: kind != "updated", LASTING))
        within = f"number BETWEEN {self._begin_of(zone, lasting)} AND {_end_of(zone, lasting)}"
        events = [
            *(event for _, event in lasting),
            *(event for _, event in self._events(zone, until_ns, lambda kind: kind == "updated", within)),
        ]
        return {"points": points, "events": sorted(events, key=lambda event: int(event["stamp_ns"]))}

    def _begin_of(self, zone: str, lasting: Sequence[_Happened]) -> int:
        """The number of the moment before which nothing changed about it. Of zones of others nothing is told:
        to find that out the whole history would be read, for seconds, as often as somebody asks."""
        if not lasting:
            return self._newest_number - MOST_POINTS
        number, event = lasting[-1]
        return number if event["id"] == zone and event["kind"] in ("created", "split") else 0

    def _told_of(self, number: int) -> dict[str, Any]:
        """What the figures of a moment say of its zones."""
        rows = self._store.rows(
            f"SELECT json_extract(figures, '$.of') FROM moments WHERE number = ? AND {_IS_WHOLE}", (number,)
        )
        told: dict[str, Any] = json.loads(rows[0][0] or "{}") if rows else {}
        return told

    def _events(
        self, zone: str, until_ns: int | None, is_wanted: Callable[[str], bool], condition: str
    ) -> Iterator[_Happened]:
        """Of the newest `MOST_POINTS` moments of a zone for which a condition in SQL holds, the newest
        first."""
        for number, stamp_ns, text in self._store.rows(
            "SELECT number, stamp_ns, json_extract(figures, '$.events') FROM moments WHERE figures LIKE ? "
            f"AND stamp_ns <= ? AND ({condition}) AND {_IS_WHOLE} ORDER BY number DESC LIMIT ?",
            (f'%"{zone}"%', _until(until_ns), MOST_POINTS),
        ):
            for event in json.loads(text or "[]"):
                if zone in (event["id"], event.get("other")) and is_wanted(event["kind"]):
                    yield number, {**moment_json("stamp", stamp_ns), "other": None, **event}

    def _figures(
        self, until_ns: int | None = None, told: str = "figures"
    ) -> Iterator[tuple[int, dict[str, Any]]]:
        ((first, last),) = self._store.rows(
            "SELECT MIN(number), MAX(number) FROM moments WHERE stamp_ns <= ?", (_until(until_ns),)
        )
        if first is None:
            return
        stride = max(1, -(-(last - first + 1) // MOST_POINTS))
        for stamp_ns, figures in self._store.rows(
            "WITH RECURSIVE wanted (number) AS "
            "(SELECT ?1 UNION ALL SELECT number - ?2 FROM wanted WHERE number - ?2 >= ?3) "
            f"SELECT stamp_ns, {told} FROM wanted JOIN moments USING (number) WHERE {_IS_WHOLE} "
            "ORDER BY stamp_ns, number",
            (last, stride, first),
        ):
            yield stamp_ns, json.loads(figures)

    def _last_of(self, table: Literal["moments", "beliefs"], stamp_ns: int) -> tuple[int, int] | None:
        """The number of the last row up to a stamp, or of the last one that came behind it with a stamp of
        before; and as of when that is. None before the first."""
        rows = self._store.rows(
            f"SELECT number, stamp_ns FROM {table} WHERE stamp_ns <= ? "
            "ORDER BY stamp_ns DESC, number DESC LIMIT 1",
            (stamp_ns,),
        )
        if not rows:
            return None
        ((number, then_ns),) = rows
        ((behind,),) = self._store.rows(
            f"SELECT MAX(number) FROM {table} WHERE stamp_ns BETWEEN ? AND ? AND number <= ?",
            (then_ns - _BEHIND_NS, then_ns, self._newest_number),
        )
        return max(number, behind or 0), then_ns

    def add_belief(self, number: int, stamp_ns: int, belief: bytes) -> None:
        """The crowd map from above as it was."""
        body = zlib.compress(belief, 1)
        self._store.note(
            lambda connection: connection.execute(
                "INSERT OR REPLACE INTO beliefs VALUES (?, ?, ?)", (number, stamp_ns, body)
            ),
            size=len(body),
        )

    def belief_at(self, stamp_ns: int) -> tuple[int, bytes] | None:
        """The last one up to a stamp, as for `at`, with the number of its moment. LostMomentError where it is
        damaged."""
        last = self._last_of("beliefs", stamp_ns)
        if last is None:
            return None
        rows = self._store.rows("SELECT body FROM beliefs WHERE number = ?", last[:1])
        with _readable(last[0]):
            return (last[0], zlib.decompress(rows[0][0])) if rows else None

    def span_ns(self) -> tuple[int, int] | None:
        """Stamps of the first moment that there ever was, and of the last."""
        ((first, last),) = self._store.rows(
            "SELECT MIN(stamp_ns), MAX(stamp_ns) FROM moments WHERE typeof(stamp_ns) = 'integer'"
        )
        forgotten = self._store.rows("SELECT value FROM about WHERE name = 'first_stamp_ns'")
        return None if first is None else (int(forgotten[0][0]) if forgotten else first, last)


_LOST = "what was closed then is not known: nothing could be written at moment {} of the history"
_FORGOTTEN = "what was closed then is not known any more: the history that is kept begins later"
_DAMAGED = "what was known then is lost: moment {} of the history is damaged"
_IS_WHOLE = (
    "typeof(stamp_ns) = 'integer' AND CASE WHEN json_valid(figures) THEN json_type(figures) = 'object' END"
)
"""In SQL: one that is damaged is missing from what goes over all."""
_OWN = ("of", "events", "static")
_WITHOUT_OWN = f"json_remove(figures, {', '.join(repr(f'$.{name}') for name in _OWN)})"
"""In SQL: with many zones nearly all of a row is theirs, and it would be read here to be left out."""


@contextmanager
def _readable(number: int) -> Iterator[None]:
    """LostMomentError for a moment that is damaged."""
    try:
        yield
    except (zlib.error, ValueError, TypeError, LookupError, AttributeError) as error:
        raise LostMomentError(_DAMAGED.format(number)) from error


def _end_of(zone: str, lasting: Sequence[_Happened]) -> int:
    """The number of the moment after which nothing changed about it."""
    number, event = lasting[0] if lasting else (_LAST, {})
    return number if event.get("id") == zone and event["kind"] in ("expired", "merged") else _LAST


def _until(stamp_ns: int | None) -> int:
    return _LAST if stamp_ns is None else stamp_ns


def _plain(value: float) -> float | None:
    return value if value == value else None


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def forget_before(connection: sqlite3.Connection, stamp_ns: int) -> None:
    """Retention: moments and beliefs before a stamp, except what later ones need to be read."""
    forget_moments_before(connection, stamp_ns)
    connection.execute("DELETE FROM beliefs WHERE stamp_ns < ?", (stamp_ns,))
    connection.execute("DELETE FROM media WHERE stamp_ns < ?", (stamp_ns,))


def forget_moments_before(connection: sqlite3.Connection, stamp_ns: int) -> None:
    (whole,) = connection.execute(
        "SELECT MAX(number) FROM moments WHERE whole AND stamp_ns <= ?", (stamp_ns,)
    ).fetchone()
    if whole is not None:
        # By it consumers tell this mission from another one, which knows nothing of what this one closed.
        connection.execute(
            "INSERT OR IGNORE INTO about SELECT 'first_stamp_ns', MIN(stamp_ns) FROM moments "
            "WHERE typeof(stamp_ns) = 'integer' HAVING COUNT(*) > 0"
        )
        connection.execute("DELETE FROM moments WHERE number < ?", (whole,))


def trim_moments(connection: sqlite3.Connection, room: int) -> None:
    """Retention: the oldest moments go until the rest needs about `room` bytes, as the newest ones do."""
    count, size = connection.execute(
        "SELECT (SELECT COUNT(*) FROM moments), AVG(LENGTH(line) + LENGTH(marks) + LENGTH(figures)) "
        "FROM (SELECT * FROM moments ORDER BY number DESC LIMIT ?)",
        (2 * WHOLE_EVERY,),
    ).fetchone()
    if not count or count * size <= room:
        return
    (stamp_ns,) = connection.execute(
        "SELECT stamp_ns FROM moments ORDER BY number DESC LIMIT 1 OFFSET ?", (int(room / size),)
    ).fetchone()
    forget_moments_before(connection, stamp_ns)
