"""Shares forced to increase where they are known to, although counting noise hides it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def pool_adjacent_violators(
    numerator: ArrayLike, denominator: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Merge neighbouring bins until numerator / denominator increases from bin to bin.

    Both [K], not negative, and no bin zero in both. Returns both arrays with every bin replaced by the mean
    of its merged block: their ratio is the isotonic least-squares fit of numerator / (numerator +
    denominator) with weights numerator + denominator, and the maximum-likelihood estimate of a monotone
    likelihood ratio when they count two classes (pool-adjacent-violators: Ayer et al., 1955; Dykstra,
    Kochar and Robertson, 1995). ValueError for other input.
    """
    up, down = np.asarray(numerator, np.float64), np.asarray(denominator, np.float64)
    if up.ndim != 1 or up.shape != down.shape:
        raise ValueError(f"numerator and denominator must be [K], got {list(up.shape)}, {list(down.shape)}")
    if not ((up >= 0.0) & (down >= 0.0) & (up + down > 0.0)).all():
        raise ValueError("numerator and denominator must not be negative, nor both zero in one bin")
    blocks: list[tuple[float, float, int]] = []
    for block in zip(up.tolist(), down.tolist(), [1] * len(up), strict=True):
        # Ratios are compared crosswise, so that a denominator of zero is simply the largest.
        while blocks and blocks[-1][0] * block[1] >= block[0] * blocks[-1][1]:
            above, below, bins = blocks.pop()
            block = (above + block[0], below + block[1], bins + block[2])
        blocks.append(block)
    bins_of = np.array([bins for *_, bins in blocks], np.int64)
    means = np.array([(above / bins, below / bins) for above, below, bins in blocks]).reshape(-1, 2)
    pooled = np.repeat(means, bins_of, axis=0)
    return pooled[:, 0], pooled[:, 1]
