"""The nearest clear place."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence.planner import ClearAir, way_out
from crowdfence.zones import ZoneSet
from support.fence_zones import zone

SQUARE = shapely.box(0.0, 0.0, 100.0, 40.0)


@pytest.mark.parametrize(
    ("place", "clearance_m", "wanted"),
    [
        ((50.0, 10.0), 0.0, (50.0, -0.05)),
        ((50.0, 35.0), 15.0, (50.0, 55.05)),
        ((2.0, 20.0), 15.0, (-15.05, 20.0)),
        ((50.0, -10.0), 15.0, (50.0, -15.05)),  # clear, but not by so much
        ((50.0, -20.0), 15.0, (50.0, -20.0)),
    ],
)
def test_the_shortest_way_leads_over_the_nearest_edge(
    place: tuple[float, float], clearance_m: float, wanted: tuple[float, float]
) -> None:
    # What is drawn around zones reaches 2 % of the distance farther: 0.3 m of 15 m.
    assert way_out(place, [SQUARE], clearance_m) == pytest.approx(wanted, abs=0.3)


def test_two_zones_that_meet_are_left_together() -> None:
    """The nearest edge of its own zone leads into the next one."""
    beside = shapely.box(0.0, -60.0, 100.0, 0.0)
    assert way_out((50.0, 5.0), [SQUARE, beside]) == pytest.approx((50.0, 40.05), abs=0.01)


@settings(max_examples=40)
@given(
    boxes=st.lists(st.tuples(*[st.integers(-60, 60)] * 2, *[st.integers(1, 50)] * 2), min_size=1, max_size=5),
    clearance_m=st.sampled_from([0.0, 3.0, 15.0]),
)
def test_the_place_is_as_clear_as_was_asked_and_none_is_nearer(
    boxes: list[tuple[int, int, int, int]], clearance_m: float
) -> None:
    closed = [shapely.box(x, y, x + w, y + h) for x, y, w, h in boxes]
    place = np.array(way_out((0.0, 0.0), closed, clearance_m))
    zones = ZoneSet(tuple(zone(one, f"Z{i}") for i, one in enumerate(closed)), 0.5, 0.0, 0, 0.0)
    air = ClearAir(zones)
    assert air.clearance_m([*place, 5.0], 0)[0] >= clearance_m
    distance_m = float(np.linalg.norm(place))
    if distance_m > 0.0:
        angle = np.linspace(0.0, 2 * np.pi, 180)
        # What is drawn around zones reaches at most 3 % of the distance farther than it must.
        nearer = max(0.0, distance_m - 0.1 - 0.03 * clearance_m) * np.stack(
            [np.cos(angle), np.sin(angle)], axis=1
        )
        clearances_m = air.clearance_m(np.column_stack([nearer, np.full(len(nearer), 5.0)]), 0)
        assert (clearances_m < clearance_m + 0.1 + 0.03 * clearance_m).all()
