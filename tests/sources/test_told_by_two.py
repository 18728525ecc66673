"""Two that tell one track by turns: what is told of it, and of what else jumps."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from crowdfence.sources.pose_track import track_from_rows
from crowdfence.sources.told_by_two import told_by_two

COUNT = 100
STAMPS = 10**18 + np.arange(COUNT) * 20_000_000
ALONG = np.column_stack([np.arange(COUNT) * 0.2, np.zeros(COUNT), np.full(COUNT, 30.0)])  # 10 m/s
STILL = np.tile([1.0, 0.0, 0.0, 0.0], (COUNT, 1))


def turned(heading_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    return Rotation.from_euler("z", heading_deg[:, None], degrees=True).as_quat()[:, [3, 0, 1, 2]]


@pytest.mark.parametrize("every", [2, 5])
def test_two_that_tell_where_a_drone_is(every: int) -> None:
    """The other one tells half of the rows, or a fifth, 6 m beside."""
    other = np.arange(COUNT) % every == 0
    positions = ALONG + np.outer(other, [0.0, 6.0, 0.0])
    assert told_by_two(STAMPS, positions, STILL) == "6 m"
    track, remarks = track_from_rows(STAMPS.tolist(), positions, STILL)
    assert len(track) == COUNT
    assert [one.partition(":")[0] for one in remarks] == ["pose rows are 6 m away and back, again and again"]


def test_two_that_tell_how_a_gimbal_stands() -> None:
    """Its driver, and joints that nobody set: 40 degrees apart, while it follows a slow turn."""
    heading_deg = np.where(np.arange(COUNT) % 2 == 0, 0.0, 40.0 + 0.02 * np.arange(COUNT))
    found = told_by_two(STAMPS, np.zeros((COUNT, 3)), turned(heading_deg))
    assert found is not None and found.endswith(" degrees") and 40 <= float(found.split()[0]) <= 42


def test_what_else_jumps_is_not_told_by_two() -> None:
    random = np.random.default_rng(0)
    swing = np.where(np.arange(COUNT) % 2 == 0, -30.0, 30.0)
    # A gimbal that swings from picture to picture, one a second.
    assert told_by_two(STAMPS * 50, ALONG, turned(swing)) is None
    assert told_by_two(STAMPS, ALONG, turned(np.arange(COUNT) * 7.0)) is None  # 350 degrees a second
    once = ALONG.copy()
    once[[20, 50, 70], 1] += 50.0
    assert told_by_two(STAMPS, once, STILL) is None
    for size_m in (1.0, 5.0):  # errors that each row has by itself, in height alone, too
        noise = random.normal(0.0, size_m, (COUNT, 3))
        assert told_by_two(STAMPS, ALONG + noise, STILL) is None
        assert told_by_two(STAMPS, ALONG + noise * [0.0, 0.0, 1.0], STILL) is None
    assert told_by_two(STAMPS[:0], ALONG[:0], STILL[:0]) is None
