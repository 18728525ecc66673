"""Which zone is which, by itself: regions are plain sets of columns."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from crowdfence.zones.tracker import ZoneTracker, column_keys, column_places
from crowdfence.zones.zone_id import MOST_ID, zone_id


def row(*columns: int) -> NDArray[np.int64]:
    """Columns (i, 0)."""
    return column_keys(np.array([(i, 0) for i in columns]).reshape(-1, 2))


@given(
    st.lists(st.tuples(st.integers(-(2**30), 2**30), st.integers(-(2**30), 2**30)), max_size=20, unique=True)
)
def test_keys_hold_their_columns_in_their_order(columns: list[tuple[int, int]]) -> None:
    places = np.array(sorted(columns), dtype=np.int64).reshape(-1, 2)
    keys = column_keys(places)
    assert (np.diff(keys) > 0).all()
    np.testing.assert_array_equal(column_places(keys), places)


@given(st.lists(st.lists(st.integers(0, 25), max_size=12, unique=True), min_size=2, max_size=8))
def test_ids_are_unique_never_reborn_and_every_end_is_told(history: list[list[int]]) -> None:
    tracker, ended, alive = ZoneTracker(), set(), {}
    for stamp_ns, cells in enumerate(history):
        groups = np.split(np.sort(cells), np.flatnonzero(np.diff(np.sort(cells)) > 1) + 1) if cells else []
        regions = [row(*group.tolist()) for group in groups]
        tracks, events = tracker.step(regions, stamp_ns)
        names = [track.id for track in tracks]
        assert len(set(names)) == len(names) and not ended & set(names)
        gone = {event.id for event in events if event.kind in ("expired", "merged")}
        born = {event.id for event in events if event.kind in ("created", "split")}
        assert gone == alive.keys() - set(names) and born == set(names) - alive.keys()
        # Who is gone shares nothing with what is there, or went into a zone that is there and older.
        for event in events:
            if event.kind == "merged":
                assert event.other in names and alive[event.other].number < alive[event.id].number
            elif event.kind == "expired":
                columns = alive[event.id].columns
                assert not any(np.isin(columns, region).any() for region in regions)
        ended |= gone
        alive = {track.id: track for track in tracks}


def test_the_nearest_zone_that_nobody_continues_is_continued() -> None:
    tracker = ZoneTracker(nearness_columns=3.0)
    first, _ = tracker.step([row(0, 1), row(10, 11)], 0)
    moved, events = tracker.step([row(4, 5), row(10, 11, 12)], 1)  # 3 columns on: from 1 to 4
    assert [track.id for track in moved] == [track.id for track in first] and events == []
    far, events = tracker.step([row(9), row(20)], 2)
    # 9 is next to 10, which continues nowhere else; 20 is too far from 5.
    assert far[0].id == "Z2" and far[1].id == "Z3"
    assert {(event.kind, event.id) for event in events} == {("expired", "Z1"), ("created", "Z3")}


def test_of_zones_that_are_as_near_the_oldest_is_continued() -> None:
    """More of them than a leaf of a k-d tree holds, which names any of those that are as near."""
    tracker = ZoneTracker(nearness_columns=1.0)
    square = np.array([[i, j] for i in range(0, 20, 2) for j in range(20)])
    zones, _ = tracker.step([column_keys(np.array([place])) for place in square], 0)
    number = {tuple(place): track.number for place, track in zip(square.tolist(), zones, strict=True)}
    for i in range(1, 19, 2):
        for j in range(20):
            restored = ZoneTracker(nearness_columns=1.0)
            restored.restore(tracker.to_json(), tracker.arrays())
            (zone,), _ = restored.step([column_keys(np.array([[i, j]]))], 1)
            assert zone.number == min(number[i - 1, j], number[i + 1, j])


def test_identifiers_have_at_most_seven_characters() -> None:
    assert len(zone_id(MOST_ID)) == 7
    assert len({zone_id(number) for number in range(1, 5000)}) == 4999
