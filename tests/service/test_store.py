"""The file of the service: opened where it should not or cannot be, asked by several at once."""

import errno
import os
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import closing, contextmanager
from pathlib import Path
from threading import Event, Thread
from time import sleep
from types import SimpleNamespace

import pytest

from crowdfence.service.store import FILE, Store, StoreError
from crowdfence.service.write_trouble import WriteTrouble
from support.served import ORIGIN, write_level_ground

# Instructions of SQLite that take seconds, as a look through a day of moments does.
LONG = "WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT 6000000) SELECT MAX(i) FROM n"


def test_a_question_that_takes_long_holds_up_no_other(tmp_path: Path) -> None:
    store = Store(tmp_path, durable=False)
    found: list[object] = []
    asks = Thread(target=lambda: found.extend(store.rows(LONG)))
    asks.start()
    sleep(0.2)
    assert store.rows("SELECT 1") == [(1,)] and asks.is_alive()
    asks.join()
    store.close()
    assert found == [(6_000_000,)]


def test_who_asks_a_closed_store_is_told_so(tmp_path: Path) -> None:
    store = Store(tmp_path, durable=False)
    store.close()
    for _ in range(9):
        with pytest.raises(StoreError, match="closed"):
            store.rows("SELECT 1")
    told = []
    late = store.submit(lambda connection: None, told.append)
    with pytest.raises(sqlite3.Error, match="the service has ended"):
        late.result(timeout=10.0)
    assert told == [late]


def test_what_is_handed_in_while_it_closes_is_written_or_refused(tmp_path: Path) -> None:
    """Requests that outlast the end of the server: their threads must end, and know."""
    store = Store(tmp_path, durable=False)
    futures: list[Future[object]] = []

    def give(giver: int) -> None:
        for number in range(100_000):
            row = (f"{giver} {number}", "")
            futures.append(
                store.submit(
                    lambda connection, row=row: connection.execute("INSERT INTO about VALUES (?, ?)", row)
                )
            )
            if futures[-1].done() and futures[-1].exception():
                return

    givers = [Thread(target=give, args=(giver,)) for giver in range(4)]
    for thread in givers:
        thread.start()
    sleep(0.2)
    store.close()
    for thread in givers:
        thread.join()
    written = sum(one.exception(timeout=10.0) is None for one in futures)
    assert 0 < written < len(futures)
    with closing(sqlite3.connect(tmp_path / FILE)) as kept:
        assert kept.execute("SELECT COUNT(*) FROM about WHERE value = ''").fetchone() == (written,)


def bytes_below(folder: Path) -> dict[str, bytes]:
    """Of the file and the journal of a write that was cut off."""
    names = (FILE, f"{FILE}-journal")
    return {one.name: one.read_bytes() for one in folder.iterdir() if one.name in names}


def cut_off(folder: Path, begun: str) -> None:
    """A file that held what `begun` wrote, as a kill in the middle of the next, large write leaves it."""
    whole = folder / "whole"
    whole.mkdir()
    with closing(sqlite3.connect(whole / FILE, isolation_level=None)) as writing:
        writing.executescript(f"{begun}; PRAGMA cache_size = 1; BEGIN; CREATE TABLE large (a)")
        writing.execute("INSERT INTO large VALUES (zeroblob(1000000))")
        for name in (FILE, f"{FILE}-journal"):
            shutil.copy(whole / name, folder / name)
    peeking = sqlite3.connect(f"file:{folder / FILE}?mode=ro", uri=True)
    with closing(peeking), pytest.raises(sqlite3.Error, match="readonly"):
        peeking.execute("SELECT name FROM sqlite_master")


@pytest.mark.parametrize("mode", ["DELETE", "WAL"])
def test_a_database_of_another_program_is_left_as_it_is(tmp_path: Path, mode: str) -> None:
    with closing(sqlite3.connect(tmp_path / FILE)) as theirs:
        theirs.execute(f"PRAGMA journal_mode = {mode}")
        theirs.executescript("CREATE TABLE people (name TEXT); INSERT INTO people VALUES ('Ada')")
    before = bytes_below(tmp_path)
    for _ in range(2):  # and the lock is free again
        with pytest.raises(StoreError) as refused:
            Store(tmp_path)
        assert str(refused.value) == (
            f"{tmp_path / FILE} is a database of another program (it has a table people): name another "
            "folder with --data"
        )
    assert bytes_below(tmp_path) == before
    with closing(sqlite3.connect(tmp_path / FILE)) as theirs:
        assert theirs.execute("SELECT name FROM sqlite_master").fetchall() == [("people",)]


def test_also_where_a_write_of_that_program_was_cut_off(tmp_path: Path) -> None:
    cut_off(tmp_path, "CREATE TABLE people (name TEXT)")
    before = bytes_below(tmp_path)
    with pytest.raises(StoreError, match="a database of another program"):
        Store(tmp_path)
    assert bytes_below(tmp_path) == before and len(before) == 2


def test_a_store_whose_making_was_cut_off_is_made(tmp_path: Path) -> None:
    """Its first page is there, and the journal of the write that should have made the rest."""
    cut_off(tmp_path, "PRAGMA user_version = 1")
    store = Store(tmp_path)
    tables = {name for (name,) in store.rows("SELECT name FROM sqlite_master")}
    assert {"about", "journal", "alerts"} <= tables and "large" not in tables
    store.close()


def test_a_store_of_a_later_version_is_left_as_it_is(tmp_path: Path) -> None:
    Store(tmp_path).close()
    with closing(sqlite3.connect(tmp_path / FILE, isolation_level=None)) as later:
        later.execute("UPDATE about SET value = '2' WHERE name = 'version'")
        later.execute("DROP TABLE alerts")  # that it keeps elsewhere
    before = bytes_below(tmp_path)
    with pytest.raises(StoreError, match="has version 2; this crowdfence reads 1: name another folder"):
        Store(tmp_path)
    assert bytes_below(tmp_path) == before


@contextmanager
def as_nobody() -> Iterator[None]:
    """Root may write everywhere."""
    is_root = os.geteuid() == 0
    if is_root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if is_root:
            os.seteuid(0)


def test_a_folder_that_may_not_be_written_is_one_line(tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    theirs.chmod(0o555)
    tmp_path.chmod(0o755)
    for folder in (theirs, theirs / "data"):
        with as_nobody(), pytest.raises(StoreError) as refused:
            Store(folder)
        assert str(refused.value) == (
            f"{folder}: Permission denied; --data needs a folder that the service can write, on a disk with "
            "room"
        )


def test_a_file_in_place_of_the_folder_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "data").write_text("no folder")
    with pytest.raises(StoreError, match=r"data: File exists; --data needs a folder"):
        Store(tmp_path / "data")


def test_a_disk_that_cannot_lock_is_not_told_as_in_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("crowdfence.service.store.fcntl.flock", refused)
    with pytest.raises(StoreError, match=r"cannot be locked: No locks available; --data needs a folder on"):
        Store(tmp_path)


def on_a_disk_of(size: str, folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    """The command line in a process that sees a disk of this size at `folder`; skipped where none can be."""
    folder.mkdir()
    alone = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c"]
    mounting = f"mount -t tmpfs -o size={size} none '{folder}'"
    if shutil.which("unshare") is None or subprocess.run([*alone, mounting], check=False).returncode != 0:
        pytest.skip("no disk can be mounted here")
    return subprocess.run(
        [*alone, f'{mounting} && exec "$@"', "sh", sys.executable, "-m", "crowdfence", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize("size", ["4k", "24k", "80k"])
def test_a_full_disk_is_one_line(tmp_path: Path, size: str) -> None:
    """Whichever of its files has no room: SQLite says something else of each."""
    ground = write_level_ground(tmp_path / "ground.tif")
    map_ = ("--terrain", ground, "--terrain-option", "height_offset_m=0", "--voxel-size-m", 2)
    how = (*map_, "--origin", ORIGIN, "--port", 0)
    done = on_a_disk_of(size, tmp_path / "disk", "serve", *how, "--data", tmp_path / "disk" / "data")
    errors = [line for line in done.stderr.splitlines() if not line.startswith("INFO")]
    assert done.returncode == 1 and len(errors) == 1, done.stderr
    assert errors[0].startswith(f"error: {tmp_path / 'disk' / 'data'}")
    assert "0.0 MB are free; make room there, or name a folder on another disk with --data" in errors[0]


FULL = sqlite3.OperationalError("database or disk is full")


def test_a_full_disk_is_told_until_as_much_goes_through_as_was_refused(tmp_path: Path) -> None:
    trouble = WriteTrouble(tmp_path)
    trouble.passed(0)
    assert trouble.text is None
    trouble.refused(FULL, 50_000)
    trouble.refused(FULL, 9_000)
    for size in (0, 300, 9_000, 40_000):
        trouble.passed(size)
        assert trouble.text == "database or disk is full", size
    trouble.refused(FULL, 0)  # what went through before it says nothing about now
    trouble.passed(49_999)
    assert trouble.text is not None
    trouble.passed(1)
    assert trouble.text is None
    trouble.refused(FULL, 0)
    trouble.passed(4095)
    assert trouble.text is not None, "what nobody told the size of needs a page"
    trouble.passed(1)
    assert trouble.text is None


def test_a_full_disk_is_told_until_there_is_room_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That was not there at the refusal: a quota is full on a disk with room."""
    free = 0
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=free))
    trouble = WriteTrouble(tmp_path)
    trouble.refused(FULL, 50_000)
    for free in (0, 199_999_999):
        trouble.passed(0)
        assert trouble.text is not None, free
    free = 200_000_000
    trouble.passed(0)
    assert trouble.text is None
    trouble.refused(FULL, 50_000)
    trouble.passed(0)
    assert trouble.text is not None


def test_a_write_that_finds_no_room_takes_none_that_does_with_it(tmp_path: Path) -> None:
    """They come in one commit, which the large one ends; what is small fits into the pages that are there."""
    store = Store(tmp_path, durable=False)
    store.submit(lambda connection: connection.execute("PRAGMA max_page_count = 1")).result()
    goes_on, told = Event(), []
    store.on_trouble = told.append
    insert = "INSERT INTO about VALUES (?, ?)"
    first = store.submit(lambda connection: goes_on.wait(20.0))
    sizes = {"alert": 100, "view": 100_000, "alert after it": 100}
    futures = {
        name: store.submit(
            lambda connection, row=(name, "x" * size): connection.execute(insert, row), size=size
        )
        for name, size in sizes.items()
    }
    goes_on.set()
    assert first.result() and "full" in str(futures["view"].exception())
    store.flush()
    kept = {name for (name,) in store.rows("SELECT name FROM about")}
    assert kept & {*sizes} == {"alert", "alert after it"}
    assert futures["alert"].exception() is None and "full" in told[-1], "the small ones do not call it well"
    store.close()
