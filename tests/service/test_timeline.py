"""Moments on disk, asked for over time."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import shapely
from httpx import Response

from crowdfence.service import timeline as timeline_module
from crowdfence.service.store import Store
from crowdfence.service.timeline import LostMomentError, Moment, Timeline, forget_before
from crowdfence.zones import Zone, ZoneEvent, ZoneSet
from support.small_service import asked, message, running, settle, views

NAME = 'a"b\\ü$.of'


def test_points_are_the_figures_of_the_moments_whatever_zones_there_were(tmp_path: Path) -> None:
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    figures = [
        {"seen_m2": 0.1 + 0.2, "crowd_m2": 1e-17, "closed_m2": 1.0 / 3.0, "zones": 1},
        {"seen_m2": 1.5e300, "crowd_m2": 0.0, "closed_m2": 4.0, "zones": 1},
    ]
    for number, told in enumerate(figures, 1):
        given = Zone.of_no_look(NAME, shapely.box(0, 0, 2, 2), "static", "given")
        event = ZoneEvent(number * 1_000_000_000, "created", "Z1")
        zones = ZoneSet((), 0.5, 0.0, 0, 0.0, static=(given,), events=(event,))
        timeline.add(Moment(number, number * 1_000_000_000, zones, {}, told))
    store.flush()
    points = timeline.points()
    store.close()
    assert points == [
        {"stamp_ns": "1000000000", "stamp_ms": 1000.0, **figures[0]},
        {"stamp_ns": "2000000000", "stamp_ms": 2000.0, **figures[1]},
    ]
    assert [type(point["zones"]) for point in points] == [int, int]


def test_points_are_in_the_order_of_their_stamps(tmp_path: Path) -> None:
    """An operator acts at 40 s, the steps of 20 and 30 s come behind: who looks for one among the points by
    halves found another."""
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    zone = Zone.of_no_look("Z1", shapely.box(0, 0, 2, 2), "crowd", "seen")
    for number, stamp_s in enumerate((10, 40, 20, 30, 50), 1):
        zones = ZoneSet((zone,), 0.5, 0.0, 0, 0.0)
        timeline.add(Moment(number, stamp_s * 1_000_000_000, zones, {}, {"zones": number}))
    store.flush()
    points, history = timeline.points(), timeline.zone_history("Z1")["points"]
    store.close()
    assert [(point["stamp_ms"], point["zones"]) for point in points] == [
        (10_000.0, 1),
        (20_000.0, 3),
        (30_000.0, 4),
        (40_000.0, 2),
        (50_000.0, 5),
    ]
    assert [point["stamp_ms"] for point in history] == [10_000.0, 20_000.0, 30_000.0, 40_000.0, 50_000.0]


def test_what_became_of_a_zone_is_told_however_long_it_lasts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Z1 comes, changes for 20 moments, takes Z2 in and changes on: of changes the newest are told."""
    monkeypatch.setattr(timeline_module, "MOST_POINTS", 5)
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    zone = Zone.of_no_look("Z1", shapely.box(0, 0, 2, 2), "crowd", "seen")
    kinds: list[tuple[str, str, str | None]] = [("created", "Z1", None), *[("updated", "Z1", None)] * 20]
    kinds += [("merged", "Z2", "Z1"), ("created", "Z3", None), *[("updated", "Z1", None)] * 7]
    for number, (kind, name, other) in enumerate(kinds, 1):
        event = ZoneEvent(number * 1_000_000_000, kind, name, other)  # type: ignore[arg-type]
        zones = ZoneSet((zone,), 0.5, 0.0, 0, 0.0, events=(event,))
        timeline.add(Moment(number, number * 1_000_000_000, zones, {}, {}))
    store.flush()
    events = timeline.zone_history("Z1")["events"]
    early = timeline.zone_history("Z1", 4_000_000_000)["events"]
    store.close()
    assert [(event["kind"], event["stamp_ms"] / 1e3) for event in events] == [
        ("created", 1.0),
        ("merged", 22.0),
        *[("updated", float(number)) for number in range(26, 31)],
    ]
    assert [event["stamp_ms"] / 1e3 for event in early] == [1.0, 2.0, 3.0, 4.0]


def test_what_became_of_a_zone_is_found_without_reading_the_whole_history(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An open card asks every second. After eight hours each took two to three seconds, and with four of them
    views waited to be looked up."""
    monkeypatch.setattr(timeline_module, "MOST_POINTS", 5)
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    flown = [("created", "Z1"), ("updated", "Z1"), ("updated", "Z1"), ("expired", "Z1"), ("created", "Z2")]
    for number, (kind, name) in enumerate([*flown, *[("updated", "Z2")] * 20], 1):
        event = ZoneEvent(number * 1_000_000_000, kind, name)  # type: ignore[arg-type]
        timeline.add(replace(_moment(number), zones=replace(_moment(number).zones, events=(event,))))
    store.flush()
    asked, rows = [], store.rows

    def noting(query: str, values: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        asked.append((query, values))
        return rows(query, values)

    monkeypatch.setattr(store, "rows", noting)
    told = {zone: timeline.zone_history(zone)["events"] for zone in ("Z1", "Z2", "O1")}
    points = timeline.points()
    steps = [row[3] for query, values in asked for row in rows(f"EXPLAIN QUERY PLAN {query}", values)]
    store.close()
    assert {zone: [event["kind"] for event in events] for zone, events in told.items()} == {
        "Z1": ["created", "updated", "updated", "expired"],
        "Z2": ["created", *["updated"] * 5],
        "O1": [],
    }
    assert [point["stamp_ms"] for point in points] == [5e3, 10e3, 15e3, 20e3, 25e3]
    assert not [step for step in steps if step.startswith("SCAN moments") and "lasting_moments" not in step]


def _moment(number: int, *static: Zone) -> Moment:
    return Moment(number, number * 1_000_000_000, ZoneSet((), 0.5, 0.0, 0, 0.0, static=static), {}, {})


def _given(name: str, east: float) -> Zone:
    return Zone.of_no_look(name, shapely.box(east, 0, east + 2, 3), "static", "given")


def test_zones_of_others_are_written_once_and_told_at_every_moment(tmp_path: Path) -> None:
    """A1 throughout, D1 drawn at the third of six moments and taken back at the fifth."""
    a1, d1 = _given("A1", 0.0), _given("D1", 7.0)
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    for number, zones in enumerate([(a1,), (a1,), (a1, d1), (a1, d1), (a1,), (a1,)], 1):
        timeline.add(_moment(number, *zones))
    store.flush()
    told = [timeline.at(number * 1_000_000_000) for number in range(1, 7)]
    histories = {name: timeline.zone_history(name)["points"] for name in ("A1", "D1")}
    sizes = [
        size for (size,) in store.rows("SELECT LENGTH(line) + LENGTH(figures) FROM moments ORDER BY number")
    ]
    points = timeline.points()
    store.close()
    assert [[zone.id for zone in moment.zones.static] for moment in told if moment] == [
        ["A1"],
        ["A1"],
        ["A1", "D1"],
        ["A1", "D1"],
        ["A1"],
        ["A1"],
    ]
    assert all(moment and moment.zones.static[0].polygon.equals(a1.polygon) for moment in told)
    assert told[3] and told[3].figures == {}
    assert [point["stamp_ms"] for point in histories["A1"]] == [1e3, 2e3, 3e3, 4e3, 5e3, 6e3]
    assert [point["stamp_ms"] for point in histories["D1"]] == [3e3, 4e3]
    assert {point["closed_m2"] for point in histories["D1"]} == {6.0}
    assert all(set(point) == {"stamp_ns", "stamp_ms"} for point in points)
    assert max(sizes[1], sizes[3], sizes[5]) < 0.75 * min(sizes[0], sizes[2])


def test_a_step_behind_what_an_operator_did_is_in_the_history_of_that_instant(tmp_path: Path) -> None:
    """An operator acts at 40 s, while the map is at 10 s: of 40 s the step of 30 s is known last, which came
    behind it. Asked for between 40 s and the next step, a crowd of 20 s was missing."""
    store = Store(tmp_path, durable=False)
    try:
        timeline = Timeline(store)
        second, steps = 1_000_000_000, ((1, 10), (2, 40), (3, 20), (4, 30), (5, 50))
        for number, stamp_s in steps:
            given = [_given("stage", 0.0)] * (number >= 2) + [_given("crowd", 50.0)] * (number >= 3)
            timeline.add(replace(_moment(number, *given), stamp_ns=stamp_s * second))
        store.flush()
        found = {at_s: timeline.at(at_s * second) for at_s in (10, 20, 39, 40, 45, 50)}
        told = {
            at_s: (one.stamp_ns // second, [zone.id for zone in one.zones.static])
            for at_s, one in found.items()
            if one is not None
        }
        both = ["stage", "crowd"]
        assert told == {
            10: (10, []),
            20: (20, both),
            39: (30, both),
            40: (40, both),
            45: (40, both),
            50: (50, both),
        }
        again = Timeline(store)  # after a restart, before the first moment
        assert again.at(39 * second) is not None
    finally:
        store.close()


def test_a_map_of_a_step_behind_what_an_operator_did_is_that_of_the_instant(tmp_path: Path) -> None:
    """As its zones are: at 40 s an operator acted, with the map of 10 s; those of 20 and 30 s came behind."""
    store = Store(tmp_path, durable=False)
    try:
        timeline, second = Timeline(store), 1_000_000_000
        for number, stamp_s in ((1, 10), (2, 40), (3, 20), (4, 30), (5, 50)):
            timeline.add(replace(_moment(number), stamp_ns=stamp_s * second))
            timeline.add_belief(number, stamp_s * second, f"map {number}".encode())
        store.flush()
        found = {at_s: timeline.belief_at(at_s * second) for at_s in (9, 10, 20, 39, 40, 45, 50)}
        told = {at_s: one and (one[0], one[1].decode()) for at_s, one in found.items()}
        third, fourth = (3, "map 3"), (4, "map 4")
        assert told == {
            9: None,
            10: (1, "map 1"),
            20: third,
            39: fourth,
            40: fourth,
            45: fourth,
            50: (5, "map 5"),
        }
    finally:
        store.close()


def test_a_thousand_zones_of_others_add_nothing_to_a_moment_at_which_they_stay(tmp_path: Path) -> None:
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    many = tuple(_given(f"N{k}", 3.0 * k) for k in range(1000))
    for number in range(1, timeline_module.WHOLE_EVERY + 2):
        timeline.add(_moment(number, *many))
    store.flush()
    sizes = [
        size for (size,) in store.rows("SELECT LENGTH(line) + LENGTH(figures) FROM moments ORDER BY number")
    ]
    last = timeline.at((timeline_module.WHOLE_EVERY + 1) * 1_000_000_000)
    store.close()
    assert max(sizes[1:-1]) < 1000 < 20_000 < min(sizes[0], sizes[-1])
    assert last is not None and [zone.id for zone in last.zones.static] == [zone.id for zone in many]


def test_a_zone_of_others_whose_moment_found_no_room_on_the_disk_is_not_lost(tmp_path: Path) -> None:
    """Moment 2 is not written; 3 was on its way already when the service heard of it, and says so."""
    a1, d1 = _given("A1", 0.0), _given("D1", 7.0)
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    timeline.add(_moment(1, a1))
    note = store.note
    store.note = lambda write, size=0: None  # type: ignore[method-assign]
    timeline.add(_moment(2, a1, d1))
    store.note = note  # type: ignore[method-assign]
    timeline.add(_moment(3, a1, d1))
    timeline.begin_whole()
    timeline.add(_moment(4, a1, d1))
    store.flush()
    told, first = timeline.at(4_000_000_000), timeline.at(1_000_000_000)
    # Nor is what was closed at 1 s taken for what was closed at 2 s.
    for stamp_ns in (1_000_000_001, 2_000_000_000, 3_000_000_000):
        with pytest.raises(LostMomentError, match="nothing could be written at moment 2 of the history"):
            timeline.at(stamp_ns)
    store.close()
    assert told is not None and [zone.id for zone in told.zones.static] == ["A1", "D1"]
    assert first is not None and [zone.id for zone in first.zones.static] == ["A1"]


@pytest.mark.parametrize("written", [0, 1])
def test_what_was_closed_while_the_disk_is_still_full_is_not_told_as_it_was_before(
    tmp_path: Path, written: int
) -> None:
    """The crowd of 2 s came after the last moment that the disk took: the 4th is published and in memory."""
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    zone = Zone.of_no_look("Z1", shapely.box(0, 0, 2, 2), "crowd", "seen")
    note = store.note
    for number, zones in enumerate(((), (zone,), (zone,), (zone,)), 1):
        store.note = note if number <= written else lambda write, size=0: None  # type: ignore[method-assign]
        timeline.add(Moment(number, number * 1_000_000_000, ZoneSet(zones, 0.5, 0.0, 0, 0.0), {}, {}))
    first_lost = written + 1
    with pytest.raises(LostMomentError, match=f"nothing could be written at moment {first_lost} of the"):
        timeline.at(2_500_000_000)
    store.close()


def test_what_is_not_on_disk_yet_is_waited_for(tmp_path: Path) -> None:
    """A disk that takes its time: the moment of 2 s lies in the queue when somebody asks for it."""
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    zone = Zone.of_no_look("Z1", shapely.box(0, 0, 2, 2), "crowd", "seen")
    timeline.add(Moment(1, 1_000_000_000, ZoneSet((), 0.5, 0.0, 0, 0.0), {}, {}))
    store.flush()
    store.note(lambda connection: time.sleep(0.3))
    for number in (2, 3, 4):
        timeline.add(Moment(number, number * 1_000_000_000, ZoneSet((zone,), 0.5, 0.0, 0, 0.0), {}, {}))
    told = timeline.at(2_500_000_000)
    store.close()
    assert told is not None and told.number == 2


def test_a_crowd_that_grew_while_the_disk_was_full_is_not_told_as_it_was_before(tmp_path: Path) -> None:
    """Moment 3 has the outline of 2 and does not tell it: it was told with that of 1, half as wide."""
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    small, large = (Zone.of_no_look("Z1", shapely.box(0, 0, wide, 2), "crowd", "seen") for wide in (2, 4))
    note = store.note
    for number, zone in enumerate((small, large, large), 1):
        if number == 2:
            store.note = lambda write, size=0: None  # type: ignore[method-assign]
        timeline.add(Moment(number, number * 1_000_000_000, ZoneSet((zone,), 0.5, 0.0, 0, 0.0), {}, {}))
        store.note = note  # type: ignore[method-assign]
    store.flush()
    with pytest.raises(LostMomentError):
        timeline.at(3_000_000_000)
    store.close()


def test_what_was_closed_before_the_history_that_is_kept_is_not_nothing(tmp_path: Path) -> None:
    """A crowd at every second from the first on; after 120 moments those before the 101st are forgotten."""
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    zone = Zone.of_no_look("Z1", shapely.box(0, 0, 2, 2), "crowd", "seen")
    for number in range(1, 121):
        timeline.add(Moment(number, number * 1_000_000_000, ZoneSet((zone,), 0.5, 0.0, 0, 0.0), {}, {}))
    assert timeline.at(500_000_000) is None  # nobody had seen anything
    store.written(lambda connection: forget_before(connection, 110_000_000_000))
    kept = timeline.at(101_000_000_000)
    with pytest.raises(LostMomentError, match="the history that is kept begins later"):
        timeline.at(60_000_000_000)
    store.close()
    assert kept is not None and [one.id for one in kept.zones] == ["Z1"]


@pytest.mark.parametrize("field", ["line = x'00'", "line = 'text'", "marks = '{'", "figures = '{'"])
def test_a_moment_that_is_damaged_is_said_not_to_be_known(tmp_path: Path, field: str) -> None:
    """Who asked for it, or for one that rests on it, got an error 500."""
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    for number in (1, 2, 3):
        given = Zone.of_no_look(f"S{number}", shapely.box(0, 0, 2, 2), "static", "given")
        zones = ZoneSet((), 0.5, 0.0, 0, 0.0, static=(given,))
        timeline.add(Moment(number, number * 1_000_000_000, zones, {}, {}))
    store.written(lambda connection: connection.execute(f"UPDATE moments SET {field} WHERE number = 2"))
    first = timeline.at(1_000_000_000)
    with pytest.raises(LostMomentError, match="moment 2 of the history is damaged"):
        timeline.at(2_500_000_000)
    store.close()
    assert first is not None and [zone.id for zone in first.zones.static] == ["S1"]


@pytest.mark.parametrize(
    "field", ["figures = '{'", "figures = x'ff'", "figures = '[]'", "figures = '{}'", "stamp_ns = 'text'"]
)
def test_a_moment_that_is_damaged_is_missing_from_what_goes_over_all(tmp_path: Path, field: str) -> None:
    """One such row, and the time line and the history of every zone were errors 500 or 503 until it was a
    day old."""
    store = Store(tmp_path, durable=False)
    timeline, s1 = Timeline(store), _given("S1", 0.0)
    for number in (1, 2, 3, 4):
        known = _moment(number, *[s1] * (number > 1))  # moment 2 tells of it for those that follow
        zones = replace(known.zones, events=(ZoneEvent(known.stamp_ns, "updated", "S1"),))
        timeline.add(replace(known, zones=zones, figures={"zones": number}))
    store.flush()
    before = timeline.zone_history("S1")
    for damaged in (3, 2):
        store.written(
            lambda connection, damaged=damaged: connection.execute(
                f"UPDATE moments SET {field} WHERE number = {damaged}"
            )
        )
        left = [number for number in (1, 2, 3, 4) if number < damaged or number == 4]
        points, history = timeline.points(), timeline.zone_history("S1")
        assert [point["zones"] for point in points if "zones" in point] == left
        assert [event["stamp_ms"] for event in history["events"]] == [1e3 * number for number in left]
        assert all(point in before["points"] for point in history["points"])
    span = timeline.span_ns()
    store.close()
    assert span == (1_000_000_000, 4_000_000_000)


def test_a_map_that_is_damaged_is_said_not_to_be_known(tmp_path: Path) -> None:
    store = Store(tmp_path, durable=False)
    timeline = Timeline(store)
    for number in (1, 2):
        timeline.add_belief(number, number * 1_000_000_000, b"map")
    store.written(lambda connection: connection.execute("UPDATE beliefs SET body = x'00' WHERE number = 2"))
    with pytest.raises(LostMomentError, match="moment 2 of the history is damaged"):
        timeline.belief_at(2_000_000_000)
    first = timeline.belief_at(1_000_000_000)
    store.close()
    assert first == (1, b"map")


@pytest.mark.parametrize(
    ("at", "told"),
    [(10**9, "seconds"), (10**6, "milliseconds"), (10**3, "microseconds"), (10**18, "before 2001")],
)
def test_who_asks_in_another_unit_is_not_told_that_nothing_was_closed(
    tmp_path: Path, at: int, told: str
) -> None:
    """Its numbers are stamps of January 1970, before the first moment: the answer was an open field."""
    with running(tmp_path) as service, asked(service) as http:
        for one in views(9):
            service.live.intake.give_view(message(one))
        settle(service)
        newest_ns = service.mission.newest.stamp_ns
        assert http.get("/api/v1/zones", params={"at": newest_ns}).json()["zones"]
        for path in ("zones", "export", "drones", "belief"):
            refused = http.get(f"/api/v1/{path}", params={"at": newest_ns // at})
            assert refused.status_code == 422 and told in refused.json()["detail"]


def test_who_asks_for_a_time_to_come_is_not_told_of_now(tmp_path: Path) -> None:
    """A zone that is dismissed for a minute was left out of a file for ten minutes later."""
    with running(tmp_path) as service, asked(service) as http:
        for one in views(9):
            service.live.intake.give_view(message(one))
        settle(service)
        newest_ns = service.mission.newest.stamp_ns
        latest_ns = max(newest_ns, service.now_ns())
        assert http.get("/api/v1/zones", params={"at": latest_ns + 10**9}).status_code == 200
        for path in ("zones", "export", "drones", "belief", "zones/Z1/history"):
            refused = http.get(f"/api/v1/{path}", params={"at": latest_ns + 600 * 10**9})
            assert refused.status_code == 422, path
            assert "after now" in refused.json()["detail"]


def test_the_history_of_a_zone_that_never_was_is_not_found(tmp_path: Path) -> None:
    """A misspelled id was told as one to which nothing ever happened."""
    theirs = Zone.of_no_look("HOSP", shapely.box(1, 1, 9, 9), "static", "given")
    with running(tmp_path, static_zones=[theirs]) as service, asked(service) as http:

        def history(zone: str, **how: Any) -> Response:
            return http.get(f"/api/v1/zones/{zone}/history", params=how)

        assert history("HOSP").json() == {"points": [], "events": []}, "it is closed before the first view"
        for one in views(9):
            service.live.intake.give_view(message(one))
        settle(service)
        never = history("Z11")
        assert never.status_code == 404 and "there is no zone Z11" in never.json()["detail"]
        (first,) = [one for one in history("Z1").json()["events"] if one["kind"] == "created"]
        before = history("Z1", at=int(first["stamp_ns"]) - 1)
        assert before.status_code == 200 and before.json() == {"points": [], "events": []}


def test_a_parameter_that_there_is_not_is_refused(tmp_path: Path) -> None:
    """A misspelled `at` was left out, and what is closed now told for then; a misspelled datum, above what
    heights count."""
    with running(tmp_path) as service, asked(service) as http:
        for one in views(9):
            service.live.intake.give_view(message(one))
        settle(service)
        at_ns = service.mission.newest.stamp_ns
        refused = http.get("/api/v1/zones", params={"at_ns": at_ns})
        assert (refused.status_code, refused.json()["detail"]) == (
            422,
            "there is no parameter 'at_ns'; there are: at, without_static",
        )
        for path in (
            "export?format=ed318&country=CHE&daturn=WGS84",
            "zones/Z1/history?since=0",
            "drones?at=&at_ms=1",
            "timeline?at=",
        ):
            assert http.get(f"/api/v1/{path}").status_code == 422
            assert http.head(f"/api/v1/{path}").status_code == 422
        assert http.get("/api/v1/zones/Z1/history", params={"at": at_ns}).status_code == 200
        assert http.head("/api/v1/zones", params={"at": at_ns}).status_code == 200
        assert http.post(f"/api/v1/zones?at={at_ns}", json={}).status_code == 422
