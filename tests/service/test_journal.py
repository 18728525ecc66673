"""Records on disk, and what it costs to find one."""

from pathlib import Path

from crowdfence.service.journal import Journal, Record
from crowdfence.service.store import Store

SECOND_NS = 1_000_000_000


def test_a_view_is_found_and_missed_at_the_cost_of_one_however_many_there_are(tmp_path: Path) -> None:
    """Every view is looked up before it is taken: with a scan a fleet would slow itself down as it flies."""
    store = Store(tmp_path, durable=False)
    journal = Journal(store)
    body = b"x" * 5000

    def steps_of(stamp_ns: int) -> tuple[int | None, int]:
        """The place of uav1's view, and how many instructions SQLite took to say so."""
        steps = 0

        def count() -> int:
            nonlocal steps
            steps += 1
            return 0

        for reader in store._readers.queue:
            reader.set_progress_handler(count, 1)
        place = journal.place_of("view", "uav1", stamp_ns)
        for reader in store._readers.queue:
            reader.set_progress_handler(None, 1)
        return place, steps

    def append(first: int, last: int) -> None:
        for number in range(first, last):
            record = Record(0, "view", "uav1", number * SECOND_NS, 0, body)
            future = journal.append(record, lambda done: None)
        assert future.result() == last

    append(0, 20)
    steps_of(0)  # reads the schema
    few = [steps_of(7 * SECOND_NS), steps_of(7 * SECOND_NS + 1)]
    append(20, 1000)
    many = [steps_of(7 * SECOND_NS), steps_of(7 * SECOND_NS + 1)]
    store.close()
    assert [place for place, _ in few] == [place for place, _ in many] == [8, None]
    assert max(steps for _, steps in many) <= 2 * max(steps for _, steps in few)
