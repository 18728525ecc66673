"""What is known of the ground below a way."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st

from crowdfence import VoxelState
from crowdfence.exports.state_raster import StateRaster
from crowdfence.planner import ClearAir, NoRoute, safe_route
from crowdfence.planner.seen_ground import metres_by_state, not_known_empty
from crowdfence.zones import ZoneSet

# Cells of 2 m from (10, -4) to (16, 0): never seen, empty, empty; below them hidden, not cleared, stale.
GROUND = StateRaster(np.array([[0, 2, 2], [1, 5, 3]], dtype=np.uint8), Affine(2, 0, 10, 0, -2, 0))


def nonzero(metres: dict[VoxelState, float]) -> dict[str, float]:
    return {state.name: round(length, 9) for state, length in metres.items() if length}


def test_every_metre_counts_where_it_lies() -> None:
    assert nonzero(metres_by_state([(11, -1), (16, -1)], GROUND)) == {"NEVER_SEEN": 1.0, "EMPTY": 4.0}
    # Down from the empty cell in the north-east, west through the three of the south, and 3 m beyond.
    way = [(15, -1), (15, -3), (7, -3)]
    assert nonzero(metres_by_state(way, GROUND)) == {
        "EMPTY": 1.0,
        "STALE": 1.0 + 1.0,
        "NOT_CLEARED": 2.0,
        "OCCLUDED": 2.0,
        "NEVER_SEEN": 3.0,
    }
    # Across the corner where four cells meet: half of it over the empty one.
    diagonal = metres_by_state([(12, -4), (16, 0)], GROUND)
    assert nonzero(diagonal) == {"NOT_CLEARED": round(8**0.5, 9), "EMPTY": round(8**0.5, 9)}


def test_on_an_edge_counts_the_cell_of_which_less_is_known() -> None:
    assert nonzero(metres_by_state([(12, 0), (12, -4)], GROUND)) == {"NEVER_SEEN": 2.0, "OCCLUDED": 2.0}
    assert nonzero(metres_by_state([(12, -2), (16, -2)], GROUND)) == {"NOT_CLEARED": 2.0, "STALE": 2.0}
    # The rim of the raster: beyond it nobody looked.
    assert nonzero(metres_by_state([(12, 0), (16, 0)], GROUND)) == {"NEVER_SEEN": 4.0}


PLACES = st.tuples(st.floats(5, 25), st.floats(-10, 5))


@given(st.lists(PLACES, min_size=2, max_size=4))
def test_the_metres_are_those_of_the_way_and_of_its_cuts(way: list[tuple[float, float]]) -> None:
    metres = metres_by_state(way, GROUND)
    length_m = sum(np.hypot(*np.subtract(a, b)) for a, b in pairwise(way))
    assert sum(metres.values()) == pytest.approx(length_m, abs=1e-6)
    legs = [shapely.LineString(leg) for leg in pairwise(way)]
    empty = shapely.box(12, -2, 16, 0)
    # Along its edge is not over it.
    least_m, most_m = (
        sum(leg.intersection(box).length for leg in legs) for box in (empty.buffer(-1e-4), empty)
    )
    assert least_m - 1e-6 <= metres[VoxelState.EMPTY] <= most_m + 1e-6


def test_a_vehicle_that_waits_flies_no_metre() -> None:
    assert nonzero(metres_by_state([(13, -1), (13, -1), (14, -1)], GROUND)) == {"EMPTY": 1.0}


def test_ground_that_was_not_seen_empty_closes_like_a_zone() -> None:
    """All of the map but the two empty cells."""
    zone = not_known_empty(GROUND, shapely.box(0, -20, 40, 20))
    assert zone.kind == "unseen"
    assert zone.polygon.equals(shapely.box(0, -20, 40, 20) - shapely.box(12, -2, 16, 0))
    assert safe_route((13, -1), (15, -1), [zone]).length_m == 2.0
    with pytest.raises(NoRoute, match="in zone UNSEEN"):
        safe_route((13, -1), (15, -3), [zone])


def test_ground_that_was_not_seen_empty_is_closed_at_every_height() -> None:
    """The raster knows no heights."""
    zone = not_known_empty(GROUND, shapely.box(0, -20, 40, 20))
    air = ClearAir(ZoneSet((), 0.5, 0.0, 0, 0.0, unseen=(zone,)))
    assert air.is_clear([(20, 0, 900.0), (20, 0, -50.0), (14, -1, 0.0)], 0).tolist() == [False, False, True]
