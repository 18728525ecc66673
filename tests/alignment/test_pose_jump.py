"""Steps in what the poses of a drone are off: found where they are, and not where none is."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from crowdfence.alignment.offset_fit import JITTER
from crowdfence.alignment.pose_jump import LEAST, find_jump

PICTURES = 24
STAMPS_NS = 1_760_000_000_000_000_000 + np.arange(PICTURES) * 1_000_000_000
PITCH, YAW, EAST = 0, 1, 3


def noise(seed: int, scale: float = 1.0) -> NDArray[np.float64]:
    """[PICTURES, 6], `scale` times what is expected of poses."""
    return np.random.default_rng(seed).normal(size=(PICTURES, 6)) * JITTER * scale


def step(quantity: int, size: float, first: int) -> NDArray[np.float64]:
    """Around 0 on the mean, as an offset in the middle leaves it."""
    off = np.zeros((PICTURES, 6))
    off[first:, quantity] = size
    return off - off.mean(axis=0)


@pytest.mark.parametrize("scale", [0.0, 1.0, 4.0])
def test_noise_is_no_jump(scale: float) -> None:
    assert [seed for seed in range(300) if find_jump(STAMPS_NS, noise(seed, scale))] == []


def test_a_jump_is_found_between_its_pictures() -> None:
    """1.2 degrees are eight standard deviations of a pose: of 300 flights the place is one picture off in a
    few, no further in any."""
    exact = 0
    for seed in range(300):
        first = 3 + seed % (PICTURES - 6)
        found = find_jump(STAMPS_NS, noise(seed) + step(YAW, 1.2, first))
        assert found is not None and "yaw" in found.by and abs(found.by["yaw"] - 1.2) < 0.4
        k = round((found.after_ns - STAMPS_NS[0]) / 1e9)
        assert abs(k - first) <= 1 and found.after_ns - found.before_ns == 1_000_000_000
        exact += k == first
    assert exact > 285


def test_order_is_that_of_the_stamps() -> None:
    off = noise(1) + step(EAST, -2.0, 10)
    mixed = np.random.default_rng(2).permutation(PICTURES)
    assert find_jump(STAMPS_NS[mixed], off[mixed]) == find_jump(STAMPS_NS, off)


@pytest.mark.parametrize("quantity", [PITCH, EAST])
def test_what_is_small_is_no_matter(quantity: int) -> None:
    """However sure it is."""
    assert find_jump(STAMPS_NS, step(quantity, 0.99 * LEAST[quantity], 12)) is None
    assert find_jump(STAMPS_NS, step(quantity, 1.2 * LEAST[quantity], 12)) is not None


def test_a_drift_is_no_jump() -> None:
    """From -1 to 1 degree and metre in the course of the flight."""
    drift = np.linspace(-1.0, 1.0, PICTURES)[:, None] * np.ones(6)
    assert [seed for seed in range(300) if find_jump(STAMPS_NS, noise(seed) + drift)] == []


def test_single_pictures_are_no_jump() -> None:
    """One picture 5 degrees off, anywhere."""
    for at in range(PICTURES):
        off = noise(at)
        off[at, YAW] += 5.0
        assert find_jump(STAMPS_NS, off) is None


@pytest.mark.parametrize("pictures", [0, 1, 5])
def test_few_pictures_have_none(pictures: int) -> None:
    off = step(YAW, 5.0, 3)[:pictures]
    assert find_jump(STAMPS_NS[:pictures], off) is None
