"""What was accepted, in order: views, observations, ticks of the clock, when the map was looked at
again without them, what operators did.

The state of the service is a function of these records alone, so that it can be had again from the last
snapshot and the records behind it.
"""

from __future__ import annotations

import logging
import sqlite3
import zlib
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, NamedTuple

from crowdfence.service.store import BEGIN_ANEW, Store, StoreError, Write

_LOG = logging.getLogger(__name__)

RecordKind = Literal["view", "observation", "tick", "look", "operator"]
KEPT_SNAPSHOTS = 2


@dataclass(frozen=True, slots=True)
class Record:
    """One line of the journal."""

    seq: int
    """Its place; 0 for one that is not written yet."""
    kind: RecordKind
    drone: str
    """Empty for ticks, looks and operators."""
    stamp_ns: int
    received_ns: int
    body: bytes
    """As it came: JSON of a view or an action, bytes of an observation."""

    @property
    def checksum(self) -> int:
        head = f"{self.kind}|{self.drone}|{self.stamp_ns}|{self.received_ns}|".encode()
        return zlib.crc32(self.body, zlib.crc32(head))

    def at(self, seq: int) -> Record:
        """The same, written at a place."""
        return replace(self, seq=seq)


class PutAside(NamedTuple):
    """Records from the first damaged one to the end."""

    records: int
    operators: list[Record]
    """Those of them that tell what operators did, and are whole."""
    unread_operators: int
    """Those of operators that are not."""


class Journal:
    """Records and snapshots in a store."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def append(
        self, record: Record, then: Callable[[Future[int]], None], beside: Write | None = None
    ) -> Future[int]:
        """Write it, and what must be written with it or not at all; its place comes once it is on disk.
        sqlite3.IntegrityError for a view that is there already, other sqlite3.Error where it cannot be
        written. `then` is called in the order of the places."""
        return self._store.submit(_writing(record, beside), then, size=len(record.body))

    def append_again(self, record: Record) -> Record:
        """Write, behind all others, what was put aside; at its new place. StoreError."""
        return record.at(self._store.written(_writing(record)))

    def place_of(self, kind: RecordKind, drone: str, stamp_ns: int) -> int | None:
        """Of a view that is there already."""
        # The kinds as the partial index names them: without them SQLite reads the whole journal.
        rows = self._store.rows(
            "SELECT seq FROM journal WHERE kind IN ('view', 'observation') AND kind = ? AND drone = ? "
            "AND stamp_ns = ?",
            (kind, drone, stamp_ns),
        )
        return rows[0][0] if rows else None

    def after(self, seq: int) -> tuple[list[Record], PutAside]:
        """The records behind a place, in order, up to the first that is damaged; the others are put aside.
        StoreError where one is missing."""
        records = [
            (_record(row), row[5])
            for row in self._store.rows(
                "SELECT seq, kind, drone, stamp_ns, received_ns, checksum, body FROM journal WHERE seq > ? "
                "ORDER BY seq",
                (seq,),
            )
        ]
        places = [seq, *(record.seq for record, _ in records)]
        for applied, place in pairwise(places):
            if place != applied + 1:
                self._check_next(applied, place)
        whole = next(
            (number for number, (record, checksum) in enumerate(records) if record.checksum != checksum),
            len(records),
        )
        if whole < len(records):
            self._put_aside(records[whole][0].seq)
        operators = [one for one in records[whole:] if one[0].kind == "operator"]
        readable = [record for record, checksum in operators if record.checksum == checksum]
        aside = PutAside(len(records) - whole, readable, len(operators) - len(readable))
        return [record for record, _ in records[:whole]], aside

    def _check_next(self, applied: int, first: int) -> None:
        """The places of records that were put aside are given again; builds of before left them empty."""
        ((aside,),) = self._store.rows(
            "SELECT COUNT(DISTINCT seq) FROM damaged WHERE seq > ? AND seq < ?", (applied, first)
        )
        if first - applied - 1 > aside:
            raise StoreError(
                f"{self._store.path}: records {applied + 1} to {first - 1} are gone, and no snapshot holds "
                f"what they did; {BEGIN_ANEW}"
            )

    def _put_aside(self, first: int) -> None:
        def write(connection: sqlite3.Connection) -> None:
            connection.execute("INSERT INTO damaged SELECT * FROM journal WHERE seq >= ?", (first,))
            connection.execute("DELETE FROM journal WHERE seq >= ?", (first,))
            connection.execute("UPDATE sqlite_sequence SET seq = ? WHERE name = 'journal'", (first - 1,))

        self._store.written(write)

    def record(self, seq: int) -> Record | None:
        """One record; None where it is gone or damaged."""
        rows = self._store.rows(
            "SELECT seq, kind, drone, stamp_ns, received_ns, checksum, body FROM journal WHERE seq = ?",
            (seq,),
        )
        for row in rows:
            record = _record(row)
            if record.checksum == row[5]:
                return record
        return None

    def keep_snapshot(
        self, seq: int, body: bytes, *, needed_from: int, forget_before_ns: int
    ) -> Future[None]:
        """The state after record `seq`; it needs records from `needed_from` on. Older records go, except
        those behind the snapshot before and those received after `forget_before_ns`, which tell
        duplicates."""
        checksum = zlib.crc32(body)

        def write(connection: sqlite3.Connection) -> None:
            oldest = connection.execute("SELECT MIN(seq) FROM snapshots").fetchone()[0]
            connection.execute("INSERT OR REPLACE INTO snapshots VALUES (?, ?, ?)", (seq, checksum, body))
            connection.execute(
                "DELETE FROM snapshots WHERE seq NOT IN "
                "(SELECT seq FROM snapshots ORDER BY seq DESC LIMIT ?)",
                (KEPT_SNAPSHOTS,),
            )
            if oldest is not None:
                connection.execute(
                    "DELETE FROM journal WHERE seq <= ? AND seq < ? AND received_ns < ?",
                    (oldest, needed_from, forget_before_ns),
                )

        return self._store.submit(write, size=len(body))

    def restore_newest(self, restore: Callable[[int, bytes], None]) -> None:
        """Call `restore` with place and state of the newest snapshot, and with older ones until one can be
        used: it may fail in any way, as long as nothing has changed then. StoreError where there are
        snapshots and none can be used: records that they stand for may be gone."""
        rows = self._store.rows("SELECT seq, checksum, body FROM snapshots ORDER BY seq DESC")
        for seq, checksum, body in rows:
            if not isinstance(body, bytes) or zlib.crc32(body) != checksum:
                _LOG.error("snapshot %s is damaged: its checksum does not fit", seq)
                continue
            try:
                restore(seq, body)
                return
            except Exception:  # of another build, say
                _LOG.exception("snapshot %s cannot be used", seq)
        if rows:
            raise StoreError(
                f"{self._store.path}: none of its {len(rows)} snapshots can be used (the log says why); "
                f"{BEGIN_ANEW}"
            )


def _writing(record: Record, beside: Write | None = None) -> Write:
    """The place of a record, once it is written with what belongs to it."""
    row = (record.kind, record.drone, record.stamp_ns, record.received_ns, record.checksum, record.body)

    def write(connection: sqlite3.Connection) -> int | None:
        if beside is not None:
            beside(connection)
        return connection.execute(
            "INSERT INTO journal (kind, drone, stamp_ns, received_ns, checksum, body) "
            "VALUES (?, ?, ?, ?, ?, ?)",
            row,
        ).lastrowid

    return write


def _record(row: Sequence[Any]) -> Record:
    seq, kind, drone, stamp_ns, received_ns, _, body = row
    if not isinstance(body, bytes):  # damaged, so that its checksum does not fit
        body = b""
    return Record(seq, kind, drone, stamp_ns, received_ns, body)
