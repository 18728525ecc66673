"""Sets of columns as sorted keys, by sorting.

`np.unique`, `np.union1d` and `np.isin` put numbers into a hash table, in which keys of the columns of a large
map (i << 32 plus j) collide: seconds for what takes milliseconds here, where two sorted runs are merged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def distinct(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Each of the keys [N] once, sorted."""
    ordered = np.sort(keys, axis=None, kind="stable")
    return ordered[np.append(True, ordered[1:] != ordered[:-1])] if len(ordered) else ordered


def united(first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.int64]:
    """Every key of either, once, sorted. Both are sorted and distinct, [N] and [M]."""
    if not len(first) or not len(second):
        return first if len(first) else second
    return distinct(np.concatenate([first, second]))


def are_among(keys: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each of the keys (any shape) is one of others [M], which need not be sorted."""
    if not len(others):
        return np.zeros(np.shape(keys), dtype=np.bool_)
    ordered = np.sort(others, kind="stable")
    at = np.searchsorted(ordered, keys).clip(max=len(ordered) - 1)
    return np.asarray(ordered[at] == keys)
