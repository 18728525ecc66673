"""Moments on disk, asked for over time."""

from pathlib import Path

import pytest
import shapely

from crowdfence.service import timeline as timeline_module
from crowdfence.service.store import Store
from crowdfence.service.timeline import Moment, Timeline
from crowdfence.zones import Zone, ZoneEvent, ZoneSet

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
