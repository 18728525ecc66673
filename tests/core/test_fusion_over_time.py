"""Crowd maps over random histories, held against the equations: what comes late, out of order or not at all,
ground that nobody looks at, maps that are written and read on the way."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import crowdfence as cf
from support.slow_fusion import SECOND_NS, SlowFusion, Table, log_odds

FLOOR = cf.Terrain.from_occupancy(np.ones((36, 36, 1), bool), 1.0)  # two pages of a crowd map
PLACES = FLOOR.voxel_indices(np.arange(FLOOR.voxel_count))[:, :2]
TABLE = Table(np.array([0.25, 0.5, 0.75]), np.array([-3.0, 0.5, 2.0, 6.0]))
RATIO = cf.LikelihoodRatio([], [], TABLE.borders, [[TABLE.log_ratio]])
OF_TABLE = {"prior": 0.1, "focal_px": 100.0, "threshold": 0.3}
RATES = cf.Rates(0.9, 0.2)
METHODS = {
    "evidence": lambda decay: cf.Evidence(
        RATIO, memory_s=4.0, sharp_gsd_m=0.1, doubt=0.5, agreement=0.3, cleared=0.03, **OF_TABLE
    ),
    "paper": lambda decay: cf.Paper(RATES, 0.1, alpha=0.4, decay=decay, fleet_size=5),
    "or": lambda decay: cf.Or(),
    "linear-pool": lambda decay: cf.LinearPool(RATES, 0.1, alpha=0.4, decay=decay),
    "log-pool": lambda decay: cf.LogPool(RATIO, alpha=0.4, decay=decay, **OF_TABLE),
    "log-odds": lambda decay: cf.LogOdds(RATES, 0.1),
    "moving-average": lambda decay: cf.MovingAverage(RATIO, memory_s=4.0, **OF_TABLE),
}
IN_ANY_ORDER = ("evidence", "or", "moving-average")


def looks(rng: np.random.Generator, drone: str, stamp_ns: int) -> cf.Observation:
    """At a square of the floor, from near or far, from above or from below the plane of some places."""
    centre, reach = PLACES[rng.integers(len(PLACES))], rng.integers(1, 25)
    near = (np.abs(PLACES - centre) <= reach).all(axis=1)
    ids, beside = np.flatnonzero(near), np.flatnonzero(~near)
    values = np.array([0.0, 0.25, 0.4, 0.5, 0.6, 0.75, 0.76, 1.0])  # on borders of the table, and between
    one = rng.choice(values)
    return cf.Observation(
        FLOOR,
        drone,
        stamp_ns,
        voxel_ids=ids,
        mean=rng.choice(values, len(ids)) if rng.random() < 0.5 else np.full(len(ids), one),
        pixel_count=np.ones(len(ids), np.int64),
        range_m=np.full(len(ids), rng.choice([5.0, 10.0, 30.0])),
        tilt_deg=rng.choice([90.0, 90.0, 20.0, -5.0], len(ids)),
        occluded_ids=beside[rng.random(len(beside)) < 0.1],
        focal_px=rng.choice([0.0, 200.0]),
    )


def is_near(p: NDArray[np.float64], borders: list[float]) -> NDArray[np.bool_]:
    """Where the core keeps float32, and float64 cannot say on which side it is."""
    odds = log_odds(np.clip(p, 1e-12, 1 - 1e-12))
    return np.any([np.abs(odds - log_odds(border)) < 1e-3 for border in borders], axis=0)


def hold_against(crowd_map: cf.CrowdMap, slow: SlowFusion, stamp_ns: int, stale_after_s: float) -> None:
    now, then = slow.probability(stamp_ns), slow.probability(slow.last_ns)
    threshold = crowd_map.default_threshold()
    np.testing.assert_allclose(crowd_map.probability(stamp_ns), now, atol=3e-6)
    np.testing.assert_array_equal(crowd_map.last_seen_ns(), slow.last_ns)
    borders = [threshold, *([slow.told["cleared"]] if slow.name == "evidence" else [])]
    sure = ~is_near(now, borders) & ~is_near(then, borders)
    state = crowd_map.state(stamp_ns, stale_after_s=stale_after_s)
    np.testing.assert_array_equal(state[sure], slow.state(stamp_ns, threshold, stale_after_s)[sure])
    of_state = np.flatnonzero(state == cf.VoxelState.EMPTY)
    np.testing.assert_array_equal(crowd_map.empty_ids(stamp_ns, stale_after_s=stale_after_s), of_state)
    expected = {
        "crowd_ids": (crowd_map.crowd_ids(stamp_ns), (now >= threshold) & slow.seen),
        "at_last_looks": (crowd_map.crowd_ids_at_last_looks(), (then >= threshold) & slow.seen),
        "shown_ids": (crowd_map.shown_ids(stamp_ns), slow.shown(threshold, stamp_ns)),
        "shown_at_last_looks": (crowd_map.shown_ids_at_last_looks(), slow.shown(threshold, slow.last_ns)),
    }
    for name, (ids, those) in expected.items():
        found = np.isin(np.arange(FLOOR.voxel_count), ids)
        np.testing.assert_array_equal(found[sure], those[sure], err_msg=name)


@pytest.mark.parametrize("name", METHODS)
@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), decay=st.sampled_from([0.0, 0.1, 1e6]))
def test_a_map_is_what_the_equations_make_of_all_looks(name: str, seed: int, decay: float) -> None:
    """Reading changes nothing, and neither does a map that is written and read on the way."""
    rng = np.random.default_rng(seed)
    method = METHODS[name](decay)
    crowd_map, never_read = (cf.CrowdMap(FLOOR, method, max_gap_s=1e6) for _ in range(2))
    told = {key: value for key, value in method.parameters.items() if not isinstance(value, str)}
    slow = SlowFusion(name, told, TABLE, FLOOR.voxel_count)
    stamp_ns = int(rng.choice([0, 1_763_780_000 * SECOND_NS, 2**62]))
    for _ in range(rng.integers(2, 9)):
        after_s = rng.choice([0.3, 1.0, 1.5, 40.0, 90_000.0])
        if name in IN_ANY_ORDER and rng.random() < 0.3:
            after_s = -min(rng.choice([0.3, 3.0]), stamp_ns / SECOND_NS)
        at_ns = stamp_ns + int(after_s * SECOND_NS)
        fleet = rng.permutation(["a", "b", "c", "d", "e"])[: rng.integers(0, 4)]
        late_ns = [int(rng.choice([0, 0, 1, 2, 4]) * 6e8) for _ in fleet]
        views = [
            looks(rng, str(drone), max(at_ns - late, 0)) for drone, late in zip(fleet, late_ns, strict=True)
        ]
        for one in (crowd_map, never_read):
            one.integrate_observations(views, at_ns)
        slow.take_in(views, at_ns)
        stamp_ns = slow.newest_ns
        if rng.random() < 0.7:
            read_after_s = rng.choice([0.0, 0.4, 2.0, 35.0, 1e6])
            hold_against(crowd_map, slow, stamp_ns + int(read_after_s * SECOND_NS), rng.choice([0.0, 30.0]))
        if rng.random() < 0.3:
            crowd_map = cf.CrowdMap.from_bytes(crowd_map.to_bytes(), FLOOR)
    hold_against(crowd_map, slow, stamp_ns, 30.0)
    assert crowd_map.to_bytes() == never_read.to_bytes()
