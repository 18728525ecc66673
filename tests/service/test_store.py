"""The file of the service, asked by several at once."""

from pathlib import Path
from threading import Thread
from time import sleep

import pytest

from crowdfence.service.store import Store, StoreError

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
