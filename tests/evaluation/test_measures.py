"""What a report shows beside IoU, worked by hand on a plain of 1 m columns."""

import tracemalloc

import numpy as np
import pytest

from crowdfence import Terrain
from crowdfence.evaluation.closing_cost import ClosingCost
from crowdfence.evaluation.probability_quality import ProbabilityQuality
from crowdfence.evaluation.route_safety import RouteSafety
from crowdfence.evaluation.safety import CrowdsInView
from crowdfence.evaluation.zone_delay import ZoneDelay

PLAIN = Terrain.from_occupancy(np.ones((300, 300, 1), bool), 1.0)
SECOND_NS = 10**9


def block(west: int, south: int, side: int) -> np.ndarray:
    """Columns of a square."""
    i, j = np.mgrid[west : west + side, south : south + side]
    return np.stack([i.ravel(), j.ravel()], axis=1)


def crowd_on(ground: np.ndarray) -> CrowdsInView:
    """One person on every column."""
    return CrowdsInView(ground, np.ones(len(ground), bool), np.zeros(0, np.int64), ground)


NOTHING = np.zeros((0, 2), np.int64)


def test_a_probability_is_judged_by_its_claims_and_its_ranks() -> None:
    quality = ProbabilityQuality()
    # Two of the four claimed at 0.5 are crowd: calibrated, but badly ranked; one at 0.9 is.
    quality.add([0.5, 0.5, 0.5, 0.5, 0.9], np.array([True, False, True, False, True]))
    assert quality.calibration_error == pytest.approx(0.1 / 5)
    assert quality.brier == pytest.approx((4 * 0.25 + 0.01) / 5)
    # The one at 0.9 is found at precision 1, the two at 0.5 together with everything, at 3 / 5.
    assert quality.average_precision == pytest.approx((1.0 + 2 * 3 / 5) / 3)


def test_ranks_may_come_from_another_score() -> None:
    quality = ProbabilityQuality()
    quality.add([1.0, 1.0], np.array([True, False]), score=[0.8, 0.3])
    assert quality.average_precision == 1.0
    assert quality.brier == 0.5


def test_nothing_seen_is_no_figure() -> None:
    quality = ProbabilityQuality()
    assert np.isnan([quality.average_precision, quality.brier, quality.calibration_error]).all()


def test_few_missed_people_cost_the_ground_that_scores_as_low_as_theirs() -> None:
    # Nine people score 0.8 and one, far from them, 0.2. Elsewhere 40 columns score 0.5 and 60 score 0.1.
    people = np.vstack([block(10, 10, 3), [[60, 60]]])
    other = block(150, 150, 10)
    columns = np.vstack([people, other])
    score = np.concatenate([np.full(9, 0.8), [0.2], np.full(40, 0.5), np.full(60, 0.1)])
    cost = ClosingCost()
    cost.add(crowd_on(people), columns, score, 1.0)
    # To miss nobody the threshold must be 0.2, which also closes the 40; to miss one in ten, 0.8 is enough.
    np.testing.assert_allclose(cost.curve(np.array([0.0, 0.05, 0.1])), [40 / 10, 40 / 10, 0.0])


def test_what_a_threshold_costs_is_counted_in_bounded_memory() -> None:
    """8 bytes a column and moment were 10 GB for an hour over 0.1 km2, and as much again for each method."""
    columns = block(0, 0, 60)
    score = np.random.default_rng(1).random(len(columns))
    crowds, cost = crowd_on(block(0, 0, 2)), ClosingCost()
    cost.add(crowds, columns, score, 1.0)
    tracemalloc.start()
    for _ in range(50):
        cost.add(crowds, columns, score, 1.0)
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert held < 50 * len(columns) * 8 / 4
    # The 4 people score alike at 51 moments; exactly at their threshold counts as closed.
    apart = [np.hypot(*np.maximum(np.abs(columns - person) - 0.5, 0.0).T) for person in crowds.people]
    lowest = min(score[one <= 5.0].max() for one in apart)
    far = np.hypot(*np.maximum(columns - 1.5, 0.0).T) > 5.0
    (found,) = cost.curve(np.array([0.0]))
    exact = np.count_nonzero(score[far] >= lowest) / len(crowds.ground)
    assert exact <= found <= np.count_nonzero(score[far] >= lowest - 1e-3) / len(crowds.ground)


def test_a_threshold_costs_what_zones_at_it_do() -> None:
    """By edges, people and ground alike: of a column aslant, 4 m each way, 4.95 m and not 5.66 m."""
    person, aslant, beyond = [10, 10], [14, 14], [14, 15]
    columns = np.array([person, aslant, beyond])
    cost = ClosingCost()
    cost.add(crowd_on(np.array([person])), columns, np.array([0.1, 0.9, 0.9]), 1.0)
    # Zones at 0.9 hold the person, 4.95 m from the one, and of them only the other is closed for nobody.
    np.testing.assert_allclose(cost.curve(np.array([0.0])), [1.0])


def test_who_shows_nowhere_cannot_be_reached_by_a_threshold() -> None:
    cost = ClosingCost()
    cost.add(crowd_on(np.array([[10, 10], [100, 100]])), np.array([[10, 10]]), np.array([0.9]), 1.0)
    at_none, at_half = cost.curve(np.array([0.0, 0.5]))
    assert np.isnan(at_none) and at_half == 0.0


def test_zones_lag_behind_crowds_that_come_and_go() -> None:
    delay, ground = ZoneDelay(), block(20, 20, 2)
    for second in range(10):
        here = ground if second < 6 else NOTHING
        closed = ground if 2 <= second < 9 else NOTHING
        delay.add(crowd_on(here), closed, 1.0, second * SECOND_NS)
    # In view from 0 and closed at 2; left at 6 and open at 9.
    assert delay.to_mark == (2.0, 0.0, 4)
    assert delay.to_clear == (3.0, 0.0, 4)


def test_ground_that_is_never_closed_is_told() -> None:
    delay = ZoneDelay()
    delay.add(crowd_on(block(20, 20, 2)), NOTHING, 1.0, 0)
    assert np.isnan(delay.to_mark.median_s) and delay.to_mark.never == 1.0
    assert delay.to_clear.columns == 0


def test_a_planner_flies_over_a_crowd_exactly_if_no_zone_is_in_the_way() -> None:
    crowd = crowd_on(block(148, 148, 5))
    for closed, crossing in ((NOTHING, 2), (block(148, 148, 5), 0), (block(10, 10, 5), 2)):
        routes = RouteSafety()
        routes.add(crowd, closed, PLAIN)
        assert (routes.asked, routes.crossing, routes.without) == (2, crossing, 0)
    # A zone that holds both ends leaves no way, which crosses nobody.
    routes = RouteSafety()
    routes.add(crowd, block(60, 60, 180), PLAIN)
    assert (routes.asked, routes.crossing, routes.without) == (2, 0, 2)
