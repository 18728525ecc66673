"""Moments on disk, asked for over time."""

from pathlib import Path

import shapely

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
