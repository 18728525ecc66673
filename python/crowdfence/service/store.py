"""What the service keeps on disk: one SQLite file, written by one thread.

Several threads hand in writes; what has gathered is committed together, so that one flush of the disk serves
them all. A write counts once its commit is flushed (WAL, synchronous=FULL): a process that is killed, or a
machine that loses power, finds it again, and nothing of what came after.
"""

from __future__ import annotations

import fcntl
import json
import logging
import queue
import shutil
import sqlite3
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
from threading import Lock, Thread
from typing import Any, NamedTuple, TextIO, get_args

from crowdfence.service.held_files import HeldFiles
from crowdfence.service.write_ahead_log import commits_in
from crowdfence.service.write_trouble import WriteTrouble
from crowdfence.zones.tracker import EventKind

FILE = "crowdfence.sqlite"
LOCK = "crowdfence.lock"
VERSION = 1
MOST_TOGETHER = 256
"""Writes of one commit."""
_READERS = 4
"""Questions at once. What became of a zone is looked for in the whole history, for seconds after a day of
flying, and views, which are looked up before they are taken, must not wait for it."""

BEGIN_ANEW = "move the folder away to begin anew, or restore a copy"
"""What to do about a file that cannot be gone on with."""
_SHORT = 60
"""Characters of a value that is named where it differs."""
_NEEDS_BYTES = 1_000_000
"""What a disk must have free for a new file, its log and its index; with less, SQLite says many things."""
_REMEDIES = {
    "full": "make room there, or name a folder on another disk with --data",
    "unable to open": "the service must be able to read and write it",
    "readonly": "the service must be able to write it and its folder",
    "locked": "end the program that has it open",
    "disk I/O": "the system's log says what the disk has",
}
"""What to do about an error of SQLite by a word of its text, which is the same in every build."""

_LOG = logging.getLogger(__name__)

Write = Callable[[sqlite3.Connection], Any]


class _Entry(NamedTuple):
    """A write that waits."""

    write: Write
    future: Future[Any]
    size: int


class _Outcome(NamedTuple):
    """What became of it."""

    entry: _Entry
    result: Any
    failure: Exception | None


LASTING = " OR ".join(
    f'figures LIKE \'%"kind":"{kind}"%\'' for kind in get_args(EventKind) if kind != "updated"
)
"""In SQL: moments at which more became of a zone than that it changed; they are few."""
_TABLES = f"""
CREATE TABLE IF NOT EXISTS about (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS journal (
  seq INTEGER PRIMARY KEY AUTOINCREMENT, kind TEXT NOT NULL, drone TEXT NOT NULL, stamp_ns INTEGER NOT NULL,
  received_ns INTEGER NOT NULL, checksum INTEGER NOT NULL, body BLOB NOT NULL);
CREATE UNIQUE INDEX IF NOT EXISTS journal_once ON journal (kind, drone, stamp_ns)
  WHERE kind IN ('view', 'observation');
CREATE TABLE IF NOT EXISTS damaged AS SELECT * FROM journal WHERE 0;
CREATE TABLE IF NOT EXISTS snapshots (seq INTEGER PRIMARY KEY, checksum INTEGER NOT NULL, body BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS moments (
  number INTEGER PRIMARY KEY, stamp_ns INTEGER NOT NULL, whole INTEGER NOT NULL, line BLOB NOT NULL,
  marks TEXT NOT NULL, figures TEXT NOT NULL);
CREATE INDEX IF NOT EXISTS moments_by_stamp ON moments (stamp_ns);
CREATE INDEX IF NOT EXISTS lasting_moments ON moments (number) WHERE {LASTING};
CREATE TABLE IF NOT EXISTS beliefs (number INTEGER PRIMARY KEY, stamp_ns INTEGER NOT NULL, body BLOB NOT
NULL); CREATE INDEX IF NOT EXISTS beliefs_by_stamp ON beliefs (stamp_ns); CREATE TABLE IF NOT EXISTS media (
  kind TEXT NOT NULL, drone TEXT NOT NULL, stamp_ns INTEGER NOT NULL, body BLOB NOT NULL,
  PRIMARY KEY (kind, drone, stamp_ns)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS audit (
  id INTEGER PRIMARY KEY AUTOINCREMENT, stamp_ns INTEGER NOT NULL, user TEXT NOT NULL, role TEXT NOT NULL,
  action TEXT NOT NULL, zone TEXT, reason TEXT, drone TEXT);
CREATE TABLE IF NOT EXISTS alerts (id TEXT PRIMARY KEY, raised_ns INTEGER NOT NULL, body TEXT NOT NULL);
"""


class StoreError(OSError):
    """The file cannot be read or written; the message names it."""


class Store:
    """Open until `close`. `durable=False` is for replays, which can be had again."""

    def __init__(self, folder: Path, *, durable: bool = True) -> None:
        """StoreError for a folder that cannot be written or is in use, and for a file that is damaged, of
        another version or of another program, which is left as it is."""
        self.path = folder / FILE
        self._lock_file = _locked(folder)
        self.on_trouble: Callable[[str | None], None] = lambda trouble: None
        """Called with what went wrong when writes fail, and with None when they work again."""
        self.lost_commits = 0
        """At the end of the log, where one byte is damaged: SQLite goes on as if they had never been."""
        self._trouble = WriteTrouble(folder)
        self._writes: queue.Queue[_Entry | None] = queue.Queue()
        self._closing, self._is_closed = Lock(), False
        self._readers: queue.LifoQueue[sqlite3.Connection] = queue.LifoQueue()
        try:
            self._writer = self._opened(durable)
            self._files = HeldFiles((self.path, self.path.with_name(f"{FILE}-wal")))
            for _ in range(_READERS):
                reader = sqlite3.connect(self.path, check_same_thread=False)
                # Damaged text is for who reads it to find, who knows what to do without it.
                reader.text_factory = partial(str, encoding="utf-8", errors="replace")
                self._readers.put(reader)
                reader.execute("PRAGMA query_only = 1")
        except sqlite3.Error as error:
            self._lock_file.close()
            raise self._refusal(error) from error
        except StoreError:
            self._lock_file.close()
            raise
        self._thread = Thread(target=self._write_all, name="store", daemon=True)
        self._thread.start()

    def _refusal(self, error: sqlite3.Error) -> StoreError:
        """What is wrong, where, and what to do."""
        free = shutil.disk_usage(self.path.parent).free
        if free < _NEEDS_BYTES:
            return StoreError(f"{self.path}: {error}, {free / 1e6:.1f} MB are free; {_REMEDIES['full']}")
        remedy = next((told for word, told in _REMEDIES.items() if word in str(error)), BEGIN_ANEW)
        return StoreError(f"{self.path}: {error}; {remedy}")

    def _opened(self, durable: bool) -> sqlite3.Connection:
        self._check_ours()
        commits = commits_in(self.path)
        connection = sqlite3.connect(self.path, check_same_thread=False, isolation_level=None, timeout=2.0)
        # Before the first page is written, which WAL does: it cannot be chosen later.
        connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute(f"PRAGMA synchronous = {'FULL' if durable else 'OFF'}")
        (found,) = connection.execute("PRAGMA quick_check(1)").fetchone()
        if found != "ok":
            raise StoreError(f"{self.path} is damaged ({found}); {BEGIN_ANEW}")
        (_, frames, _) = connection.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
        self.lost_commits = sum(end > frames for end in commits)
        # Together: a file that was begun half would be taken for one of another program.
        connection.executescript(
            f"BEGIN; {_TABLES} INSERT OR IGNORE INTO about VALUES ('version', '{VERSION}'); COMMIT"
        )
        # Builds of before let operators decide about zones alone.
        if "drone" not in {row[1] for row in connection.execute("PRAGMA table_info(audit)")}:
            connection.execute("ALTER TABLE audit ADD COLUMN drone TEXT")
        return connection

    def _check_ours(self) -> None:
        """StoreError for a file that others write, which ours would be written into; it is only read here."""
        if not self.path.exists() or self.path.stat().st_size == 0:
            return
        # Beside a journal of a write that was cut off SQLite reads a file only after it has rolled that back.
        how = "immutable=1" if self.path.with_name(f"{FILE}-journal").exists() else "mode=ro"
        with closing(sqlite3.connect(f"{self.path.resolve().as_uri()}?{how}", uri=True)) as peeking:
            tables = {
                name for (name,) in peeking.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
            }
            if tables and not tables >= {"about", "journal"}:
                raise StoreError(
                    f"{self.path} is a database of another program (it has a table {min(tables)}): name "
                    "another folder with --data"
                )
            version = tables and peeking.execute("SELECT value FROM about WHERE name = 'version'").fetchone()
        if version and version[0] != str(VERSION):
            raise StoreError(
                f"{self.path} has version {version[0]}; this crowdfence reads {VERSION}: name another folder "
                "with --data, or serve it with the crowdfence that wrote it"
            )

    def belongs_to(self, **what: str) -> None:
        """Written when the file is new, compared when it is not. StoreError names what differs."""
        known = dict(self.rows("SELECT name, value FROM about"))
        for name, value in what.items():
            if _set_values(known.setdefault(name, value)) != _set_values(value):
                raise StoreError(
                    f"{self.path} was begun with another {name}{_difference(known[name], value)}: start it "
                    "with the same to go on, or name another folder with --data, which begins with nothing "
                    "seen"
                )
        rows = list(what.items())
        self.written(
            lambda connection: connection.executemany("INSERT OR IGNORE INTO about VALUES (?, ?)", rows)
        )

    def submit(
        self, write: Write, then: Callable[[Future[Any]], None] | None = None, *, size: int = 0
    ) -> Future[Any]:
        """Write with the next commit; the result of `write` comes once it is on disk. Its error comes instead
        where it failed, sqlite3.Error where that was the file's; nothing of it was written then. `then` is
        called in the thread that writes, in the order of the writes. `size`: about how many bytes it needs,
        0 for few."""
        future: Future[Any] = Future()
        if then is not None:
            future.add_done_callback(then)
        with self._closing:
            if not self._is_closed:
                self._writes.put(_Entry(write, future, size))
                return future
        future.set_exception(sqlite3.ProgrammingError("the service has ended"))
        return future

    def written(self, write: Write) -> Any:
        """The result of a write that nothing can go on without, once it is on disk. StoreError."""
        try:
            return self.submit(write).result()
        except sqlite3.Error as error:
            raise self._refusal(error) from error

    def note(self, write: Write, *, size: int = 0) -> None:
        """`submit` for what nobody waits for: a failure is told to `on_trouble` alone."""
        self.submit(write, size=size)

    def flush(self) -> None:
        """Wait until all that was handed in is on disk, or was refused."""
        self.submit(lambda connection: None).result()

    @property
    def waiting(self) -> int:
        """Writes that are not on disk yet."""
        return self._writes.qsize()

    @property
    def bytes(self) -> int:
        """Size of the file, without what is not yet moved into it; 0 where it was removed."""
        return self.path.stat().st_size if self.path.exists() else 0

    def rows(self, query: str, values: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        """What is on disk. StoreError when it cannot be read."""
        reader = self._readers.get()
        try:
            return reader.execute(query, values).fetchall()
        except sqlite3.Error as error:
            raise StoreError(f"{self.path}: {error}") from error
        finally:
            self._readers.put(reader)

    def close(self) -> None:
        """Write what waits, then close."""
        with self._closing:  # nothing comes behind the last one, whose giver would wait for good
            self._is_closed = True
            self._writes.put(None)
        self._thread.join()
        readers = [self._readers.get() for _ in range(_READERS)]
        for connection in (*readers, self._writer):
            with suppress(sqlite3.Error):
                connection.close()
        for reader in readers:  # who asks now is told that it is closed
            self._readers.put(reader)
        self._lock_file.close()

    def _write_all(self) -> None:
        open_ = True
        while open_:
            batch = [self._writes.get()]
            while len(batch) < MOST_TOGETHER and not self._writes.empty():
                batch.append(self._writes.get())
            open_ = None not in batch
            self._commit([entry for entry in batch if entry is not None])

    def _commit(self, batch: list[_Entry]) -> None:
        """All answers come after the commit, also that something is there already."""
        outcomes = self._together(batch)
        self._tell(outcomes)
        for entry, result, failure in outcomes:
            if failure is None:
                entry.future.set_result(result)
            else:
                entry.future.set_exception(failure)

    def _together(self, batch: list[_Entry]) -> list[_Outcome]:
        """In one commit; each by itself where the disk has no room for all."""
        try:
            self._check_files()
            self._writer.execute("BEGIN IMMEDIATE")
            outcomes = [_Outcome(entry, *self._alone(entry.write)) for entry in batch]
            self._writer.execute("COMMIT")
        except Exception as error:  # whatever it is: those who wait hear of it, and the next writes follow
            with suppress(sqlite3.Error):
                self._writer.execute("ROLLBACK")
            if len(batch) > 1 and "full" in str(error):
                return [outcome for entry in batch for outcome in self._together([entry])]
            return [_Outcome(entry, None, error) for entry in batch]
        return outcomes

    def _check_files(self) -> None:
        """sqlite3.OperationalError where a restart would not find what is written. SQLite writes into a file
        without a name as into any other."""
        lost = self._files.lost
        if lost is not None:
            raise sqlite3.OperationalError(
                f"{lost} was removed or moved away while it is in use, so that what is written would not be "
                "found again: put the same file back if it still exists; if not, what is known is in this "
                "process alone: export the zones before it ends, and give them to the next (--static-zones)"
            )

    def _alone(self, write: Write) -> tuple[Any, Exception | None]:
        """The write by itself: one that fails takes back nothing but its own."""
        self._writer.execute("SAVEPOINT one")
        try:
            result = write(self._writer)
        except Exception as error:
            if not self._writer.in_transaction:  # a full disk ends the whole transaction
                raise
            if not isinstance(error, sqlite3.Error):
                _LOG.exception("a write failed by a mistake of ours")
            self._writer.execute("ROLLBACK TO one")
            self._writer.execute("RELEASE one")
            return None, error
        self._writer.execute("RELEASE one")
        return result, None

    def _tell(self, outcomes: list[_Outcome]) -> None:
        before = self._trouble.text
        self._trouble.passed(sum(one.entry.size for one in outcomes if one.failure is None))
        for one in outcomes:
            if one.failure is not None and _is_trouble(one.failure):
                self._trouble.refused(one.failure, one.entry.size)
        if self._trouble.text is not None or before is not None:
            self.on_trouble(self._trouble.text)


def _set_values(text: str) -> dict[str, Any] | str:
    """What a value sets, by name, or else the value: what nobody sets may be missing, as a build that did not
    know it yet wrote none."""
    with suppress(ValueError):
        read = json.loads(text)
        if isinstance(read, dict):
            return {name: value for name, value in read.items() if value is not None}
    return text


def _difference(before: str, now: str) -> str:
    """What differs between two values, as far as they are short enough to be read."""
    old, new = _set_values(before), _set_values(now)
    if isinstance(old, str) or isinstance(new, str):
        return f" ({before}, now {now})" if len(before) + len(now) < 2 * _SHORT else ""
    differ = [name for name in {**old, **new} if old.get(name) != new.get(name)]
    told = ((name, json.dumps(old.get(name)), json.dumps(new.get(name))) for name in differ)
    said = [
        f"{name} {value}, now {other}" if len(value) + len(other) < 2 * _SHORT else name
        for name, value, other in told
    ]
    return f" ({'; '.join(said)})"


def _locked(folder: Path) -> TextIO:
    """The lock of a folder, which is made; held until it is closed. StoreError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / LOCK).open("w")
    except OSError as error:
        raise StoreError(
            f"{folder}: {error.strerror}; --data needs a folder that the service can write, on a disk with "
            "room"
        ) from error
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        file.close()
        if isinstance(error, BlockingIOError):
            raise StoreError(f"{folder} is in use by another service") from error
        raise StoreError(
            f"{folder} cannot be locked: {error.strerror}; --data needs a folder on a disk that can, which "
            "some of other machines cannot"
        ) from error
    return file


def _is_trouble(error: Exception) -> bool:
    """Whether the file cannot be written, rather than one write refused."""
    return isinstance(error, sqlite3.Error) and not isinstance(error, sqlite3.IntegrityError)
