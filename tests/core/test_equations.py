"""Equations 1-3: cases worked out by hand, and a slow dense evaluation written from the paper."""

import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from crowdfence import Camera, CrowdMap, Paper, Rates, Terrain, View, blend, pool

Array = NDArray[np.float64]

REFERENCE = json.loads((Path(__file__).parents[2] / "reference" / "equations.json").read_text())
DETECTORS = {
    name: (Rates(detector["true_positive"], detector["false_positive"]), detector["prior"])
    for name, detector in REFERENCE["detectors"].items()
}
SECOND_NS = 1_000_000_000
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


def _cases(part: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("case", REFERENCE[part], ids=lambda case: case["name"])


def _switches(case: dict[str, Any], *names: str) -> dict[str, Any]:
    return {name: case[name] for name in names if name in case}


def _arithmetic(by_hand: str) -> float:
    """Value of an expression of numbers, + - * / ^, brackets and e."""
    assert re.fullmatch(r"[0-9+\-*/^(). e]+", by_hand), by_hand
    return float(eval(by_hand.replace("^", "**"), {"__builtins__": {}}, {"e": math.e}))


# --- by hand


def test_the_numbers_of_the_reference_are_those_of_its_arithmetic() -> None:
    reads = [read for case in REFERENCE["crowd_map"] for read in case["reads"]]
    for case in REFERENCE["pool"] + REFERENCE["blend"] + reads:
        assert _arithmetic(case["by_hand"]) == pytest.approx(case["probability"], abs=1e-15), case


@pytest.mark.parametrize("name", DETECTORS)
def test_posteriors(name: str) -> None:
    rates, prior = DETECTORS[name]
    paper = Paper(rates, prior, fleet_size=1)
    assert paper.post_positive == pytest.approx(REFERENCE["detectors"][name]["post_positive"], abs=1e-12)
    assert paper.post_negative == pytest.approx(REFERENCE["detectors"][name]["post_negative"], abs=1e-12)


@_cases("pool")
def test_pool_by_hand(case: dict[str, Any]) -> None:
    fleet = np.array([[math.nan if m is None else m] for m in case["m"]])
    visible = ~np.isnan(fleet)
    rates, prior = DETECTORS[case["detector"]]
    switches = _switches(case, "b_threshold", "unseen", "normalise")
    probability, seen = pool(fleet, visible, rates, prior, **switches)
    assert probability[0] == pytest.approx(case["probability"], abs=1e-12)
    assert seen[0] == visible.any()


@_cases("blend")
def test_blend_by_hand(case: dict[str, Any]) -> None:
    seen = case["pooled"] is not None
    blended = blend(
        [case["previous"]],
        [case["elapsed_s"]],
        [case["pooled"] if seen else math.nan],
        [seen],
        alpha=case["alpha"],
        decay_per_s=case["decay_per_s"],
    )
    assert blended == pytest.approx([case["probability"]], abs=1e-12)


@_cases("crowd_map")
def test_crowd_map_by_hand(case: dict[str, Any]) -> None:
    switches = _switches(case, "alpha", "decay", "decay_unit", "initial", "unseen", "normalise")
    method = Paper(*DETECTORS["quarter"], fleet_size=case["fleet_size"], **switches)
    terrain = Terrain.from_occupancy(np.ones((1, 1, 1), bool), 1.0)
    crowd_map = CrowdMap(terrain, method, max_gap_s=math.inf)
    above = DOWN.copy()
    above[:3, 3] = (0.5, 0.5, 10.0)
    camera = Camera.pinhole(1, 1, 100.0, 100.0, 0.5, 0.5)
    for instant in case["instants"]:
        stamp_ns = instant["stamp_s"] * SECOND_NS
        looks = instant["m"].items()
        views = [View(drone, stamp_ns, camera, above, np.array([[m]], np.float32)) for drone, m in looks]
        crowd_map.integrate(views, stamp_ns)
    for read in case["reads"]:
        probability = crowd_map.probability(read["stamp_s"] * SECOND_NS)
        # P~ is kept in steps of 2^-32.
        assert probability == pytest.approx([read["probability"]], rel=0, abs=1e-12 + 2**-33 / method.alpha)


# --- against a slow evaluation


@dataclass(frozen=True, slots=True)
class DensePaper:
    """Equations 1-3 over every drone of the fleet, every voxel and every instant."""

    rates: Rates
    prior: float
    alpha: float
    decay: float
    unseen: Literal["fleet", "visible"]
    normalise: bool
    initial: Literal["zero", "prior", "first"]
    decay_unit: Literal["second", "frame"]
    b_threshold: float

    def pooled(self, m: Array, visible: NDArray[np.bool_]) -> Array:
        """Equations 1-2. m and visible [N, V] -> P [V], of use where somebody sees the voxel."""
        true_positive, false_positive = self.rates.true_positive, self.rates.false_positive
        m = np.where(visible, m, 0.0)
        b = m > self.b_threshold  # false where the drone does not see
        given_crowd = np.where(b, true_positive, 1.0 - true_positive)
        given_none = np.where(b, false_positive, 1.0 - false_positive)
        posterior = given_crowd * self.prior / (given_crowd * self.prior + given_none * (1.0 - self.prior))
        counts = np.ones_like(visible) if self.unseen == "fleet" else visible
        weight = np.abs(m - 0.5) / (0.5 * np.maximum(counts.sum(axis=0), 1)) * counts
        if self.normalise:
            total = weight.sum(axis=0)
            mean = (weight * posterior).sum(axis=0) / np.where(total > 0.0, total, 1.0)
            return np.where(total > 0.0, mean, self.prior)
        return np.asarray((weight * posterior).sum(axis=0))

    def run(self, stamps_s: Sequence[float], m: Array, visible: NDArray[np.bool_]) -> Array:
        """m and visible [T, N, V] -> P~ [T, V] after each instant, faded at every instant."""
        voxels = m.shape[2]
        belief = np.full(voxels, self.prior if self.initial == "prior" else 0.0)
        looked_before = np.zeros(voxels, bool)
        history = np.empty((len(stamps_s), voxels))
        for t, stamp_s in enumerate(stamps_s):
            if t > 0:
                step = stamp_s - stamps_s[t - 1] if self.decay_unit == "second" else 1.0
                belief = np.where(looked_before, belief * math.exp(-self.decay * step), belief)
            pooled = self.pooled(m[t], visible[t])
            whole = (self.initial == "first") & ~looked_before
            blended = np.where(whole, pooled, self.alpha * pooled + (1.0 - self.alpha) * belief)
            seen = visible[t].any(axis=0)
            belief = np.where(seen, blended, belief)
            looked_before |= seen
            history[t] = belief
        return history

    def faded(self, belief: Array, seen: NDArray[np.bool_], later_s: float) -> Array:
        """P~ [V] at a stamp after the last instant; `seen` = anybody looked before."""
        if self.decay_unit == "frame":
            return belief
        return np.where(seen, belief * math.exp(-self.decay * later_s), belief)


FLEET = ("north", "east", "south", "west")
INSTANTS = 30
FLOOR = (9, 7)
IMAGE = (4, 3)  # voxels wide and high: one pixel a voxel


def _random_flight(
    rng: np.random.Generator,
) -> tuple[NDArray[np.int64], Array, NDArray[np.bool_], NDArray[np.int64]]:
    """Stamps [T], m and visible [T, N, X, Y], and where each drone's image begins [T, N, 2]."""
    gaps_ns = rng.choice([40_000_000, 333_333_333, 1_700_000_001, 95 * SECOND_NS], INSTANTS)
    stamps_ns = 1_700_000_000 * SECOND_NS + np.cumsum(gaps_ns)
    # Values that float32 holds exactly, certainty and complete doubt among them.
    m = rng.integers(0, 17, (INSTANTS, len(FLEET), *FLOOR)) / 16.0
    corner = rng.integers(0, (FLOOR[0] - IMAGE[0] + 1, FLOOR[1] - IMAGE[1] + 1), (INSTANTS, len(FLEET), 2))
    flying = rng.random((INSTANTS, len(FLEET))) < 0.6
    flying[7] = flying[8] = False  # two instants without any drone
    visible = np.zeros_like(m, bool)
    for t, drone in zip(*np.nonzero(flying), strict=True):
        x, y = corner[t, drone]
        visible[t, drone, x : x + IMAGE[0], y : y + IMAGE[1]] = True
    return stamps_ns, m, visible, corner


def _view(drone: str, stamp_ns: int, m: Array, corner: NDArray[np.int64]) -> View:
    """Looks straight down on IMAGE voxels from `corner`, image top to the north; m [X, Y] of the floor."""
    width, height = IMAGE
    camera = Camera.pinhole(width, height, 20.0, 20.0, width / 2, height / 2)
    x, y = corner.tolist()
    world_from_camera = DOWN.copy()
    # 20 m above the top of the floor, f = 20 px: a voxel of 1 m is a pixel.
    world_from_camera[:3, 3] = (x + width / 2, y + height / 2, 21.0)
    heatmap = m[x : x + width, y : y + height].T[::-1]
    return View(drone, stamp_ns, camera, world_from_camera, heatmap)


@pytest.mark.parametrize(
    ("unseen", "normalise", "initial", "decay_unit"),
    list(product(("fleet", "visible"), (False, True), ("zero", "prior", "first"), ("second", "frame"))),
)
def test_crowd_map_agrees_with_a_dense_evaluation(
    unseen: Literal["fleet", "visible"],
    normalise: bool,
    initial: Literal["zero", "prior", "first"],
    decay_unit: Literal["second", "frame"],
) -> None:
    seed = ("fleet", "visible").index(unseen) + 10 * ("zero", "prior", "first").index(initial)
    rng = np.random.default_rng([seed, normalise, decay_unit == "frame"])
    stamps_ns, m, visible, corner = _random_flight(rng)
    dense = DensePaper(
        rates=Rates(rng.uniform(0.3, 0.99), rng.uniform(0.001, 0.3)),
        prior=rng.uniform(0.01, 0.6),
        alpha=rng.uniform(0.05, 1.0),
        decay=rng.uniform(0.0, 0.1),
        unseen=unseen,
        normalise=normalise,
        initial=initial,
        decay_unit=decay_unit,
        b_threshold=float(rng.choice([0.25, 0.5, 0.75])),
    )
    terrain = Terrain.from_occupancy(np.ones((*FLOOR, 1), bool), 1.0)
    method = Paper(
        dense.rates,
        dense.prior,
        alpha=dense.alpha,
        decay=dense.decay,
        fleet_size=len(FLEET),
        b_threshold=dense.b_threshold,
        unseen=unseen,
        normalise=normalise,
        initial=initial,
        decay_unit=decay_unit,
    )
    crowd_map = CrowdMap(terrain, method)
    column, row, _ = terrain.voxel_indices(np.arange(terrain.voxel_count)).T
    in_id_order = np.ravel_multi_index((column, row), FLOOR)

    stamps_s = (stamps_ns - stamps_ns[0]) / 1e9
    flat = (INSTANTS, len(FLEET), -1)
    expected = dense.run(stamps_s.tolist(), m.reshape(flat), visible.reshape(flat))[:, in_id_order]
    seen_by = visible.reshape(flat)[:, :, in_id_order]
    for t, stamp_ns in enumerate(stamps_ns.tolist()):
        flying = [n for n in range(len(FLEET)) if visible[t, n].any()]
        update = crowd_map.integrate(
            [_view(FLEET[n], stamp_ns, m[t, n], corner[t, n]) for n in flying], stamp_ns
        )
        np.testing.assert_array_equal(update.voxel_ids, np.flatnonzero(seen_by[t].any(axis=0)))
        np.testing.assert_allclose(crowd_map.probability(stamp_ns), expected[t], rtol=0, atol=1e-9)
        np.testing.assert_allclose(update.probability, expected[t][update.voxel_ids], rtol=0, atol=1e-9)

    seen = np.asarray(seen_by.any(axis=(0, 1)))
    np.testing.assert_array_equal(crowd_map.seen(), seen)
    for later_s in (0.25, 12.0, 3600.0, 0.25):  # reading changes nothing
        later = crowd_map.probability(int(stamps_ns[-1]) + round(later_s * 1e9))
        np.testing.assert_allclose(later, dense.faded(expected[-1], seen, later_s), rtol=0, atol=1e-9)


@pytest.mark.parametrize("unseen", ["fleet", "visible"])
@pytest.mark.parametrize("normalise", [False, True])
def test_pool_agrees_with_a_dense_evaluation(unseen: Literal["fleet", "visible"], normalise: bool) -> None:
    rng = np.random.default_rng(11)
    m = rng.random((5, 400))
    visible = rng.random(m.shape) < 0.4
    rates = Rates(0.66, 0.024)
    dense = DensePaper(rates, 0.2, 1.0, 0.0, unseen, normalise, "zero", "second", 0.5)
    probability, seen = pool(m, visible, rates, 0.2, unseen=unseen, normalise=normalise)
    np.testing.assert_array_equal(seen, visible.any(axis=0))
    np.testing.assert_allclose(probability[seen], dense.pooled(m, visible)[seen], rtol=0, atol=1e-12)


# --- bounds


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Rates(0.0, 0.1), "true_positive is 0; it must be strictly between 0 and 1"),
        (lambda: Rates(1.0, 0.1), "true_positive is 1; it must be strictly between 0 and 1"),
        (lambda: Rates(0.9, 0.0), "false_positive is 0; it must be strictly between 0 and 1"),
        (lambda: Rates(0.9, 1.0), "false_positive is 1; it must be strictly between 0 and 1"),
        (lambda: Rates(0.9, math.nan), "false_positive is NaN; it must be strictly between 0 and 1"),
        (lambda: _pool_one(prior=0.0), "prior is 0; it must be strictly between 0 and 1"),
        (lambda: _pool_one(prior=1.0), "prior is 1; it must be strictly between 0 and 1"),
        (lambda: _pool_one(b_threshold=1.5), "b_threshold is 1.5; it must be in [0, 1)"),
        (lambda: _pool_one(unseen="all"), 'unseen is "all"; it must be "fleet" or "visible"'),
        (lambda: _pool_one(m=math.nan), "m is NaN; it must be inside [0, 1]"),
        (lambda: _pool_one(m=1.01), "m is 1.01; it must be inside [0, 1]"),
        (lambda: pool([0.5], [True], Rates(0.9, 0.1), 0.2), "m has shape [1]; it must be [N, N]"),
        (lambda: pool([[0.5]], [[1.0]], Rates(0.9, 0.1), 0.2), "visible has elements of type float64"),
        (
            lambda: pool([[0.5, 0.5]], [[True]], Rates(0.9, 0.1), 0.2),
            "visible has shape [1, 1]; it must be [1, 2]",
        ),
        (lambda: _blend_one(alpha=0.0), "alpha is 0; it must be in (0, 1]"),
        (lambda: _blend_one(alpha=1.01), "alpha is 1.01; it must be in (0, 1]"),
        (lambda: _blend_one(decay_per_s=-0.1), "decay is -0.1; it must be finite and >= 0"),
        (lambda: _blend_one(decay_per_s=math.inf), "decay is inf; it must be finite and >= 0"),
        (lambda: _blend_one(elapsed_s=-1.0), "elapsed_s is -1; it must be finite and >= 0"),
        (lambda: _blend_one(elapsed_s=math.inf), "elapsed_s is inf; it must be finite and >= 0"),
        (lambda: _blend_one(previous=1.5), "previous is 1.5; it must be inside [0, 1]"),
        (lambda: _blend_one(pooled=math.nan), "pooled is NaN; it must be inside [0, 1]"),
        (
            lambda: blend([0.1, 0.2], [1.0], [0.1, 0.2], [True, True], alpha=0.5, decay_per_s=0.0),
            "elapsed_s has shape [1]; it must be [2]",
        ),
    ],
)
def test_bounds_are_named(call: Any, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        call()


def _pool_one(*, m: float = 0.5, prior: float = 0.2, **switches: Any) -> None:
    pool([[m]], [[True]], Rates(0.9, 0.1), prior, **switches)


def _blend_one(
    *,
    previous: float = 0.5,
    elapsed_s: float = 1.0,
    pooled: float = 0.5,
    alpha: float = 0.5,
    decay_per_s: float = 0.1,
) -> None:
    blend([previous], [elapsed_s], [pooled], [True], alpha=alpha, decay_per_s=decay_per_s)
