"""Cells made of blocks of values."""

import numpy as np
import pytest

from crowdfence.block_means import block_means


def test_every_cell_is_the_mean_of_its_block():
    values = np.array([[0, 2, 9, 9], [4, 6, 9, 9]], np.uint8)
    means = block_means(values, 2)
    assert means.dtype == np.float32
    np.testing.assert_array_equal(means, [[3.0, 9.0]])  # (0 + 2 + 4 + 6) / 4


def test_axes_before_the_last_two_are_kept_apart():
    many = np.stack([np.zeros((4, 6), np.bool_), np.ones((4, 6), np.bool_)])[:, None]
    np.testing.assert_array_equal(block_means(many, 2)[:, 0, 1, 2], [0.0, 1.0])
    assert block_means(many, 2).shape == (2, 1, 2, 3)


def test_sums_of_many_bytes_do_not_overflow():
    assert block_means(np.full((64, 64), 255, np.uint8), 64) == 255.0


@pytest.mark.parametrize("shape", [(4, 6), (6, 4)])
def test_broken_cells_are_refused(shape):
    with pytest.raises(ValueError, match=rf"{shape[1]}x{shape[0]} values has no whole cells of 4x4"):
        block_means(np.zeros(shape), 4)
