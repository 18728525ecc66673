"""Crowds and their ground from the positions of people."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.truth.crowd_ground import CrowdGround, crowds_of
from crowdfence.truth.world import stand_beside, truth_from_positions

# Flat ground of 1 m voxels whose top lies at z = 1, and a deck above it whose top lies at z = 11.
TWO_LEVELS = np.zeros((20, 20, 11), np.bool_)
TWO_LEVELS[:, :, [0, 10]] = True
TERRAIN = Terrain.from_occupancy(TWO_LEVELS, 1.0)


def at(*places: tuple[float, float], z: float = 1.0) -> NDArray[np.float64]:
    return np.array([[x, y, z] for x, y in places])


def crowd_voxels(positions: NDArray[np.float64], **options: object) -> set[tuple[int, ...]]:
    """With half a metre around each person, which keeps rows of people inside rows of voxels."""
    options = {"person_radius_m": 0.5} | options
    truth = truth_from_positions(positions, TERRAIN, 2.0, 3, **options)  # type: ignore[arg-type]
    return {tuple(index) for index in TERRAIN.voxel_indices(np.flatnonzero(truth))}


def test_core_border_and_bystander() -> None:
    """A cross with arms of 1.4 m: only the middle person has five within 1.5 m, the arms belong to its crowd.
    The bystander is near one arm, which is no core, and far from the middle."""
    cross = at((0, 0), (1.4, 0), (-1.4, 0), (0, 1.4), (0, -1.4), (2.8, 0))
    np.testing.assert_array_equal(crowds_of(cross, 1.5, 5), [0, 0, 0, 0, 0, -1])


def test_height_does_not_separate_a_crowd() -> None:
    stairs = np.array([[0, 0, 0], [1, 0, 3], [2, 0, 6]], np.float64)
    np.testing.assert_array_equal(crowds_of(stairs, 1.5, 3), [0, 0, 0])


@given(st.integers(0, 2**32 - 1), st.integers(0, 40), st.integers(1, 6))
@settings(max_examples=60)
def test_crowds_against_the_definition(seed: int, people: int, min_people: int) -> None:
    positions = np.random.default_rng(seed).uniform(0, 10, (people, 3))
    found = crowds_of(positions, 1.5, min_people)
    distance = np.hypot(*(positions[:, None, :2] - positions[None, :, :2]).transpose(2, 0, 1))
    near = distance <= 1.5
    core = near.sum(axis=1) >= min_people
    linked = np.linalg.matrix_power((near & core & core[:, None]).astype(float), max(people, 1)) > 0
    for one in range(people):
        assert (found[one] >= 0) == bool((near[one] & core).any())
        if core[one]:
            np.testing.assert_array_equal(found[core] == found[one], linked[one][core])
        elif found[one] >= 0:
            nearest = np.flatnonzero(core)[distance[one][core].argmin()]
            assert found[one] == found[nearest]


def test_the_ground_between_people_belongs_to_the_crowd() -> None:
    """Three people 2 m apart. At the middle between two, a disc of 2 m that keeps 0.5 m from both would need
    its centre more than sqrt(2.5^2 - 1) = 2.29 m away: closed. One metre beside the row it fits: open."""
    assert crowd_voxels(at((5.5, 5.5), (7.5, 5.5), (9.5, 5.5))) == {(i, 5, 0) for i in range(5, 10)}


def test_the_outline_of_the_ground() -> None:
    """A disc of 2 m that touches the discs of 1 m around two people 2 m apart has its centre
    sqrt(3^2 - 1^2) = 2.828 m beside the middle between them: the gap is closed up to 0.828 m away."""
    row = CrowdGround(at((5.5, 5.5), (7.5, 5.5), (9.5, 5.5)), 2.0, 1.0, 0.0625)
    inside = np.array([[6.5, 6.26], [6.5, 4.74], [8.5, 6.26], [5.5, 6.44], [10.44, 5.5], [4.56, 5.5]])
    outside = np.array([[6.5, 6.40], [6.5, 4.60], [8.5, 6.40], [5.5, 6.56], [10.56, 5.5], [4.44, 5.5]])
    assert row.contains(inside).all() and not row.contains(outside).any()
    assert not row.contains(np.array([[-1e6, 5.5], [6.5, 1e6]])).any()


def test_the_ground_rises_with_the_feet() -> None:
    """Between two people the height is the mean of theirs; at one of them, 2 m from the other, the weights
    are 1 / 0.05 and 1 / 4.05."""
    pair = CrowdGround(np.array([[0.0, 0.0, 10.0], [2.0, 0.0, 11.0]]), 2.0, 1.0, 0.125)
    at_first = (10.0 / 0.05 + 11.0 / 4.05) / (1.0 / 0.05 + 1.0 / 4.05)
    np.testing.assert_allclose(pair.height_m(np.array([[1.0, 0.0], [0.0, 0.0]])), [10.5, at_first])
    np.testing.assert_array_equal(pair.nearest_feet_m(np.array([[0.9, 5.0], [1.1, 5.0]])), [10.0, 11.0])
    np.testing.assert_allclose(pair.distance_m(np.array([[0.0, 3.0], [2.0, -4.0]])), [3.0, 4.0])


def test_a_crowd_on_the_deck_leaves_the_ground_below_alone() -> None:
    upstairs = crowd_voxels(at((5.5, 5.5), (7.5, 5.5), (9.5, 5.5), z=11.0))
    assert upstairs == {(i, 5, 10) for i in range(5, 10)}


def test_two_people_are_no_crowd() -> None:
    assert crowd_voxels(at((5.5, 5.5), (6.5, 5.5), (15.5, 5.5))) == set()
    assert crowd_voxels(np.zeros((0, 3))) == set()


def test_crowds_are_closed_one_by_one() -> None:
    """Two pairs of triples 3 m apart: further than the radius, so the ground between them stays open."""
    triple = [(5.2, 5.2), (5.5, 5.5), (5.8, 5.8)]
    both = at(*triple, *((x + 3.0, y) for x, y in triple))
    assert crowd_voxels(both) == {(5, 5, 0), (8, 5, 0)}


def test_people_in_coarse_columns_are_never_lost() -> None:
    """In the corner of a 10 m voxel, far from its centre."""
    coarse = Terrain.from_occupancy(np.ones((2, 2, 1), np.bool_), 10.0)
    truth = truth_from_positions(at((0.5, 0.5), (1.0, 0.5), (0.5, 1.0), z=10.0), coarse, 2.0, 3)
    assert coarse.voxel_indices(np.flatnonzero(truth)).tolist() == [[0, 0, 0]]


def test_people_off_the_terrain() -> None:
    below = at((5.5, 5.5), (6.5, 5.5), (7.5, 5.5), z=-50.0)
    with pytest.raises(
        ValueError, match=r"3 of 3 people .* \(5\.50, 5\.50, -50\.00\) m: check frame .* take a map"
    ):
        crowd_voxels(below)
    assert crowd_voxels(below, off_terrain="ignore") == set()
    outside = at((-5.5, 5.5), (-6.5, 5.5), (-7.5, 5.5))
    assert crowd_voxels(outside, off_terrain="ignore") == set()
    assert crowd_voxels(outside, off_terrain="beside") == set()
    with pytest.raises(ValueError, match="3 of 3 people"):
        crowd_voxels(below, off_terrain="beside")
    at_the_rim = at((0.5, 5.5), (1.5, 5.5), (-0.5, 5.5))
    assert stand_beside(at_the_rim, TERRAIN).tolist() == [False, False, True]
    assert not stand_beside(below, TERRAIN).any()
    on_the_map = {(0, 5, 0), (1, 5, 0)}
    assert crowd_voxels(at_the_rim, off_terrain="beside") == on_the_map


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"positions_enu": np.zeros((3, 2))}, r"positions must be finite metres \[N, 3\]"),
        ({"positions_enu": np.full((3, 3), np.nan)}, "positions must be finite"),
        ({"radius_m": 0.0}, "radius_m must be positive and finite, got 0"),
        ({"min_people": 0}, "min_people must be at least 1, got 0"),
        ({"person_radius_m": -1.0}, "person_radius_m must be positive"),
        ({"off_terrain": "drop"}, 'off_terrain must be "refuse", "beside" or "ignore"'),
    ],
)
def test_bad_input(change: dict[str, object], message: str) -> None:
    arguments = {"positions_enu": at((5.5, 5.5)), "terrain": TERRAIN} | change
    with pytest.raises(ValueError, match=message):
        truth_from_positions(**arguments)  # type: ignore[arg-type]


def test_positions_in_degrees_or_kilometres_are_no_crowd() -> None:
    """A crowd of 400, sparse or as dense as one that crushes, is one; in degrees it stood on one voxel."""
    square = np.stack([*np.meshgrid(np.arange(20.0), np.arange(20.0)), np.zeros((20, 20))], axis=-1)
    people = square.reshape(-1, 3)
    for spacing_m in (0.25, 1.0):
        assert (crowds_of(people * spacing_m, 2.0, 3) == 0).all()
    for other in (people / 1000.0, np.array([46.5, 8.0, 0.0]) + people / 111_000.0):
        with pytest.raises(ValueError, match="400 people have 400 others within 2.0 m on average; check"):
            crowds_of(other, 2.0, 3)


def test_positions_in_the_wrong_unit_are_refused_before_memory_runs_out() -> None:
    crowded = np.zeros((8000, 3))
    with pytest.raises(ValueError, match="8000 people have 8000 others within 2"):
        crowds_of(crowded, 2.0, 3)
    chain = np.stack([np.arange(0, 40_000, 1.0)] * 2 + [np.zeros(40_000)], axis=1)
    with pytest.raises(ValueError, match="one crowd spans"):
        truth_from_positions(chain, TERRAIN, 2.0, 3, off_terrain="ignore")
