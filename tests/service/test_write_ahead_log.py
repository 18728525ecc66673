"""Which commits a log holds, whatever its checksums say."""

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from crowdfence.service.write_ahead_log import commits_in

HEADER, FRAME = 32, 24
PAGE = 4096


@pytest.fixture
def writing(tmp_path: Path) -> Iterator[sqlite3.Connection]:
    """A database with three commits in its log, which nothing moves into it; each is of one page."""
    with closing(sqlite3.connect(tmp_path / "db", isolation_level=None)) as connection:
        connection.executescript(f"PRAGMA page_size = {PAGE}; PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA wal_autocheckpoint = 0")
        connection.execute("CREATE TABLE numbers (number)")
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        for number in range(3):
            connection.execute("INSERT INTO numbers VALUES (?)", (number,))
        yield connection


def crashed(tmp_path: Path) -> tuple[Path, bytearray]:
    """A copy of the database as it is on disk, and its log."""
    folder = tmp_path / "crashed"
    folder.mkdir()
    for name in ("db", "db-wal"):
        shutil.copy(tmp_path / name, folder / name)
    return folder / "db", bytearray((folder / "db-wal").read_bytes())


def frames_read(database: Path) -> int:
    """How many of its log SQLite itself finds."""
    with closing(sqlite3.connect(database)) as connection:
        return int(connection.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()[1])


def test_each_commit_ends_with_its_last_frame(writing: sqlite3.Connection, tmp_path: Path) -> None:
    writing.execute("INSERT INTO numbers VALUES (zeroblob(?))", (3 * PAGE,))
    database, log = crashed(tmp_path)
    frames = (len(log) - HEADER) // (FRAME + PAGE)
    assert frames > 4 and commits_in(database) == (1, 2, 3, frames)
    assert frames_read(database) == frames


@pytest.mark.parametrize("byte", [0, 17, 40, HEADER + 4, HEADER + 9, HEADER + FRAME + 100])
def test_commits_that_sqlite_leaves_out_are_in_it(
    writing: sqlite3.Connection, tmp_path: Path, byte: int
) -> None:
    """A bit of the log's header, of the first frame's, or of its page."""
    database, log = crashed(tmp_path)
    log[byte] ^= 1
    database.with_name("db-wal").write_bytes(log)
    commits = commits_in(database)
    assert commits[-2:] == (2, 3)
    assert frames_read(database) == 0


def test_frames_of_a_log_before_it_and_a_part_of_a_frame_are_none(
    writing: sqlite3.Connection, tmp_path: Path
) -> None:
    assert writing.execute("PRAGMA wal_checkpoint(RESTART)").fetchone() == (0, 3, 3)
    writing.execute("INSERT INTO numbers VALUES (3)")
    database, log = crashed(tmp_path)
    assert len(log) == HEADER + 3 * (FRAME + PAGE) and commits_in(database) == (1,)
    database.with_name("db-wal").write_bytes(log[: HEADER + FRAME + PAGE - 1])
    assert commits_in(database) == ()


@pytest.mark.parametrize("log", [None, b"", b"x" * HEADER, b"x" * 60, b"x" * 10_000])
def test_without_a_log_there_are_none(tmp_path: Path, log: bytes | None) -> None:
    (tmp_path / "db").write_bytes(b"")
    if log is not None:
        (tmp_path / "db-wal").write_bytes(log)
    assert commits_in(tmp_path / "db") == ()
